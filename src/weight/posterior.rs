//! Bayes's rule at the end of records whose log-likelihoods are given.

use super::state::check_prior;
use crate::error::{Error, Result};
use crate::real::{Mask, Real, exp};
use crate::simd::{Block, Kernel, dispatch};

/// Probabilities of the models after each record, shape (record, model), from the
/// log-likelihoods of the record under each, as
/// [`Mmae::log_likelihoods`](crate::engine::Mmae::log_likelihoods) returns them.
///
/// ```text
/// p_i = p_i(0) e^{l_i} / sum_j p_j(0) e^{l_j}
/// ```
/// `prior` need not sum to one. A model without a log-likelihood (NaN: its filter
/// failed) has no weight; a record without a finite one has NaN for all models.
///
/// ```
/// use mmae::weight::posterior;
/// let p = posterior(&[1.0, 3.0], &[-1000.0, -1000.0, -5.0, f64::NAN])?;
/// assert!((p[0] - 0.25).abs() < 1e-15 && (p[0] + p[1] - 1.0).abs() < 1e-15);
/// assert_eq!(p[2..], [1.0, 0.0]);
/// # Ok::<(), mmae::Error>(())
/// ```
///
/// # Source
/// Zhang et al. (2018), (4), over all steps at once.
///
/// # Errors
/// Of [`check_prior`]; `Shape` unless there is a number per model and record.
pub fn posterior(prior: &[f64], log_lik: &[f64]) -> Result<Vec<f64>> {
    let log_prior = check_prior(prior)?;
    let models = prior.len();
    if !log_lik.len().is_multiple_of(models) {
        return Err(Error::Shape {
            what: "log-likelihoods of the records".into(),
            want: [log_lik.len().div_ceil(models), models],
            got: [1, log_lik.len()],
        });
    }
    let mut p = vec![0.0; log_lik.len()];
    dispatch(Posterior { log_prior: &log_prior, log_lik, p: &mut p });
    Ok(p)
}

struct Posterior<'a> {
    log_prior: &'a [f64],
    log_lik: &'a [f64],
    p: &'a mut [f64],
}

impl Kernel for Posterior<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let models = self.log_prior.len();
        let mut p = vec![T::zero(); models];
        let lanes = T::LANES * models;
        for (log_lik, out) in self.log_lik.chunks(lanes).zip(self.p.chunks_mut(lanes)) {
            let last = log_lik.len() / models - 1;
            let none = T::splat(f64::NEG_INFINITY);
            let mut best = none;
            for i in 0..models {
                let mut of_model = Block::default();
                for l in 0..T::LANES {
                    of_model.0[l] = log_lik[l.min(last) * models + i];
                }
                let l = T::load(&of_model.0);
                let counts = self.log_prior[i] > f64::NEG_INFINITY;
                p[i] = T::select(l.eq(l) & T::Mask::splat(counts), l, none);
                best = best.max(p[i]);
            }
            // differences first: long records have large sums, and priors have digits
            let mut top = none;
            for i in 0..models {
                p[i] = (p[i] - best) + T::splat(self.log_prior[i]);
                top = top.max(p[i]);
            }
            let none = T::select(best.is_finite(), T::zero(), T::splat(f64::NAN));
            let mut sum = none;
            for p in &mut p {
                *p = exp(*p - top);
                sum = sum + *p;
            }
            let inverse = sum.recip();
            for i in 0..models {
                let mut of_model = Block::default();
                (p[i] * inverse).store(&mut of_model.0);
                for l in 0..T::LANES.min(last + 1) {
                    out[l * models + i] = of_model.0[l];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::posterior;

    #[test]
    fn records_are_the_same_in_any_company() {
        let log_lik: Vec<f64> = (0..39 * 3).map(|k| 30.0 * (k as f64 * 0.7).sin()).collect();
        let prior = [1.0, 0.0, 2.0];
        let all = posterior(&prior, &log_lik).unwrap();
        for (l, p) in log_lik.chunks(3).zip(all.chunks(3)) {
            assert_eq!(p, posterior(&prior, l).unwrap());
            let odds = (l[2] - l[0]).exp() * 2.0;
            assert!((p[2] / p[0] / odds - 1.0).abs() < 1e-13 && p[1] == 0.0);
            assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn nothing_is_passed_on_silently() {
        let (none, gone) = (f64::NEG_INFINITY, f64::NAN);
        let p = posterior(&[1.0, 1.0], &[gone, gone, none, none, none, 3.0]).unwrap();
        assert!(p[..4].iter().all(|p| p.is_nan()));
        assert_eq!(p[4..], [0.0, 1.0]);
        assert!(posterior(&[1.0, 1.0], &[0.0; 3]).is_err());
        assert!(posterior(&[1.0, -1.0], &[0.0; 2]).is_err());
        assert!(posterior(&[1.0, 1.0], &[]).unwrap().is_empty());
    }
}
