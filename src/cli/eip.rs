//! `mmae eip`: the EIP sets of a scenario.

use std::io;
use std::time::{Instant, SystemTime};

use super::arguments::EipArguments;
use super::failure::{Failure, say};
use super::output::{self, Watch};
use super::progress::Progress;
use super::signals::Signals;
use crate::eip::EipSets;
use crate::error::Error;
use crate::par::RunControl;
use crate::real::Tier;
use crate::report::manifest::{self, Manifest};
use crate::report::write::{MANIFEST, Output};
use crate::report::{figure, json, summary, table, text, write};
use crate::scenario::Scenario;

const FILES: [&str; 4] = ["eip.json", "upsilon.parquet", "eip.svg", MANIFEST];
/// Messages of one kind, at most.
const MANY: usize = 4;

pub(super) fn run(args: &EipArguments, signals: &Signals) -> Result<(), Failure> {
    let clock = Clock { wall: SystemTime::now(), start: Instant::now() };
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

struct Clock {
    wall: SystemTime,
    start: Instant,
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
    let unusable = messages.len();
    limit(&mut messages);
    let plants: Vec<_> = sets.cases.iter().flat_map(|case| &case.unstable).collect();
    if !plants.is_empty() {
        let mut unstable: Vec<String> = plants
            .iter()
            .take(MANY + 1)
            .map(|u| {
                let at = summary::plant_name(sets, u.plant);
                Error::UnstablePlant { index: u.plant, parameters: at, mode: u.mode }.to_string()
            })
            .collect();
        limit(&mut unstable);
        messages.extend(unstable);
    }
    let count = summary::count(sets.grid.len(), "plant");
    let summary = if unusable == sets.models.len() {
        format!("none of the {} is usable", summary::count(unusable, "model"))
    } else {
        format!("none of the {count} has a winner")
    };
    messages.push(format!("{summary}: nothing was written"));
    Err(Failure::Numerical(messages))
}

/// What a partial result lacks, on the standard error.
fn warn(sets: &EipSets) {
    for case in &sets.cases {
        if let Some(first) = case.unstable.first() {
            let delay = if sets.cases.len() > 1 {
                format!(" with delay {}", summary::delay(case.delay))
            } else {
                String::new()
            };
            say(
                "warning",
                &format!(
                    "the loop of {} of {}{delay} is unstable (first: {}, mode {}): they have no winner",
                    case.unstable.len(),
                    summary::count(case.winner.len(), "plant"),
                    summary::plant_name(sets, first.plant),
                    first.mode,
                ),
            );
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
    let bytes = std::fs::read(&args.file).map_err(|source| {
        Failure::from(crate::scenario::Error::Read { path: args.file.clone(), source })
    })?;
    let manifest = Manifest {
        schema: manifest::SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        command: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
        scenario: manifest::Scenario {
            path: args.file.display().to_string(),
            sha256: write::sha256(&bytes),
        },
        cpu_tier: Tier::best().name().into(),
        threads: threads(args),
        started: manifest::rfc3339(clock.wall),
        seconds: clock.start.elapsed().as_secs_f64(),
        files: output.written(),
    };
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
