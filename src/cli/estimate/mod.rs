//! `mmae estimate`: the bank of a scenario on recorded data.

pub(super) mod data;
mod seen;

use std::io::{self, Write};

use serde::Serialize;

use super::arguments::{EstimateArguments, LawName};
use super::clock::Clock;
use super::course;
use super::failure::{Failure, say};
use super::output;
use super::signals::Signals;
use crate::engine::{Estimate, Mmae};
use crate::par::RunControl;
use crate::report::timeline::{Bands, Timeline, Track};
use crate::report::write::{MANIFEST, Output};
use crate::report::{figure, layout, significant};
use crate::scenario::{Diagnostic, Error, Estimator, Refusal, Scenario, Since, Uneven};
use crate::weight::{DwsgScheme, Law};
use data::Record;
use seen::Seen;

pub(super) fn run(args: &EstimateArguments, signals: &Signals) -> Result<(), Failure> {
    let clock = Clock::start();
    let scenario = Scenario::from_file(&args.file)?;
    for warning in scenario.warnings() {
        say("warning", &warning.to_string());
    }
    if scenario.is_adaptive() {
        return super::adaptive::estimate(args, &scenario, signals, &clock);
    }
    let mut estimator = scenario.estimator()?;
    if let Some(name) = args.weighting {
        estimator.weighting.law = law(name, &estimator);
    }
    let record = data::read(&args.data, &estimator.names)?;
    let mut mmae = estimator.start().map_err(|e| scenario.explain_run(e))?;
    let pace = mmae.bank().pace();
    if pace > COARSE {
        say(
            "warning",
            &format!(
                "the fastest observer turns by {} within a sample: the weights of a continuous \
                 record want a shorter dt; or sample the plant and run Kalman filters",
                significant(pace, 3)
            ),
        );
    }
    for (i, failure) in mmae.bank().failures().iter().enumerate() {
        if let Some(failure) = failure {
            let label = &estimator.labels[i];
            say("warning", &format!("model {} ({label}) is unusable: {failure}", i + 1));
        }
    }
    let output = match &args.out {
        Some(dir) => Some(Output::open(dir, &FILES, args.force)?),
        None => None,
    };
    // a picture needs the whole of the record, the report what was asked for
    let every = if output.is_some() { 1 } else { args.every };
    let mut seen = Seen::new(output.is_some());
    let mut rows = filter(args, every, &estimator, &record, &mut mmae, signals, &mut seen)?;
    let estimate = mmae.estimate();
    if let Some(mut output) = output {
        let dir = output.dir().to_path_buf();
        let kept = thin(&rows, args.every);
        output.add(FILES[0], |out| print_json(out, &estimator, estimate, &seen, &kept))?;
        let run = timeline(&scenario, &estimator, &rows, record.t.is_some(), signals);
        output.add(FILES[1], |out| figure::write_timeline(&run, out))?;
        let course = seen.course.take().unwrap_or_default();
        let (models, law) = (estimator.labels.len(), estimator.weighting.law.name());
        let subtitle = format!("{models} models, law {law}, {} samples", rows.len());
        let stack = course.stack(&run.title, subtitle, &run.time, &estimator.names);
        output.add(FILES[2], |out| figure::write_stack(&stack, out))?;
        let manifest = clock.manifest(&args.file, 1, output.written())?;
        output.add(MANIFEST, |out| manifest.write(out))?;
        if signals.raised() {
            return Err(Failure::Cancelled);
        }
        output.commit()?;
        say("note", &format!("wrote {} to {}", FILES.join(", "), dir.display()));
        rows = kept;
    }
    if !estimate.explained {
        say("warning", "no model could explain the last measurement, which left the weights alone");
    }
    for (i, failed) in estimate.failed.iter().enumerate() {
        if *failed && mmae.bank().failures()[i].is_none() {
            say("warning", &format!("model {} ({}) ran away", i + 1, estimator.labels[i]));
        }
    }
    output::print(Some(signals), |out| {
        if args.json {
            print_json(out, &estimator, estimate, &seen, &rows)
        } else {
            print_text(out, &estimator, estimate, &seen, &rows)
        }
    })
}

/// Product of the fastest observer pole and the sampling interval from which on
/// the likelihood of a continuous record is no longer that of its samples.
const COARSE: f64 = 0.3;

const FILES: [&str; 4] = ["estimate.json", "weights.svg", "record.svg", MANIFEST];

