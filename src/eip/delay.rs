//! Stability of a loop with an exact delay: what an approximation of the delay
//! as states cannot decide near the limit.
//!
//! The zeros of the characteristic function in the right half-plane are counted
//! by its winding along the imaginary axis:
//!
//! ```text
//! D(s) = det(s I - A - e^{-s tau} A_d) / (s + gamma)^n,   D(j inf) = 1
//! change of arg D(jw) over 0 <= w < inf  =  -pi (number of zeros with Re s > 0)
//! ```
//!
//! Frequencies are `w = gamma s / (1 - s)`, shared by all plants, with plants in
//! lanes; where the argument turns by more than a sixth of a circle between two of
//! them, more are put between.
//!
//! # Source
//! Mikhailov (1938); for delays see Gu, Kharitonov, Chen (2003), section 1.3.

use crate::model::LoopBlock;
use crate::real::Real;
use crate::simd::{self, Block, Kernel, LANES};
use crate::small::{Cx, Dyn, cx_det};

/// Frequencies over the whole axis.
const NODES: usize = 48;
/// Turns of `e^{-jw tau}` (in radians) that are followed one by one.
const RADIANS: usize = 24;
/// Bisections of one interval at most: a zero nearer to the axis is on it.
const DEPTH: u32 = 40;
/// A count other than zero is repeated with this many times the frequencies.
const DENSER: usize = 8;
/// Steps of Newton's method.
const STEPS: usize = 30;

/// Zeros in the right half-plane, for one delay.
pub(crate) struct Winding {
    tau: f64,
    gamma: f64,
    /// Increasing, in [0, 1).
    nodes: Vec<f64>,
}

/// `A` and `A_d` of plants of one order, eight to a lane block.
pub(crate) struct DelayedBatch {
    n: usize,
    len: usize,
    data: Vec<Block>,
}

impl DelayedBatch {
    pub(crate) fn new() -> Self {
        Self { n: 0, len: 0, data: Vec::new() }
    }

    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds a block; all have one order. The first of a group fills its lanes.
    pub(crate) fn push(&mut self, block: &LoopBlock) {
        if self.len == 0 {
            self.n = block.np();
        }
        let size = self.size();
        let (group, lane) = (self.len / LANES, self.len % LANES);
        if self.data.len() < (group + 1) * size {
            self.data.resize((group + 1) * size, Block::default());
        }
        let slots = &mut self.data[group * size..(group + 1) * size];
        for i in 0..self.n {
            for j in 0..self.n {
                let delayed = block.delayed.as_ref().map_or(0.0, |d| d.A[(i, j)]);
                for (half, value) in [block.A[(i, j)], delayed].into_iter().enumerate() {
                    let slot = &mut slots[(half * self.n + i) * self.n + j];
                    if lane == 0 {
                        slot.0 = [value; LANES];
                    } else {
                        slot.0[lane] = value;
                    }
                }
            }
        }
        self.len += 1;
    }

    fn size(&self) -> usize {
        2 * self.n * self.n
    }

    /// `A` and `A_d` of plant `k`.
    fn plant(&self, k: usize) -> Vec<f64> {
        let size = self.size();
        let blocks = &self.data[k / LANES * size..][..size];
        blocks.iter().map(|b| b.0[k % LANES]).collect()
    }
}

impl Winding {
    /// For a delay of `tau` seconds and loops whose rates are about `gamma`.
    pub(crate) fn new(tau: f64, gamma: f64) -> Self {
        let at = |w: f64| w / (gamma + w);
        let mut nodes: Vec<f64> = (0..NODES).map(|k| k as f64 / NODES as f64).collect();
        nodes.extend((1..=RADIANS).map(|k| at(k as f64 / tau)));
        nodes.sort_by(f64::total_cmp);
        Self { tau, gamma, nodes }
    }

