//! Why a Riccati equation has no stabilizing solution.

use faer::Mat;

use crate::error::Error;
use crate::solve::backend::Factors;
use crate::solve::lanes::Kind;
use crate::solve::modes::{Region, unseen_mode};
use crate::solve::problem::Field;

/// The reason that item `k` of `fields` (`A B Q R`, perhaps `S`) has no
/// stabilizing solution, as far as its modes tell; `reached` is the residual and
/// the number of iterations of the best attempt.
pub(super) fn explain(
    kind: Kind,
    [n, m]: [usize; 2],
    fields: &[Field<'_>],
    k: usize,
    reached: (f64, u32),
) -> Error {
    let continuous = kind == Kind::Continuous;
    let what = || String::from(if continuous { "CARE" } else { "DARE" });
    let matrix = |at: usize, rows: usize, cols: usize| {
        let x = fields[at].item(k);
        Mat::from_fn(rows, cols, |i, j| x[i * cols + j])
    };
    let (a, b) = (matrix(0, n, n), matrix(1, n, m));
    let unreached = unseen_mode(a.transpose(), b.transpose(), continuous, Region::Unstable);
    if let Ok(Some(mode)) = unreached {
        let states = mode.states(None);
        return Error::NotStabilizable { what: what(), eigenvalue: mode.eigenvalue, states };
    }
    let (q, r) = (matrix(2, n, n), matrix(3, m, m));
    let s = fields.get(4).map(|_| matrix(4, n, m));
    if let Some((a, q)) = without_cross_term(a, &b, q, r, s) {
        let unseen = unseen_mode(a.as_ref(), q.as_ref(), continuous, Region::Boundary);
        if let Ok(Some(mode)) = unseen {
            let states = mode.states(None);
            return Error::NotDetectable { what: what(), eigenvalue: mode.eigenvalue, states };
        }
    }
    let (residual, iterations) = reached;
    Error::NoStabilizingSolution { what: what(), residual, iterations }
}

/// `A - B R^-1 S'` and `Q - S R^-1 S'`; `None` for a singular `R` with a cross
/// term.
fn without_cross_term(
    mut a: Mat<f64>,
    b: &Mat<f64>,
    mut q: Mat<f64>,
    r: Mat<f64>,
    s: Option<Mat<f64>>,
) -> Option<(Mat<f64>, Mat<f64>)> {
    let Some(s) = s else { return Some((a, q)) };
    let (n, m) = (s.nrows(), s.ncols());
    let mut gain = s.transpose().to_owned();
    if m > 0 {
        Factors::new(r)?.solve(&mut gain);
    }
    for j in 0..n {
        for i in 0..n {
            for l in 0..m {
                a[(i, j)] -= b[(i, l)] * gain[(l, j)];
                q[(i, j)] -= s[(i, l)] * gain[(l, j)];
            }
        }
    }
    Some((a, q))
}
