//! What came out of the trials.

use super::tally::{Shape, Trajectory, sum};
use crate::error::Error;

/// Means over all trials at a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// The step, from 1.
    pub step: u64,
    /// Mean weight of each model.
    pub p: Vec<f64>,
    /// Standard deviation of the weight over the trials.
    pub p_std: Vec<f64>,
    /// Mean logarithm of each weight; minus infinity where a trial has weight
    /// zero.
    pub log_p: Vec<f64>,
    /// Fraction of trials in which the model has the largest weight.
    pub identified: Vec<f64>,
    /// Mean normalised innovation squared, `r' S^-1 r`, whose expectation is the
    /// number of outputs where the model is right; over the trials in which the
    /// member did not fail, NaN if there is none.
    pub nis: Vec<f64>,
    /// Fraction of trials in which the member failed.
    pub failed: Vec<f64>,
    /// Fraction of those trials in which it lies in the band that holds 95 % of
    /// them where the model is right.
    pub nis_inside: Vec<f64>,
    /// Mean normalised error squared of each model's estimate; its expectation is
    /// the number of states where the model is right. NaN where `P_i` is singular,
    /// and for observers whose `P` is no covariance.
    ///
    /// ```text
    /// (x - x_i)' P_i^-1 (x - x_i)
    /// ```
    pub nees: Vec<f64>,
    /// Fraction of trials with it in the band that should hold 95 %.
    pub nees_inside: Vec<f64>,
    /// The same of the fused estimate, with the covariance of the mixture.
    ///
    /// ```text
    /// P = sum p_i (P_i + (x_i - x_hat)(x_i - x_hat)')
    /// ```
    pub nees_fused: f64,
    /// Fraction of trials with it in the band that should hold 95 %.
    pub nees_fused_inside: f64,
    /// `sqrt(mean |x - x_hat|^2)` of the fused estimate. Errors are those of the
    /// states that plant and observers have in common: the first ones of both.
    pub x_error_rms: f64,
    /// Mean error `x - x_hat` of each state: the bias.
    pub x_error_mean: Vec<f64>,
    /// Standard deviation of the error of each state over the trials.
    pub x_error_std: Vec<f64>,
    /// Quantiles over the trials, at [`LEVELS`](super::LEVELS): of each weight, of
    /// each parameter estimate `sum p_i theta_i`, of the error of each state and of
    /// its Euclidean norm. Exact for up to 1024 trials; for more right to a
    /// sixteenth of their value, of the smaller of `p` and `1 - p` for a weight, and
    /// to 1/4096 of the range of the values for a parameter; they are then those of the
    /// value at the rank or below it, without interpolation between two values.
    pub p_quantiles: Vec<[f64; 5]>,
    /// See above.
    pub theta_hat_quantiles: Vec<[f64; 5]>,
    /// See above.
    pub x_error_quantiles: Vec<[f64; 5]>,
    /// See above.
    pub x_error_norm_quantiles: [f64; 5],
}

impl Moment {
    /// `sum p_i values_i`: the mean estimate of a parameter.
    ///
    /// # Panics
    /// Unless there is a value a model.
    pub fn mean(&self, values: &[f64]) -> f64 {
        assert_eq!(values.len(), self.p.len(), "one value a model");
        self.p.iter().zip(values).filter(|(p, _)| **p > 0.0).map(|(p, v)| p * v).sum()
    }
}

/// What came out of all trials.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Trials run.
    pub trials: u64,
    /// Steps of each.
    pub steps: u64,
    /// Seed.
    pub seed: u64,
    /// Band that holds the mean over the trials of the normalised innovation
    /// squared of a model that is right, with probability 95 %.
    pub nis_band: [f64; 2],
    /// The same for the normalised estimation error squared; NaN for observers
    /// whose `P` is no covariance.
    pub nees_band: [f64; 2],
    /// The steps that were asked for; the last one is the end.
    pub record: Vec<Moment>,
    /// The trials that were asked for, in order.
    pub kept: Vec<Trajectory>,
    /// Models that could not be designed.
    pub failures: Vec<Option<Error>>,
}

impl Summary {
    /// Means at the end.
    ///
    /// # Panics
    /// Never for a summary that [`MonteCarlo::run`](super::MonteCarlo::run) returned.
    pub fn last(&self) -> &Moment {
        &self.record[self.record.len() - 1]
    }
}

/// Means from sums over `count` trials.
pub(super) fn moment(
    step: u64,
    sums: &[f64],
    quantiles: Vec<[f64; 5]>,
    shape: &Shape,
    count: f64,
) -> Moment {
    let (models, c) = (shape.models, shape.common);
    let (lists, singles) = sums.split_at(sum::LISTS * models);
    let list = |j: usize| &lists[j * models..][..models];
    let mean = |j: usize| -> Vec<f64> { list(j).iter().map(|s| s / count).collect() };
    let ratio =
        |j: usize, of: &[f64]| -> Vec<f64> { list(j).iter().zip(of).map(|(s, n)| s / n).collect() };
    let std = |mean: &f64, square: &f64| {
        // an error that has run away has no spread
        if square.is_finite() { (square - mean * mean).max(0.0).sqrt() } else { f64::NAN }
    };
    let p = mean(sum::P);
    let p_std = p.iter().zip(&mean(sum::P_SQUARED)).map(|(p, s)| std(p, s)).collect();
    let alive: Vec<f64> = list(sum::FAILED).iter().map(|failed| count - failed).collect();
    let judged = list(sum::NEES_COUNT);
    let errors = |from: usize| singles[sum::SINGLES + from..][..c].iter().map(|s| s / count);
    let x_error_mean: Vec<f64> = errors(0).collect();
    let x_error_std = x_error_mean.iter().zip(errors(c)).map(|(m, s)| std(m, &s)).collect();
    let mut quantiles = quantiles.into_iter();
    let mut take = |n: usize| -> Vec<[f64; 5]> { quantiles.by_ref().take(n).collect() };
    Moment {
        step,
        p,
        p_std,
        log_p: mean(sum::LOG_P),
        identified: mean(sum::CHOSEN),
        nis: ratio(sum::NIS, &alive),
        nis_inside: ratio(sum::NIS_INSIDE, &alive),
        nees: ratio(sum::NEES, judged),
        nees_inside: ratio(sum::NEES_INSIDE, judged),
        nees_fused: singles[sum::FUSED] / singles[sum::FUSED_COUNT],
        nees_fused_inside: singles[sum::FUSED_INSIDE] / singles[sum::FUSED_COUNT],
        failed: mean(sum::FAILED),
        x_error_rms: (singles[sum::ERROR] / count).sqrt(),
        x_error_mean,
        x_error_std,
        p_quantiles: take(models),
        theta_hat_quantiles: take(shape.parameters()),
        x_error_quantiles: take(c),
        x_error_norm_quantiles: take(1).first().copied().unwrap_or([f64::NAN; 5]),
    }
}
