//! `mmae check`: what a scenario says and what a run would take.

use std::io::{self, Write};

use super::arguments::CheckArguments;
use super::failure::{Failure, say};
use super::output;
use crate::bank::GainMode;
use crate::eip::{Cost, Study};
use crate::model::Time;
use crate::par::RunControl;
use crate::report::{json, plain, significant, summary, text};
use crate::scenario::{self, Diagnostic, Estimator, Scenario};

/// Floating-point operations a second and core that the kernels reach on
/// problems of this size, roughly; for the estimate of the time only.
const RATE: f64 = 5e9;

pub(super) fn run(args: &CheckArguments) -> Result<(), Failure> {
    let checked = Scenario::from_file(&args.file);
    if let Ok(scenario) = &checked {
        for warning in scenario.warnings() {
            say("warning", &warning.to_string());
        }
    }
    let name = args.file.display().to_string();
    let result = checked.and_then(|scenario| {
        if scenario.is_adaptive() {
            let sizes = adaptive(&scenario)?;
            if args.json {
                let report = Report::of_adaptive(&name, sizes, scenario.warnings());
                return Ok(output::print(None, |out| print_json(out, &report)));
            }
            let title = scenario.title();
            return Ok(output::print(None, |out| print_adaptive(out, &name, title, &sizes)));
        }
        if !scenario.has_study() {
            let bank = scenario.estimator()?;
            bank.start().map_err(|e| scenario.explain_run(e))?;
            if scenario.has_run() {
                simulates(&scenario)?;
            }
            if args.json {
                let report = Report::of_bank(&name, &bank, scenario.warnings());
                return Ok(output::print(None, |out| print_json(out, &report)));
            }
            let title = scenario.title();
            return Ok(output::print(None, |out| print_bank(out, &name, title, &bank)));
        }
        let study = scenario.study()?;
        let cost = study.cost().map_err(|e| scenario.explain(e))?;
        if scenario.has_run() {
            simulates(&scenario)?;
        }
        if args.json {
            let warnings = scenario.warnings();
            let report = Report::new(&name, &study, &cost, warnings);
            return Ok(output::print(None, |out| print_json(out, &report)));
        }
        let title = scenario.title();
        Ok(output::print(None, |out| print_text(out, &name, title, &study, &cost)))
    });
    match result {
        Ok(printed) => printed,
        Err(e) => {
            if args.json {
                let report = Report::refused(&name, &e);
                output::print(None, |out| print_json(out, &report))?;
            }
            Err(e.into())
        }
    }
}

/// Sizes of the adaptive observers; those that cannot be used are told, and are an error
/// where no other one can.
fn adaptive(scenario: &Scenario) -> Result<Vec<ObserverSize>, scenario::Error> {
    let observers = scenario.adaptive_observers();
    let built = scenario.build_adaptive();
    let (mut first, mut told) = (None, Vec::new());
    let mut sizes = Vec::new();
    for (observer, built) in observers.iter().zip(built) {
        let [states, inputs, outputs, parameters] = observer.structure.sizes();
        let refused = built.err();
        if let Some(e) = &refused {
            told.push(format!("observer {} cannot be used: {e}", observer.name));
            first.get_or_insert_with(|| scenario.explain_adaptive(e.clone(), &observer.name));
        }
        sizes.push(ObserverSize {
            name: observer.name.clone(),
            states,
            inputs,
            outputs,
            parameters,
            reading: observer.settings.reading.name(),
            usable: refused.is_none(),
        });
    }
    match first {
        Some(e) if sizes.iter().all(|s| !s.usable) => return Err(e),
        _ => told.iter().for_each(|text| say("warning", text)),
    }
    if scenario.has_run() {
        let cases = scenario.adaptive_cases(&[])?;
        for trials in cases.iter().flat_map(|c| &c.trials).zip(sizes.iter().cycle()) {
            if trials.1.usable {
                trials.0.check().map_err(|e| scenario.explain_adaptive(e, &trials.1.name))?;
            }
        }
    }
    Ok(sizes)
}

