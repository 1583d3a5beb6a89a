//! From the parsed text to a [`Scenario`]: tables in turn, then the checks that
//! need all of them.

use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::diagnostic::Error;
use super::explicit::Explicit;
use super::places::Places;
use super::reader::{Reader, Value, clip};
use super::table::Table;
use super::{
    FORMAT, Scenario, adaptive, bank, explicit, keys, plant, run, settings, signals, surroundings,
    truth, weighting,
};
use crate::model::{Family, Names, Surroundings, Time};
use crate::observer::ObserverKind;

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

/// Reads every table; each has its say before the first failure ends it. With
/// `given` the plants are those of the caller.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    root: &DeTable<'a>,
    given: Option<Arc<dyn Family>>,
) -> Option<Scenario> {
    let table = Table::new(reader, "", 0, root, keys::TOP);
    format(&table)?;
    let title = match table.get("title") {
        Some(value) => Some(reader.string("title", value)?.to_string()),
        None => None,
    };
    if table.get("adaptive").is_some() && table.get("bank").is_none() {
        return adaptive_alone(&table, title);
    }
    let shaped = table.get("disturbance").is_some();
    let matrices = table.get("bank").filter(|bank| {
        let described = table.get("plant").is_some_and(|p| has(p, "A") || has(p, "family"));
        explicit::is_explicit(bank) && !described
    });
    let mut models = None;
    let own = given.is_some();
    let (plant, read) = match (given, matrices) {
        (Some(_), Some(_)) => {
            let remedy = "give the models as parameter values";
            return table.error("bank", "models by matrices, but the plants are given", remedy);
        }
        (Some(_), None) if table.get("plant").is_some() => {
            return table.error("plant", "the plants are given with the text", "remove it");
        }
        (Some(family), None) => (None, plant::around(family)),
        (None, Some(bank)) => {
            let (read, found) = without_family(&table, bank)?;
            models = Some(found);
            (None, read)
        }
        (None, None) => {
            let plant =
                table.need("plant", "add [plant] with time, states, outputs, A, C and R")?;
            (Some(plant), plant::read(reader, plant, shaped)?)
        }
    };
    let plant::Read { family, entries, surroundings: brought } = read;
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
    let weighted = own || plant.is_some_and(|p| has(p, "Q") || has(p, "family"));
    // the file's own filter stands before what a built-in family brings
    let filter_states = match &disturbance {
        Some(own) => own.as_ref().map_or(0, |f| f.nf()),
        None => brought.disturbance.as_ref().map_or(0, |f| f.nf()),
    };
    let bank = match &models {
        Some(found) => Some(bank::explicit(reader, table.get("bank")?, &family, found)),
        None => table
            .get("bank")
            .map(|value| bank::read(reader, value, &family, shaped, filter_states, weighted)),
    };
    let size = bank.as_ref().and_then(|b| b.as_ref()).map(|(b, _)| b.models.len());
    // without models the checks of their number would only repeat what was said
    let weighting = table.get("weighting").filter(|_| size.is_some()).map(|value| {
        let (models, outputs) = (size.unwrap_or(0), family.names.outputs.len());
        let observer = bank.as_ref().and_then(|b| b.as_ref()).map(|(b, _)| b.observer);
        let held = observer.is_none_or(ObserverKind::is_continuous);
        weighting::read(reader, value, models, outputs, held)
    });
    let truth = table.get("truth").map(|value| {
        let own = family.names.states.len() + filter_states;
        truth::read(reader, value, &family, size.unwrap_or(0), own)
    });
    let signals =
        table.get("signals").map(|value| signals::read(reader, value, names, filter_states > 0));
    let run = table.get("run").map(|value| run::read(reader, value));
    let adaptive = table.get("adaptive").map(|value| adaptive::read(reader, value));
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
    let (bank, start) = maybe(bank)?.unzip();
    let scenario = Scenario {
        title,
        surroundings: Surroundings {
            // the file's own stands before what a built-in family brings
            controller: maybe(controller)?.or(brought.controller),
            disturbance: maybe(disturbance)?.or(brought.disturbance),
            input: maybe(input)?.or(brought.input),
            pade_order: actuator.pade,
        },
        delay: actuator.delay.map_or(0.0, |(delay, _)| delay),
        unmodelled: actuator.unmodelled,
        bank,
        start,
        explicit: models,
        weighting: maybe(weighting)?,
        truth: maybe(truth)?,
        signals: maybe(signals)?.unwrap_or_default(),
        run: maybe(run)?,
        settings,
        adaptive: maybe(adaptive)?,
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

/// A file of adaptive observers: the first one's plant stands for the family.
fn adaptive_alone<'a>(table: &Table<'_, 'a>, title: Option<String>) -> Option<Scenario> {
    let reader = table.reader;
    let only = ["format", "title", "adaptive", "signals", "run"];
    let other = keys::TOP.iter().find(|key| !only.contains(key) && table.get(key).is_some());
    if let Some(key) = other {
        let remedy = "remove it, or add [bank]: adaptive observers alone take \
                      [adaptive], [signals] and [run]";
        return table.error(key, "without a bank", remedy);
    }
    let section = adaptive::read(reader, table.get("adaptive")?);
    let run = table.get("run").map(|value| run::read(reader, value));
    let section = section?;
    let signals = table.get("signals").map(|value| adaptive::signals(table, value, &section.names));
    let first = section.observers.first()?;
    let plant = adaptive::stand_in(first);
    let names = Names { states: first.states().to_vec(), ..section.names.clone() };
    Some(Scenario {
        title,
        surroundings: Surroundings::default(),
        delay: 0.0,
        bank: None,
        start: None,
        explicit: None,
        weighting: None,
        truth: None,
        signals: maybe(signals)?.unwrap_or_default(),
        run: maybe(run)?,
        unmodelled: None,
        settings: None,
        adaptive: Some(section),
        warnings: Vec::new(),
        places: places(reader, table.top()),
        family: Arc::new(explicit::family(&plant, names)),
    })
}

/// Names, time and models of a file whose bank is given by matrices: `[plant]`
/// then only names things.
fn without_family<'a>(table: &Table<'_, 'a>, bank: &Value<'a>) -> Option<(plant::Read, Explicit)> {
    let reader = table.reader;
    let models = bank.get_ref().as_table()?.get("models")?.get_ref().as_array()?;
    let (time, names) = match table.get("plant") {
        Some(value) => plant::names_only(reader, value)?,
        None => (Time::Discrete { dt: 1.0 }, Names::default()),
    };
    let found = explicit::read(reader, models, time)?;
    let first = found.plants.first()?;
    let numbered = Names::numbered(first.nx(), first.nu(), first.nw(), first.ny());
    let mut names = names;
    for (key, list, default) in [
        ("states", &mut names.states, numbered.states),
        ("inputs", &mut names.inputs, numbered.inputs),
        ("disturbances", &mut names.disturbances, numbered.disturbances),
        ("outputs", &mut names.outputs, numbered.outputs),
    ] {
        if list.is_empty() {
            *list = default;
        } else if list.len() != default.len() {
            let message = format!("{} names, but the models have {}", list.len(), default.len());
            let at = table.place("plant", key);
            return reader.error(at, &format!("plant.{key}"), message, "name each of them");
        }
    }
    let read = plant::Read {
        family: explicit::family(first, names),
        entries: Default::default(),
        surroundings: Surroundings::default(),
    };
    Some((read, found))
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
    let driven = !scenario.signals.inputs.is_empty();
    if around.controller.is_none() && around.input.is_none() && !driven {
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
