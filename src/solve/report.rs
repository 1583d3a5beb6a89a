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
    /// measured before the last correction, in twice the working precision; for an
    /// item that needed none, in the working precision.
    pub residual: f64,
    /// Size of the last correction relative to `X`, in balanced coordinates:
    /// what the iteration could still see. Zero for an item that needed none.
    pub correction: f64,
    /// Verified stability margin of the closed loop (of `A` itself for linear
    /// equations): every eigenvalue has `Re <= -margin` in continuous time,
    /// modulus `<= 1 - margin` in discrete time. A lower bound, from powers of
    /// the matrix; not positive or NaN if stability was not shown.
    pub margin: f64,
    /// Doubling steps spent, corrections included.
    pub iterations: u32,
    /// Bound on `|X - X_exact| / |X|` in the Frobenius norm, where computed:
    /// from the residual or the last corrections, and the condition, see
    /// [the guide](crate::guide::solvers). Exact is the solution for the numbers
    /// as given.
    pub error_bound: Option<f64>,
    /// Condition, where computed: by how much a residual relative to the terms of
    /// the equation is amplified in `X`, in balanced coordinates. A relative
    /// change of the data by `d` moves `X` by up to `condition * d`. Of a Lyapunov
    /// equation it may be some times as large as it need be, where that is still
    /// small enough for an error bound of 1e-13.
    pub condition: Option<f64>,
    /// False where the solution should not be used without thought: rounding of
    /// the data alone may move it by more than 1e-6 (`condition > 4.5e9`), the
    /// error bound is above that, or `R` is not positive definite in continuous
    /// time.
    pub reliable: bool,
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
            condition: None,
            reliable: false,
            method: Method::None,
        }
    }

    /// The report of an item that was refused before any work.
    pub(crate) fn refused(error: Error) -> Self {
        ItemReport { status: Err(error), ..Self::pending() }
    }
}

/// What is called reliable: an error, and a condition times the rounding of the
/// data, up to this.
const RELIABLE: f64 = 1e-6;

/// Error bound and condition as a report holds them (`None` for NaN: not
/// computed), and whether they are small enough to rely on.
pub(crate) fn judged(error_bound: f64, condition: f64) -> (Option<f64>, Option<f64>, bool) {
    let known = |x: f64| (!x.is_nan()).then_some(x);
    let large = error_bound > RELIABLE || condition * f64::EPSILON > RELIABLE;
    (known(error_bound), known(condition), !large)
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
