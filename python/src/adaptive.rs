//! Adaptive observers: simulated and on recorded data, over grids of tunings.

use mmae::Error;
use mmae::adaptive::{Courses, Records, Settings, run_records};
use mmae::par::RunControl;
use mmae::scenario::Since;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Array, room};
use crate::errors;
use crate::guard::{self, Call};
use crate::observer::Task;
use crate::pack::Pack;
use crate::record::{shapes, times};
use crate::scenario::Scenario;

/// The plant of a scenario under its adaptive observer: trials of every tuning and case.
#[pyfunction]
#[pyo3(signature = (scenario, observer, grid, case, truth, trials, seed, every, tolerance, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "all that can be asked")]
pub(crate) fn adaptive_trials<'py>(
    py: Python<'py>,
    scenario: &'py Bound<'py, Scenario>,
    observer: Option<&str>,
    grid: &Bound<'py, PyDict>,
    case: Option<&str>,
    truth: Vec<(String, f64)>,
    trials: Option<u64>,
    seed: Option<u64>,
    every: Option<u64>,
    tolerance: f64,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let task = Task::new(py, scenario.get(), observer, grid)?;
    let inner = &task.scenario.inner;
    let mut cases = inner.adaptive_cases(&truth).map_err(|e| errors::scenario(py, &e))?;
    if let Some(name) = case {
        let names: Vec<String> = cases.iter().map(|c| c.name.clone()).collect();
        cases.retain(|c| c.name == name);
        if cases.is_empty() {
            let text =
                format!("case: none is called '{name}': the scenario has {}", names.join(", "));
            return Err(errors::input(py, &text, "unknown_case"));
        }
    }
    for case in &mut cases {
        let own = &mut case.trials[task.number];
        own.trials = trials.unwrap_or(own.trials);
        own.seed = seed.unwrap_or(own.seed);
        own.every = every.unwrap_or(own.every);
    }
    let call = Call { threads, progress };
    let ran = guard::long(py, &call, |control| {
        let mut all = Vec::new();
        for (k, case) in cases.iter().enumerate() {
            let (before, count) = (k as u64, cases.len() as u64);
            let report = |done: u64, total: u64| {
                if let Some(report) = control.progress {
                    report(before * total + done, count * total);
                }
            };
            let part = RunControl { progress: Some(&report), ..*control };
            all.push(case.trials[task.number].courses(&task.tunings, tolerance, &part)?);
        }
        let reports = all[0].t.len();
        let courses: Vec<Courses> =
            all.iter_mut().map(|run| std::mem::take(&mut run.courses)).collect();
        let behind = task.behind(&courses, reports);
        Ok((all, courses, behind))
    })?;
    let (runs, courses, behind) = ran.map_err(|e| match e {
        e @ (Error::Shape { .. } | Error::NonFinite { .. } | Error::Range { .. })
            if !task.stacked =>
        {
            errors::scenario(py, &inner.explain_adaptive(e, &task.observer.name))
        }
        e => task.raise(py, e),
    })?;
    task.left(py, &courses)?;
    let out = Pack::new(py);
    task.describe(&out, &courses[0])?;
    let (count, reports) = (cases.len(), runs[0].t.len());
    let own = |i: usize| &cases[i].trials[task.number];
    out.set("cases", cases.iter().map(|c| c.name.as_str()).collect::<Vec<_>>())?;
    out.set("plant_states", &cases[0].states)?;
    out.set("trials", own(0).trials)?;
    out.set("seed", own(0).seed)?;
    out.set("samples", own(0).samples)?;
    out.array("t", runs[0].t.clone(), &[reports])?;
    let x = runs.iter().flat_map(|run| run.x.iter().copied()).collect();
    out.array("x", x, &[count, reports, cases[0].states.len()])?;
    out.array("truth_steps", runs.iter().map(|run| run.parts).collect(), &[count])?;
    out.array("truth_error", runs.iter().map(|run| run.truth_error).collect(), &[count])?;
    let truths = |lists: Vec<&Option<Vec<f64>>>| -> Option<Vec<f64>> {
        lists.into_iter().cloned().collect::<Option<Vec<_>>>().map(|lists| lists.concat())
    };
    let known = truths(cases.iter().map(|c| &c.theta[task.number]).collect());
    out.set("theta", known)?;
    out.set("physical_theta", truths(cases.iter().map(|c| &c.physical[task.number]).collect()))?;
    task.physical(&out, behind, count)?;
    task.courses(&out, courses, reports)?;
    Ok(out.0)
}

