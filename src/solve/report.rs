//! Solutions and what is known about each.

use faer::Mat;

use crate::error::{Error, Result};

/// Which algorithm the returned `X` came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Doubling in lanes, eight problems at a time.
    Doubling,
    /// The per-item path: large orders, and what the lanes could not do.
    Fallback,
    /// None: the item has no solution.
    None,
}

/// What is known about one solution.
#[derive(Debug, Clone, PartialEq)]
pub struct ItemReport {
    /// `Ok`, or why the item has no solution; its `X` is then NaN throughout.
    pub status: Result<(), Error>,
    /// Frobenius norm of the residual over the sum of the norms of its terms,
    /// in balanced coordinates (so a change of units leaves it alone). It is
    /// measured before the last correction, in twice the working precision.
    pub residual: f64,
    /// Size of the last correction relative to `X`, in balanced coordinates:
    /// what the iteration could still see.
    pub correction: f64,
    /// Verified stability margin of the closed loop (of `A` itself for linear
    /// equations): every eigenvalue has `Re <= -margin` in continuous time,
    /// modulus `<= 1 - margin` in discrete time. A lower bound, from powers of
    /// the matrix; not positive or NaN if stability was not shown.
    pub margin: f64,
    /// Doubling steps spent, corrections included.
    pub iterations: u32,
    /// Bound on `|X - X_exact| / |X|` in the Frobenius norm, where computed.
    pub error_bound: Option<f64>,
    /// The algorithm.
    pub method: Method,
}

impl ItemReport {
    /// A report yet to be filled in.
    pub(crate) fn pending() -> Self {
        ItemReport {
            status: Ok(()),
            residual: f64::NAN,
            correction: f64::NAN,
            margin: f64::NAN,
            iterations: 0,
            error_bound: None,
            method: Method::None,
        }
    }

    /// The report of an item that was refused before any work.
    pub(crate) fn refused(error: Error) -> Self {
        ItemReport { status: Err(error), ..Self::pending() }
    }
}

/// Solutions of a batch.
#[derive(Debug, Clone, PartialEq)]
pub struct Solutions {
    /// Rows of each `X`.
    pub rows: usize,
    /// Columns of each `X`.
    pub cols: usize,
    /// All `X` in C order, shape `(len, rows, cols)`; NaN where the status is an
    /// error.
    pub x: Vec<f64>,
    /// One report an item.
    pub items: Vec<ItemReport>,
}

impl Solutions {
    /// Number of items.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// True if there is no item.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// `X` of item `k` row by row, or why there is none.
    ///
    /// # Errors
    /// The item's status.
    ///
    /// # Panics
    /// Unless `k < len`.
    pub fn item(&self, k: usize) -> Result<&[f64]> {
        let size = self.rows * self.cols;
        match &self.items[k].status {
            Ok(()) => Ok(&self.x[k * size..][..size]),
            Err(error) => Err(error.clone()),
        }
    }

    /// `X` of item `k` as a matrix.
    ///
    /// # Errors
    /// As [`Solutions::item`].
    ///
    /// # Panics
    /// Unless `k < len`.
    pub fn matrix(&self, k: usize) -> Result<Mat<f64>> {
        let x = self.item(k)?;
        Ok(Mat::from_fn(self.rows, self.cols, |i, j| x[i * self.cols + j]))
    }

    /// The only item of a batch of one.
    pub(crate) fn into_one(mut self) -> Result<Solution> {
        let x = self.matrix(0)?;
        Ok(Solution { X: x, report: self.items.swap_remove(0) })
    }
}

/// The solution of one problem.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Solution {
    /// The solution.
    pub X: Mat<f64>,
    /// What is known about it; its status is `Ok`.
    pub report: ItemReport,
}
