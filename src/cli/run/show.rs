//! What `mmae run` prints.

use std::io::{self, Write};

use serde::Serialize;

use super::recentring::Recentring;
use crate::report::{layout, significant};
use crate::scenario::{Estimator, Simulation};
use crate::sim::{LEVELS, Moment, Summary, Trajectory};

/// Means over the trials, at a step or at the end.
#[derive(Serialize)]
struct Statistics<'a> {
    p: &'a [f64],
    p_std: &'a [f64],
    p_quantiles: &'a [[f64; 5]],
    identified: &'a [f64],
    theta_hat: Vec<f64>,
    theta_hat_quantiles: Vec<Vec<Option<f64>>>,
    x_error_rms: Option<f64>,
    x_error_mean: Vec<Option<f64>>,
    x_error_std: Vec<Option<f64>>,
    x_error_quantiles: Vec<Vec<Option<f64>>>,
    x_error_norm_quantiles: Vec<Option<f64>>,
    nis: Vec<Option<f64>>,
    nis_inside: Vec<Option<f64>>,
    nees: Vec<Option<f64>>,
    nees_inside: Vec<Option<f64>>,
    nees_fused: Option<f64>,
    nees_fused_inside: Option<f64>,
    failed: &'a [f64],
}

impl<'a> Statistics<'a> {
    fn new(m: &'a Moment, estimator: &Estimator) -> Self {
        let rows = |list: &[[f64; 5]]| list.iter().map(|q| numbers(q)).collect();
        Self {
            p: &m.p,
            p_std: &m.p_std,
            p_quantiles: &m.p_quantiles,
            identified: &m.identified,
            theta_hat: estimator.theta_hat(&m.p),
            theta_hat_quantiles: rows(&m.theta_hat_quantiles),
            x_error_rms: number(m.x_error_rms),
            x_error_mean: numbers(&m.x_error_mean),
            x_error_std: numbers(&m.x_error_std),
            x_error_quantiles: rows(&m.x_error_quantiles),
            x_error_norm_quantiles: numbers(&m.x_error_norm_quantiles),
            nis: numbers(&m.nis),
            nis_inside: numbers(&m.nis_inside),
            nees: numbers(&m.nees),
            nees_inside: numbers(&m.nees_inside),
            nees_fused: number(m.nees_fused),
            nees_fused_inside: number(m.nees_fused_inside),
            failed: &m.failed,
        }
    }
}

/// A report.
#[derive(Serialize)]
struct Row<'a> {
    k: u64,
    t: f64,
    /// True values of the parameters.
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    theta: &'a [f64],
    #[serde(flatten)]
    statistics: Statistics<'a>,
}

/// The end of one trial.
#[derive(Serialize)]
struct Each {
    trial: u64,
    log_weights: Vec<Option<f64>>,
    p: Vec<f64>,
    best: Option<usize>,
    x: Vec<Option<f64>>,
    x_hat: Vec<Option<f64>>,
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    version: &'static str,
    parameters: &'a [String],
    models: &'a [Vec<f64>],
    labels: &'a [String],
    law: &'static str,
    steps: u64,
    dt: f64,
    trials: u64,
    seed: u64,
    states: &'a [String],
    quantile_levels: [f64; 5],
    nis_band: Vec<Option<f64>>,
    nees_band: Vec<Option<f64>>,
    log_weights: Vec<Option<f64>>,
    #[serde(flatten)]
    statistics: Statistics<'a>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    per_trial: Vec<Each>,
    #[serde(skip_serializing_if = "Option::is_none")]
    recentring: Option<&'a Recentring>,
    record: Vec<Row<'a>>,
}