/// Sees that `mmae run` could begin.
fn simulates(scenario: &Scenario) -> Result<(), scenario::Error> {
    let simulation = scenario.simulation(&[])?;
    let beside = scenario.recentring(&simulation)?;
    let experiment = simulation.experiment(Vec::new());
    experiment.check(&RunControl::default()).map_err(|e| scenario.explain_run(e))?;
    beside.map_or(Ok(()), |b| b.check().map_err(|e| scenario.explain_run(e)))
}

fn print_text(
    out: &mut dyn Write,
    name: &str,
    title: Option<&str>,
    study: &Study,
    cost: &Cost,
) -> io::Result<()> {
    let names = study.family.names();
    let mut row = |key: &str, value: &str| {
        if value.is_empty() { Ok(()) } else { writeln!(out, "  {key:<13} {value}") }
    };
    row("scenario", &format!("{name} is valid"))?;
    row("title", title.unwrap_or(""))?;
    let time = match study.family.time() {
        Time::Continuous => "continuous".into(),
        Time::Discrete { dt } => format!("discrete, dt = {} s", plain(dt)),
    };
    row("time", &time)?;
    for (key, list) in [
        ("states", &names.states),
        ("inputs", &names.inputs),
        ("disturbances", &names.disturbances),
        ("outputs", &names.outputs),
    ] {
        row(key, &list.join(", "))?;
    }
    for (axis_name, axis) in study.grid.axes() {
        let (from, to) = summary::ends(axis);
        let values = summary::count(axis.len(), "value");
        row("grid", &format!("{axis_name} in [{}, {}], {values}", plain(from), plain(to)))?;
    }
    row("measure", &summary::convention(study.convention))?;
    row("plants", &cost.plants.to_string())?;
    row("models", &cost.models.to_string())?;
    let delays: Vec<String> = study.delays.iter().map(|d| summary::delay(*d)).collect();
    row("delays", &delays.join(", "))?;
    row(
        "order",
        &format!("{} (plants in their loop), {} (observers)", cost.order, cost.model_order),
    )?;
    row("method", text::method_name(cost.method))?;
    row("memory", &format!("{} of at most {}", bytes(cost.bytes), bytes(study.memory_limit)))?;
    let seconds = cost.flops / RATE;
    let seconds = if seconds < 1e-3 {
        "under a millisecond".into()
    } else {
        format!("about {} s", significant(seconds, 1))
    };
    row("work", &format!("{:.1e} operations, {seconds} on one core", cost.flops))
}

/// A scenario whose bank only runs.
fn print_bank(
    out: &mut dyn Write,
    name: &str,
    title: Option<&str>,
    bank: &Estimator,
) -> io::Result<()> {
    let mut row = |key: &str, value: &str| {
        if value.is_empty() { Ok(()) } else { writeln!(out, "  {key:<13} {value}") }
    };
    row("scenario", &format!("{name} is valid"))?;
    row("title", title.unwrap_or(""))?;
    let names = &bank.names;
    for (key, list) in
        [("states", &names.states), ("inputs", &names.inputs), ("outputs", &names.outputs)]
    {
        row(key, &list.join(", "))?;
    }
    row("observer", bank.members.observer.name())?;
    let gains = match bank.settings.gains {
        GainMode::Steady => "steady",
        GainMode::Recursive => "recursive",
    };
    row("gains", gains)?;
    row("models", &bank.labels.len().to_string())?;
    row("parameters", &bank.parameters.join(", "))?;
    row("law", bank.weighting.law.name())
}

/// A scenario of adaptive observers.
fn print_adaptive(
    out: &mut dyn Write,
    name: &str,
    title: Option<&str>,
    sizes: &[ObserverSize],
) -> io::Result<()> {
    let mut row = |key: &str, value: &str| {
        if value.is_empty() { Ok(()) } else { writeln!(out, "  {key:<13} {value}") }
    };
    row("scenario", &format!("{name} is valid"))?;
    row("title", title.unwrap_or(""))?;
    for s in sizes {
        let used = if s.usable { "" } else { ", cannot be used" };
        let (states, parameters) = (s.states, s.parameters);
        let what = format!(
            "{}: {states} states, {parameters} parameters, reading {}{used}",
            s.name, s.reading
        );
        row("observer", &what)?;
    }
    Ok(())
}