    /// Number of unstable zeros of each plant; `None` where there is one on the
    /// axis, or where feedback is strong at frequencies that turn many times in
    /// the delay.
    pub(crate) fn counts(&self, batch: &DelayedBatch) -> Vec<Option<usize>> {
        let width = self.nodes.len() + 2;
        let mut values = vec![(0.0, 0.0); batch.len * width];
        simd::dispatch(Values { winding: self, batch, out: &mut values });
        let rows = values.chunks_exact(width).enumerate();
        rows.map(|(k, row)| {
            let (plus, minus) = (row[width - 2], row[width - 1]);
            if !weak(plus, minus) {
                return None;
            }
            self.count(&row[..width - 2], &self.nodes, || batch.plant(k))
        })
        .collect()
    }

    /// The count of plant `k` with more frequencies: two zeros between neighbours
    /// could be taken for others.
    pub(crate) fn count_again(&self, batch: &DelayedBatch, k: usize) -> Option<usize> {
        let plant = batch.plant(k);
        let mut nodes = Vec::with_capacity(DENSER * self.nodes.len());
        for (k, &from) in self.nodes.iter().enumerate() {
            let to = self.nodes.get(k + 1).copied().unwrap_or(1.0);
            nodes.extend((0..DENSER).map(|i| from + (to - from) * i as f64 / DENSER as f64));
        }
        let values: Vec<(f64, f64)> = nodes.iter().map(|&s| self.value(&plant, s)).collect();
        self.count(&values, &nodes, || plant.clone())
    }

    /// Where the feedback is judged: the last of the followed turns of the delay.
    fn last(&self) -> f64 {
        RADIANS as f64 / self.tau
    }

    /// `D` at one node, one plant.
    fn value(&self, plant: &[f64], node: f64) -> (f64, f64) {
        let n = order(plant);
        let w = self.gamma * node / (1.0 - node);
        let d = characteristic(n, plant, Cx::new(0.0, w), self.shift(w), self.gamma, &mut vec![]);
        (d.re, d.im)
    }

    /// `e^{-jw tau}`.
    fn shift(&self, w: f64) -> Cx<f64> {
        Cx::new(libm::cos(w * self.tau), -libm::sin(w * self.tau))
    }

    /// Winding from the values at `nodes`.
    fn count(
        &self,
        values: &[(f64, f64)],
        nodes: &[f64],
        plant: impl Fn() -> Vec<f64>,
    ) -> Option<usize> {
        let mut made: Option<Vec<f64>> = None;
        let mut turn = 0.0;
        for (k, &from) in values.iter().enumerate() {
            let to = values.get(k + 1).copied().unwrap_or((1.0, 0.0));
            turn += match small_turn(from, to) {
                Some(turn) => turn,
                None => {
                    let plant = made.get_or_insert_with(&plant);
                    let ends = (nodes[k], nodes.get(k + 1).copied().unwrap_or(1.0));
                    self.bisect(plant, ends, (from, to), DEPTH)?
                }
            };
        }
        let zeros = (-turn / std::f64::consts::PI).round();
        // rounding cannot make it negative: then something was missed
        (zeros >= 0.0).then_some(zeros as usize)
    }

    /// Change of the argument between two nodes.
    fn bisect(
        &self,
        plant: &[f64],
        ends: (f64, f64),
        values: ((f64, f64), (f64, f64)),
        depth: u32,
    ) -> Option<f64> {
        if depth == 0 {
            return None;
        }
        let middle = 0.5 * (ends.0 + ends.1);
        let value = self.value(plant, middle);
        let half = |ends: (f64, f64), from, to| match small_turn(from, to) {
            Some(turn) => Some(turn),
            None => self.bisect(plant, ends, (from, to), depth - 1),
        };
        let left = half((ends.0, middle), values.0, value)?;
        Some(left + half((middle, ends.1), value, values.1)?)
    }

