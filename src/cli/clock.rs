//! When a run began, and the manifest of what it wrote.

use std::path::Path;
use std::time::{Instant, SystemTime};

use super::failure::Failure;
use crate::real::Tier;
use crate::report::manifest::{self, Manifest};
use crate::report::write::{self, Written};
use crate::scenario::Error;

pub(super) struct Clock {
    wall: SystemTime,
    start: Instant,
}

impl Clock {
    pub(super) fn start() -> Self {
        Clock { wall: SystemTime::now(), start: Instant::now() }
    }

    /// The manifest of a run of the scenario `file` that wrote `files`.
    pub(super) fn manifest(
        &self,
        file: &Path,
        threads: usize,
        files: Vec<Written>,
    ) -> Result<Manifest, Failure> {
        let bytes = std::fs::read(file)
            .map_err(|source| Failure::from(Error::Read { path: file.into(), source }))?;
        Ok(Manifest {
            schema: manifest::SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            command: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
            scenario: manifest::Scenario {
                path: file.display().to_string(),
                sha256: write::sha256(&bytes),
            },
            cpu_tier: Tier::best().name().into(),
            threads,
            started: manifest::rfc3339(self.wall),
            seconds: self.start.elapsed().as_secs_f64(),
            files,
        })
    }
}