/// Recorded data under the adaptive observer of a scenario: every tuning, every record.
#[pyfunction]
#[pyo3(signature = (scenario, observer, grid, y, u, t, every, tolerance, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "all that can be asked")]
pub(crate) fn adaptive_records<'py>(
    py: Python<'py>,
    scenario: &'py Bound<'py, Scenario>,
    observer: Option<&str>,
    grid: &Bound<'py, PyDict>,
    y: &Bound<'py, PyAny>,
    u: Option<&Bound<'py, PyAny>>,
    t: Option<&Bound<'py, PyAny>>,
    every: usize,
    tolerance: f64,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let y = Array::take("y", y)?;
    let u = u.map(|u| Array::take("u", u)).transpose()?;
    let task = Task::new(py, scenario.get(), observer, grid)?;
    let [_, m, q, _] = task.observer.structure.sizes();
    let [records, samples] = shapes(py, &y, u.as_ref(), [m, q])?;
    let t = times(py, t, samples)?;
    let dt = task.observer.settings.dt;
    let intervals = t.as_ref().map(|t| whole(py, t.data(), dt)).transpose()?.unwrap_or_default();
    let mut reports: Vec<usize> = match every {
        0 => Vec::new(),
        every => (every - 1..samples).step_by(every).collect(),
    };
    if reports.last() != Some(&(samples - 1)) {
        reports.push(samples - 1);
    }
    room(py, "the record", y.data().len() as u128 * 8)?;
    let idle = vec![0.0; if u.is_none() { samples * m } else { 0 }];
    let signals = Records {
        records,
        samples,
        y: y.data(),
        u: u.as_ref().map_or(&idle, |u| u.data()),
        intervals: &intervals,
        reports: &reports,
    };
    let t0 = t.as_ref().map_or(0.0, |t| t.data()[0]);
    let settings = Settings { t0, ..task.observer.settings.clone() };
    let call = Call { threads, progress };
    let ran = guard::long(py, &call, |control| {
        let structure = &task.observer.structure;
        let courses =
            run_records(structure, &settings, &task.tunings, &signals, tolerance, control)?;
        let all = vec![courses];
        let behind = task.behind(&all, reports.len());
        Ok((all, behind))
    })?;
    let (courses, behind) = ran.map_err(|e| task.raise(py, e))?;
    task.left(py, &courses)?;
    let out = Pack::new(py);
    task.describe(&out, &courses[0])?;
    let at = |k: &usize| t.as_ref().map_or(*k as f64 * dt, |t| t.data()[*k]);
    out.array("t", reports.iter().map(at).collect(), &[reports.len()])?;
    let total = if intervals.is_empty() { samples as u64 } else { intervals.iter().sum() };
    out.set("samples", total)?;
    task.physical(&out, behind, 1)?;
    task.courses(&out, courses, reports.len())?;
    Ok(out.0)
}

/// Sampling intervals from measurement to measurement.
fn whole(py: Python<'_>, t: &[f64], dt: f64) -> PyResult<Vec<u64>> {
    let one = |(k, since): (usize, Since)| match since {
        Since::Steps(steps) => Ok(steps),
        Since::Seconds(seconds) => {
            let text = format!(
                "t[{k}]: {seconds} s after the sample before, not a multiple of dt = {dt} s: give \
                 the interval of the record as adaptive.dt"
            );
            Err(errors::input(py, &text, "range"))
        }
    };
    Since::all(t, dt).enumerate().map(one).collect()
}
