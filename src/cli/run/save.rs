//! The result directory of `mmae run`.

use std::time::{Instant, SystemTime};

use super::super::arguments::RunArguments;
use super::super::failure::Failure;
use super::super::output::Watch;
use super::super::signals::Signals;
use super::show;
use crate::real::Tier;
use crate::report::manifest::{self, Manifest};
use crate::report::write::{self, MANIFEST, Output};
use crate::scenario::Simulation;
use crate::sim::Summary;

pub(super) const FILES: [&str; 2] = ["run.json", MANIFEST];

pub(super) fn save(
    args: &RunArguments,
    simulation: &Simulation,
    summary: &Summary,
    mut output: Output,
    signals: &Signals,
    (wall, start): (SystemTime, Instant),
) -> Result<(), Failure> {
    let written = output.add(FILES[0], |out| {
        show::json(&mut Watch { out, signals: Some(signals) }, simulation, summary)
    });
    if signals.raised() {
        return Err(Failure::Cancelled);
    }
    written.map_err(Failure::from)?;
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
        threads: match args.threads {
            0 => std::thread::available_parallelism().map_or(1, Into::into),
            n => n.into(),
        },
        started: manifest::rfc3339(wall),
        seconds: start.elapsed().as_secs_f64(),
        files: output.written(),
    };
    output.add(MANIFEST, |out| manifest.write(out))?;
    if signals.raised() {
        return Err(Failure::Cancelled);
    }
    Ok(output.commit()?)
}