/// `1.2 MB`.
fn bytes(n: u128) -> String {
    let n = n as f64;
    for (unit, name) in [(1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB")] {
        if n >= unit {
            return format!("{} {name}", significant(n / unit, 3));
        }
    }
    format!("{n} bytes")
}

#[derive(serde::Serialize)]
struct Report<'a> {
    schema: &'static str,
    file: &'a str,
    valid: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    size: Option<Size>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bank: Option<BankSize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    adaptive: Vec<ObserverSize>,
    warnings: Vec<Place<'a>>,
    errors: Vec<Place<'a>>,
}

#[derive(serde::Serialize)]
struct Size {
    plants: usize,
    models: usize,
    delays: usize,
    order: usize,
    model_order: usize,
    method: &'static str,
    flops: f64,
    bytes: u64,
    memory_limit: u64,
}

#[derive(serde::Serialize)]
struct ObserverSize {
    name: String,
    states: usize,
    inputs: usize,
    outputs: usize,
    parameters: usize,
    reading: &'static str,
    usable: bool,
}

#[derive(serde::Serialize)]
struct BankSize {
    models: usize,
    order: usize,
    inputs: usize,
    outputs: usize,
    law: &'static str,
}

#[derive(serde::Serialize)]
struct Place<'a> {
    line: Option<usize>,
    column: Option<usize>,
    key: &'a str,
    message: String,
    remedy: &'a str,
}

impl<'a> Place<'a> {
    fn new(d: &'a Diagnostic) -> Self {
        Self {
            line: Some(d.line),
            column: Some(d.column),
            key: &d.key,
            message: d.message.clone(),
            remedy: &d.remedy,
        }
    }
}

impl<'a> Report<'a> {
    fn new(file: &'a str, study: &Study, cost: &Cost, warnings: &'a [Diagnostic]) -> Self {
        let narrow = |n: u128| u64::try_from(n).unwrap_or(u64::MAX);
        let size = Size {
            plants: cost.plants,
            models: cost.models,
            delays: cost.delays,
            order: cost.order,
            model_order: cost.model_order,
            method: json::method(cost.method),
            flops: cost.flops,
            bytes: narrow(cost.bytes),
            memory_limit: narrow(study.memory_limit),
        };
        let warnings = warnings.iter().map(Place::new).collect();
        Self {
            schema: "mmae.check/1",
            file,
            valid: true,
            size: Some(size),
            bank: None,
            adaptive: vec![],
            warnings,
            errors: vec![],
        }
    }

    fn of_bank(file: &'a str, bank: &Estimator, warnings: &'a [Diagnostic]) -> Self {
        let names = &bank.names;
        let size = BankSize {
            models: bank.labels.len(),
            order: names.states.len(),
            inputs: names.inputs.len(),
            outputs: names.outputs.len(),
            law: bank.weighting.law.name(),
        };
        Self {
            schema: "mmae.check/1",
            file,
            valid: true,
            size: None,
            bank: Some(size),
            adaptive: vec![],
            warnings: warnings.iter().map(Place::new).collect(),
            errors: vec![],
        }
    }

    fn of_adaptive(file: &'a str, adaptive: Vec<ObserverSize>, warnings: &'a [Diagnostic]) -> Self {
        Self {
            schema: "mmae.check/1",
            file,
            valid: true,
            size: None,
            bank: None,
            adaptive,
            warnings: warnings.iter().map(Place::new).collect(),
            errors: vec![],
        }
    }

    fn refused(file: &'a str, error: &'a scenario::Error) -> Self {
        let mut errors: Vec<Place<'_>> = error.diagnostics().iter().map(Place::new).collect();
        if errors.is_empty() {
            let message = error.to_string();
            errors.push(Place { line: None, column: None, key: "", message, remedy: "" });
        }
        Self {
            schema: "mmae.check/1",
            file,
            valid: false,
            size: None,
            bank: None,
            adaptive: vec![],
            warnings: vec![],
            errors,
        }
    }
}

fn print_json(out: &mut dyn Write, report: &Report<'_>) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, report)?;
    out.write_all(b"\n")
}
