//! What is told of each problem.

use serde::Serialize;

use super::file::Kind;
use super::group::Flat;
use crate::error::{Error, Result};
use crate::real::Mask;
use crate::small::{self, Dyn};
use crate::solve::{ItemReport, backend};

/// One entry of the printed `cases`.
#[derive(Serialize)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(super) struct Answer {
    pub(super) id: String,
    pub(super) eq: &'static str,
    pub(super) status: &'static str,
    pub(super) code: Option<&'static str>,
    pub(super) message: Option<String>,
    pub(super) X: Option<Vec<Vec<f64>>>,
    pub(super) residual: Option<f64>,
    pub(super) error_bound: Option<f64>,
    pub(super) condition: Option<f64>,
    pub(super) reliable: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) cl_abscissa: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) cl_radius: Option<f64>,
    pub(super) iterations: Option<u32>,
}

impl Answer {
    pub(super) fn failed(id: &str, kind: Kind, error: &Error) -> Self {
        Answer {
            id: id.into(),
            eq: kind.name(),
            status: "error",
            code: Some(error.code()),
            message: Some(error.to_string()),
            X: None,
            residual: None,
            error_bound: None,
            condition: None,
            reliable: None,
            cl_abscissa: None,
            cl_radius: None,
            iterations: None,
        }
    }

    /// The answer to a problem whose solution is `x`.
    ///
    /// # Errors
    /// Of the eigenvalues of the closed loop.
    pub(super) fn solved(id: &str, p: &Flat, x: &[f64], report: &ItemReport) -> Result<Self> {
        let loop_matrix = closed_loop(p, x)?;
        let n = p.n;
        let modes =
            backend::eigenvalues(faer::Mat::from_fn(n, n, |i, j| loop_matrix[i * n + j]).as_ref())?;
        let finite = |v: f64| v.is_finite().then_some(v);
        let abscissa = modes.iter().fold(f64::NEG_INFINITY, |m, v| m.max(v.re));
        let radius = modes.iter().fold(0.0_f64, |m, v| m.max(v.re.hypot(v.im)));
        let continuous = p.kind.is_continuous();
        Ok(Answer {
            id: id.into(),
            eq: p.kind.name(),
            status: "ok",
            code: None,
            message: None,
            X: Some(x.chunks_exact(n).map(<[f64]>::to_vec).collect()),
            residual: finite(report.residual),
            error_bound: report.error_bound.and_then(finite),
            condition: report.condition.and_then(finite),
            reliable: Some(report.reliable),
            cl_abscissa: continuous.then_some(abscissa),
            cl_radius: (!continuous).then_some(radius),
            iterations: Some(report.iterations),
        })
    }
}

/// The matrix whose eigenvalues decide: `A - B K` of a Riccati equation, `A` of
/// a linear one.
///
/// ```text
/// continuous   K = R^-1 (B'X + S')
/// discrete     K = (R + B'XB)^-1 (B'XA + S')
/// ```
fn closed_loop(p: &Flat, x: &[f64]) -> Result<Vec<f64>> {
    let mut a = p.A.clone();
    if p.m == 0 {
        return Ok(a);
    }
    let (n, m) = (Dyn(p.n), Dyn(p.m));
    let mut bx = vec![0.0; p.m * p.n];
    small::mul_tn(m, n, n, &p.B, x, &mut bx);
    let (mut weight, mut gain) = (p.R.clone(), bx.clone());
    if !p.kind.is_continuous() {
        small::mul_add(m, n, m, &bx, &p.B, &mut weight);
        small::mul(m, n, n, &bx, &p.A, &mut gain);
    }
    if let Some(s) = &p.S {
        for i in 0..p.m {
            for j in 0..p.n {
                gain[i * p.n + j] += s[j * p.m + i];
            }
        }
    }
    let info = small::solve(m, n, &mut weight, &mut gain, &mut vec![0.0; p.m]);
    if !Mask::lane(info.ok, 0) {
        return Err(Error::Singular { what: "the weight of the inputs".into() });
    }
    small::mul_sub(n, m, n, &p.B, &gain, &mut a);
    Ok(a)
}
