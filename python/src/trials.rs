//! Simulated trials: statistics over all, courses of some.

use mmae::sim::{LEVELS, Moment, Summary};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::room;
use crate::errors;
use crate::estimate::names;
use crate::guard::{self, Call};
use crate::pack::Pack;
use crate::scenario::Scenario;

/// Runs the trials of a scenario; the courses of the first `keep` are kept.
#[pyfunction]
#[pyo3(signature = (scenario, truth, trials, seed, every, keep, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "all that the command line takes")]
pub(crate) fn trials<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    truth: Vec<(String, f64)>,
    trials: Option<u64>,
    seed: Option<u64>,
    every: Option<u64>,
    keep: u64,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let scenario = &scenario.inner;
    let built = guard::short(py, Some(1), |_| scenario.simulation(&truth))?;
    let mut simulation = built.map_err(|e| errors::scenario(py, &e))?;
    simulation.trials = trials.unwrap_or(simulation.trials);
    simulation.seed = seed.unwrap_or(simulation.seed);
    simulation.every = every.unwrap_or(simulation.every);
    let keep = keep.min(simulation.trials);
    let estimator = &simulation.estimator;
    let reports = match simulation.every {
        0 => 1,
        every => simulation.steps / every + 1,
    };
    let (models, states) = (estimator.labels.len(), estimator.names.states.len());
    let row = 72 * (10 * models + 4 * states + 8);
    room(py, "the reports of the trials", u128::from(reports) * row as u128)?;
    let course = 8 * (models + 2 * states + estimator.names.outputs.len() + 8);
    let courses = u128::from(keep) * u128::from(reports) * course as u128;
    room(py, "the courses of the trials", courses)?;
    let experiment = simulation.experiment((0..keep).collect());
    let ran = guard::long(py, &Call { threads, progress }, |control| experiment.run(control))?;
    let summary = ran.map_err(|e| errors::scenario(py, &scenario.explain_run(e)))?;
    let out = Pack::new(py);
    names(&out, estimator)?;
    out.set("dt", simulation.dt)?;
    out.set("title", scenario.title())?;
    out.set("trials", summary.trials)?;
    out.set("steps", summary.steps)?;
    out.set("seed", summary.seed)?;
    out.set("nis_band", summary.nis_band)?;
    out.set("nees_band", summary.nees_band)?;
    out.array("levels", LEVELS.to_vec(), &[LEVELS.len()])?;
    let failures: Vec<(usize, String)> = (summary.failures.iter().enumerate())
        .filter_map(|(i, f)| Some((i, f.as_ref()?.to_string())))
        .collect();
    out.set("failures", failures)?;
    let theta = summary.record.iter().flat_map(|m| simulation.theta(m.step)).copied().collect();
    let parameters = match &simulation.schedule[..] {
        [] => 0,
        _ => estimator.parameters.len(),
    };
    out.array("theta", theta, &[summary.record.len(), parameters])?;
    statistics(&out, &summary)?;
    if keep > 0 {
        courses_of(&out, &summary)?;
    }
    Ok(out.0)
}

/// One array a statistic, the first dimension is the report.
fn statistics(out: &Pack<'_>, summary: &Summary) -> PyResult<()> {
    let record = &summary.record;
    let reports = record.len();
    let steps: Vec<u64> = record.iter().map(|m| m.step).collect();
    out.array("record", steps, &[reports])?;
    type List = fn(&Moment) -> &[f64];
    let lists: [(&str, List); 10] = [
        ("p", |m| &m.p),
        ("p_std", |m| &m.p_std),
        ("log_p", |m| &m.log_p),
        ("identified", |m| &m.identified),
        ("nis", |m| &m.nis),
        ("nis_inside", |m| &m.nis_inside),
        ("nees", |m| &m.nees),
        ("nees_inside", |m| &m.nees_inside),
        ("x_error_mean", |m| &m.x_error_mean),
        ("x_error_std", |m| &m.x_error_std),
    ];
    for (name, list) in lists {
        let data: Vec<f64> = record.iter().flat_map(list).copied().collect();
        let width = data.len() / reports.max(1);
        out.array(name, data, &[reports, width])?;
    }
    let failed: Vec<f64> = record.iter().flat_map(|m| &m.failed).copied().collect();
    let models = failed.len() / reports.max(1);
    out.array("failed", failed, &[reports, models])?;
    type Spread = fn(&Moment) -> &[[f64; 5]];
    let spreads: [(&str, Spread); 3] = [
        ("p_quantiles", |m| &m.p_quantiles),
        ("theta_hat_quantiles", |m| &m.theta_hat_quantiles),
        ("x_error_quantiles", |m| &m.x_error_quantiles),
    ];
    for (name, spread) in spreads {
        let data: Vec<f64> = record.iter().flat_map(spread).flatten().copied().collect();
        let width = data.len() / (reports.max(1) * LEVELS.len());
        out.array(name, data, &[reports, width, LEVELS.len()])?;
    }
    let norms = record.iter().flat_map(|m| m.x_error_norm_quantiles).collect();
    out.array("x_error_norm_quantiles", norms, &[reports, LEVELS.len()])?;
    for (name, one) in [
        ("x_error_rms", (|m: &Moment| m.x_error_rms) as fn(&Moment) -> f64),
        ("nees_fused", |m| m.nees_fused),
        ("nees_fused_inside", |m| m.nees_fused_inside),
    ] {
        out.array(name, record.iter().map(one).collect(), &[reports])?;
    }
    Ok(())
}

/// Courses of the trials that were kept: trial by report by quantity.
fn courses_of(out: &Pack<'_>, summary: &Summary) -> PyResult<()> {
    let (trials, reports) = (summary.kept.len(), summary.record.len());
    let numbers: Vec<u64> = summary.kept.iter().map(|t| t.trial).collect();
    out.array("trial", numbers, &[trials])?;
    type Course = fn(&mmae::sim::Trajectory) -> &[f64];
    let all: [(&str, Course); 5] = [
        ("course_x", |t| &t.x),
        ("course_x_hat", |t| &t.x_hat),
        ("course_y", |t| &t.y),
        ("course_u", |t| &t.u),
        ("course_log_p", |t| &t.log_p),
    ];
    for (name, course) in all {
        let data: Vec<f64> = summary.kept.iter().flat_map(course).copied().collect();
        let width = data.len() / (trials * reports).max(1);
        out.array(name, data, &[trials, reports, width])?;
    }
    Ok(())
}
