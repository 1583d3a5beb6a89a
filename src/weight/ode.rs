//! Dunn's law as an ordinary differential equation.

use super::log::{log_sum_exp, normalise};
use crate::real::{Real, exp};

/// Signals of one interval for [`Law::Ode`](super::Law::Ode), whitened: both in
/// the norm of `R^-1`.
///
/// `2 substeps + 1` equidistant nodes from the start of the interval to its end.
#[derive(Debug, Clone, Copy)]
pub struct OdeNodes<'a, T> {
    /// `R^-1/2 h_i(t)`, `h_i = C_i x_hat_i`, shape (node, model, output).
    pub h: &'a [T],
    /// `R^-1/2 y(t)`, shape (node, output).
    pub y: &'a [T],
    /// Length of the interval in seconds.
    pub dt: f64,
}

/// One interval by `substeps` steps of the classical Runge-Kutta method.
///
/// ```text
/// d ln p_i / dt = h_i' R^-1 (y - sum_j p_j h_j)   (up to a common term)
/// ```
///
/// Fourth order; positive and of sum one by construction. Stable while the step
/// times `|spread of h|^2 / 4` is below 2.785.
#[inline(always)]
pub(super) fn step<T: Real>(
    nodes: &OdeNodes<'_, T>,
    substeps: usize,
    log_p: &mut [T],
    work: &mut [T],
) -> T::Mask {
    let n = log_p.len();
    let q = nodes.y.len() / (2 * substeps + 1);
    let step = nodes.dt / substeps as f64;
    let (stage, rest) = work.split_at_mut(n);
    let (slope, sum) = rest.split_at_mut(n);
    for s in 0..substeps {
        // weights of the four slopes, and how far along the last one to look
        let plan = [(0, 1.0, 0.0), (1, 2.0, 0.5), (1, 2.0, 0.5), (2, 1.0, 1.0)];
        sum[..n].fill(T::zero());
        slope[..n].fill(T::zero());
        for (node, weight, along) in plan {
            for i in 0..n {
                stage[i] = slope[i].mul_add(T::splat(along * step), log_p[i]);
            }
            let at = 2 * s + node;
            rates(&nodes.h[at * n * q..][..n * q], &nodes.y[at * q..][..q], stage, slope);
            for i in 0..n {
                sum[i] = slope[i].mul_add(T::splat(weight), sum[i]);
            }
        }
        for i in 0..n {
            log_p[i] = sum[i].mul_add(T::splat(step / 6.0), log_p[i]);
        }
    }
    normalise(log_p)
}

/// `h_i' (y - sum_j p_j h_j)` at log weights `l`; `l` is used up.
#[inline(always)]
fn rates<T: Real>(h: &[T], y: &[T], l: &mut [T], out: &mut [T]) {
    let (n, q) = (l.len(), y.len());
    let total = log_sum_exp(l);
    for i in 0..n {
        l[i] = exp(l[i] - total);
    }
    out[..n].fill(T::zero());
    for c in 0..q {
        let mut mean = T::zero();
        for j in 0..n {
            mean = l[j].mul_add(h[j * q + c], mean);
        }
        let error = y[c] - mean;
        for i in 0..n {
            out[i] = h[i * q + c].mul_add(error, out[i]);
        }
    }
}
