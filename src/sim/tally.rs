//! What is kept of the trials: sums and values for each step that is reported.

use super::consistency::{SINGULAR, Spread, chi_square_band};
use super::quantile::Axis;
use crate::bank::{Repeat, whiten};
use crate::real::{Mask, Real, exp};
use crate::simd::{Block, LANES};
use crate::small::{Dyn, cholesky, solve_lower};

/// Trials of a chunk of work.
pub(super) const CHUNK: usize = 64;

/// A trial that was asked for, at the steps that are reported.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// Number of the trial.
    pub trial: u64,
    /// State of the plant, shape (step, state).
    pub x: Vec<f64>,
    /// Fused estimate, shape (step, state of the observers).
    pub x_hat: Vec<f64>,
    /// Measurement, shape (step, output).
    pub y: Vec<f64>,
    /// Command before the actuator delay, shape (step, input); nothing if nothing
    /// drives the plant.
    pub u: Vec<f64>,
    /// Logarithms of the weights, shape (step, model).
    pub log_p: Vec<f64>,
}

/// What one report says of a trial; the numbers of `T::LANES` trials.
pub(super) struct Report<'a, T> {
    pub(super) log_p: &'a [T],
    pub(super) nis: &'a [T],
    /// NaN for a member that failed, else a number.
    pub(super) alive: &'a [T],
    /// State of the plant.
    pub(super) x: &'a [T],
    /// Estimates, shape (model, state).
    pub(super) x_hat: &'a [T],
    /// Their covariances.
    pub(super) spread: Spread<'a>,
}

/// Where the sums of a report stand: so many lists of a number a model, then
/// single numbers.
pub(super) mod sum {
    pub(crate) const P: usize = 0;
    pub(crate) const P_SQUARED: usize = 1;
    pub(crate) const LOG_P: usize = 2;
    pub(crate) const CHOSEN: usize = 3;
    pub(crate) const FAILED: usize = 4;
    pub(crate) const NIS: usize = 5;
    pub(crate) const NIS_INSIDE: usize = 6;
    pub(crate) const NEES: usize = 7;
    pub(crate) const NEES_INSIDE: usize = 8;
    pub(crate) const NEES_COUNT: usize = 9;
    pub(crate) const LISTS: usize = 10;
    pub(crate) const FUSED: usize = 0;
    pub(crate) const FUSED_INSIDE: usize = 1;
    pub(crate) const FUSED_COUNT: usize = 2;
    pub(crate) const ERROR: usize = 3;
    pub(crate) const SINGLES: usize = 4;
}

/// Sizes of a report, and what it is judged by.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    pub(super) models: usize,
    /// States of the observers.
    pub(super) n: usize,
    /// States that plant and observers have in common: the first ones of both.
    pub(super) common: usize,
    /// Values of the parameters, shape (parameter, model).
    pub(super) values: Vec<f64>,
    /// Bands of one trial.
    nis_band: [f64; 2],
    nees_band: [f64; 2],
}

impl Shape {
    pub(super) fn new(
        [n, q]: [usize; 2],
        plant_states: usize,
        models: usize,
        values: &[Vec<f64>],
    ) -> Self {
        let common = n.min(plant_states);
        let parameters = values.first().map_or(0, Vec::len);
        let all = (0..parameters).flat_map(|k| values.iter().map(move |v| v[k]));
        Self {
            models,
            n,
            common,
            values: all.collect(),
            nis_band: chi_square_band(q as f64, 1.0),
            nees_band: chi_square_band(common as f64, 1.0),
        }
    }

    pub(super) fn parameters(&self) -> usize {
        self.values.len() / self.models.max(1)
    }

    /// Numbers summed for a report.
    pub(super) fn sums(&self) -> usize {
        sum::LISTS * self.models + sum::SINGLES + 2 * self.common
    }

    /// Quantities whose values are kept: weights, parameters, errors, the norm
    /// of the error.
    pub(super) fn axes(&self) -> Vec<Axis> {
        let mut axes = vec![Axis::Unit; self.models];
        for values in self.values.chunks(self.models.max(1)) {
            let low = values.iter().fold(f64::INFINITY, |m, v| m.min(*v));
            axes.push(Axis::Range(low, values.iter().fold(low, |m, v| m.max(*v))));
        }
        axes.resize(axes.len() + self.common + 1, Axis::Line);
        axes
    }

    /// Bytes that a report of a chunk of `trials` takes.
    pub(super) fn bytes(&self, trials: usize) -> usize {
        8 * self.sums() * (LANES + 1) + 8 * trials * self.axes().len()
    }
}