    /// The zero of `D` near `start`, by Newton's method; `None` if it is not
    /// found.
    pub(crate) fn zero_near(
        &self,
        batch: &DelayedBatch,
        k: usize,
        start: Cx<f64>,
    ) -> Option<Cx<f64>> {
        let plant = batch.plant(k);
        let mut work = vec![];
        let mut value = |s: Cx<f64>| {
            let size = libm::exp(-s.re * self.tau);
            let angle = s.im * self.tau;
            let shift = Cx::new(size * libm::cos(angle), -size * libm::sin(angle));
            characteristic(order(&plant), &plant, s, shift, self.gamma, &mut work)
        };
        let mut s = start;
        for _ in 0..STEPS {
            let size = s.re.hypot(s.im).max(self.gamma);
            let h = 1e-5 * size;
            let slope = (value(s + Cx::real(h)) - value(s - Cx::real(h))).scale(0.5 / h);
            let step = value(s) / slope;
            let length = step.re.hypot(step.im);
            if !length.is_finite() {
                return None;
            }
            // not further than half the distance to the origin at once
            s = s - step.scale((0.5 * size / length).min(1.0));
            if length <= 1e-12 * size {
                return Some(s);
            }
        }
        None
    }
}

/// True if the delayed feedback hardly acts, from `D(e)` and `D(-e)`.
///
/// ```text
/// |D(e) - D(-e)| < |D(e) + D(-e)| / 2,   e = e^{-jw tau}
/// ```
fn weak(plus: (f64, f64), minus: (f64, f64)) -> bool {
    let square = |re: f64, im: f64| re * re + im * im;
    square(plus.0 - minus.0, plus.1 - minus.1) < 0.25 * square(plus.0 + minus.0, plus.1 + minus.1)
}

/// The change of argument from one value to the next if it is less than a sixth
/// of a circle.
fn small_turn(from: (f64, f64), to: (f64, f64)) -> Option<f64> {
    let re = from.0 * to.0 + from.1 * to.1;
    let im = from.0 * to.1 - from.1 * to.0;
    let size = (from.0 * from.0 + from.1 * from.1) * (to.0 * to.0 + to.1 * to.1);
    (re > 0.0 && 4.0 * re * re > size).then(|| libm::atan2(im, re))
}

fn order(plant: &[f64]) -> usize {
    (plant.len() / 2).isqrt()
}

/// `det((s I - A - shift A_d) / (s + gamma))`; `plant` holds `A` and `A_d`.
#[inline(always)]
fn characteristic<T: Real>(
    n: usize,
    plant: &[T],
    s: Cx<T>,
    shift: Cx<T>,
    gamma: T,
    work: &mut Vec<Cx<T>>,
) -> Cx<T> {
    let scale = (s + Cx::real(gamma)).recip();
    let delayed = shift * scale;
    let diagonal = s * scale;
    work.clear();
    for i in 0..n * n {
        let (a, d) = (plant[i], plant[n * n + i]);
        let mut entry = Cx::new(
            d.neg_mul_add(delayed.re, -(a * scale.re)),
            d.neg_mul_add(delayed.im, -(a * scale.im)),
        );
        if i % (n + 1) == 0 {
            entry = entry + diagonal;
        }
        work.push(entry);
    }
    cx_det(Dyn(n), work)
}

/// `D` of every plant at every node.
struct Values<'a> {
    winding: &'a Winding,
    batch: &'a DelayedBatch,
    out: &'a mut [(f64, f64)],
}

impl Kernel for Values<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Values { winding, batch, out } = self;
        let (n, size) = (batch.n, batch.size());
        let mut plant = vec![T::zero(); size];
        let mut work = Vec::with_capacity(n * n);
        let width = winding.nodes.len() + 2;
        for (g, out) in out.chunks_mut(T::LANES * width).enumerate() {
            let first = g * T::LANES;
            let blocks = &batch.data[first / LANES * size..][..size];
            simd::load_group(blocks, first % LANES / T::LANES, &mut plant);
            for k in 0..width {
                let w = match winding.nodes.get(k) {
                    Some(&node) => winding.gamma * node / (1.0 - node),
                    None => winding.last(),
                };
                let mut e = winding.shift(w);
                if k + 1 == width {
                    e = -e;
                }
                let s = Cx::new(T::zero(), T::splat(w));
                let shift = Cx::new(T::splat(e.re), T::splat(e.im));
                let gamma = T::splat(winding.gamma);
                let d = characteristic(n, &plant, s, shift, gamma, &mut work);
                for (l, row) in out.chunks_exact_mut(width).enumerate() {
                    row[k] = (d.re.lane(l), d.im.lane(l));
                }
            }
        }
    }
}
