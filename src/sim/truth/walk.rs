//! Eight trials of a truth on their way.

use super::course::Course;
use super::source::{Phase, Source, Timing};
use crate::bank::{self, Repeat};
use crate::real::{LaneKernel, Real};
use crate::sim::random::Streams;
use crate::simd::{Block, load_group};

/// Steps whose normal numbers are made at a time; even, so that none is wasted.
pub(in crate::sim) const AHEAD: usize = 16;

/// Eight trials (or one, for the oracle) on their way.
pub(in crate::sim) struct Walk<'a, T> {
    source: &'a Source,
    streams: Streams,
    group: usize,
    normals: Vec<Block>,
    /// Step within `normals`.
    at: usize,
    phase: usize,
    k: u64,
    /// The state now.
    pub(in crate::sim) x: Vec<T>,
    /// The command of the last step, before the delay; nothing if there never is
    /// one.
    pub(in crate::sim) u: Vec<T>,
    next: Vec<T>,
    z: Vec<T>,
    /// Known disturbances.
    w: Vec<T>,
    /// What the controller makes of the last measurement.
    feedback: Vec<T>,
    /// State of the controller, of the input filter.
    inner: [Vec<T>; 2],
    /// Commands that have not arrived, slot by slot, the latest at `head`.
    past: Vec<T>,
    head: usize,
}

impl<'a, T: Real> Walk<'a, T> {
    /// Trials `first` to `first + 7` at the start.
    #[inline(always)]
    pub(in crate::sim) fn new(source: &'a Source, seed: u64, first: u64, group: usize) -> Self {
        let n = source.n;
        let each = source.drive.iter().sum();
        let mut streams = Streams::new(seed, first);
        let mut x: Vec<T> = source.x0.iter().map(|&v| T::splat(v)).collect();
        if !source.spread.is_empty() {
            let mut blocks = vec![Block::default(); n];
            streams.normals::<T>(&mut blocks);
            let mut z = vec![T::zero(); n];
            load_group(&blocks, group, &mut z);
            add_product(&source.spread, &z, &mut x);
        }
        let inputs = if source.is_driven() { source.m } else { 0 };
        let inner = [&source.controller, &source.filter]
            .map(|block| vec![T::zero(); block.as_ref().map_or(0, |b| b.n)]);
        let most = inner[0].len().max(inner[1].len()).max(n);
        let slots = source.delay + usize::from(source.split);
        Self {
            source,
            streams,
            group,
            normals: vec![Block::default(); AHEAD * each],
            at: AHEAD,
            phase: 0,
            k: 0,
            x,
            u: vec![T::zero(); inputs],
            next: vec![T::zero(); most],
            z: vec![T::zero(); each],
            w: vec![T::zero(); source.known.disturbances.len()],
            feedback: vec![T::zero(); inputs],
            inner,
            past: vec![T::zero(); slots * inputs],
            head: 0,
        }
    }

    /// Some steps, as many as there are rows of measurements: the same by bits as one
    /// after the other. Commands go to `u`, a row a step, unless there never is one.
    #[inline(always)]
    pub(in crate::sim) fn steps(&mut self, y: &mut [T], u: &mut [T]) {
        let (q, m) = (self.source.q, self.u.len());
        let each = self.z.len();
        let count = y.len() / q;
        let mut done = 0;
        while done < count {
            if !self.source.is_plain() || (self.k == 0 && !self.source.moves_first()) {
                self.step(&mut y[done * q..][..q]);
                u[done * m..][..m].copy_from_slice(&self.u);
                done += 1;
                continue;
            }
            self.refill();
            let now = (count - done).min(AHEAD - self.at);
            let [w, v, _, _] = self.source.drive;
            T::outline(Course {
                phase: self.source.phase(0),
                drive: [w, v],
                normals: &self.normals[self.at * each..][..now * each],
                group: self.group,
                x: &mut self.x,
                next: &mut self.next,
                z: &mut self.z,
                y: &mut y[done * q..][..now * q],
                q,
            });
            self.at += now;
            self.k += now as u64;
            done += now;
        }
    }

    /// Normal numbers for the step that comes.
    #[inline(always)]
    fn refill(&mut self) {
        if self.at == AHEAD {
            self.streams.normals::<T>(&mut self.normals);
            self.at = 0;
        }
    }

    /// The next step; writes the measurement.
    #[inline(always)]
    pub(in crate::sim) fn step(&mut self, y: &mut [T]) {
        self.k += 1;
        let source = self.source;
        let each = self.z.len();
        self.refill();
        load_group(&self.normals[self.at * each..][..each], self.group, &mut self.z);
        self.at += 1;
        while self.phase + 1 < source.from.len() && source.from[self.phase + 1] <= self.k {
            self.phase += 1;
        }
        let phase = source.phase(self.phase);
        match source.timing {
            Timing::Hold => {
                self.measure(phase, y);
                self.control(y);
                self.go(phase);
            }
            Timing::MeasureAtStart if self.k == 1 => {
                self.measure(phase, y);
                self.control(y);
            }
            Timing::MoveFirst | Timing::MeasureAtStart => {
                self.go(phase);
                self.measure(phase, y);
                self.control(y);
            }
        }
    }

