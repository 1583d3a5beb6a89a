//! Banks on recorded data.

use mmae::Error;
use mmae::engine::{Arrays, Mmae};
use mmae::scenario::Estimator;
use mmae::sim::chi_square_band;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Array, room};
use crate::errors;
use crate::guard::{self, Call};
use crate::pack::Pack;
use crate::record::{Signals, filter, intervals, many_uneven, shapes, shifted, times};
use crate::scenario::Scenario;

/// What models and states are called.
pub(crate) fn names(out: &Pack<'_>, estimator: &Estimator) -> PyResult<()> {
    out.set("parameters", &estimator.parameters)?;
    let (models, parameters) = (estimator.labels.len(), estimator.parameters.len());
    let values = estimator.values.iter().flatten().copied().collect();
    out.array("values", values, &[models, parameters])?;
    out.set("labels", &estimator.labels)?;
    out.set("law", estimator.weighting.law.name())?;
    out.set("states", &estimator.names.states)?;
    out.set("inputs", &estimator.names.inputs)?;
    out.set("outputs", &estimator.names.outputs)
}

/// The bank of a scenario, at its start.
fn start(py: Python<'_>, scenario: &Scenario) -> PyResult<(Estimator, Mmae)> {
    let scenario = &scenario.inner;
    let estimator = scenario.estimator().map_err(|e| errors::scenario(py, &e))?;
    let started = guard::short(py, Some(1), |_| estimator.start())?;
    let mmae = started.map_err(|e| errors::scenario(py, &scenario.explain_run(e)))?;
    Ok((estimator, mmae))
}

/// One record through the bank, every step of it.
#[pyfunction]
#[pyo3(signature = (scenario, y, u, t, progress))]
pub(crate) fn estimate<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    y: &Bound<'py, PyAny>,
    u: Option<&Bound<'py, PyAny>>,
    t: Option<&Bound<'py, PyAny>>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let y = Array::take("y", y)?;
    let u = u.map(|u| Array::take("u", u)).transpose()?;
    let (estimator, mut mmae) = start(py, scenario)?;
    let [n, m, q] = mmae.bank().sizes();
    let [_, steps] = shapes(py, &y, u.as_ref(), [m, q])?;
    let (models, dt) = (estimator.labels.len(), mmae.bank().dt());
    room(py, "the record", steps as u128 * (models * (3 + q) + n + 1) as u128 * 8)?;
    let t = times(py, t, steps)?;
    let since = intervals(py, t.as_ref(), &estimator, dt)?;
    let u = u.map_or(Vec::new(), |u| shifted(u.data(), steps, m, mmae.bank().is_continuous()));
    let y = y.data();
    let signals = Signals { y, u: &u, since: since.as_deref() };
    let call = Call { threads: Some(1), progress };
    let ran = guard::long(py, &call, |control| filter(&estimator, &mut mmae, &signals, control))?;
    let record = match ran {
        (record, None) => record,
        (_, Some((k, e))) => {
            let text = format!("sample {}: {e}", k + 1);
            return Err(match e {
                Error::AllFailed { .. } => errors::numerical(py, &text, e.code()),
                e => errors::input(py, &text, e.code()),
            });
        }
    };
    let out = Pack::new(py);
    names(&out, &estimator)?;
    let evenly = || (1..=steps).map(|k| k as f64 * dt).collect();
    out.array("t", t.map_or_else(evenly, |t| t.data().to_vec()), &[steps])?;
    out.array("p", record.p, &[steps, models])?;
    out.array("log_p", record.log_p, &[steps, models])?;
    out.array("x_hat", record.x_hat, &[steps, n])?;
    out.array("log_lik", record.log_lik, &[steps])?;
    out.array("nis", record.nis, &[steps, models])?;
    out.array("r", record.r, &[steps, models, q])?;
    let e = mmae.estimate();
    out.array("log_lik_models", e.log_lik_models.clone(), &[models])?;
    out.array("failed", e.failed.clone(), &[models])?;
    let present: Vec<usize> =
        y.chunks(q).map(|y| y.iter().filter(|v| !v.is_nan()).count()).filter(|n| *n > 0).collect();
    let (seen, samples) = (present.iter().sum::<usize>() as f64, present.len() as f64);
    out.set("nis_band", chi_square_band(seen / samples, samples))?;
    Ok(out.0)
}

/// Many records through the bank, reported every so many steps.
#[pyfunction]
#[pyo3(signature = (scenario, y, u, t, every, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "signals, and how they are run")]
pub(crate) fn estimate_many<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    y: &Bound<'py, PyAny>,
    u: Option<&Bound<'py, PyAny>>,
    t: Option<&Bound<'py, PyAny>>,
    every: usize,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let y = Array::take("y", y)?;
    let u = u.map(|u| Array::take("u", u)).transpose()?;
    let (estimator, mmae) = start(py, scenario)?;
    let [n, m, q] = mmae.bank().sizes();
    let [records, steps] = shapes(py, &y, u.as_ref(), [m, q])?;
    let models = estimator.labels.len();
    let reports = steps.checked_div(every).map_or(1, |n| n + 1);
    let rows = records as u128 * reports as u128;
    room(py, "the courses of the records", rows * (models + n) as u128 * 8)?;
    let (t, dt) = (times(py, t, steps)?, mmae.bank().dt());
    let since = intervals(py, t.as_ref(), &estimator, dt)?;
    let u = u.map_or(Vec::new(), |u| shifted(u.data(), steps, m, mmae.bank().is_continuous()));
    let arrays = Arrays { records, steps, y: y.data(), u: &u, every };
    let call = Call { threads, progress };
    let ran = guard::long(py, &call, |control| match &since {
        Some(since) => many_uneven(&estimator, &mmae, &arrays, since, control),
        None => mmae.run_arrays(&arrays, control),
    })?;
    let courses = ran.map_err(|e| errors::engine(py, &e))?;
    let out = Pack::new(py);
    names(&out, &estimator)?;
    let reports = courses.steps.len();
    let at = |k: &usize| t.as_ref().map_or(*k as f64 * dt, |t| t.data()[k - 1]);
    out.array("t", courses.steps.iter().map(at).collect(), &[reports])?;
    out.array("log_p", courses.log_p, &[records, reports, models])?;
    out.array("x_hat", courses.x_hat, &[records, reports, n])?;
    out.array("log_lik", courses.log_lik, &[records])?;
    out.array("log_lik_models", courses.log_lik_models, &[records, models])?;
    out.array("failed", courses.failed, &[records, models])?;
    Ok(out.0)
}
