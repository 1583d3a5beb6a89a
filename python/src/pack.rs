//! Results out: vectors become arrays without a copy.

use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// `data` as an array of the given shape; the memory goes over to Python.
///
/// Fails only if the shape does not hold as many numbers.
pub(crate) fn array<'py, T: Element>(
    py: Python<'py>,
    data: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_vec(py, data).reshape(shape)
}

/// A dictionary of results under construction.
pub(crate) struct Pack<'py>(pub(crate) Bound<'py, PyDict>);

impl<'py> Pack<'py> {
    pub(crate) fn new(py: Python<'py>) -> Self {
        Self(PyDict::new(py))
    }

    /// An array.
    pub(crate) fn array<T: Element>(
        &self,
        name: &str,
        data: Vec<T>,
        shape: &[usize],
    ) -> PyResult<()> {
        self.0.set_item(name, array(self.0.py(), data, shape)?)
    }

    /// Anything else.
    pub(crate) fn set(&self, name: &str, value: impl IntoPyObject<'py>) -> PyResult<()> {
        self.0.set_item(name, value)
    }
}
