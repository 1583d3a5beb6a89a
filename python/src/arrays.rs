//! Arrays in: float64, C order, without a copy where nobody can write to them.

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::input;

/// An array of numbers that stays as it is while the engine works.
///
/// Arrays that are frozen (read-only, as is every array that they are views of)
/// are used in place, others are copied before the interpreter lock goes: another
/// thread may write to them meanwhile.
pub(crate) struct Array<'py> {
    name: &'static str,
    shape: Vec<usize>,
    held: Held<'py>,
}

enum Held<'py> {
    /// In place.
    Lent(PyReadonlyArrayDyn<'py, f64>),
    Own(Vec<f64>),
}

impl<'py> Array<'py> {
    /// Takes the argument called `name`.
    ///
    /// float64 in C order goes straight through; `pymmae._arrays.convert` brings
    /// everything else into that form, or refuses it by name.
    pub(crate) fn take(name: &'static str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        let py = value.py();
        if let Some(array) = plain(value) {
            let shape = array.shape().to_vec();
            let lent = array.readonly();
            let held = match is_frozen(&array)? {
                true => Held::Lent(lent),
                false => {
                    room(py, name, array.len() as u128 * 8)?;
                    Held::Own(lent.as_slice()?.to_vec())
                }
            };
            return Ok(Self { name, shape, held });
        }
        let convert = py.import("pymmae._arrays")?.getattr("convert")?;
        let made = convert.call1((name, value))?;
        let Some(array) = plain(&made) else {
            return Err(input(py, &format!("{name} is no array of numbers: give one"), "dtype"));
        };
        // a new array that nobody else has
        let shape = array.shape().to_vec();
        Ok(Self { name, shape, held: Held::Lent(array.readonly()) })
    }

    pub(crate) fn shape(&self) -> &[usize] {
        &self.shape
    }

    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    /// The numbers in C order.
    pub(crate) fn data(&self) -> &[f64] {
        match &self.held {
            // contiguous, see `plain`
            Held::Lent(array) => array.as_slice().unwrap_or_default(),
            Held::Own(data) => data,
        }
    }

    /// True if no copy was made.
    pub(crate) fn is_lent(&self) -> bool {
        matches!(self.held, Held::Lent(_))
    }

    /// Its number of dimensions, or an error that says what is wanted.
    pub(crate) fn expect_dims(&self, py: Python<'_>, at_least: usize, form: &str) -> PyResult<()> {
        if self.shape.len() >= at_least {
            return Ok(());
        }
        let text = format!(
            "{} has {} dimensions: give an array of shape {form}",
            self.name,
            self.shape.len()
        );
        Err(input(py, &text, "shape"))
    }
}

/// The array itself if it is exactly float64 in C order, aligned, and no subclass.
fn plain<'py>(value: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArrayDyn<f64>>> {
    let array = value.cast_exact::<PyArrayDyn<f64>>().ok()?;
    let aligned = (array.data() as usize).is_multiple_of(align_of::<f64>());
    (aligned && array.is_c_contiguous()).then(|| array.clone())
}

/// True if no array can write to these numbers.
fn is_frozen(array: &Bound<'_, PyArrayDyn<f64>>) -> PyResult<bool> {
    let py = array.py();
    let mut at = array.as_any().clone();
    loop {
        let Ok(flags) = at.getattr("flags") else {
            // bytes never change; other owners may
            return Ok(at.is_instance_of::<pyo3::types::PyBytes>());
        };
        if flags.getattr("writeable")?.is_truthy()? {
            return Ok(false);
        }
        let base = at.getattr("base")?;
        if base.is(py.None()) {
            return Ok(true);
        }
        at = base;
    }
}

/// Fails with `LimitError` if `bytes` more do not fit in the machine's memory.
pub(crate) fn room(py: Python<'_>, what: &str, bytes: u128) -> PyResult<()> {
    const SMALL: u128 = 1 << 26;
    if bytes > SMALL {
        py.import("pymmae._arrays")?.getattr("room")?.call1((what, bytes))?;
    }
    Ok(())
}
