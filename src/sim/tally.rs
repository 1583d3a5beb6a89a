//! What is kept of the trials: sums for each step that is reported.

use crate::real::{Mask, Real, exp};
use crate::simd::{Block, LANES};

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
    /// Logarithms of the weights, shape (step, model).
    pub log_p: Vec<f64>,
}

/// What one report says of a trial; the numbers of `T::LANES` trials.
pub(super) struct Report<'a, T> {
    pub(super) log_p: &'a [T],
    pub(super) nis: &'a [T],
    /// NaN for a member that failed, else a number.
    pub(super) alive: &'a [T],
    /// Squared error of the fused estimate.
    pub(super) error: T,
}

/// Numbers summed for a report of `models` models.
pub(super) fn width(models: usize) -> usize {
    6 * models + 1
}

/// Adds a report to the sums of its step; lanes of trials that do not exist
/// count nothing.
#[inline(always)]
pub(super) fn add<T: Real>(report: &Report<'_, T>, group: usize, valid: usize, sums: &mut [Block]) {
    let models = report.log_p.len();
    let lanes = group * T::LANES;
    let counts = T::from_fn(|l| if lanes + l < valid { 1.0 } else { 0.0 });
    let real = counts.gt(T::zero());
    let mut top = T::splat(f64::NEG_INFINITY);
    let mut best = T::splat(-1.0);
    for i in 0..models {
        let better = report.log_p[i].gt(top);
        top = T::select(better, report.log_p[i], top);
        best = T::select(better, T::splat(i as f64), best);
    }
    for i in 0..models {
        let log_p = report.log_p[i];
        let p = exp(log_p);
        let chosen = T::select(best.eq(T::splat(i as f64)), T::one(), T::zero());
        let alive = report.alive[i].eq(report.alive[i]);
        let failed = T::select(alive, T::zero(), T::one());
        let nis = T::select(alive, report.nis[i], T::zero());
        let numbers = [p, p * p, log_p, chosen, nis, failed];
        for (j, number) in numbers.into_iter().enumerate() {
            let number = T::select(real, number, T::zero());
            let sum = &mut sums[j * models + i].0[lanes..];
            (T::load(sum) + number).store(sum);
        }
    }
    let error = T::select(real, report.error, T::zero());
    let sum = &mut sums[6 * models].0[lanes..];
    (T::load(sum) + error).store(sum);
}

/// Fused estimate of `x`, shape (model, state): members without weight may hold
/// anything.
#[inline(always)]
pub(super) fn fuse<T: Real>(log_p: &[T], x: &[T], fused: &mut [T]) {
    let n = fused.len();
    for j in 0..n {
        fused[j] = T::zero();
    }
    for i in 0..log_p.len() {
        let p = exp(log_p[i]);
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

/// `|x - x_hat|^2` over the states of the plant that the observers have.
#[inline(always)]
pub(super) fn squared_error<T: Real>(x: &[T], x_hat: &[T]) -> T {
    let mut sum = T::zero();
    for j in 0..x.len().min(x_hat.len()) {
        let e = x[j] - x_hat[j];
        sum = e.mul_add(e, sum);
    }
    sum
}

/// Sums over lanes, in order.
pub(super) fn across(sums: &[Block]) -> Vec<f64> {
    let sum = |b: &Block| (1..LANES).fold(b.0[0], |s, l| s + b.0[l]);
    sums.iter().map(sum).collect()
}