/// Numbers of a kernel that reports.
pub(super) struct Scratch<T> {
    /// The fused estimate.
    pub(super) fused: Vec<T>,
    /// Weights.
    w: Vec<T>,
    e: Vec<T>,
    p: Vec<T>,
    d: Vec<T>,
}

impl<T: Real> Scratch<T> {
    pub(super) fn new(shape: &Shape) -> Self {
        let room = |len: usize| vec![T::zero(); len];
        let c = shape.common;
        Self { fused: room(shape.n), w: room(shape.models), e: room(c), p: room(c * c), d: room(c) }
    }
}

/// Sums and values of a chunk of trials.
pub(super) struct Tally<'a> {
    shape: &'a Shape,
    /// Shape (report, number).
    sums: Vec<Block>,
    /// Shape (report, quantity, trial).
    values: Vec<f64>,
    quantities: usize,
    trials: usize,
    /// First of the eight trials at hand, and how many there are.
    start: usize,
    valid: usize,
}

impl<'a> Tally<'a> {
    pub(super) fn new(shape: &'a Shape, reports: usize, trials: usize) -> Self {
        let quantities = shape.axes().len();
        Self {
            shape,
            sums: vec![Block::default(); reports * shape.sums()],
            values: vec![0.0; reports * quantities * trials],
            quantities,
            trials,
            start: 0,
            valid: 0,
        }
    }

    /// Goes on to trials `start` to `start + valid - 1` of the chunk.
    pub(super) fn begin(&mut self, start: usize, valid: usize) {
        (self.start, self.valid) = (start, valid);
    }

    /// Sums over the lanes, in order, and the values.
    pub(super) fn finish(self) -> (Vec<f64>, Vec<f64>) {
        let across = |b: &Block| (1..LANES).fold(b.0[0], |s, l| s + b.0[l]);
        (self.sums.iter().map(across).collect(), self.values)
    }

    /// Adds report number `at` to its sums; lanes of trials that do not exist
    /// count nothing.
    #[inline(always)]
    pub(super) fn add<T: Real>(
        &mut self,
        report: &Report<'_, T>,
        scratch: &mut Scratch<T>,
        group: usize,
        at: usize,
    ) {
        let shape = self.shape;
        let (models, n, c) = (shape.models, shape.n, shape.common);
        let lanes = group * T::LANES;
        let valid = self.valid;
        let counts = T::from_fn(|l| if lanes + l < valid { 1.0 } else { 0.0 });
        let real = counts.gt(T::zero());
        let mut values = Values {
            all: &mut self.values[at * self.quantities * self.trials..],
            trials: self.trials,
            trial: self.start + lanes,
            count: valid.saturating_sub(lanes).min(T::LANES),
            next: 0,
        };
        let width = shape.sums();
        let sums = &mut self.sums[at * width..][..width];
        let (lists, singles) = sums.split_at_mut(sum::LISTS * models);
        let mut lists = Sums::<T> { all: lists, real, lanes };
        let mut singles = Sums::<T> { all: singles, real, lanes };

        for i in 0..models {
            scratch.w[i] = exp(report.log_p[i]);
        }
        fuse(&scratch.w, report.x_hat, &mut scratch.fused);
        let mut top = T::splat(f64::NEG_INFINITY);
        let mut best = T::splat(-1.0);
        for i in 0..models {
            // a member that failed is nothing that a plant is identified as
            let alive = report.alive[i].eq(report.alive[i]);
            let better = report.log_p[i].gt(top) & alive;
            top = T::select(better, report.log_p[i], top);
            best = T::select(better, T::splat(i as f64), best);
        }
        for i in 0..models {
            let log_p = report.log_p[i];
            let p = scratch.w[i];
            let alive = report.alive[i].eq(report.alive[i]);
            for j in 0..c {
                scratch.e[j] = report.x[j] - report.x_hat[i * n + j];
            }
            let nees = whiten(Repeat(&report.spread.white[i * c * c..][..c * c]), &scratch.e);
            let judged = alive & nees.eq(nees);
            let nis = report.nis[i];
            let numbers = [
                (sum::P, p),
                (sum::P_SQUARED, p * p),
                (sum::LOG_P, log_p),
                (sum::CHOSEN, one_if::<T>(best.eq(T::splat(i as f64)))),
                (sum::FAILED, one_if::<T>(!alive)),
                (sum::NIS, T::select(alive, nis, T::zero())),
                (sum::NIS_INSIDE, one_if::<T>(alive & inside(nis, shape.nis_band))),
                (sum::NEES, T::select(judged, nees, T::zero())),
                (sum::NEES_INSIDE, one_if::<T>(judged & inside(nees, shape.nees_band))),
                (sum::NEES_COUNT, one_if::<T>(judged)),
            ];
            for (list, number) in numbers {
                lists.add(list * models + i, number);
            }
            values.push(p);
        }
        for k in 0..shape.parameters() {
            let mut theta = T::zero();
            for i in 0..models {
                let p = scratch.w[i];
                let value = T::splat(shape.values[k * models + i]);
                theta = T::select(p.gt(T::zero()), p.mul_add(value, theta), theta);
            }
            values.push(theta);
        }
        let mut square = T::zero();
        for j in 0..c {
            let e = report.x[j] - scratch.fused[j];
            scratch.e[j] = e;
            square = e.mul_add(e, square);
            singles.add(sum::SINGLES + j, e);
            singles.add(sum::SINGLES + c + j, e * e);
            values.push(e);
        }
        values.push(square.sqrt());
        singles.add(sum::ERROR, square);
        let (nees, judged) = fused_nees(report, n, scratch);
        singles.add(sum::FUSED, T::select(judged, nees, T::zero()));
        singles.add(sum::FUSED_INSIDE, one_if::<T>(judged & inside(nees, shape.nees_band)));
        singles.add(sum::FUSED_COUNT, one_if::<T>(judged));
    }
}

