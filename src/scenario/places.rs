//! Where the keys of a scenario stand, for errors that come later.

use std::collections::BTreeMap;

use super::diagnostic::{Diagnostic, Error};

/// Line and column, both from 1.
type Place = (usize, usize);

/// Entries of the plant's matrices: columns, and places by rows.
pub(super) type EntryPlaces = BTreeMap<&'static str, (usize, Vec<Place>)>;

/// The places of a scenario's keys.
#[derive(Debug, Clone, Default)]
pub(super) struct Places {
    pub(super) file: String,
    /// By dotted path.
    pub(super) keys: BTreeMap<String, Place>,
    /// Of the plant's matrices.
    pub(super) entries: EntryPlaces,
}

impl Places {
    /// `error` with the key that is responsible for it; that of no other key is a
    /// fault of the table `table`.
    pub(super) fn explain(&self, error: crate::Error, table: &str) -> Error {
        let mut key = responsible(&error);
        if table != "eip" {
            key = match key.as_str() {
                "eip" | "eip.memory_limit" => table.into(),
                "plant.dt" if !self.keys.contains_key("plant.dt") => "bank.dt".into(),
                _ => key,
            };
        }
        if key == "eip.delays" && !self.keys.contains_key("eip.delays") {
            key = "actuator.delay".into();
        }
        let mut place = None;
        if let Some((letter, row, col)) = entry(&error)
            && let Some((cols, places)) = self.entries.get(letter)
            && col < *cols
        {
            place = places.get(row * cols + col).copied();
        }
        // the nearest key above one that was left out
        let mut at = match key.as_str() {
            "eip" if self.keys.contains_key("weighting") => "weighting",
            "eip" if !self.keys.contains_key("eip") => "bank",
            key => key,
        };
        while place.is_none() && !at.is_empty() {
            place = self.keys.get(at).copied();
            at = at.rsplit_once('.').map_or("", |(head, _)| head);
        }
        let (line, column) = place.unwrap_or((1, 1));
        let (message, remedy) = split(&error);
        let file = self.file.clone();
        let at = Box::new(Diagnostic { file, line, column, key, message, remedy });
        Error::Engine { at, source: error }
    }
}

/// The message of an engine error and the remedy that it ends with.
pub(super) fn split(error: &crate::Error) -> (String, String) {
    let text = error.to_string();
    match text.rsplit_once(": ") {
        Some((message, remedy)) => (message.into(), remedy.into()),
        None => (text, "see the description of this key in the guide".into()),
    }
}

/// Matrix of the plant, row and column of an entry that is not finite.
fn entry(error: &crate::Error) -> Option<(&str, usize, usize)> {
    match error {
        crate::Error::Plant { source, .. } | crate::Error::AllFailed { source, .. } => {
            entry(source)
        }
        crate::Error::NonFinite { what, row, col } => Some((what, *row, *col)),
        _ => None,
    }
}

/// The key that an engine error is about.
fn responsible(error: &crate::Error) -> String {
    use crate::Error as E;
    match error {
        E::Plant { source, .. } | E::AllFailed { source, .. } => responsible(source),
        E::Model { .. } => "bank.models".into(),
        E::UnstablePlant { .. } | E::Quadrature { .. } => "eip.grid".into(),
        E::UnknownParameter { .. } => "eip.grid".into(),
        E::InvalidDt { .. } => "plant.dt".into(),
        E::Limit { .. } => "eip.memory_limit".into(),
        E::NonFinite { what, row, col } => format!("{}[{row}][{col}]", path(what)),
        E::Empty { what }
        | E::Shape { what, .. }
        | E::NotSymmetric { what, .. }
        | E::NotPsd { what, .. }
        | E::NotPositiveDefinite { what }
        | E::Range { what, .. } => path(what),
        _ => "eip".into(),
    }
}

/// The path of what the engine calls `what`.
fn path(what: &str) -> String {
    match what {
        "A" | "B" | "G" | "C" | "Q" | "R" => format!("plant.{what}"),
        "grid" => "eip.grid".into(),
        "actuator delay" => "eip.delays".into(),
        "W" => "weighting.innovation".into(),
        "Pi" => "weighting.Pi".into(),
        "prior" => "bank.prior".into(),
        "P(0)" => "bank.P0".into(),
        "x_hat(0)" => "bank.x0".into(),
        _ => match what.strip_prefix("grid of ") {
            Some(name) => format!("eip.grid.{name}"),
            None => what.into(),
        },
    }
}
