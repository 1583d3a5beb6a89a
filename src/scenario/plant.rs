//! `[plant]`: names, parameters and matrices.

use std::cell::RefCell;

use faer::Mat;
use toml::de::DeValue;

use super::expression::Entry;
use super::family::{ExpressionFamily, Origin, Pattern, Quantity, values};
use super::keys;
use super::matrix::{Scope, Size, Written};
use super::operators::{CONSTANTS, FUNCTIONS};
use super::places::EntryPlaces;
use super::reader::{Reader, Value};
use super::table::Table;
use crate::model::{Names, Parameter, Time};

/// Reads `[plant]`; `shaped` when a filter colours the disturbance, whose
/// intensity is then that of the filter.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    shaped: bool,
) -> Option<(ExpressionFamily, EntryPlaces)> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("plant", value, "a table");
    };
    let table = Table::new(reader, "plant", value.span().start, map, keys::PLANT);
    let time = time(&table);
    let quantities = quantities(&table);
    let list = |key: &str| match table.get(key) {
        Some(value) => reader.names(&table.key(key), value),
        None => Some(Vec::new()),
    };
    let some = |key: &str| {
        let remedy = format!("name them, as in {key} = [\"a\", \"b\"]");
        let value = table.need(key, &remedy)?;
        match reader.names(&table.key(key), value)? {
            names if names.is_empty() => table.error(key, "the list is empty", remedy),
            names => Some(names),
        }
    };
    let (states, outputs) = (some("states"), some("outputs"));
    let (inputs, disturbances) = (list("inputs"), list("disturbances"));
    let names =
        Names { states: states?, inputs: inputs?, disturbances: disturbances?, outputs: outputs? };
    let quantities = quantities?;
    let (patterns, places) = matrices(&table, &names, &quantities, shaped)?;
    let (parameters, quantities) = quantities;
    let family = ExpressionFamily { parameters, quantities, names, time: time?, patterns };
    unused(&table, &family);
    Some((family, places))
}

fn time(table: &Table<'_, '_>) -> Option<Time> {
    let choices = [("continuous", true), ("discrete", false)];
    let value = table.need("time", "write time = \"continuous\" or time = \"discrete\"")?;
    let continuous = table.reader.choice("plant.time", value, &choices)?;
    match (continuous, table.get("dt")) {
        (true, None) => Some(Time::Continuous),
        (true, Some(_)) => table.error(
            "dt",
            "a continuous plant is not sampled",
            "remove it, or set time = \"discrete\"",
        ),
        (false, _) => {
            let value = table.need("dt", "give the sampling interval in seconds")?;
            let dt = table.reader.number("plant.dt", value)?;
            if dt > 0.0 {
                Some(Time::Discrete { dt })
            } else {
                table.error(
                    "dt",
                    format!("{dt} is not a sampling interval"),
                    "give positive seconds",
                )
            }
        }
    }
}

/// Reads `[plant.parameters]` in the order of the file.
fn quantities(table: &Table<'_, '_>) -> Option<(Vec<Parameter>, Vec<Quantity>)> {
    let (mut free, mut quantities) = (Vec::new(), Vec::<Quantity>::new());
    let Some(value) = table.get("parameters") else { return Some((free, quantities)) };
    let reader = table.reader;
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("plant.parameters", value, "a table of numbers");
    };
    let inner = Table::named(reader, "plant.parameters", value.span().start, map)?;
    let mut good = true;
    for (name, span, value) in inner.in_order() {
        let key = inner.key(name);
        let entry = {
            let known: Vec<&str> = quantities.iter().map(|q| q.name.as_str()).collect();
            let scope = Scope { names: &known, otherwise: "a parameter can use those above it" };
            reader.entry(&key, value, scope)
        };
        let bad = match &entry {
            Some(Entry::Constant(value)) if !value.is_finite() => Some((
                "not a finite number".to_string(),
                "look for a division by zero, or a root of a negative number",
            )),
            _ => bad_name(name),
        };
        if let Some((message, remedy)) = bad {
            reader.error::<()>(span.start, &key, message, remedy);
            good = false;
        }
        let value = match entry {
            Some(entry @ (Entry::Parameter(_) | Entry::Formula(_))) => Origin::Derived(entry),
            number => {
                // one that failed is kept, so that its users are not reported too
                good &= number.is_some();
                let nominal = number.map_or(1.0, |n| n.value(&[]));
                free.push(Parameter { name: name.into(), nominal });
                Origin::Free(free.len() - 1)
            }
        };
        quantities.push(Quantity { name: name.into(), value });
    }
    good.then_some((free, quantities))
}

