//! Checks of one matrix: shape, finiteness, symmetry, definiteness.

use faer::{Mat, MatRef};

use crate::error::{Error, Result};
use crate::solve::backend;

/// Relative asymmetry that is taken for rounding and symmetrised away.
const SYMMETRY: f64 = 1e-12;
/// Negative eigenvalues below this share of the largest are rounding.
const DEFINITENESS: f64 = 1e-12;

/// Fails with `Shape` unless `m` is `want[0]` by `want[1]`.
pub fn check_shape(what: &str, m: MatRef<'_, f64>, want: [usize; 2]) -> Result<()> {
    let got = [m.nrows(), m.ncols()];
    if got == want { Ok(()) } else { Err(Error::Shape { what: what.into(), want, got }) }
}

/// Fails with `Conflict` unless there are `want` names of `what`.
pub(crate) fn check_count(what: &str, names: &[String], want: usize) -> Result<()> {
    if names.len() == want {
        return Ok(());
    }
    Err(Error::Conflict {
        problem: format!("{} names of {what} for {want}", names.len()),
        remedy: "give one name each".into(),
    })
}

/// Fails with `NonFinite` at the first NaN or infinite entry.
pub fn check_finite(what: &str, m: MatRef<'_, f64>) -> Result<()> {
    for row in 0..m.nrows() {
        for col in 0..m.ncols() {
            if !m[(row, col)].is_finite() {
                return Err(Error::NonFinite { what: what.into(), row, col });
            }
        }
    }
    Ok(())
}

/// Fails with `NonFinite` for an infinite output or an input that is no number; `y` and `u`
/// hold rows of `q` outputs and `m` inputs, `steps` to a record.
pub(crate) fn check_signals(y: &[f64], u: &[f64], steps: usize, [m, q]: [usize; 2]) -> Result<()> {
    let place = |at: usize, width: usize, what: &str| {
        let (row, col) = (at / width, at % width);
        let (record, row) = (row / steps, row % steps);
        Err(Error::NonFinite { what: format!("{what} of record {record}"), row, col })
    };
    if let Some(at) = y.iter().position(|v| v.is_infinite()) {
        return place(at, q, "y");
    }
    if let Some(at) = u.iter().position(|v| !v.is_finite()) {
        return place(at, m, "u");
    }
    Ok(())
}

/// Fails unless the finite square matrix `m` is symmetric (to 1e-12 of its
/// largest entry) and positive semidefinite, or definite where `definite`.
pub fn check_covariance(what: &str, m: MatRef<'_, f64>, definite: bool) -> Result<()> {
    let n = m.nrows();
    let mut largest = 0.0_f64;
    let mut difference = 0.0_f64;
    for i in 0..n {
        for j in 0..n {
            largest = largest.max(m[(i, j)].abs());
            difference = difference.max((m[(i, j)] - m[(j, i)]).abs());
        }
    }
    if difference > SYMMETRY * largest {
        return Err(Error::NotSymmetric { what: what.into(), relative: difference / largest });
    }
    let eigenvalues = backend::symmetric_eigenvalues(m)?;
    let (Some(&min_eig), Some(&max_eig)) = (eigenvalues.first(), eigenvalues.last()) else {
        return Ok(());
    };
    if min_eig < -DEFINITENESS * max_eig.abs().max(min_eig.abs()) {
        return Err(Error::NotPsd { what: what.into(), min_eig });
    }
    if definite && !scaled_definite(m)? {
        return Err(Error::NotPositiveDefinite { what: what.into() });
    }
    Ok(())
}

/// Definiteness judged after scaling to a unit diagonal, so that channels in
/// different units (1e-10 beside 1e10) are not taken for a singular matrix.
fn scaled_definite(m: MatRef<'_, f64>) -> Result<bool> {
    let n = m.nrows();
    if (0..n).any(|i| m[(i, i)] <= 0.0) {
        return Ok(false);
    }
    let root: Vec<f64> = (0..n).map(|i| m[(i, i)].sqrt()).collect();
    let scaled = Mat::from_fn(n, n, |i, j| m[(i, j)] / root[i] / root[j]);
    let eigenvalues = backend::symmetric_eigenvalues(scaled.as_ref())?;
    Ok(eigenvalues.first().is_none_or(|&e| e > 4.0 * f64::EPSILON * n as f64))
}
