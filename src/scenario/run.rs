//! `[run]`: how long, how often, and what is reported.

use toml::de::DeValue;

use super::keys;
use super::reader::{Reader, Value};
use super::table::Table;
use crate::sim::Measurement;

const MEASUREMENTS: [(&str, Measurement); 2] =
    [("sampled", Measurement::Sampled), ("continuous", Measurement::Continuous)];

/// `[run]`, read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Run {
    pub(super) length: Length,
    pub(super) trials: u64,
    pub(super) seed: u64,
    pub(super) every: u64,
    pub(super) measurement: Measurement,
}

/// How long a trial is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Length {
    /// So many measurements.
    Steps(u64),
    /// So many seconds.
    Duration(f64),
}

/// Reads `[run]`.
pub(super) fn read<'a>(reader: &Reader<'a>, value: &Value<'a>) -> Option<Run> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("run", value, "a table");
    };
    let table = Table::new(reader, "run", value.span().start, map, keys::RUN);
    let length = match (table.get("steps"), table.get("duration")) {
        (Some(_), Some(_)) => {
            table.error("duration", "both steps and duration are given", "keep one of them")
        }
        (_, Some(value)) => match reader.number("run.duration", value)? {
            seconds if seconds > 0.0 => Some(Length::Duration(seconds)),
            seconds => {
                let message = format!("{seconds} is not a duration");
                table.error("duration", message, "give positive seconds")
            }
        },
        (None, None) => {
            table.need("steps", "give the number of measurements, or duration").and(None)
        }
        (Some(value), None) => reader.integer("run.steps", value, 1).map(Length::Steps),
    };
    let whole = |key: &str, least: i64, default: u64| match table.get(key) {
        Some(value) => reader.integer(&table.key(key), value, least),
        None => Some(default),
    };
    let (trials, seed, every) = (whole("trials", 1, 1), whole("seed", 0, 1), whole("every", 0, 0));
    let measurement = match table.get("measurement") {
        Some(value) => reader.choice("run.measurement", value, &MEASUREMENTS),
        None => Some(Measurement::Sampled),
    };
    Some(Run {
        length: length?,
        trials: trials?,
        seed: seed?,
        every: every?,
        measurement: measurement?,
    })
}