fn number(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

fn numbers(list: &[f64]) -> Vec<Option<f64>> {
    list.iter().map(|v| number(*v)).collect()
}

fn each(simulation: &Simulation, trial: &Trajectory, models: usize) -> Each {
    let last = |all: &[f64], n: usize| all[all.len() - n.min(all.len())..].to_vec();
    let log_p = last(&trial.log_p, models);
    let mut best: Option<usize> = None;
    for (i, l) in log_p.iter().enumerate() {
        if *l > best.map_or(f64::NEG_INFINITY, |b| log_p[b]) {
            best = Some(i);
        }
    }
    Each {
        trial: trial.trial,
        log_weights: numbers(&log_p),
        p: log_p.iter().map(|l| libm::exp(*l)).collect(),
        best,
        x: numbers(&last(&trial.x, simulation.truth.x0.len())),
        x_hat: numbers(&last(&trial.x_hat, simulation.estimator.names.states.len())),
    }
}

/// One object.
pub(super) fn json(
    out: &mut dyn Write,
    simulation: &Simulation,
    summary: &Summary,
    recentring: Option<&Recentring>,
) -> io::Result<()> {
    let (estimator, end) = (&simulation.estimator, summary.last());
    let rows = summary.record.iter().map(|m| Row {
        k: m.step,
        t: m.step as f64 * simulation.dt,
        theta: simulation.theta(m.step),
        statistics: Statistics::new(m, estimator),
    });
    let document = Document {
        schema: "mmae.run/1",
        version: env!("CARGO_PKG_VERSION"),
        parameters: &estimator.parameters,
        models: &estimator.values,
        labels: &estimator.labels,
        law: estimator.weighting.law.name(),
        steps: summary.steps,
        dt: simulation.dt,
        trials: summary.trials,
        seed: summary.seed,
        states: &estimator.names.states[..end.x_error_mean.len()],
        quantile_levels: LEVELS,
        nis_band: numbers(&summary.nis_band),
        nees_band: numbers(&summary.nees_band),
        log_weights: numbers(&end.log_p),
        statistics: Statistics::new(end, estimator),
        per_trial: summary.kept.iter().map(|t| each(simulation, t, end.p.len())).collect(),
        recentring,
        record: rows.collect(),
    };
    serde_json::to_writer(&mut *out, &document)?;
    out.write_all(b"\n")
}

/// Tables.
pub(super) fn text(
    out: &mut dyn Write,
    simulation: &Simulation,
    summary: &Summary,
) -> io::Result<()> {
    let (estimator, end) = (&simulation.estimator, summary.last());
    writeln!(
        out,
        "{} trials of {} steps, {} models, law {}, seed {}.\n",
        summary.trials,
        summary.steps,
        end.p.len(),
        estimator.weighting.law.name(),
        summary.seed
    )?;
    if summary.record.len() > 1 {
        let rows = summary.record.iter().map(|m| {
            let best = (0..m.p.len())
                .max_by(|&i, &j| m.identified[i].total_cmp(&m.identified[j]).then(j.cmp(&i)))
                .unwrap_or(0);
            [
                significant(m.step as f64 * simulation.dt, 6),
                estimator.labels[best].clone(),
                format!("{:.4}", m.identified[best]),
                format!("{:.4}", m.p[best]),
                significant(m.x_error_rms, 5),
            ]
        });
        let head = ["t", "most often identified", "in", "mean p", "rms error"];
        out.write_all(layout::grid(&head, rows).as_bytes())?;
        writeln!(out)?;
    }
    let rows = (0..end.p.len()).map(|i| {
        [
            estimator.labels[i].clone(),
            format!("{:.4}", end.identified[i]),
            format!("{:.6}", end.p[i]),
            format!("{:.6}", end.p_std[i]),
            significant(end.nis[i], 5),
            significant(end.nees[i], 5),
        ]
    });
    let head = ["model", "identified", "mean p", "std p", "mean NIS", "mean NEES"];
    out.write_all(layout::grid(&head, rows).as_bytes())?;
    let range =
        |[low, high]: [f64; 2]| format!("{} to {}", significant(low, 4), significant(high, 4));
    write!(out, "95 % bands where the model is right: NIS {}", range(summary.nis_band))?;
    if summary.nees_band[0].is_finite() {
        let fused = significant(end.nees_fused, 5);
        write!(out, ", NEES {}; NEES of the fused state: {fused}", range(summary.nees_band))?;
    }
    writeln!(out)?;
    for (name, value) in estimator.parameters.iter().zip(estimator.theta_hat(&end.p)) {
        writeln!(out, "{name} = {} (mean over weights and trials)", significant(value, 6))?;
    }
    writeln!(out, "rms error of the fused state: {}", significant(end.x_error_rms, 6))
}
