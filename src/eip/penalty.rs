//! What a wrong model costs the state estimate.

use faer::Mat;

use crate::eip::setup::{PairModel, Setup};
use crate::error::{Error, Result};
use crate::model::LoopBlock;
use crate::solve::{backend, lyapunov_continuous_one, lyapunov_discrete_one};

/// How much larger the state error of model `i` is than that of model `own`, whose
/// plant this is, in the metric of the latter.
///
/// ```text
/// tr(P_own^-1 E[e_i e_i'])/n - 1,   e_i = E x_p - x_hat_i
/// ```
///
/// # Errors
/// A plant that cannot be built, an unstable loop (`NotStable`), a state that is
/// known without error (`NotPositiveDefinite`).
pub(super) fn state_penalty(
    setup: &Setup,
    theta: &[f64],
    delay: f64,
    [i, own]: [usize; 2],
) -> Result<f64> {
    let (block, _) = setup.block(theta, delay, setup.delay_states())?;
    let covariance = |i: usize| match &setup.pairs[i] {
        Some(model) => state_error(&block, model),
        None => Err(Error::Empty { what: "the observer of a model".into() }),
    };
    let (wrong, right) = (covariance(i)?, covariance(own)?);
    let inverse = backend::spd_inverse("covariance of the state error", right.as_ref())?;
    let n = inverse.nrows();
    let product = &inverse * &wrong;
    Ok((0..n).map(|k| product[(k, k)]).sum::<f64>() / n as f64 - 1.0)
}

/// `E[e e']` of one model: the last block of the joint Lyapunov equation.
///
/// ```text
/// [A 0; N F] X + X [A 0; N F]' + [B; M] [B; M]' = 0
/// N = E A - A_i E - B_i C_u - H_i (C_y - C_i E),   M = E B - H_i D_y - B_i D_u
/// ```
fn state_error(block: &LoopBlock, m: &PairModel) -> Result<Mat<f64>> {
    let (np, n) = (block.np(), m.F.nrows());
    let e = Mat::from_fn(n, np, |i, j| f64::from(u8::from(i == j)));
    let cross = &e * &block.A - &m.A * &e - &m.B * &block.Cu - &m.H * (&block.Cy - &m.C * &e);
    let input = &e * &block.B - &m.H * &block.Dy - &m.B * &block.Du;
    let a = Mat::from_fn(np + n, np + n, |i, j| match (i < np, j < np) {
        (true, true) => block.A[(i, j)],
        (true, false) => 0.0,
        (false, true) => cross[(i - np, j)],
        (false, false) => m.F[(i - np, j - np)],
    });
    let b =
        Mat::from_fn(
            np + n,
            block.nw(),
            |i, j| {
                if i < np { block.B[(i, j)] } else { input[(i - np, j)] }
            },
        );
    let q = &b * b.transpose();
    let solve =
        if block.time.is_continuous() { lyapunov_continuous_one } else { lyapunov_discrete_one };
    let x = solve(a.as_ref(), q.as_ref())?.X;
    Ok(Mat::from_fn(n, n, |i, j| x[(np + i, np + j)]))
}
