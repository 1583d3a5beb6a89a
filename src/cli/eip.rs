//! `mmae eip`: the EIP sets of a scenario.

use std::io;

use super::arguments::EipArguments;
use super::clock::Clock;
use super::failure::{Failure, say};
use super::output::{self, Watch};
use super::progress::Progress;
use super::shard;
use super::signals::Signals;
use crate::eip::{Case, EipSets};
use crate::error::Error;
use crate::par::RunControl;
use crate::report::write::{MANIFEST, Output, REPORT};
use crate::report::{figure, html, json, summary, table, text};
use crate::scenario::Scenario;

const FILES: [&str; 5] = ["eip.json", "upsilon.parquet", "eip.svg", REPORT, MANIFEST];
/// Messages of one kind, at most.
const MANY: usize = 4;

pub(super) fn run(args: &EipArguments, signals: &Signals) -> Result<(), Failure> {
    if args.in_parts() {
        return shard::run(args, signals);
    }
    let clock = Clock::start();
    let scenario = Scenario::from_file(&args.file)?;
    for warning in scenario.warnings() {
        say("warning", &warning.to_string());
    }
    let study = scenario.study()?;
    let explain = |e: Error| Failure::from(scenario.explain(e));
    // whatever keeps the run from starting or ending well is told before it
    study.cost().map_err(explain)?;
    let output = match &args.out {
        Some(dir) => Some(Output::open(dir, &FILES, args.force)?),
        None => None,
    };
    let progress = Progress::new();
    let report = |done, total| progress.update(done, total);
    let control = RunControl::default()
        .threads(args.threads.into())
        .cancel(signals.cancel())
        .progress(&report);
    let result = study.run(&control);
    progress.finish();
    let sets = result.map_err(|e| match e {
        Error::Cancelled => Failure::Cancelled,
        e => explain(e),
    })?;
    refuse_empty(&sets)?;
    warn(&sets);
    if let Some(output) = output {
        let dir = output.dir().to_path_buf();
        save(&sets, args, output, signals, &clock)?;
        say("note", &format!("wrote {} to {}", FILES.join(", "), dir.display()));
    }
    output::print(Some(signals), |out| {
        if args.json {
            json::write(&sets, out)
        } else {
            out.write_all(text::render(&sets).as_bytes())
        }
    })
}

/// Fails if no plant has a winner for any delay.
fn refuse_empty(sets: &EipSets) -> Result<(), Failure> {
    if sets.cases.iter().any(|case| case.winner.iter().any(Option::is_some)) {
        return Ok(());
    }
    let mut messages = Vec::new();
    let failed = sets.models.iter().enumerate().filter_map(|(i, m)| Some((i, m.failure.as_ref()?)));
    for (i, failure) in failed {
        let name = summary::model_name(sets, i);
        let cause = summary::cause(failure);
        messages.push(format!("model {} ({name}) is unusable: {cause}", i + 1));
    }
    limit(&mut messages);
    for case in &sets.cases {
        messages.extend(missing(sets, case));
    }
    let count = summary::count(sets.grid.len(), "plant");
    messages.push(format!("none of the {count} has a winner: nothing was written"));
    Err(Failure::Numerical(messages))
}

/// Plants without a winner, a line for each reason.
fn missing(sets: &EipSets, case: &Case) -> Vec<String> {
    let mut lines = Vec::new();
    let delay = if sets.cases.len() > 1 {
        format!(" with delay {}", summary::delay(case.delay))
    } else {
        String::new()
    };
    let of = |n: usize| format!("{n} of {}{delay}", summary::count(case.winner.len(), "plant"));
    if let Some(first) = case.unstable.first() {
        lines.push(format!(
            "the loop of {} is unstable (first: {}, mode {}): they have no winner",
            of(case.unstable.len()),
            summary::plant_name(sets, first.plant),
            first.mode,
        ));
    }
    if let Some(first) = case.failed.first() {
        let at = summary::plant_name(sets, first.plant);
        let cause = summary::plant_cause(&first.error);
        let n = of(case.failed.len());
        lines.push(format!("{n} cannot be built, the first at {at}: {cause}"));
    }
    if let Some(first) = case.undecided.first() {
        lines.push(format!(
            "{} are not decided: neither route vouches for a winner (first: {}, {})",
            of(case.undecided.len()),
            summary::plant_name(sets, first.plant),
            summary::doubt(&first.doubt),
        ));
    }
    lines
}

/// What a partial result lacks, on the standard error.
fn warn(sets: &EipSets) {
    for case in &sets.cases {
        for line in missing(sets, case) {
            say("warning", &line);
        }
        if case.replaced > 0 {
            let (n, all) = (case.replaced, case.upsilon.len());
            say(
                "warning",
                &format!(
                    "{n} of {all} pairs take the frequency integral: the Lyapunov route has lost digits there, or cannot decide"
                ),
            );
        }
        if summary::no_margin(sets, case) {
            say("warning", "no plant tells the models apart: every margin is zero");
        }
    }
    for (i, model) in sets.models.iter().enumerate() {
        if let Some(failure) = &model.failure {
            let name = summary::model_name(sets, i);
            say("warning", &format!("model {} ({name}) is unusable: {failure}", i + 1));
        }
    }
}

fn limit(messages: &mut Vec<String>) {
    if messages.len() > MANY {
        messages.truncate(MANY);
        messages.push("and more of the same kind".into());
    }
}

/// Writes the result directory.
fn save(
    sets: &EipSets,
    args: &EipArguments,
    mut output: Output,
    signals: &Signals,
    clock: &Clock,
) -> Result<(), Failure> {
    let mut add =
        |name: &str, fill: &mut dyn FnMut(&mut (dyn io::Write + Send)) -> io::Result<()>| {
            let written = output.add(name, |out| fill(&mut Watch { out, signals: Some(signals) }));
            if signals.raised() { Err(Failure::Cancelled) } else { written.map_err(Failure::from) }
        };
    add(FILES[0], &mut |out| json::write(sets, out))?;
    add(FILES[1], &mut |out| table::write(sets, out).map_err(io::Error::other))?;
    add(FILES[2], &mut |out| figure::write(sets, out))?;
    let (subtitle, text) = (summary::scope(sets), output::scenario(&args.file));
    let manifest = clock.manifest(&args.file, threads(args), output.written())?;
    let page = html::study(sets, &subtitle, &text, &manifest);
    output.add(REPORT, |out| html::write(&page, out))?;
    let manifest = clock.manifest(&args.file, threads(args), output.written())?;
    output.add(MANIFEST, |out| manifest.write(out))?;
    if signals.raised() {
        return Err(Failure::Cancelled);
    }
    Ok(output.commit()?)
}

fn threads(args: &EipArguments) -> usize {
    match args.threads {
        0 => std::thread::available_parallelism().map_or(1, Into::into),
        n => n.into(),
    }
}
