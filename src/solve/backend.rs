//! The only place where faer's algorithms are called; always sequential, so
//! that results do not depend on the number of threads.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{
    ComputeEigenvectors, evd_real, evd_scratch, self_adjoint_evd, self_adjoint_evd_scratch,
};
use faer::linalg::lu::partial_pivoting::{factor as lu, solve as lu_solve};
use faer::linalg::qr::no_pivoting::{factor as qr, solve as qr_solve};
use faer::perm::PermRef;
use faer::prelude::Solve;
use faer::prelude::default;
use faer::{Mat, MatRef, Par, Side};

use crate::error::{Eigenvalue, Error, Result};

/// Eigenvalues and eigenvectors of a real matrix.
///
/// Complex pairs take two columns of the vector matrices: real part, then
/// imaginary part of the vector of the eigenvalue with positive imaginary part.
pub struct Eigen {
    /// Eigenvalues; members of a pair are neighbours.
    pub values: Vec<Eigenvalue>,
    /// Right eigenvectors, packed.
    pub right: Mat<f64>,
    /// Left eigenvectors, packed.
    pub left: Mat<f64>,
}

fn failed(what: &str, n: usize) -> Error {
    Error::Range {
        what: format!("{what} of an order-{n} matrix"),
        value: f64::NAN,
        remedy: "the QR iteration did not converge; scale the states to similar size".into(),
    }
}

fn square_finite(what: &str, a: MatRef<'_, f64>) -> Result<usize> {
    let n = a.nrows();
    if a.ncols() != n {
        return Err(Error::Shape { what: what.into(), want: [n, n], got: [n, a.ncols()] });
    }
    for row in 0..n {
        for col in 0..n {
            if !a[(row, col)].is_finite() {
                return Err(Error::NonFinite { what: what.into(), row, col });
            }
        }
    }
    Ok(n)
}

/// Eigenvalues of a symmetric matrix, in increasing order (only the lower
/// triangle is read).
///
/// # Errors
/// `NonFinite`; `Range` if the iteration does not converge.
pub fn symmetric_eigenvalues(a: MatRef<'_, f64>) -> Result<Vec<f64>> {
    let n = square_finite("matrix", a)?;
    if n == 0 {
        return Ok(Vec::new());
    }
    let mut s = Diag::<f64>::zeros(n);
    let scratch = self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::No, Par::Seq, default());
    self_adjoint_evd(
        a,
        s.as_mut(),
        None,
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        default(),
    )
    .map_err(|_| failed("eigenvalues", n))?;
    Ok((0..n).map(|i| s[i]).collect())
}

/// Eigenvalues of a real matrix.
///
/// # Errors
/// `Shape`, `NonFinite`; `Range` if the iteration does not converge.
pub fn eigenvalues(a: MatRef<'_, f64>) -> Result<Vec<Eigenvalue>> {
    Ok(eigen_parts(a, ComputeEigenvectors::No)?.values)
}

/// Eigenvalues with right and left eigenvectors of a real matrix.
///
/// # Errors
/// As [`eigenvalues`].
pub fn eigen(a: MatRef<'_, f64>) -> Result<Eigen> {
    eigen_parts(a, ComputeEigenvectors::Yes)
}

fn eigen_parts(a: MatRef<'_, f64>, vectors: ComputeEigenvectors) -> Result<Eigen> {
    let n = square_finite("A", a)?;
    let size = if vectors == ComputeEigenvectors::Yes { n } else { 0 };
    let (mut left, mut right) = (Mat::zeros(size, size), Mat::zeros(size, size));
    if n == 0 {
        return Ok(Eigen { values: Vec::new(), right, left });
    }
    let (mut re, mut im) = (Diag::<f64>::zeros(n), Diag::<f64>::zeros(n));
    let scratch = evd_scratch::<f64>(n, vectors, vectors, Par::Seq, default());
    evd_real(
        a,
        re.as_mut(),
        im.as_mut(),
        (size > 0).then(|| left.as_mut()),
        (size > 0).then(|| right.as_mut()),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        default(),
    )
    .map_err(|_| failed("eigenvalues", n))?;
    let values = (0..n).map(|i| Eigenvalue { re: re[i], im: im[i] }).collect();
    Ok(Eigen { values, right, left })
}

