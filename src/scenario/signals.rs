//! `[signals]`: what drives the simulated plant, as known functions of time.

use toml::de::DeValue;

use super::reader::{Reader, Value, all};
use super::table::Table;
use super::{keys, suggest};
use crate::model::Names;
use crate::sim::{Signal, Signals, Term, Wave};

/// Longest sum of terms.
const TERMS: usize = 100;

/// Reads `[signals]`.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    names: &Names,
    filtered: bool,
) -> Option<Signals> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("signals", value, "a table");
    };
    let table = Table::new(reader, "signals", value.span().start, map, keys::SIGNALS);
    let inputs = channels(&table, "inputs", &names.inputs);
    let disturbances = channels(&table, "disturbances", &names.disturbances);
    let noise = channels(&table, "noise", &names.outputs);
    if filtered && table.get("disturbances").is_some() {
        let message = "the disturbances come out of the filter of [disturbance]";
        return table.error("disturbances", message, "remove one of the two");
    }
    let given = |list: Vec<Option<Signal>>| {
        if list.iter().all(Option::is_none) { Vec::new() } else { list }
    };
    let inputs = given(inputs?).into_iter().map(Option::unwrap_or_default).collect();
    Some(Signals { inputs, disturbances: given(disturbances?), noise: given(noise?) })
}

/// The signals of the channels `names`, by name.
fn channels(table: &Table<'_, '_>, key: &str, names: &[String]) -> Option<Vec<Option<Signal>>> {
    let mut found: Vec<Option<Signal>> = vec![None; names.len()];
    let Some(value) = table.get(key) else { return Some(found) };
    let (reader, path) = (table.reader, table.key(key));
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(&path, value, "a table of signals by name");
    };
    let inner = Table::named(reader, &path, value.span().start, map)?;
    let read = all(inner.in_order().into_iter().map(|(name, span, value)| {
        let key = inner.key(name);
        let Some(channel) = names.iter().position(|n| n == name) else {
            let known: Vec<&str> = names.iter().map(String::as_str).collect();
            let remedy = suggest::remedy(name, &known, "the names here are");
            return reader.error(span.start, &key, "no such channel of the plant", remedy);
        };
        let signal = signal(reader, &key, value)?;
        match signal.check(&key) {
            Ok(()) => Some((channel, signal)),
            Err(e) => {
                let (message, remedy) = super::places::split(&e);
                reader.error(value.span().start, &key, message, remedy)
            }
        }
    }))?;
    for (channel, signal) in read {
        found[channel] = Some(signal);
    }
    Some(found)
}

/// A number, a wave, or a list of them to be added.
fn signal(reader: &Reader<'_>, key: &str, value: &Value<'_>) -> Option<Signal> {
    match value.get_ref() {
        DeValue::Array(list) if list.len() > TERMS => {
            let message = format!("{} terms, over the limit of {TERMS}", list.len());
            reader.error(value.span().start, key, message, "write it as a table of values")
        }
        DeValue::Array(list) => {
            let terms = list.iter().enumerate();
            let terms = all(terms.map(|(i, v)| term(reader, &format!("{key}[{i}]"), v)))?;
            Some(Signal { terms })
        }
        _ => Some(Signal { terms: vec![term(reader, key, value)?] }),
    }
}

/// The shapes and their names.
#[derive(Clone, Copy, PartialEq)]
enum Shape {
    Constant,
    Square,
    Sine,
    Table,
    White,
}

const SHAPES: [(&str, Shape); 5] = [
    ("constant", Shape::Constant),
    ("square", Shape::Square),
    ("sine", Shape::Sine),
    ("table", Shape::Table),
    ("white", Shape::White),
];

/// Keys that belong to one shape each, or to two.
fn admits(shape: Shape, key: &str) -> bool {
    match key {
        "wave" => true,
        "decay" => shape != Shape::White,
        "amplitude" => matches!(shape, Shape::Square | Shape::Sine),
        "period" => shape == Shape::Square,
        "omega" | "phase" => shape == Shape::Sine,
        "t" => shape == Shape::Table,
        "value" => matches!(shape, Shape::Table | Shape::Constant),
        "intensity" => shape == Shape::White,
        _ => true, // reported as unknown already
    }
}

fn term(reader: &Reader<'_>, key: &str, value: &Value<'_>) -> Option<Term> {
    let map = match value.get_ref() {
        DeValue::Table(map) => map,
        DeValue::Integer(_) | DeValue::Float(_) => {
            let value = reader.number(key, value)?;
            return Some(Term { wave: Wave::Constant { value }, decay: 0.0 });
        }
        _ => {
            let wanted = "a number or a table such as { wave = \"sine\", omega = 2 }";
            return reader.wrong_type(key, value, wanted);
        }
    };
    let table = Table::new(reader, key, value.span().start, map, keys::WAVE);
    let wave = table.need("wave", "add wave = \"square\", \"sine\", \"table\", .. ")?;
    let shape = reader.choice(&table.key("wave"), wave, &SHAPES)?;
    for (name, span, _) in table.in_order() {
        if !admits(shape, name) {
            let known = keys::WAVE.iter().filter(|k| admits(shape, k));
            let remedy =
                format!("this wave takes {}", known.copied().collect::<Vec<_>>().join(", "));
            return reader.error(span.start, &table.key(name), "not of this wave", remedy);
        }
    }
    let number = |key: &str, default: Option<f64>| match (table.get(key), default) {
        (Some(value), _) => reader.number(&table.key(key), value),
        (None, Some(default)) => Some(default),
        (None, None) => {
            table.need(key, "this wave needs it")?;
            None
        }
    };
    let wave = match shape {
        Shape::Constant => Wave::Constant { value: number("value", None)? },
        Shape::Square => Wave::Square {
            amplitude: number("amplitude", Some(1.0))?,
            period: number("period", None)?,
        },
        Shape::Sine => Wave::Sine {
            amplitude: number("amplitude", Some(1.0))?,
            omega: number("omega", None)?,
            phase: number("phase", Some(0.0))?,
        },
        Shape::Table => {
            let list = |key: &str| {
                let value = table.need(key, "give the times t and as many values")?;
                reader.numbers(&table.key(key), value)
            };
            let (t, value) = (list("t"), list("value"));
            Wave::Table { t: t?, value: value? }
        }
        Shape::White => Wave::White { intensity: number("intensity", None)? },
    };
    Some(Term { wave, decay: number("decay", Some(0.0))? })
}
