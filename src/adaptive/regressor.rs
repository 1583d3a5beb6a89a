//! What multiplies the parameters: columns that are given, and unknown entries of
//! `A`.

use std::fmt;

/// The regressors `Gamma(y, u, t)` of a plant and its known terms.
///
/// ```text
/// x' = A x + Gamma(y, u, t) theta + f(y, u, t)
/// ```
/// The one trait of this module that users implement; [`FnRegressor`] makes one of a
/// closure. It must have the same value for the same arguments: trials, threads and
/// lanes call it in any order.
pub trait Regressor: Send + Sync {
    /// Columns of `Gamma`: parameters that are no entries of `A`.
    fn columns(&self) -> usize;

    /// Writes `Gamma`, column after column (n numbers each), and the known term `f`
    /// (n numbers, zero on entry), at `t` seconds, inputs `u` and outputs `y`.
    fn evaluate(&self, t: f64, u: &[f64], y: &[f64], gamma: &mut [f64], known: &mut [f64]);
}

/// A [`Regressor`] from a closure.
///
/// ```
/// use mmae::adaptive::{FnRegressor, Regressor};
/// // columns [0, u] and [0, sin y], no known term
/// let regressor = FnRegressor::new(2, |_t, u, y, gamma, _known| {
///     gamma.copy_from_slice(&[0.0, u[0], 0.0, y[0].sin()]);
/// });
/// let (mut gamma, mut known) = ([0.0; 4], [0.0; 2]);
/// regressor.evaluate(0.0, &[2.0], &[0.5], &mut gamma, &mut known);
/// assert_eq!((gamma[1], gamma[3], known), (2.0, 0.5_f64.sin(), [0.0; 2]));
/// ```
pub struct FnRegressor<F> {
    columns: usize,
    f: F,
}

impl<F> FnRegressor<F>
where
    F: Fn(f64, &[f64], &[f64], &mut [f64], &mut [f64]) + Send + Sync,
{
    /// A regressor of `columns` columns that `f` writes, see [`Regressor::evaluate`].
    pub fn new(columns: usize, f: F) -> Self {
        Self { columns, f }
    }
}

impl<F> Regressor for FnRegressor<F>
where
    F: Fn(f64, &[f64], &[f64], &mut [f64], &mut [f64]) + Send + Sync,
{
    fn columns(&self) -> usize {
        self.columns
    }

    fn evaluate(&self, t: f64, u: &[f64], y: &[f64], gamma: &mut [f64], known: &mut [f64]) {
        (self.f)(t, u, y, gamma, known);
    }
}

impl<F> fmt::Debug for FnRegressor<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FnRegressor").field("columns", &self.columns).finish_non_exhaustive()
    }
}

/// What a parameter multiplies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    /// The unknown part of `A[row][col]`: the regressor is `E_row x_col`, with the
    /// measured state where an output is that state alone, else the estimated one.
    Entry {
        /// Row of the entry.
        row: usize,
        /// Its column.
        col: usize,
    },
    /// The next column of the [`Regressor`], in the order of the parameters.
    Given,
}

/// An unknown parameter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unknown {
    /// Its name.
    pub name: String,
    /// What it multiplies.
    pub column: Column,
}

impl Unknown {
    /// The unknown part of `A[row][col]`.
    pub fn entry(name: &str, row: usize, col: usize) -> Self {
        Self { name: name.into(), column: Column::Entry { row, col } }
    }

    /// The parameter of the next given column.
    pub fn given(name: &str) -> Self {
        Self { name: name.into(), column: Column::Given }
    }
}
