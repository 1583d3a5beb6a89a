//! Coefficients of a sample.

use super::plant::Tuning;
use crate::error::{Error, Result};
use crate::small::{Dyn, expm, expm_work};

/// The filter on an interval with linearly interpolated input, and the weights of the
/// least squares.
///
/// ```text
/// psi(k+1) = Phi psi(k) + G0 g(k) + G1 g(k+1),   Phi = e^{A_k h},   A_k = A - K C
/// E = exp([A_k I 0; 0 0 I; 0 0 0] h),   G1 = E_13 / h,   G0 = E_12 - G1
/// mu = e^{-lambda h},   w = (1 - mu) / lambda
/// ```
pub(super) struct Scheme {
    pub(super) phi: Vec<f64>,
    pub(super) g0: Vec<f64>,
    pub(super) g1: Vec<f64>,
    pub(super) mu: f64,
    pub(super) weight: f64,
}

impl Scheme {
    pub(super) fn new(tuning: &Tuning, h: f64) -> Result<Self> {
        let n = tuning.A.nrows();
        let a_k = closed(tuning);
        let size = 3 * n;
        let mut block = vec![0.0; size * size];
        for i in 0..n {
            for j in 0..n {
                block[i * size + j] = a_k[i * n + j] * h;
            }
            block[i * size + n + i] = h;
            block[(n + i) * size + 2 * n + i] = h;
        }
        let (mut e, mut work) = (vec![0.0; size * size], vec![0.0; expm_work(size)]);
        if !expm(Dyn(size), &block, &mut e, &mut work) {
            let what = "the exponential of (A - K C) dt".into();
            return Err(Error::NonFinite { what, row: 0, col: 0 });
        }
        let part = |col: usize| -> Vec<f64> {
            (0..n * n).map(|k| e[(k / n) * size + col * n + k % n]).collect()
        };
        let g1: Vec<f64> = part(2).iter().map(|v| v / h).collect();
        let g0 = part(1).iter().zip(&g1).map(|(all, last)| all - last).collect();
        Ok(Self {
            phi: part(0),
            g0,
            g1,
            mu: libm::exp(-tuning.lambda * h),
            weight: Self::weight(tuning.lambda, h),
        })
    }

    /// `(1 - e^{-lambda h}) / lambda`, `h` without forgetting.
    pub(super) fn weight(lambda: f64, h: f64) -> f64 {
        if lambda == 0.0 { h } else { -libm::expm1(-lambda * h) / lambda }
    }
}

/// `A - K C`, row by row.
pub(super) fn closed(tuning: &Tuning) -> Vec<f64> {
    let (n, q) = (tuning.A.nrows(), tuning.C.nrows());
    let entry = |i: usize, j: usize| {
        (0..q).fold(tuning.A[(i, j)], |sum, l| sum - tuning.K[(i, l)] * tuning.C[(l, j)])
    };
    (0..n * n).map(|e| entry(e / n, e % n)).collect()
}
