//! What is printed: one JSON object, or tables.

use std::io::{self, Write};

use serde::Serialize;

use super::answer::{Answer, Numbers, Refused};
use crate::report::{layout, significant};
use crate::scenario::Scenario;
use crate::sim::AdaptiveTrials;

/// What all answers share.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Header {
    schema: &'static str,
    version: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    title: Option<String>,
    dt: f64,
    samples: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    trials: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
}

impl Header {
    /// Of trials.
    pub(super) fn of(scenario: &Scenario, trials: &AdaptiveTrials) -> Self {
        Self {
            trials: Some(trials.trials),
            seed: Some(trials.seed),
            ..Self::record(scenario, trials.settings.dt, trials.samples)
        }
    }

    /// Of a record.
    pub(super) fn record(scenario: &Scenario, dt: f64, samples: u64) -> Self {
        Self {
            schema: "mmae.adaptive/1",
            version: env!("CARGO_PKG_VERSION"),
            title: scenario.title().map(str::to_string),
            dt,
            samples,
            trials: None,
            seed: None,
        }
    }
}

/// The first answer stands at the top, all of them under `observers`.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    header: &'a Header,
    #[serde(skip_serializing_if = "Option::is_none")]
    case: Option<&'a str>,
    observer: Option<&'a str>,
    parameters: &'a [String],
    theta_hat: &'a [Option<f64>],
    theta_std: &'a [Option<f64>],
    #[serde(skip_serializing_if = "Option::is_none")]
    theta: Option<&'a [f64]>,
    states: &'a [String],
    x_hat: &'a [Option<f64>],
    observers: &'a [Answer],
    refused: &'a [Refused],
}

pub(super) fn json(
    out: &mut dyn Write,
    header: &Header,
    refused: &[Refused],
    answers: &[Answer],
) -> io::Result<()> {
    let first = answers.first();
    let list = |pick: fn(&Answer) -> &Numbers| first.map_or(&[][..], |a| pick(a).as_slice());
    let document = Document {
        header,
        case: first.and_then(|a| a.case.as_deref()),
        observer: first.map(|a| a.observer.as_str()),
        parameters: first.map_or(&[], |a| &a.parameters),
        theta_hat: list(|a| &a.theta_hat),
        theta_std: list(|a| &a.theta_std),
        theta: first.and_then(|a| a.theta.as_deref()),
        states: first.map_or(&[], |a| &a.states),
        x_hat: list(|a| &a.x_hat),
        observers: answers,
        refused,
    };
    serde_json::to_writer(&mut *out, &document)?;
    out.write_all(b"\n")
}

pub(super) fn text(
    out: &mut dyn Write,
    header: &Header,
    refused: &[Refused],
    answers: &[Answer],
) -> io::Result<()> {
    write!(out, "{} samples every {} s", header.samples, significant(header.dt, 6))?;
    match (header.trials, header.seed) {
        (Some(trials), Some(seed)) if trials > 1 => {
            writeln!(out, ", {trials} trials, seed {seed}.")?;
        }
        _ => writeln!(out, ".")?,
    }
    for r in refused {
        writeln!(out, "\n{}: {}", r.observer, r.message)?;
    }
    for answer in answers {
        writeln!(out)?;
        one(out, answer)?;
    }
    Ok(())
}

/// Digits of a number in a table.
const DIGITS: usize = 6;

fn shown(v: Option<f64>, digits: usize) -> String {
    v.map_or_else(|| "-".into(), |v| significant(v, digits))
}

/// Rows `name, estimate, standard deviation, truth, error` of a list of parameters.
fn table(
    names: &[String],
    value: &[Option<f64>],
    std: &[Option<f64>],
    truth: Option<&[f64]>,
    spread: &[Option<f64>],
) -> String {
    let mut head = vec!["parameter", "estimate", "std"];
    if !spread.is_empty() {
        head.push("std of trials");
    }
    if truth.is_some() {
        head.extend(["true", "error"]);
    }
    let rows = (0..names.len()).map(|i| {
        let mut row = vec![names[i].clone(), shown(value[i], DIGITS), shown(std[i], 3)];
        if let Some(spread) = spread.get(i) {
            row.push(shown(*spread, 3));
        }
        if let Some(truth) = truth.and_then(|t| t.get(i)) {
            let error = value[i].map(|v| 100.0 * (v - truth) / truth.abs());
            row.push(significant(*truth, DIGITS));
            let percent = |e: f64| format!("{} %", significant(e, 3));
            row.push(error.filter(|e| e.is_finite()).map_or_else(|| "-".into(), percent));
        }
        row
    });
    layout::columns(&head, rows)
}

fn one(out: &mut dyn Write, a: &Answer) -> io::Result<()> {
    if let Some(case) = &a.case {
        write!(out, "{case}, ")?;
    }
    writeln!(out, "{} (reading {}, lambda {}):", a.observer, a.reading, significant(a.lambda, 4))?;
    let truth = a.theta.as_deref();
    let rows = table(&a.parameters, &a.theta_hat, &a.theta_std, truth, &a.theta_spread);
    out.write_all(rows.as_bytes())?;
    if let Some(b) = &a.physical {
        match &b.failure {
            Some(failure) => writeln!(out, "behind them: {failure}")?,
            None => {
                let rows = table(&b.parameters, &b.value, &b.std, b.truth.as_deref(), &[]);
                out.write_all(rows.as_bytes())?;
            }
        }
    }
    let bound: Vec<&str> = (a.parameters.iter().zip(&a.at_bound))
        .filter(|(_, at)| **at)
        .map(|(name, _)| name.as_str())
        .collect();
    if !bound.is_empty() {
        writeln!(out, "on a bound: {}", bound.join(", "))?;
    }
    writeln!(
        out,
        "last window: condition of the excitation {}, residual {}, drift {}",
        shown(a.window.condition, 3),
        shown(a.window.residual, 3),
        shown(a.window.drift, 3)
    )
}