/// Singular values of a real matrix, in decreasing order.
///
/// # Errors
/// `Range` if the iteration does not converge.
pub fn singular_values(a: MatRef<'_, f64>) -> Result<Vec<f64>> {
    a.singular_values().map_err(|_| failed("singular values", a.nrows()))
}

/// `P A = L U` with partial pivoting.
pub(crate) struct Factors {
    lu: Mat<f64>,
    perm: Vec<usize>,
    perm_inv: Vec<usize>,
}

impl Factors {
    /// Factors `a`; `None` if a pivot is zero or not finite.
    pub(crate) fn new(mut a: Mat<f64>) -> Option<Self> {
        let n = a.nrows();
        let (mut perm, mut perm_inv) = (vec![0_usize; n], vec![0_usize; n]);
        let scratch = lu::lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        lu::lu_in_place(a.as_mut(), &mut perm, &mut perm_inv, Par::Seq, stack, default());
        let sound = (0..n).all(|i| a[(i, i)] != 0.0 && a[(i, i)].is_finite());
        sound.then_some(Factors { lu: a, perm, perm_inv })
    }

    /// `ln|det A|`.
    pub(crate) fn log_det(&self) -> f64 {
        (0..self.lu.nrows()).map(|i| libm::log(self.lu[(i, i)].abs())).sum()
    }

    /// `B <- A^-1 B`.
    pub(crate) fn solve(&self, b: &mut Mat<f64>) {
        let n = self.lu.nrows();
        let scratch = lu_solve::solve_in_place_scratch::<usize, f64>(n, b.ncols(), Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        // Made by the factorisation: a permutation and its inverse.
        let perm = PermRef::new_checked(&self.perm, &self.perm_inv, n);
        let factors = self.lu.as_ref();
        lu_solve::solve_in_place(factors, factors, perm, b.as_mut(), Par::Seq, stack);
    }
}

/// The `X` of least `|A X - B|`, `A` with at least as many rows as columns, by
/// Householder QR.
pub(crate) fn least_squares(mut a: Mat<f64>, mut b: Mat<f64>) -> Mat<f64> {
    let (rows, cols) = (a.nrows(), a.ncols());
    let block = qr::recommended_block_size::<f64>(rows, cols);
    let mut reflectors = Mat::zeros(block, cols);
    let scratch = qr::qr_in_place_scratch::<f64>(rows, cols, block, Par::Seq, default())
        .or(qr_solve::solve_lstsq_in_place_scratch::<f64>(rows, cols, block, b.ncols(), Par::Seq));
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    qr::qr_in_place(a.as_mut(), reflectors.as_mut(), Par::Seq, stack, default());
    let stack = MemStack::new(&mut memory);
    let (basis, factor) = (a.as_ref(), reflectors.as_ref());
    qr_solve::solve_lstsq_in_place(basis, factor, basis, b.as_mut(), Par::Seq, stack);
    Mat::from_fn(cols, b.ncols(), |i, j| b[(i, j)])
}

/// Inverse of a symmetric positive definite matrix; `what` names it in errors.
///
/// # Errors
/// `NotPositiveDefinite`.
pub fn spd_inverse(what: &str, m: MatRef<'_, f64>) -> Result<Mat<f64>> {
    let n = m.nrows();
    let factor =
        m.llt(Side::Lower).map_err(|_| Error::NotPositiveDefinite { what: what.into() })?;
    let inverse = factor.solve(Mat::<f64>::identity(n, n));
    Ok(Mat::from_fn(n, n, |i, j| 0.5 * (inverse[(i, j)] + inverse[(j, i)])))
}

/// `ln det` of a symmetric positive definite matrix; `what` names it in errors.
///
/// # Errors
/// `NotPositiveDefinite`.
pub fn spd_ln_det(what: &str, m: MatRef<'_, f64>) -> Result<f64> {
    let factor =
        m.llt(Side::Lower).map_err(|_| Error::NotPositiveDefinite { what: what.into() })?;
    let l = factor.L();
    Ok((0..m.nrows()).map(|i| 2.0 * libm::log(l[(i, i)])).sum())
}
