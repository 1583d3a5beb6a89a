//! The dynamic weighting signal generator.

use super::law::DwsgScheme;
use super::log::{largest, log_sum_exp, normalise};
use crate::real::{Mask, Real, exp, ln};

/// Newton steps at most; 19 were the most in 20,000 extreme draws.
const STEPS: usize = 64;

/// One step of length `lambda_dt` with log-likelihoods `log_lik` (tempered
/// already), on log weights.
#[inline(always)]
pub(super) fn step<T: Real>(
    scheme: DwsgScheme,
    lambda_dt: f64,
    log_lik: &[T],
    log_p: &mut [T],
    work: &mut [T],
) -> T::Mask {
    match scheme {
        DwsgScheme::Mixture => mixture(lambda_dt.min(1.0), log_lik, log_p, work),
        DwsgScheme::Left | DwsgScheme::Trapezoid => frozen(lambda_dt, log_lik, log_p, work),
    }
}

/// `p <- (1 - mu) p + mu Bayes(p)`.
///
/// ```text
/// ln p_i <- ln((1 - mu) p_i + mu p_i l_i / lbar),   lbar = sum p_j l_j
/// ```
/// as a sum of two logarithms, so that a model far behind is not lost.
#[inline(always)]
fn mixture<T: Real>(mu: f64, log_lik: &[T], log_p: &mut [T], work: &mut [T]) -> T::Mask {
    let n = log_p.len();
    for i in 0..n {
        work[i] = log_p[i] + log_lik[i];
    }
    let mean = log_sum_exp(&work[..n]);
    let good = mean.is_finite();
    let worst = T::splat(f64::NEG_INFINITY);
    let (stay, go) = (T::splat(libm::log(1.0 - mu)), T::splat(libm::log(mu)));
    for i in 0..n {
        let (old, new) = (stay + log_p[i], go + (work[i] - mean));
        let top = old.max(new);
        let some = top.gt(worst);
        let shift = T::select(some, top, T::zero());
        let sum = shift + ln(exp(old - shift) + exp(new - shift));
        let moved = T::select(some, sum, worst);
        log_p[i] = T::select(good, moved, log_p[i]);
    }
    normalise(log_p) & good
}

/// Exact for frozen likelihoods: with `l` scaled to a maximum of 1,
///
/// ```text
/// sum p_j e^{l_j sigma} = e^{lambda dt},   ln p_i += l_i sigma - lambda dt
/// ```
///
/// `sigma` by Newton's method on the logarithm of the sum, which is convex and
/// increasing, from two upper bounds: it falls monotonically to the root.
#[inline(always)]
fn frozen<T: Real>(lambda_dt: f64, log_lik: &[T], log_p: &mut [T], work: &mut [T]) -> T::Mask {
    let n = log_p.len();
    let (l, tilted) = work.split_at_mut(n);
    let top = largest(log_lik);
    let good = top.is_finite();
    let shift = T::select(good, top, T::zero());
    let goal = T::splat(lambda_dt);
    // Jensen: ln sum p e^{l sigma} >= lbar sigma; and every term is below the sum
    let mut mean = T::zero();
    let mut sigma = T::splat(f64::INFINITY);
    for i in 0..n {
        l[i] = exp(log_lik[i] - shift);
        mean = l[i].mul_add(exp(log_p[i]), mean);
        sigma = ((goal - log_p[i]) / l[i]).min(sigma);
    }
    sigma = (goal / mean).min(sigma);
    let mut done = !(good & sigma.is_finite());
    sigma = T::select(done, T::zero(), sigma);
    for _ in 0..STEPS {
        for i in 0..n {
            tilted[i] = l[i].mul_add(sigma, log_p[i]);
        }
        let value = log_sum_exp(tilted);
        let mut slope = T::zero();
        for i in 0..n {
            slope = l[i].mul_add(exp(tilted[i] - value), slope);
        }
        let next = sigma - (value - goal) / slope;
        // rounding ends the fall
        let falls = next.lt(sigma) & next.ge(T::zero());
        let step = (sigma - next).le(T::splat(2.0 * f64::EPSILON) * sigma);
        sigma = T::select(done | !falls, sigma, next);
        done = done | !falls | step;
        if done.all() {
            break;
        }
    }
    for i in 0..n {
        let change = l[i].mul_add(sigma, -goal);
        log_p[i] = T::select(good, log_p[i] + change, log_p[i]);
    }
    normalise(log_p) & good
}