    /// `u = f + u_ext`, `x <- A x + B0 u(k-d) + B1 u(k-d-1) + G w`.
    #[inline(always)]
    fn go(&mut self, phase: Phase<'_>) {
        let source = self.source;
        let n = self.x.len();
        let [disturbance, measurement, filtered, _] = source.drive;
        self.command();
        for i in 0..n {
            self.next[i] = T::zero();
        }
        if !self.u.is_empty() {
            let (u, next) = ([&self.u[..], &self.past[..]], &mut self.next[..n]);
            add_product(phase.b[0], sent(u, self.head, source.delay), next);
            if source.split {
                add_product(phase.b[1], sent(u, self.head, source.delay + 1), next);
            }
            self.send();
        }
        if !self.w.is_empty() {
            let t = self.time();
            for j in 0..self.w.len() {
                let (_, signal) = &source.known.disturbances[j];
                self.w[j] = T::splat(signal.held(t, source.known.dt));
            }
            add_product(phase.s, &self.w, &mut self.next[..n]);
        }
        add_product(phase.a, &self.x, &mut self.next[..n]);
        add_product(phase.g, &self.z[..disturbance], &mut self.next[..n]);
        self.x.copy_from_slice(&self.next[..n]);
        if let Some(filter) = &source.filter {
            let z = &self.z[disturbance + measurement..][..filtered];
            advance(&filter.a, &filter.b, z, &mut self.inner[1], &mut self.next);
        }
    }

    /// The command of the step.
    #[inline(always)]
    fn command(&mut self) {
        let source = self.source;
        self.u.copy_from_slice(&self.feedback);
        if let Some(filter) = &source.filter {
            add_product(&filter.c, &self.inner[1], &mut self.u);
        }
        let known = &source.known;
        if known.inputs.is_empty() {
            return;
        }
        let t = self.time();
        for j in 0..self.u.len() {
            self.u[j] = self.u[j] + T::splat(known.inputs[j].held(t, known.dt));
        }
        let z = &self.z[self.z.len() - known.white.len()..];
        for i in 0..z.len() {
            let (j, std) = known.white[i];
            self.u[j] = T::splat(std).mul_add(z[i], self.u[j]);
        }
    }

    /// The moment from which the plant moves.
    #[inline(always)]
    fn time(&self) -> f64 {
        let before = match self.source.timing {
            Timing::Hold | Timing::MoveFirst => 1,
            // the first step does not move
            Timing::MeasureAtStart => 2,
        };
        self.k.saturating_sub(before) as f64 * self.source.known.dt
    }

    /// Takes the command of the step among those on their way.
    #[inline(always)]
    fn send(&mut self) {
        let m = self.u.len();
        let slots = self.past.len() / m;
        if slots > 0 {
            self.head = (self.head + slots - 1) % slots;
            self.past[self.head * m..][..m].copy_from_slice(&self.u);
        }
    }

    /// `f = C_K x_K + D_K y`, `x_K <- A_K x_K + B_K y`.
    #[inline(always)]
    fn control(&mut self, y: &[T]) {
        let Some(k) = &self.source.controller else { return };
        for f in &mut self.feedback {
            *f = T::zero();
        }
        add_product(&k.c, &self.inner[0], &mut self.feedback);
        add_product(&k.d, y, &mut self.feedback);
        advance(&k.a, &k.b, y, &mut self.inner[0], &mut self.next);
    }

    /// `y = C x + v`.
    #[inline(always)]
    fn measure(&self, phase: Phase<'_>, y: &mut [T]) {
        let [disturbance, measurement, _, _] = self.source.drive;
        for v in y.iter_mut() {
            *v = T::zero();
        }
        add_product(phase.c, &self.x, y);
        add_product(phase.r, &self.z[disturbance..][..measurement], y);
        let known = &self.source.known;
        if !known.noise.is_empty() {
            // when the measurement is taken, not when the step begins
            let t = match self.source.timing {
                Timing::MoveFirst => self.k as f64 * known.dt,
                Timing::Hold | Timing::MeasureAtStart => (self.k - 1) as f64 * known.dt,
            };
            for (j, signal) in &known.noise {
                y[*j] = y[*j] + T::splat(signal.held(t, known.dt));
            }
        }
    }
}

/// Of the command `u` and those before it, that of `ago` steps ago.
#[inline(always)]
fn sent<T: Real>([u, past]: [&[T]; 2], head: usize, ago: usize) -> &[T] {
    let m = u.len();
    if ago == 0 {
        return u;
    }
    let slots = past.len() / m;
    &past[(head + ago - 1) % slots * m..][..m]
}

/// `x <- A x + B u`; `next` is scratch.
#[inline(always)]
fn advance<T: Real>(a: &[f64], b: &[f64], u: &[T], x: &mut [T], next: &mut [T]) {
    let n = x.len();
    for i in 0..n {
        next[i] = T::zero();
    }
    add_product(a, x, &mut next[..n]);
    add_product(b, u, &mut next[..n]);
    x.copy_from_slice(&next[..n]);
}

/// `out += M x`.
#[inline(always)]
pub(in crate::sim) fn add_product<T: Real>(m: &[f64], x: &[T], out: &mut [T]) {
    T::outline(AddProduct { m, x, out });
}

/// [`add_product`].
struct AddProduct<'a, T> {
    m: &'a [f64],
    x: &'a [T],
    out: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for AddProduct<'_, T> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let AddProduct { m, x, out } = self;
        bank::add_product::<T, false>(Repeat(m), x, out);
    }
}
