//! The plant that is really there, simulated for eight trials at once.

use faer::Mat;

use super::random::Streams;
use super::signal::Signals;
use crate::error::{Error, Result};
use crate::model::{Plant, check_covariance, check_finite, check_shape, psd_factor, sample};
use crate::real::Real;
use crate::simd::{Block, load_group};

/// The plant of a simulation: one, or several after each other.
///
/// ```text
/// x <- A x + B u + G w,   y = C x + v,   cov(w) = Q,  cov(v) = R
/// ```
/// A continuous plant is sampled exactly; its measurement noise is held between
/// two measurements, `cov(v) = R / dt`.
#[derive(Debug, Clone)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Truth {
    /// Plants of one size with the number of the first step that each makes; the
    /// first plant is there from the start, whatever its number.
    pub phases: Vec<(u64, Plant)>,
    /// State at the start.
    pub x0: Vec<f64>,
    /// Covariance of the state at the start, n by n; `None` if it is known.
    pub P0: Option<Mat<f64>>,
    /// Inputs, a row a step; the last one stays. `None` for zero.
    pub inputs: Option<Mat<f64>>,
    /// Known signals that drive it.
    pub signals: Signals,
}

impl Truth {
    /// One plant that starts at rest at `x = 0`.
    pub fn new(plant: Plant) -> Self {
        let x0 = vec![0.0; plant.nx()];
        Self { phases: vec![(0, plant)], x0, P0: None, inputs: None, signals: Signals::default() }
    }
}

/// When the plant moves and when it is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Timing {
    /// Every step moves, then measures.
    MoveFirst,
    /// The same, but the first step only measures.
    MeasureAtStart,
    /// Every step measures, then moves: signals held over an interval.
    Hold,
}

/// Matrices of a phase, row by row.
#[derive(Debug, Clone)]
struct Phase {
    from: u64,
    a: Vec<f64>,
    b: Vec<f64>,
    /// `G L` with `L L' = Q`.
    g: Vec<f64>,
    c: Vec<f64>,
    /// Factor of `R`.
    r: Vec<f64>,
}

/// A truth ready to be simulated.
#[derive(Debug, Clone)]
pub(super) struct Source {
    pub(super) n: usize,
    pub(super) q: usize,
    pub(super) m: usize,
    /// Normal numbers a step, of disturbance and measurement.
    drive: [usize; 2],
    timing: Timing,
    phases: Vec<Phase>,
    x0: Vec<f64>,
    /// Factor of `P(0)`, or nothing.
    spread: Vec<f64>,
    inputs: Vec<f64>,
}

fn rows(m: &Mat<f64>) -> Vec<f64> {
    (0..m.nrows()).flat_map(|i| (0..m.ncols()).map(move |j| m[(i, j)])).collect()
}

/// A factor without its zero columns at the end.
fn trimmed(factor: &Mat<f64>) -> usize {
    let used = |j: &usize| (0..factor.nrows()).any(|i| factor[(i, *j)] != 0.0);
    (0..factor.ncols()).rev().find(used).map_or(0, |j| j + 1)
}

fn product(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), b.ncols(), |i, j| {
        (0..a.ncols()).fold(0.0, |s, k| f64::mul_add(a[(i, k)], b[(k, j)], s))
    })
}

impl Source {
    /// Checks sizes and factors the covariances; `dt` is the interval of the
    /// measurements.
    ///
    /// # Errors
    /// `Empty` without a plant, `Shape`, `NonFinite`, `NotPositiveSemidefinite`.
    pub(super) fn new(truth: &Truth, timing: Timing, dt: f64) -> Result<Self> {
        let Some((_, first)) = truth.phases.first() else {
            return Err(Error::Empty { what: "phases of the truth".into() });
        };
        let (n, m, q) = (first.nx(), first.nu(), first.ny());
        let mut made = Vec::new();
        for (from, plant) in &truth.phases {
            check_shape("A of the truth", plant.A.as_ref(), [n, n])?;
            check_shape("B of the truth", plant.B.as_ref(), [n, m])?;
            check_shape("C of the truth", plant.C.as_ref(), [q, n])?;
            plant.check()?;
            let plant =
                if plant.time.is_continuous() { sample(plant, dt, 0.0)?.0 } else { plant.clone() };
            let g = product(&plant.G, &psd_factor(plant.Q.as_ref()));
            let r = psd_factor(plant.R.as_ref());
            made.push((*from, plant, g, r));
        }
        if let Some(i) = (1..made.len()).find(|&i| made[i].0 <= made[i - 1].0) {
            return Err(Error::Range {
                what: "first step of a phase of the truth".into(),
                value: made[i].0 as f64,
                remedy: "list the phases in the order of time".into(),
            });
        }
        let drive = [
            made.iter().map(|p| trimmed(&p.2)).max().unwrap_or(0),
            made.iter().map(|p| trimmed(&p.3)).max().unwrap_or(0),
        ];
        let cut = |f: &Mat<f64>, cols: usize| {
            let entry = |i, j| if j < f.ncols() { f[(i, j)] } else { 0.0 };
            rows(&Mat::from_fn(f.nrows(), cols, entry))
        };
        let phases = made
            .iter()
            .map(|(from, plant, g, r)| Phase {
                from: *from,
                a: rows(&plant.A),
                b: rows(&plant.B),
                g: cut(g, drive[0]),
                c: rows(&plant.C),
                r: cut(r, drive[1]),
            })
            .collect();
        if truth.x0.len() != n {
            let got = [truth.x0.len(), 1];
            return Err(Error::Shape { what: "x(0) of the truth".into(), want: [n, 1], got });
        }
        if let Some(row) = truth.x0.iter().position(|v| !v.is_finite()) {
            return Err(Error::NonFinite { what: "x(0) of the truth".into(), row, col: 0 });
        }
        let spread = match &truth.P0 {
            None => Vec::new(),
            Some(p) => {
                check_shape("P(0) of the truth", p.as_ref(), [n, n])?;
                check_finite("P(0) of the truth", p.as_ref())?;
                check_covariance("P(0) of the truth", p.as_ref(), false)?;
                rows(&psd_factor(p.as_ref()))
            }
        };
        let inputs = match &truth.inputs {
            None => Vec::new(),
            Some(u) => {
                check_shape("inputs of the truth", u.as_ref(), [u.nrows().max(1), m])?;
                check_finite("inputs of the truth", u.as_ref())?;
                rows(u)
            }
        };
        Ok(Self { n, q, m, drive, timing, phases, x0: truth.x0.clone(), spread, inputs })
    }

