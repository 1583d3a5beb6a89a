//! Recorded signals: shapes, times, and records through a bank.

use mmae::Error;
use mmae::engine::{Arrays, Courses, Mmae, Record};
use mmae::par::{self, RunControl};
use mmae::scenario::{Estimator, Since, Uneven};
use pyo3::prelude::*;

use crate::arrays::Array;
use crate::errors;

/// Measurements between two looks at whether to stop.
const PIECE: usize = 4096;

/// Inputs as the engine's steps take them: those of a row act from its time on, so
/// that a discrete filter is told those of the row before.
pub(crate) fn shifted(u: &[f64], steps: usize, m: usize, continuous: bool) -> Vec<f64> {
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
pub(crate) fn shapes(
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

/// Times of the measurements, one each, rising.
pub(crate) fn times<'py>(
    py: Python<'py>,
    t: Option<&Bound<'py, PyAny>>,
    steps: usize,
) -> PyResult<Option<Array<'py>>> {
    let Some(t) = t else { return Ok(None) };
    let t = Array::take("t", t)?;
    if *t.shape() != [steps] {
        let text = format!("t has shape {:?}: give ({steps},), one time a row of y", t.shape());
        return Err(errors::input(py, &text, "shape"));
    }
    let data = t.data();
    if let Some(k) = data.iter().position(|v| !v.is_finite()) {
        let text =
            format!("t[{k}] is not a finite number: give every row its time, or leave out t");
        return Err(errors::input(py, &text, "not_finite"));
    }
    if let Some(k) = data.windows(2).position(|w| w[1] <= w[0]) {
        let text = format!(
            "t[{}]: times must increase: give a time later than that of the row before",
            k + 1
        );
        return Err(errors::input(py, &text, "range"));
    }
    Ok(Some(t))
}

/// The time from measurement to measurement, or why the bank cannot take them.
pub(crate) fn intervals(
    py: Python<'_>,
    t: Option<&Array<'_>>,
    estimator: &Estimator,
    dt: f64,
) -> PyResult<Option<Vec<Since>>> {
    let found = t.map(|t| estimator.intervals(t.data(), dt)).transpose();
    found.map_err(|r| {
        errors::input(py, &format!("t[{}]: {}: {}", r.at, r.message, r.remedy), "range")
    })
}

/// A record, inputs as the engine's steps take them.
#[derive(Clone, Copy)]
pub(crate) struct Signals<'a> {
    pub(crate) y: &'a [f64],
    /// Empty for zero.
    pub(crate) u: &'a [f64],
    /// Time since the measurement before, one sampling interval unless given.
    pub(crate) since: Option<&'a [Since]>,
}

/// The record in pieces; with times row by row. Also where it stopped early, and why.
pub(crate) fn filter(
    estimator: &Estimator,
    mmae: &mut Mmae,
    signals: &Signals<'_>,
    control: &RunControl<'_>,
) -> (Record, Option<(usize, Error)>) {
    let [_, m, q] = mmae.bank().sizes();
    let continuous = mmae.bank().is_continuous();
    let mut uneven = Uneven::new(estimator, mmae);
    let idle = vec![0.0; m];
    let row = |k: usize| if signals.u.is_empty() { &idle } else { &signals.u[k * m..][..m] };
    let mut all = Record::default();
    let total = signals.y.len() / q;
    let size = if signals.since.is_some() { 1 } else { PIECE };
    for first in (0..total).step_by(size) {
        if first % PIECE == 0 && control.is_cancelled() {
            return (all, Some((first, Error::Cancelled)));
        }
        if let Some(since) = signals.since {
            // a discrete filter is told the inputs of the row before already
            let before = if continuous { row(first.saturating_sub(1)) } else { row(first) };
            if let Err(e) = uneven.reach(mmae, since[first], before) {
                return (all, Some((first, e)));
            }
        }
        let count = size.min(total - first);
        let u = if signals.u.is_empty() { &[] } else { &signals.u[first * m..][..count * m] };
        let before = mmae.estimate().step;
        match mmae.run(u, &signals.y[first * q..][..count * q]) {
            Ok(piece) => extend(&mut all, piece),
            Err(e) => {
                let at = first + (mmae.estimate().step - before) as usize;
                return (all, Some((at, e)));
            }
        }
        let done = first + count;
        if let Some(report) = control.progress.filter(|_| done == total || done % PIECE == 0) {
            report(done as u64, total as u64);
        }
    }
    (all, None)
}

fn extend(all: &mut Record, piece: Record) {
    all.steps += piece.steps;
    all.p.extend(piece.p);
    all.log_p.extend(piece.log_p);
    all.x_hat.extend(piece.x_hat);
    all.log_lik.extend(piece.log_lik);
    all.nis.extend(piece.nis);
    all.r.extend(piece.r);
}

/// Many records at the same uneven times, each by itself; a record without any model that
/// is left has NaN from there on.
pub(crate) fn many_uneven(
    estimator: &Estimator,
    start: &Mmae,
    arrays: &Arrays<'_>,
    since: &[Since],
    control: &RunControl<'_>,
) -> mmae::Result<Courses> {
    let [n, m, q] = start.bank().sizes();
    let (models, steps) = (start.bank().models(), arrays.steps);
    let every = if arrays.every == 0 { steps } else { arrays.every };
    let mut reports: Vec<usize> = (every..=steps).step_by(every).collect();
    if reports.last() != Some(&steps) {
        reports.push(steps);
    }
    let own = arrays.u.len() == arrays.records * steps * m;
    let rows = par::try_map_chunks(control, arrays.records, 1, |range| {
        let record = range.start;
        let mut mmae = start.clone();
        let u = match arrays.u {
            [] => &[],
            u if own => &u[record * steps * m..][..steps * m],
            u => u,
        };
        let y = &arrays.y[record * steps * q..][..steps * q];
        let signals = Signals { y, u, since: Some(since) };
        let quiet = RunControl { progress: None, ..*control };
        let (course, stopped) = filter(estimator, &mut mmae, &signals, &quiet);
        match stopped {
            None | Some((_, Error::AllFailed { .. })) => Ok((course, mmae.estimate().clone())),
            Some((_, e)) => Err(e),
        }
    })?;
    let mut out = Courses {
        steps: reports,
        log_p: Vec::new(),
        x_hat: Vec::new(),
        log_lik: Vec::new(),
        log_lik_models: Vec::new(),
        failed: Vec::new(),
    };
    for (course, last) in rows {
        for step in &out.steps {
            let row = |list: &[f64], width: usize| match *step <= course.steps {
                true => list[(step - 1) * width..][..width].to_vec(),
                false => vec![f64::NAN; width],
            };
            out.log_p.extend(row(&course.log_p, models));
            out.x_hat.extend(row(&course.x_hat, n));
        }
        let whole = course.steps == steps;
        out.log_lik.push(if whole { course.log_lik.iter().sum() } else { f64::NAN });
        out.log_lik_models.extend(last.log_lik_models);
        out.failed.extend(last.failed);
    }
    Ok(out)
}
