//! What lanes could not do, one item at a time.
//!
//! A Riccati equation gets its start from the matrix sign function instead of
//! from doubling: slower, but without the growth of doubling on a strongly
//! unstable `A` with small weights, and without a positive definite `R`.
//! Correction and verification are those of the lanes, run on `f64`.

use faer::Mat;

use crate::solve::backend::{self, Factors};
use crate::solve::lanes::{Coefficients, Kind};

/// Steps after which the sign iteration is given up.
const MAX_STEPS: usize = 100;
/// Steps that are scaled by the determinant; the others converge quadratically.
const SCALED_STEPS: usize = 30;
/// Relative change at which the iteration ends.
const SETTLED: f64 = 1e-13;

/// A start for the correction, from the matrix sign function, with the steps
/// spent; `None` where the equation has eigenvalues on the boundary of
/// stability.
///
/// ```text
/// continuous   Z0 = [[A, -G], [-Q, -A']]
/// discrete     Z0 = [[A + I, G], [-Q, A' + I]]^-1 [[A - I, -G], [-Q, I - A']]
/// Z <- (c Z + (c Z)^-1)/2,  c = |det Z|^(-1/2n)  ->  S;     (S + I) [I; X] = 0
/// ```
/// Roberts (1980), Int. J. Control 32, 677-687; Byers (1987), Linear Algebra
/// Appl. 85, 267-279.
pub(super) fn sign_start(
    kind: Kind,
    n: usize,
    c: Coefficients<'_, f64>,
) -> Option<(Vec<f64>, u32)> {
    let at = |x: &[f64], i: usize, j: usize| x[i * n + j];
    let blocks = |a: f64, diagonal: f64, g: f64, q: f64, flip: f64| {
        Mat::from_fn(2 * n, 2 * n, |i, j| {
            let unit = if i % n == j % n { diagonal } else { 0.0 };
            match (i < n, j < n) {
                (true, true) => a * at(c.a, i, j) + unit,
                (true, false) => g * at(c.g, i, j - n),
                (false, true) => q * at(c.q, i - n, j),
                (false, false) => flip * (a * at(c.a, j - n, i - n) + unit),
            }
        })
    };
    let mut z = match kind {
        Kind::Continuous => blocks(1.0, 0.0, -1.0, -1.0, -1.0),
        Kind::Discrete => {
            let sum = blocks(1.0, 1.0, 1.0, -1.0, 1.0);
            let mut z = blocks(1.0, -1.0, -1.0, -1.0, -1.0);
            Factors::new(sum)?.solve(&mut z);
            z
        }
    };
    let mut last = f64::INFINITY;
    for step in 1..=MAX_STEPS {
        let factors = Factors::new(z.clone())?;
        let mut inverse = Mat::<f64>::identity(2 * n, 2 * n);
        factors.solve(&mut inverse);
        let mean_log = factors.log_det() / (2 * n) as f64;
        let scale = if step <= SCALED_STEPS { libm::exp(-mean_log) } else { 1.0 };
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let (mut change, mut size) = (0.0, 0.0);
        for j in 0..2 * n {
            for i in 0..2 * n {
                let next = 0.5 * (scale * z[(i, j)] + inverse[(i, j)] / scale);
                let moved = next - z[(i, j)];
                change += moved * moved;
                size += next * next;
                z[(i, j)] = next;
            }
        }
        let change = (change / size).sqrt();
        // Rounding keeps an ill-conditioned iteration from settling: the
        // correction can still take it from there.
        let stalled = step > SCALED_STEPS && change > 0.5 * last;
        last = change;
        if change <= SETTLED || stalled {
            let x = from_sign(n, &z);
            return x.iter().all(|v| v.is_finite()).then_some((x, step as u32));
        }
        if !change.is_finite() {
            return None;
        }
    }
    None
}

/// `X` from `(S + I) [I; X] = 0`, symmetric.
fn from_sign(n: usize, s: &Mat<f64>) -> Vec<f64> {
    let shifted = |i: usize, j: usize| s[(i, j)] + if i == j { 1.0 } else { 0.0 };
    let left = Mat::from_fn(2 * n, n, |i, j| shifted(i, n + j));
    let right = Mat::from_fn(2 * n, n, |i, j| -shifted(i, j));
    let x = backend::least_squares(left, right);
    (0..n * n).map(|e| 0.5 * (x[(e / n, e % n)] + x[(e % n, e / n)])).collect()
}