/// Sums of a report, in the lanes at hand.
struct Sums<'a, T: Real> {
    all: &'a mut [Block],
    real: T::Mask,
    lanes: usize,
}

impl<T: Real> Sums<'_, T> {
    #[inline(always)]
    fn add(&mut self, at: usize, number: T) {
        let sum = &mut self.all[at].0[self.lanes..];
        (T::load(sum) + T::select(self.real, number, T::zero())).store(sum);
    }
}

/// Values of a report, one quantity after the other.
struct Values<'a> {
    all: &'a mut [f64],
    trials: usize,
    trial: usize,
    count: usize,
    next: usize,
}

impl Values<'_> {
    #[inline(always)]
    fn push<T: Real>(&mut self, number: T) {
        let out = &mut self.all[self.next * self.trials + self.trial..];
        if self.count == T::LANES {
            number.store(out);
        } else {
            for l in 0..self.count {
                out[l] = number.lane(l);
            }
        }
        self.next += 1;
    }
}

#[inline(always)]
fn one_if<T: Real>(mask: T::Mask) -> T {
    T::select(mask, T::one(), T::zero())
}

#[inline(always)]
fn inside<T: Real>(number: T, band: [f64; 2]) -> T::Mask {
    number.ge(T::splat(band[0])) & number.le(T::splat(band[1]))
}

/// Fused estimate of `x`, shape (model, state): members without weight may hold
/// anything.
#[inline(always)]
fn fuse<T: Real>(p: &[T], x: &[T], fused: &mut [T]) {
    let n = fused.len();
    for j in 0..n {
        fused[j] = T::zero();
    }
    for i in 0..p.len() {
        let p = p[i];
        let counts = p.gt(T::zero());
        if !counts.any() {
            continue;
        }
        for j in 0..n {
            let sum = p.mul_add(x[i * n + j], fused[j]);
            fused[j] = T::select(counts, sum, fused[j]);
        }
    }
}

/// Normalised error squared of the fused estimate, whose error stands in
/// `scratch.e`, and the lanes where its covariance is regular.
///
/// ```text
/// P = sum p_i (P_i + (x_i - x_hat)(x_i - x_hat)'),   e' P^-1 e
/// ```
#[inline(always)]
fn fused_nees<T: Real>(report: &Report<'_, T>, n: usize, scratch: &mut Scratch<T>) -> (T, T::Mask) {
    let Scratch { fused, w, e, p: cov, d } = scratch;
    let c = e.len();
    for entry in cov.iter_mut() {
        *entry = T::zero();
    }
    for i in 0..w.len() {
        let p = w[i];
        let counts = p.gt(T::zero());
        let own = &report.spread.p[i * c * c..][..c * c];
        for r in 0..c {
            d[r] = report.x_hat[i * n + r] - fused[r];
        }
        for r in 0..c {
            for s in 0..=r {
                let sum = d[r].mul_add(d[s], T::splat(own[r * c + s]));
                let sum = p.mul_add(sum, cov[r * c + s]);
                cov[r * c + s] = T::select(counts, sum, cov[r * c + s]);
            }
        }
    }
    for r in 0..c {
        d[r] = cov[r * c + r];
    }
    let mut regular = cholesky(Dyn(c), cov);
    for r in 0..c {
        let pivot = cov[r * c + r];
        regular = regular & (pivot * pivot).gt(d[r] * T::splat(SINGULAR));
    }
    solve_lower(Dyn(c), Dyn(1), cov, e);
    let mut nees = T::zero();
    for r in 0..c {
        nees = e[r].mul_add(e[r], nees);
    }
    (nees, regular & nees.eq(nees))
}