/// Every `every`-th row; none where it is 0.
fn thin(rows: &[Row], every: u64) -> Vec<Row> {
    let every = usize::try_from(every).unwrap_or(usize::MAX);
    match every {
        0 => Vec::new(),
        _ => rows.iter().skip(every - 1).step_by(every).cloned().collect(),
    }
}

fn timeline(
    scenario: &Scenario,
    estimator: &Estimator,
    rows: &[Row],
    timed: bool,
    signals: &Signals,
) -> Timeline {
    let control = RunControl::default().cancel(signals.cancel());
    let boundaries = course::boundaries(scenario, &estimator.parameters, &control);
    let models = estimator.labels.len();
    let law = estimator.weighting.law.name();
    let track = |k: usize| Track {
        name: estimator.parameters[k].clone(),
        mean: rows.iter().map(|r| r.theta_hat[k]).collect(),
        models: estimator.values.iter().map(|v| v[k]).collect(),
        bands: Bands::default(),
        boundaries: boundaries.clone(),
        truth: None,
    };
    Timeline {
        title: scenario.title().unwrap_or("Multiple-model estimation").into(),
        subtitle: format!(
            "{models} models, law {law}, {} samples{}",
            rows.len(),
            course::legend(&estimator.parameters, false, &boundaries)
        ),
        time: if timed { "t" } else { "time, s" }.into(),
        t: rows.iter().map(|r| r.t).collect(),
        labels: estimator.labels.clone(),
        p: (0..models).map(|i| rows.iter().map(|r| r.p[i]).collect()).collect(),
        bands: Vec::new(),
        parameters: (0..estimator.parameters.len()).map(track).collect(),
    }
}

/// The law behind a name of the command line.
pub(super) fn law(name: LawName, estimator: &Estimator) -> Law {
    match name {
        LawName::Bayes => Law::Bayes,
        LawName::Zhang1 => Law::Zhang { n_max: 1.0 },
        LawName::Zhang2 => Law::Zhang { n_max: f64::INFINITY },
        LawName::Dunn => Law::Likelihood,
        LawName::DunnOde => Law::Ode { substeps: 4 },
        LawName::Dwsg => match estimator.weighting.law {
            own @ Law::Dwsg { .. } => own,
            _ => {
                let held = estimator.members.observer.is_continuous();
                let lambda = estimator.settings.dt.filter(|_| held).map_or(1.0, |dt| 1.0 / dt);
                Law::Dwsg { lambda, tempering: 1.0, scheme: DwsgScheme::Left }
            }
        },
    }
}

/// A step that is reported.
#[derive(Clone, Serialize)]
struct Row {
    t: f64,
    p: Vec<f64>,
    theta_hat: Vec<f64>,
    x_hat: Vec<f64>,
    nis: Vec<Option<f64>>,
}

/// Runs the record through the bank; every `every`-th step is kept, none for 0.
fn filter(
    args: &EstimateArguments,
    every: u64,
    estimator: &Estimator,
    record: &Record,
    mmae: &mut Mmae,
    signals: &Signals,
    seen: &mut Seen,
) -> Result<Vec<Row>, Failure> {
    let [_, m, q] = mmae.bank().sizes();
    let dt = mmae.bank().dt();
    let nothing = vec![0.0; m];
    let continuous = mmae.bank().is_continuous();
    let mut rows = Vec::new();
    let intervals = match &record.t {
        Some(t) => estimator.intervals(t, dt).map_err(|r| refuse(args, r))?,
        None => vec![Since::Steps(1); record.len],
    };
    let mut uneven = Uneven::new(estimator, mmae);
    for k in 0..record.len {
        if signals.raised() {
            return Err(Failure::Cancelled);
        }
        let held = &record.u[k * m..][..m];
        // a row's input acts from its time on: in discrete time up to the next
        // measurement, in continuous time along the interval that begins there
        let before = if k > 0 { &record.u[(k - 1) * m..][..m] } else { &nothing[..] };
        let u = if continuous { held } else { before };
        uneven.reach(mmae, intervals[k], before).map_err(|e| numerical(k, &e))?;
        let y = &record.y[k * q..][..q];
        let step = mmae.step(u, y);
        step.map_err(|e| numerical(k, &e))?;
        let t = record.t.as_ref().map_or((k + 1) as f64 * dt, |t| t[k]);
        seen.add(t, y, mmae);
        let e = mmae.estimate();
        if every > 0 && (k as u64 + 1).is_multiple_of(every) {
            rows.push(Row {
                t,
                p: e.p.clone(),
                theta_hat: estimator.theta_hat(&e.p),
                x_hat: e.x_hat.clone(),
                nis: e.nis.iter().map(|v| v.is_finite().then_some(*v)).collect(),
            });
        }
    }
    Ok(rows)
}