    /// Inputs of step `k`, from 1; empty for zero.
    #[inline(always)]
    pub(super) fn input(&self, k: u64) -> &[f64] {
        let m = self.m;
        if m == 0 || self.inputs.is_empty() {
            return &[];
        }
        let last = self.inputs.len() / m - 1;
        let row = usize::try_from(k - 1).map_or(last, |row| row.min(last));
        &self.inputs[row * m..][..m]
    }
}

/// Steps whose normal numbers are made at a time; even, so that none is wasted.
const AHEAD: usize = 16;

/// Eight trials (or one, for the oracle) on their way.
pub(super) struct Walk<'a, T> {
    source: &'a Source,
    streams: Streams,
    group: usize,
    normals: Vec<Block>,
    /// Step within `normals`.
    at: usize,
    phase: usize,
    k: u64,
    /// The state now.
    pub(super) x: Vec<T>,
    next: Vec<T>,
    z: Vec<T>,
}

impl<'a, T: Real> Walk<'a, T> {
    /// Trials `first` to `first + 7` at the start.
    #[inline(always)]
    pub(super) fn new(source: &'a Source, seed: u64, first: u64, group: usize) -> Self {
        let n = source.n;
        let each = source.drive[0] + source.drive[1];
        let mut streams = Streams::new(seed, first);
        let mut x: Vec<T> = source.x0.iter().map(|&v| T::splat(v)).collect();
        if !source.spread.is_empty() {
            let mut blocks = vec![Block::default(); n];
            streams.normals::<T>(&mut blocks);
            let mut z = vec![T::zero(); n];
            load_group(&blocks, group, &mut z);
            add_product(&source.spread, &z, &mut x);
        }
        Self {
            source,
            streams,
            group,
            normals: vec![Block::default(); AHEAD * each],
            at: AHEAD,
            phase: 0,
            k: 0,
            x,
            next: vec![T::zero(); n],
            z: vec![T::zero(); each],
        }
    }

    /// The next step; writes the measurement.
    #[inline(always)]
    pub(super) fn step(&mut self, y: &mut [T]) {
        self.k += 1;
        let source = self.source;
        let each = self.z.len();
        if self.at == AHEAD {
            self.streams.normals::<T>(&mut self.normals);
            self.at = 0;
        }
        load_group(&self.normals[self.at * each..][..each], self.group, &mut self.z);
        self.at += 1;
        while self.phase + 1 < source.phases.len() && source.phases[self.phase + 1].from <= self.k {
            self.phase += 1;
        }
        let phase = &source.phases[self.phase];
        match source.timing {
            Timing::MoveFirst => {
                self.go(phase);
                self.measure(phase, y);
            }
            Timing::MeasureAtStart => {
                if self.k > 1 {
                    self.go(phase);
                }
                self.measure(phase, y);
            }
            Timing::Hold => {
                self.measure(phase, y);
                self.go(phase);
            }
        }
    }

    /// `x <- A x + B u + G w`.
    #[inline(always)]
    fn go(&mut self, phase: &Phase) {
        let (n, m) = (self.x.len(), self.source.m);
        let u = self.source.input(self.k);
        for i in 0..n {
            let mut sum = T::zero();
            for j in 0..u.len() {
                sum = sum + T::splat(phase.b[i * m + j] * u[j]);
            }
            self.next[i] = sum;
        }
        add_product(&phase.a, &self.x, &mut self.next);
        add_product(&phase.g, &self.z[..self.source.drive[0]], &mut self.next);
        std::mem::swap(&mut self.x, &mut self.next);
    }

    /// `y = C x + v`.
    #[inline(always)]
    fn measure(&self, phase: &Phase, y: &mut [T]) {
        for v in y.iter_mut() {
            *v = T::zero();
        }
        add_product(&phase.c, &self.x, y);
        add_product(&phase.r, &self.z[self.source.drive[0]..], y);
    }
}

/// `out += M x`.
#[inline(always)]
fn add_product<T: Real>(m: &[f64], x: &[T], out: &mut [T]) {
    let n = x.len();
    for i in 0..out.len() {
        let mut sum = out[i];
        for j in 0..n {
            sum = T::splat(m[i * n + j]).mul_add(x[j], sum);
        }
        out[i] = sum;
    }
}
