//! Errors of the engine as the exceptions of `pymmae.errors`.

use mmae::report::write;
use mmae::{Error, scenario, sweep};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// An exception of `pymmae.errors` by name.
fn raise(py: Python<'_>, class: &str, message: &str, code: &str) -> PyErr {
    let made = py
        .import("pymmae.errors")
        .and_then(|module| module.getattr(class))
        .and_then(|class| class.call1((message, code)));
    made.map_or_else(|error| error, PyErr::from_value)
}

/// Bad input that the binding itself finds.
pub(crate) fn input(py: Python<'_>, message: &str, code: &str) -> PyErr {
    raise(py, "InputError", message, code)
}

/// A panic of the engine.
pub(crate) fn internal(py: Python<'_>, message: &str) -> PyErr {
    let text = format!("the engine failed: {message}: this is a bug, please report it");
    raise(py, "InternalError", &text, "internal")
}

/// The class for an error of the engine.
fn class_of(error: &Error) -> &'static str {
    match error {
        Error::Limit { .. } => "LimitError",
        Error::Cancelled => "Cancelled",
        Error::Model { source, .. } | Error::Plant { source, .. } => class_of(source),
        Error::AllFailed { .. }
        | Error::Undetectable { .. }
        | Error::Unstabilizable { .. }
        | Error::NoStabilizingSolution { .. }
        | Error::NotStabilizable { .. }
        | Error::NotDetectable { .. }
        | Error::FiniteEscape { .. }
        | Error::Singular { .. }
        | Error::NotStable { .. }
        | Error::NoUniqueSolution { .. }
        | Error::UnstablePlant { .. }
        | Error::Quadrature { .. } => "NumericalError",
        _ => "InputError",
    }
}

/// An error of the engine.
pub(crate) fn engine(py: Python<'_>, error: &Error) -> PyErr {
    raise(py, class_of(error), &error.to_string(), error.code())
}

/// Why a scenario cannot be used.
pub(crate) fn scenario(py: Python<'_>, error: &scenario::Error) -> PyErr {
    let message = error.to_string();
    let (class, code) = match error {
        scenario::Error::Read { .. } => ("FileError", "read"),
        scenario::Error::TooLarge { .. } => ("LimitError", "limit"),
        scenario::Error::Engine { source, .. } => match class_of(source) {
            "InputError" => ("ScenarioError", source.code()),
            class => (class, source.code()),
        },
        _ => ("ScenarioError", "scenario"),
    };
    let raised = raise(py, class, &message, code);
    let list: PyResult<Vec<_>> = error.diagnostics().iter().map(|d| diagnostic(py, d)).collect();
    match list.and_then(|list| raised.value(py).setattr("diagnostics", list)) {
        Ok(()) => raised,
        Err(error) => error,
    }
}

/// Place, message and remedy of one thing that is wrong.
pub(crate) fn diagnostic<'py>(
    py: Python<'py>,
    d: &scenario::Diagnostic,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("file", &d.file)?;
    dict.set_item("line", d.line)?;
    dict.set_item("column", d.column)?;
    dict.set_item("key", &d.key)?;
    dict.set_item("message", &d.message)?;
    dict.set_item("remedy", &d.remedy)?;
    Ok(dict)
}

/// A record or trial that came to nothing.
pub(crate) fn numerical(py: Python<'_>, message: &str, code: &str) -> PyErr {
    raise(py, "NumericalError", message, code)
}

/// Why a shard or a merge did not come to its end.
pub(crate) fn sweep(py: Python<'_>, error: &sweep::Error) -> PyErr {
    let text = error.to_string();
    match error {
        sweep::Error::Engine(error) => engine(py, error),
        sweep::Error::Files(write::Error::Locked { .. }) => raise(py, "FileError", &text, "locked"),
        sweep::Error::Files(_) => raise(py, "FileError", &text, "write"),
        sweep::Error::Stopped { .. } => raise(py, "Cancelled", &text, "cancelled"),
        sweep::Error::Incomplete { .. } => raise(py, "SweepError", &text, "incomplete"),
        _ => raise(py, "InputError", &text, "conflict"),
    }
}