fn numerical(k: usize, error: &crate::Error) -> Failure {
    Failure::Numerical(vec![format!("sample {}: {error}", k + 1)])
}

fn refuse(args: &EstimateArguments, refusal: Refusal) -> Error {
    Error::Invalid(vec![Diagnostic {
        file: args.data.display().to_string(),
        line: refusal.at + 2,
        column: 1,
        key: "t".into(),
        message: refusal.message,
        remedy: refusal.remedy.into(),
    }])
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    version: &'static str,
    parameters: &'a [String],
    models: &'a [Vec<f64>],
    labels: &'a [String],
    law: &'static str,
    samples: u64,
    log_weights: Vec<Option<f64>>,
    p: &'a [f64],
    theta_hat: Vec<f64>,
    identified: Vec<f64>,
    best: Option<usize>,
    n_eff: f64,
    loglik: Vec<Option<f64>>,
    nis_mean: Vec<Option<f64>>,
    nis_band: Vec<Option<f64>>,
    states: &'a [String],
    x_hat: &'a [f64],
    failed: &'a [bool],
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    record: &'a [Row],
}

fn print_json(
    out: &mut dyn Write,
    estimator: &Estimator,
    e: &Estimate,
    seen: &Seen,
    rows: &[Row],
) -> io::Result<()> {
    let finite = |list: &[f64]| list.iter().map(|v| v.is_finite().then_some(*v)).collect();
    let document = Document {
        schema: "mmae.estimate/1",
        version: env!("CARGO_PKG_VERSION"),
        parameters: &estimator.parameters,
        models: &estimator.values,
        labels: &estimator.labels,
        law: estimator.weighting.law.name(),
        samples: e.step,
        log_weights: finite(&e.log_p),
        p: &e.p,
        theta_hat: estimator.theta_hat(&e.p),
        identified: (0..e.p.len()).map(|i| f64::from(u8::from(e.best == Some(i)))).collect(),
        best: e.best,
        n_eff: e.n_eff,
        loglik: finite(&e.log_lik_models),
        nis_mean: finite(&seen.nis_mean()),
        nis_band: finite(&seen.nis_band()),
        states: &estimator.names.states,
        x_hat: &e.x_hat,
        failed: &e.failed,
        record: rows,
    };
    serde_json::to_writer(&mut *out, &document)?;
    out.write_all(b"\n")
}

fn print_text(
    out: &mut dyn Write,
    estimator: &Estimator,
    e: &Estimate,
    seen: &Seen,
    rows: &[Row],
) -> io::Result<()> {
    writeln!(
        out,
        "{} samples, {} models, law {}.\n",
        e.step,
        e.p.len(),
        estimator.weighting.law.name()
    )?;
    for row in rows {
        let best = (0..row.p.len()).max_by(|&i, &j| row.p[i].total_cmp(&row.p[j])).unwrap_or(0);
        let theta: Vec<String> = row.theta_hat.iter().map(|v| significant(*v, 5)).collect();
        writeln!(
            out,
            "t = {}  {} ({:.4})  {}",
            significant(row.t, 6),
            estimator.labels[best],
            row.p[best],
            theta.join("  ")
        )?;
    }
    let nis = seen.nis_mean();
    let lines = (0..e.p.len()).map(|i| {
        [
            estimator.labels[i].clone(),
            format!("{:.6}", e.p[i]),
            significant(e.log_p[i], 6),
            significant(e.log_lik_models[i], 8),
            nis.get(i).map_or(String::new(), |nis| significant(*nis, 5)),
            if e.failed[i] {
                "failed".into()
            } else if e.best == Some(i) {
                "<".into()
            } else {
                String::new()
            },
        ]
    });
    let head = ["model", "p", "ln p", "ln likelihood", "mean NIS", ""];
    out.write_all(layout::grid(&head, lines).as_bytes())?;
    let [low, high] = seen.nis_band();
    let band = format!("{} to {}", significant(low, 4), significant(high, 4));
    writeln!(out, "95 % band of the mean NIS where the model is right: {band}")?;
    for (name, value) in estimator.parameters.iter().zip(estimator.theta_hat(&e.p)) {
        writeln!(out, "{name} = {} (mean over the weights)", significant(value, 6))?;
    }
    for (name, value) in estimator.names.states.iter().zip(&e.x_hat) {
        writeln!(out, "{name} = {}", significant(*value, 6))?;
    }
    Ok(())
}
