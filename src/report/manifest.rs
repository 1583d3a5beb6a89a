//! `manifest.json`: how a result directory came to be.

use std::io;
use std::io::Write;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::report::write::Written;

/// Name and version of the layout.
pub const SCHEMA: &str = "mmae.manifest/1";

/// What a run was, for `manifest.json`.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Manifest {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Version of the program.
    pub version: &'static str,
    /// The command line, program first.
    pub command: Vec<String>,
    /// The scenario file.
    pub scenario: Scenario,
    /// Instruction set of the kernels.
    pub cpu_tier: String,
    /// Threads used.
    pub threads: usize,
    /// Start of the run, UTC, RFC 3339.
    pub started: String,
    /// Time from the start until the files were written, in seconds.
    pub seconds: f64,
    /// The other files of the directory.
    pub files: Vec<Written>,
}

/// A scenario file, identified by its contents.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Scenario {
    /// Path as given.
    pub path: String,
    /// SHA-256 of its bytes, in hexadecimal.
    pub sha256: String,
}

impl Manifest {
    /// Writes the manifest as indented JSON.
    ///
    /// # Errors
    /// Whatever `out` reports.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        serde_json::to_writer_pretty(&mut out, self)?;
        out.write_all(b"\n")
    }
}

/// `2026-02-28T09:30:00Z`: a point in time as RFC 3339 writes it, to the second.
///
/// ```
/// use std::time::{Duration, UNIX_EPOCH};
/// let leap = UNIX_EPOCH + Duration::from_secs(1_709_164_800);
/// assert_eq!(mmae::report::manifest::rfc3339(leap), "2024-02-29T00:00:00Z");
/// ```
pub fn rfc3339(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    // Gregorian calendar counted from 1 March 0000, so that the leap day ends a
    // year; 719468 days lie between that date and 1970-01-01
    let days = days + 719_468;
    let era = days / 146_097;
    let of_era = days % 146_097;
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let day_of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (rest / 3600, rest / 60 % 60, rest % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}
