//! From the parsed text to a [`Scenario`]: tables in turn, then the checks that
//! need all of them.

use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::diagnostic::Error;
use super::places::Places;
use super::reader::{Reader, Value, clip};
use super::table::Table;
use super::{FORMAT, Scenario, bank, keys, plant, settings, surroundings};
use crate::model::{Family, Surroundings};

/// A syntax error of the parser as an `Error`.
pub(super) fn syntax(reader: &Reader<'_>, error: &toml::de::Error) -> Error {
    let span = error.span().unwrap_or(0..0);
    let text = reader.source.text;
    let message = error.message();
    let word = clip(text.get(span.clone()).unwrap_or("").trim());
    let (key, remedy) = match message {
        "duplicate key" => (word, "keep one of them"),
        _ => (String::new(), "see toml.io for the syntax"),
    };
    let message = format!("TOML: {message}");
    Error::Invalid(vec![reader.diagnostic(span.start, &key, message, remedy)])
}

/// Reads every table; each has its say before the first failure ends it.
pub(super) fn read<'a>(reader: &Reader<'a>, root: &DeTable<'a>) -> Option<Scenario> {
    let table = Table::new(reader, "", 0, root, keys::TOP);
    format(&table)?;
    let title = match table.get("title") {
        Some(value) => Some(reader.string("title", value)?.to_string()),
        None => None,
    };
    let shaped = table.get("disturbance").is_some();
    let plant = table.need("plant", "add [plant] with time, states, outputs, A, C and R");
    let plant::Read { family, entries, surroundings: brought } =
        plant::read(reader, plant?, shaped)?;
    let shaped = shaped || brought.disturbance.is_some();
    let names = family.names();
    let disturbance = table.get("disturbance").map(|value| {
        surroundings::filter(reader, "disturbance", value, &names.disturbances, "disturbances")
    });
    let input = table
        .get("input")
        .map(|value| surroundings::filter(reader, "input", value, &names.inputs, "inputs"));
    let controller =
        table.get("controller").map(|value| surroundings::controller(reader, value, names));
    let actuator = table.get("actuator").map(|value| surroundings::actuator(reader, value));
    let settings = table.get("eip").map(|value| settings::read(reader, value, &family));
    let weighted = plant.is_some_and(|p| has(p, "Q") || has(p, "family"));
    let bank = table.get("bank").map(|value| bank::read(reader, value, &family, shaped, weighted));
    // each has had its say
    let actuator = actuator.map_or(Some(Default::default()), |a| a)?;
    let mut settings = maybe(settings)?;
    if let (Some((delay, at)), Some(settings)) = (actuator.delay, &mut settings) {
        if !settings.delays.is_empty() {
            let remedy = "keep eip.delays for a family, actuator.delay for one";
            let message = "both actuator.delay and eip.delays are given";
            return reader.error(at, "actuator.delay", message, remedy);
        }
        settings.delays = vec![delay];
    }
    let scenario = Scenario {
        title,
        surroundings: Surroundings {
            // the file's own stands before what a built-in family brings
            controller: maybe(controller)?.or(brought.controller),
            disturbance: maybe(disturbance)?.or(brought.disturbance),
            input: maybe(input)?.or(brought.input),
            pade_order: actuator.pade,
        },
        bank: maybe(bank)?,
        settings,
        warnings: Vec::new(),
        places: Places { entries, ..places(reader, root) },
        family: Arc::new(family),
    };
    if !reader.failed() {
        check(reader, &scenario);
        without_effect(reader, &scenario);
    }
    Some(scenario)
}

/// An optional part: `None` when it is there and wrong.
fn maybe<T>(part: Option<Option<T>>) -> Option<Option<T>> {
    match part {
        None => Some(None),
        Some(None) => None,
        Some(value) => Some(value),
    }
}

fn has(value: &Value<'_>, key: &str) -> bool {
    matches!(value.get_ref(), DeValue::Table(map) if map.get(key).is_some())
}

fn format(table: &Table<'_, '_>) -> Option<()> {
    let Some(value) = table.get("format") else {
        let remedy = "add format = 1 at the top";
        table.reader.warn(0, "format", "missing, taken for 1", remedy);
        return Some(());
    };
    match table.reader.integer("format", value, 1)? {
        1..=FORMAT => Some(()),
        newer => {
            let message = format!("format {newer} needs a newer mmae; this one reads {FORMAT}");
            table.error("format", message, "update mmae, or write the file in the older format")
        }
    }
}

/// The engine's own checks, at the nominal values.
fn check(reader: &Reader<'_>, scenario: &Scenario) {
    let names = scenario.family.names();
    let theta: Vec<f64> = scenario.family.parameters().iter().map(|p| p.nominal).collect();
    let around = &scenario.surroundings;
    let (nu, ny, nw) = (names.inputs.len(), names.outputs.len(), names.disturbances.len());
    let checked = scenario
        .family
        .plant(&theta)
        .and_then(|plant| plant.check())
        .and_then(|()| around.controller.as_ref().map_or(Ok(()), |k| k.check(nu, ny)))
        .and_then(|()| around.disturbance.as_ref().map_or(Ok(()), |f| f.check("disturbance", nw)))
        .and_then(|()| around.input.as_ref().map_or(Ok(()), |f| f.check("input", nu)));
    if let Err(error) = checked
        && let Error::Engine { at, source } = scenario.explain(error)
    {
        reader.refuse(*at, source);
    }
}

/// Warns of keys that change nothing.
fn without_effect(reader: &Reader<'_>, scenario: &Scenario) {
    let warn = |key: &str, message: &str, remedy: &str| {
        if let Some(&(line, column)) = scenario.places.keys.get(key) {
            reader.warn_at((line, column), key, message, remedy);
        }
    };
    let around = &scenario.surroundings;
    if around.disturbance.is_some() && scenario.bank.as_ref().is_none_or(|b| b.shaping) {
        let message = "without effect: the filter of [disturbance] has its own intensity";
        warn("plant.Q", message, "give disturbance.Q, or remove this one");
    }
    if around.controller.is_none() && around.input.is_none() {
        for key in ["eip.delays", "actuator.delay"] {
            let message = "without effect: nothing drives the inputs";
            warn(key, message, "add [controller] or [input], or remove the delay");
        }
    }
}

/// Places of the keys of the upper three levels, and of matrix entries.
fn places(reader: &Reader<'_>, root: &DeTable<'_>) -> Places {
    fn walk(reader: &Reader<'_>, path: &str, map: &DeTable<'_>, places: &mut Places) {
        for (key, value) in map {
            let path = if path.is_empty() {
                key.get_ref().to_string()
            } else {
                format!("{path}.{}", key.get_ref())
            };
            places.keys.insert(path.clone(), reader.source.position(value.span().start));
            if let DeValue::Table(inner) = value.get_ref() {
                walk(reader, &path, inner, places);
            }
        }
    }
    let mut places = Places { file: reader.source.name.into(), ..Places::default() };
    walk(reader, "", root, &mut places);
    places
}
