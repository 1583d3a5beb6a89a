//! Banks on recorded data.

use mmae::Error;
use mmae::engine::{Arrays, Mmae, Record};
use mmae::par::RunControl;
use mmae::scenario::Estimator;
use mmae::sim::chi_square_band;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Array, room};
use crate::errors;
use crate::guard::{self, Call};
use crate::pack::Pack;
use crate::scenario::Scenario;

/// Measurements between two looks at whether to stop.
const PIECE: usize = 4096;

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

/// Inputs as the engine's steps take them: those of a row act from its time on, so
/// that a discrete filter is told those of the row before.
fn shifted(u: &[f64], steps: usize, m: usize, continuous: bool) -> Vec<f64> {
    if continuous || u.is_empty() || m == 0 {
        return u.to_vec();
    }
    let mut out = Vec::with_capacity(u.len());
    for record in u.chunks(steps * m) {
        out.extend(std::iter::repeat_n(0.0, m));
        out.extend_from_slice(&record[..record.len() - m]);
    }
    out
}

/// Checks `y` and `u` and says how many records there are, and steps.
fn shapes(
    py: Python<'_>,
    y: &Array<'_>,
    u: Option<&Array<'_>>,
    [m, q]: [usize; 2],
) -> PyResult<[usize; 2]> {
    let (records, steps, outputs) = match *y.shape() {
        [steps, q] => (1, steps, q),
        [records, steps, q] => (records, steps, q),
        _ => {
            let text = "y: give an array of shape (time, output), or (record, time, output)";
            return Err(errors::input(py, text, "shape"));
        }
    };
    if outputs != q {
        let text = format!("y has {outputs} outputs, the plant {q}: give one column an output");
        return Err(errors::input(py, &text, "shape"));
    }
    if records == 0 || steps == 0 {
        return Err(errors::input(py, "y is empty: give at least one measurement", "empty"));
    }
    if let Some(u) = u {
        let fits = *u.shape() == [steps, m] || *u.shape() == [records, steps, m];
        if !fits || (u.shape().len() == 3 && y.shape().len() == 2) {
            let text = format!(
                "u has shape {:?}: give ({steps}, {m}), time by input, or that of every record",
                u.shape()
            );
            return Err(errors::input(py, &text, "shape"));
        }
    }
    Ok([records, steps])
}

/// One record through the bank, every step of it.
#[pyfunction]
#[pyo3(signature = (scenario, y, u, progress))]
pub(crate) fn estimate<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    y: &Bound<'py, PyAny>,
    u: Option<&Bound<'py, PyAny>>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let y = Array::take("y", y)?;
    let u = u.map(|u| Array::take("u", u)).transpose()?;
    let (estimator, mut mmae) = start(py, scenario)?;
    let [n, m, q] = mmae.bank().sizes();
    let [_, steps] = shapes(py, &y, u.as_ref(), [m, q])?;
    let (models, dt) = (estimator.labels.len(), mmae.bank().dt());
    room(py, "the record", steps as u128 * (models * (3 + q) + n + 1) as u128 * 8)?;
    let u = u.map_or(Vec::new(), |u| shifted(u.data(), steps, m, mmae.bank().is_continuous()));
    let y = y.data();
    let call = Call { threads: Some(1), progress };
    let ran = guard::long(py, &call, |control| filter(&mut mmae, &u, y, [m, q], control))?;
    let record = ran.map_err(|(k, e)| {
        let text = format!("sample {}: {e}", k + 1);
        match e {
            Error::AllFailed { .. } => errors::numerical(py, &text, e.code()),
            e => errors::input(py, &text, e.code()),
        }
    })?;
    let out = Pack::new(py);
    names(&out, &estimator)?;
    out.set("dt", dt)?;
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

/// The record in pieces, or the measurement at which it stopped and why.
fn filter(
    mmae: &mut Mmae,
    u: &[f64],
    y: &[f64],
    [m, q]: [usize; 2],
    control: &RunControl<'_>,
) -> Result<Record, (usize, Error)> {
    let mut all = Record::default();
    let total = y.len() / q;
    for first in (0..total).step_by(PIECE) {
        if control.is_cancelled() {
            return Err((first, Error::Cancelled));
        }
        let count = PIECE.min(total - first);
        let u = if u.is_empty() { u } else { &u[first * m..][..count * m] };
        let before = mmae.estimate().step;
        let piece = mmae.run(u, &y[first * q..][..count * q]);
        let at = first + (mmae.estimate().step - before) as usize;
        let piece = piece.map_err(|e| (at, e))?;
        all.steps += piece.steps;
        all.p.extend(piece.p);
        all.log_p.extend(piece.log_p);
        all.x_hat.extend(piece.x_hat);
        all.log_lik.extend(piece.log_lik);
        all.nis.extend(piece.nis);
        all.r.extend(piece.r);
        if let Some(report) = control.progress {
            report((first + count) as u64, total as u64);
        }
    }
    Ok(all)
}

/// Many records through the bank, reported every so many steps.
#[pyfunction]
#[pyo3(signature = (scenario, y, u, every, threads, progress))]
pub(crate) fn estimate_many<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    y: &Bound<'py, PyAny>,
    u: Option<&Bound<'py, PyAny>>,
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
    let u = u.map_or(Vec::new(), |u| shifted(u.data(), steps, m, mmae.bank().is_continuous()));
    let arrays = Arrays { records, steps, y: y.data(), u: &u, every };
    let call = Call { threads, progress };
    let ran = guard::long(py, &call, |control| mmae.run_arrays(&arrays, control))?;
    let courses = ran.map_err(|e| errors::engine(py, &e))?;
    let out = Pack::new(py);
    names(&out, &estimator)?;
    out.set("dt", mmae.bank().dt())?;
    let reports = courses.steps.len();
    out.array("steps", courses.steps, &[reports])?;
    out.array("log_p", courses.log_p, &[records, reports, models])?;
    out.array("x_hat", courses.x_hat, &[records, reports, n])?;
    out.array("log_lik", courses.log_lik, &[records])?;
    out.array("log_lik_models", courses.log_lik_models, &[records, models])?;
    out.array("failed", courses.failed, &[records, models])?;
    Ok(out.0)
}
