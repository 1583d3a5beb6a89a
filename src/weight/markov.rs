//! Models that may change between steps: a Markov chain on their indices.

use faer::Mat;

use super::log::log_sum_exp;
use crate::error::{Error, Result};
use crate::real::Real;

/// Probabilities of going from one model to another between two measurements.
///
/// ```text
/// p_j <- sum_i Pi_ij p_i
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    models: usize,
    /// `ln Pi_ij` at `i * models + j`.
    log: Vec<f64>,
    /// `Pi_ij`.
    linear: Vec<f64>,
}

impl Transition {
    /// From `Pi`, N by N, each row summing to one.
    ///
    /// # Errors
    /// `Shape`; `Range` for an entry that is no probability and a row that does
    /// not sum to one within 1e-9.
    pub fn new(pi: &Mat<f64>) -> Result<Self> {
        let n = pi.nrows();
        if pi.ncols() != n {
            return Err(Error::Shape { what: "Pi".into(), want: [n, n], got: [n, pi.ncols()] });
        }
        let mut linear = Vec::with_capacity(n * n);
        for i in 0..n {
            let mut sum = 0.0;
            for j in 0..n {
                let p = pi[(i, j)];
                if !(0.0..=1.0).contains(&p) {
                    return Err(Error::Range {
                        what: format!("Pi[{i}][{j}]"),
                        value: p,
                        remedy: "give a probability".into(),
                    });
                }
                sum += p;
            }
            if (sum - 1.0).abs() > 1e-9 {
                return Err(Error::Range {
                    what: format!("sum of row {i} of Pi"),
                    value: sum,
                    remedy: "rows hold the probabilities of where to go: make each sum to 1".into(),
                });
            }
            linear.extend((0..n).map(|j| pi[(i, j)] / sum));
        }
        let log = linear.iter().map(|&p| libm::log(p)).collect();
        Ok(Self { models: n, log, linear })
    }

    /// Stays with probability `stay`, goes to each other model with the same
    /// share of the rest.
    ///
    /// # Errors
    /// `Range` unless `stay` is a probability.
    pub fn sticky(models: usize, stay: f64) -> Result<Self> {
        let rest = if models > 1 { (1.0 - stay) / (models - 1) as f64 } else { 0.0 };
        let diagonal = if models > 1 { stay } else { 1.0 };
        Self::new(&Mat::from_fn(models, models, |i, j| if i == j { diagonal } else { rest }))
    }

    /// Number of models.
    pub fn models(&self) -> usize {
        self.models
    }

    /// `Pi_ij`.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.linear[i * self.models + j]
    }

    /// `ln p_j <- ln sum_i Pi_ij p_i`; `work` holds `2 N` numbers.
    #[inline(always)]
    pub(super) fn apply<T: Real>(&self, log_p: &mut [T], work: &mut [T]) {
        let n = self.models;
        let (terms, mixed) = work.split_at_mut(n);
        for j in 0..n {
            for i in 0..n {
                terms[i] = log_p[i] + T::splat(self.log[i * n + j]);
            }
            mixed[j] = log_sum_exp(&terms[..n]);
        }
        log_p.copy_from_slice(&mixed[..n]);
    }
}
