//! Other parameters behind those that are estimated.

use faer::Mat;

use crate::error::{Error, Result};
use crate::solve::backend::{Factors, least_squares};

/// Steps at most.
const STEPS: usize = 500;
/// Relative misfit that is reached.
const REACHED: f64 = 1e-9;
/// Damping at the start, and where it is given up.
const DAMPING: [f64; 2] = [1e-3, 1e16];

/// The parameters `phi` with `map(phi) = theta`, and the derivative `d phi / d theta`
/// (as many of both), by the method of Levenberg and Marquardt from `start`.
///
/// An observer canonical form identifies the coefficients `theta` of a transfer
/// function; masses and stiffnesses `phi` follow from them where there are as many. With
/// the covariance `P` of `theta` that of `phi` is `J P J'`, `J` the derivative. The search
/// goes by the logarithms of the parameters: each keeps the sign of its start.
///
/// # Errors
/// `Shape` for another number of parameters than of equations; `Range` for a start at
/// zero, and if the iteration does not come to an end; `Singular` where the map does not
/// determine `phi`.
///
/// # Source
/// Marquardt (1963), An algorithm for least-squares estimation of nonlinear parameters,
/// SIAM Journal 11.
///
/// ```
/// // stiffness and mass from k/m and 1/m
/// let map = |phi: &[f64], theta: &mut [f64]| {
///     theta.copy_from_slice(&[phi[0] / phi[1], 1.0 / phi[1]]);
/// };
/// let (phi, _) = mmae::adaptive::solve_parameters(map, &[3.0, 0.5], &[1.0, 1.0])?;
/// assert!((phi[0] - 6.0).abs() < 1e-9 && (phi[1] - 2.0).abs() < 1e-9);
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn solve_parameters(
    map: impl Fn(&[f64], &mut [f64]),
    theta: &[f64],
    start: &[f64],
) -> Result<(Vec<f64>, Mat<f64>)> {
    let p = theta.len();
    if start.len() != p {
        let (want, got) = ([p, 1], [start.len(), 1]);
        return Err(Error::Shape { what: "start of the parameters".into(), want, got });
    }
    if let Some(&value) = start.iter().find(|v| **v == 0.0 || !v.is_finite()) {
        let remedy = "give a number other than zero, of the sign that the parameter has".into();
        return Err(Error::Range { what: "start of a parameter".into(), value, remedy });
    }
    let problem = Problem { map: &map, theta, start };
    let mut log = vec![0.0; p];
    let mut residual = problem.misfit(&log);
    let mut damping = DAMPING[0];
    for _ in 0..STEPS {
        let slope = problem.slope(&log);
        if !(0..p).all(|i| (0..p).all(|j| slope[(i, j)].is_finite())) {
            break;
        }
        let (next, r) = loop {
            // [J; sqrt(damping) |J_k|] step = [-r; 0]
            let width = |k: usize| (0..p).map(|i| slope[(i, k)].powi(2)).sum::<f64>().sqrt();
            let left = Mat::from_fn(2 * p, p, |i, k| match i.checked_sub(p) {
                None => slope[(i, k)],
                Some(row) if row == k => damping.sqrt() * width(k).max(f64::MIN_POSITIVE),
                Some(_) => 0.0,
            });
            let right = Mat::from_fn(2 * p, 1, |i, _| if i < p { -residual[i] } else { 0.0 });
            let step = least_squares(left, right);
            let next: Vec<f64> = (0..p).map(|i| log[i] + step[(i, 0)]).collect();
            let r = problem.misfit(&next);
            // false for NaN as well
            if square(&r) < square(&residual) || damping > DAMPING[1] {
                break (next, r);
            }
            damping *= 4.0;
        };
        let better = square(&r) < square(&residual);
        if !better {
            break;
        }
        damping *= 0.2;
        (log, residual) = (next, r);
        if square(&residual).sqrt() < 1e-3 * REACHED {
            break;
        }
    }
    let reached = square(&residual).sqrt() < REACHED;
    if !reached {
        return Err(Error::Range {
            what: "misfit of the parameters behind theta".into(),
            value: square(&residual).sqrt(),
            remedy: "start closer to them, or check that the map can take these values".into(),
        });
    }
    // d log phi / d (theta / |theta|), brought to the units of both
    let mut inverse = Mat::identity(p, p);
    let singular = || Error::Singular { what: "the map from the parameters behind theta".into() };
    Factors::new(problem.slope(&log)).ok_or_else(singular)?.solve(&mut inverse);
    let phi = problem.at(&log);
    let slope = Mat::from_fn(p, p, |i, j| phi[i] * inverse[(i, j)] / problem.scale(j));
    Ok((phi, slope))
}

fn square(r: &[f64]) -> f64 {
    r.iter().map(|v| v * v).sum()
}

struct Problem<'a, F> {
    map: &'a F,
    theta: &'a [f64],
    start: &'a [f64],
}

impl<F: Fn(&[f64], &mut [f64])> Problem<'_, F> {
    fn at(&self, log: &[f64]) -> Vec<f64> {
        self.start.iter().zip(log).map(|(s, l)| s * libm::exp(*l)).collect()
    }

    fn scale(&self, i: usize) -> f64 {
        self.theta[i].abs().max(f64::MIN_POSITIVE)
    }

    /// `map(phi) - theta`, relative.
    fn misfit(&self, log: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.theta.len()];
        (self.map)(&self.at(log), &mut out);
        (0..out.len()).map(|i| (out[i] - self.theta[i]) / self.scale(i)).collect()
    }

    /// Its derivative, by differences of fourth order.
    fn slope(&self, log: &[f64]) -> Mat<f64> {
        const H: f64 = 1e-3;
        let p = log.len();
        let mut out = Mat::zeros(p, p);
        for k in 0..p {
            let side = |share: f64| {
                let mut moved = log.to_vec();
                moved[k] += share * H;
                self.misfit(&moved)
            };
            let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(side);
            for i in 0..p {
                out[(i, k)] = (a[i] - 8.0 * b[i] + 8.0 * c[i] - d[i]) / (12.0 * H);
            }
        }
        out
    }
}
