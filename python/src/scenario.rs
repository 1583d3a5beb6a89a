//! Scenarios: text in, checked; studies, banks and trials out.

use std::sync::Arc;

use mmae::model::Family;
use mmae::scenario;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors;
use crate::guard;
use crate::pack::Pack;
use crate::table::Table;

/// A scenario that was read and checked.
#[pyclass(frozen, module = "pymmae._core")]
pub(crate) struct Scenario {
    pub(crate) inner: scenario::Scenario,
    /// As it was given, for the digest of a study.
    pub(crate) text: String,
}

#[pymethods]
impl Scenario {
    /// Reads the scenario `text`; messages call it `name`. With `family` the plants
    /// are those of the dictionary, and the text has no `[plant]`.
    #[new]
    #[pyo3(signature = (name, text, family=None))]
    fn new(
        py: Python<'_>,
        name: &str,
        text: &str,
        family: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let family = family.map(|dict| Table::read(py, dict)).transpose()?;
        let family = family.map(|table| -> Arc<dyn Family> { Arc::new(table) });
        let parsed = guard::short(py, Some(1), |_| match family {
            None => scenario::Scenario::parse(name, text),
            Some(family) => scenario::Scenario::parse_with(name, text, family),
        })?;
        let inner = parsed.map_err(|e| errors::scenario(py, &e))?;
        Ok(Self { inner, text: text.into() })
    }

    /// Title, names and warnings.
    fn about<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let pack = Pack::new(py);
        let family = self.inner.family();
        let names = family.names();
        pack.set("title", self.inner.title())?;
        pack.set("continuous", family.time().is_continuous())?;
        pack.set("states", &names.states)?;
        pack.set("inputs", &names.inputs)?;
        pack.set("disturbances", &names.disturbances)?;
        pack.set("outputs", &names.outputs)?;
        let nominal: Vec<(&str, f64)> =
            family.parameters().iter().map(|p| (p.name.as_str(), p.nominal)).collect();
        pack.set("parameters", nominal)?;
        let observers: Vec<String> =
            self.inner.adaptive_observers().into_iter().map(|o| o.name).collect();
        pack.set("observers", observers)?;
        let warnings = self.inner.warnings().iter().map(|w| errors::diagnostic(py, w));
        pack.set("warnings", warnings.collect::<PyResult<Vec<_>>>()?)?;
        pack.set("has_study", self.inner.has_study())?;
        pack.set("has_run", self.inner.has_run())?;
        Ok(pack.0)
    }

    /// `A, B, G, C, Q, R` of the plant at the given parameter values.
    fn plant<'py>(
        &self,
        py: Python<'py>,
        values: Vec<(String, f64)>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let named: Vec<(&str, f64)> = values.iter().map(|(n, v)| (n.as_str(), *v)).collect();
        let family = self.inner.family();
        let made = guard::short(py, Some(1), |_| {
            let plant = family.plant(&family.theta_with(&named)?)?;
            plant.check().map(|()| plant)
        })?;
        let plant = made.map_err(|e| errors::engine(py, &e))?;
        let pack = Pack::new(py);
        for (letter, m) in [
            ("A", &plant.A),
            ("B", &plant.B),
            ("G", &plant.G),
            ("C", &plant.C),
            ("Q", &plant.Q),
            ("R", &plant.R),
        ] {
            let (rows, cols) = (m.nrows(), m.ncols());
            let entries = (0..rows * cols).map(|k| m[(k / cols, k % cols)]).collect();
            pack.array(letter, entries, &[rows, cols])?;
        }
        Ok(pack.0)
    }
}