/// What keeps `name` from being used in expressions.
fn bad_name(name: &str) -> Option<(String, &'static str)> {
    let letter = |c: char| c.is_alphabetic() || c == '_';
    if name.len() > 100
        || !name.starts_with(letter)
        || !name.chars().all(|c| letter(c) || c.is_numeric())
    {
        return Some(("not a name that expressions can use".into(), "use letters, digits and _"));
    }
    let constant = CONSTANTS.iter().any(|(n, _)| *n == name);
    if constant || FUNCTIONS.iter().any(|f| f.name == name) {
        let kind = if constant { "constant" } else { "function" };
        return Some((format!("'{name}' is a {kind} of the language"), "choose another name"));
    }
    None
}

/// Reads A, B, G, C, Q, R and evaluates each at the nominal values.
fn matrices(
    table: &Table<'_, '_>,
    names: &Names,
    (free, quantities): &(Vec<Parameter>, Vec<Quantity>),
    shaped: bool,
) -> Option<([Pattern; 6], EntryPlaces)> {
    let known: Vec<&str> = quantities.iter().map(|q| q.name.as_str()).collect();
    let scope = Scope { names: &known, otherwise: "add it under [plant.parameters]" };
    let theta: Vec<f64> = free.iter().map(|p| p.nominal).collect();
    let values = values(quantities, &theta);
    let places = RefCell::new(EntryPlaces::new());
    let finish = |letter: &'static str, written: Written| {
        written.evaluate(table.reader, &table.key(letter), &known, &values)?;
        let place = |&at: &usize| table.reader.source.position(at);
        let all = written.at.iter().map(place).collect();
        places.borrow_mut().insert(letter, (written.cols, all));
        Some(Pattern::new(letter, &written))
    };
    let matrix = |letter: &'static str, rows: (&[String], &str), cols: (&[String], &str)| {
        let [rows, cols] = [rows, cols].map(|(names, of)| Size::new(names.len(), of));
        if cols.n == Some(0) {
            // no inputs or disturbances: nothing to write
            return match table.get(letter) {
                None => Some(Pattern::constant(letter, Mat::zeros(rows.n.unwrap_or(0), 0))),
                Some(_) => {
                    let remedy = format!("name them under {}, or remove {letter}", cols.of);
                    table.error(letter, format!("the plant has no {}", cols.of), remedy)
                }
            };
        }
        let remedy = format!("give its rows, {} by {}", rows.of, cols.of);
        let value = table.need(letter, &remedy)?;
        finish(letter, table.reader.matrix(&table.key(letter), value, scope, [rows, cols])?)
    };
    let covariance = |letter: &'static str, names: &[String], of: &str, optional: bool| {
        let n = names.len();
        let value = match table.get(letter) {
            Some(_) if n == 0 => {
                let remedy = format!("name them under {of}, or remove {letter}");
                return table.error(letter, format!("the plant has no {of}"), remedy);
            }
            Some(value) => value,
            None if n == 0 || optional => {
                return Some(Pattern::constant(letter, Mat::identity(n, n)));
            }
            None => {
                table.need(letter, &format!("give a number, a diagonal or a matrix over {of}"))?
            }
        };
        let size = Size::new(n, of);
        finish(letter, table.reader.covariance(&table.key(letter), value, scope, size)?)
    };
    let (x, u) = ((&names.states[..], "states"), (&names.inputs[..], "inputs"));
    let (w, y) = ((&names.disturbances[..], "disturbances"), (&names.outputs[..], "outputs"));
    let patterns = [
        matrix("A", x, x),
        matrix("B", x, u),
        matrix("G", x, w),
        matrix("C", y, x),
        covariance("Q", w.0, w.1, shaped),
        covariance("R", y.0, y.1, false),
    ];
    let [a, b, g, c, q, r] = patterns;
    Some(([a?, b?, g?, c?, q?, r?], places.into_inner()))
}

/// Warns of parameters without effect.
fn unused(table: &Table<'_, '_>, family: &ExpressionFamily) {
    let Some(DeValue::Table(map)) = table.get("parameters").map(|v| v.get_ref()) else { return };
    for (quantity, used) in family.quantities.iter().zip(family.used()) {
        if !used && let Some((key, _)) = map.get_key_value(quantity.name.as_str()) {
            let path = format!("plant.parameters.{}", quantity.name);
            let remedy = "remove it, or use it in a matrix";
            table.reader.warn(key.span().start, &path, "no matrix depends on it", remedy);
        }
    }
}
