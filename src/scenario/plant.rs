//! `[plant]`: names, parameters and matrices.

use std::cell::RefCell;
use std::sync::Arc;

use faer::Mat;
use toml::de::DeValue;

use super::family::{ExpressionFamily, Origin, Pattern, Plants, Quantity, values};
use super::matrix::{Scope, Size, Written};
use super::parameters::{quantities, unused};
use super::places::EntryPlaces;
use super::reader::{Reader, Value};
use super::table::Table;
use super::{keys, suggest};
use crate::model::{Family, Names, Parameter, Surroundings, Time, systems};

/// `[plant]`, read.
pub(super) struct Read {
    pub(super) family: ExpressionFamily,
    /// Places of the matrix entries.
    pub(super) entries: EntryPlaces,
    /// What a built-in family brings along.
    pub(super) surroundings: Surroundings,
}

/// Reads `[plant]`; `shaped` when a filter colours the disturbance, whose
/// intensity is then that of the filter.
pub(super) fn read<'a>(reader: &Reader<'a>, value: &Value<'a>, shaped: bool) -> Option<Read> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("plant", value, "a table");
    };
    let table = Table::new(reader, "plant", value.span().start, map, keys::PLANT);
    match table.get("family") {
        Some(name) => built_in(&table, name),
        None => written(&table, shaped),
    }
}

/// A built-in family, whose parameters can be given other nominal values.
fn built_in<'a>(table: &Table<'_, 'a>, value: &Value<'a>) -> Option<Read> {
    let name = table.reader.choice("plant.family", value, &systems::NAMES.map(|n| (n, n)))?;
    let family = systems::by_name(name)?;
    let own = |key: &&&str| !["family", "parameters"].contains(key) && table.get(key).is_some();
    if let Some(key) = keys::PLANT.iter().find(own) {
        let remedy = format!("remove it, or write the whole plant in place of family = \"{name}\"");
        return table.error(key, "a built-in family has its own", remedy);
    }
    let (given, quantities) = quantities(table)?;
    let mut parameters = family.parameters().to_vec();
    let mut good = true;
    for quantity in quantities {
        let name = quantity.name.as_str();
        let own = parameters.iter_mut().find(|p| p.name == name);
        let (message, remedy) = match (own, quantity.value) {
            (Some(own), Origin::Free(index)) => {
                own.nominal = given[index].nominal;
                continue;
            }
            (Some(_), Origin::Derived(_)) => {
                let message = "a parameter of a built-in family cannot follow others";
                (message, "give its number".to_string())
            }
            (None, _) => {
                let known: Vec<&str> =
                    family.parameters().iter().map(|p| p.name.as_str()).collect();
                let remedy = suggest::remedy(name, &known, "its parameters are");
                ("the family has no such parameter", remedy)
            }
        };
        let at = table.place("parameters", name);
        table.reader.error::<()>(at, &format!("plant.parameters.{name}"), message, remedy);
        good = false;
    }
    let surroundings = match name {
        "pendulum" => systems::pendulum_surroundings(),
        _ => Surroundings::default(),
    };
    good.then(|| {
        let read = around(family);
        let quantities = free(&parameters);
        let family = ExpressionFamily { parameters, quantities, ..read.family };
        Read { family, surroundings, ..read }
    })
}

/// A family that is not written in the file.
pub(super) fn around(family: Arc<dyn Family>) -> Read {
    Read {
        family: ExpressionFamily {
            quantities: free(family.parameters()),
            parameters: family.parameters().to_vec(),
            names: family.names().clone(),
            time: family.time(),
            plants: Plants::BuiltIn(family),
        },
        entries: EntryPlaces::new(),
        surroundings: Surroundings::default(),
    }
}

/// Every parameter as a quantity of its own.
fn free(parameters: &[Parameter]) -> Vec<Quantity> {
    let each =
        |(i, p): (usize, &Parameter)| Quantity { name: p.name.clone(), value: Origin::Free(i) };
    parameters.iter().enumerate().map(each).collect()
}

/// Time and names of a plant whose matrices are those of the models.
pub(super) fn names_only<'a>(reader: &Reader<'a>, value: &Value<'a>) -> Option<(Time, Names)> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("plant", value, "a table");
    };
    let table = Table::new(reader, "plant", value.span().start, map, keys::PLANT);
    let only = ["time", "dt", "states", "inputs", "disturbances", "outputs"];
    let other = keys::PLANT.iter().find(|k| !only.contains(k) && table.get(k).is_some());
    if let Some(key) = other {
        let remedy = "give the whole plant, or only its names and its time";
        return table.error(key, "the matrices are those of bank.models", remedy);
    }
    let list = |key: &str| match table.get(key) {
        Some(value) => reader.names(&table.key(key), value),
        None => Some(Vec::new()),
    };
    let names = Names {
        states: list("states")?,
        inputs: list("inputs")?,
        disturbances: list("disturbances")?,
        outputs: list("outputs")?,
    };
    Some((time(&table)?, names))
}

/// A plant of matrices.
fn written(table: &Table<'_, '_>, shaped: bool) -> Option<Read> {
    let reader = table.reader;
    let time = time(table);
    let quantities = quantities(table);
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
    let matrices = matrices(table, &names, &quantities, shaped);
    let (parameters, quantities) = quantities;
    // what could not be read is reported; something stands in for it, so that
    // bank and study have their say as well
    let time = time.unwrap_or(Time::Continuous);
    let complete = matrices.is_some();
    let nothing = |letter| Pattern::constant(letter, Mat::zeros(0, 0));
    let (patterns, entries) = matrices
        .unwrap_or_else(|| (["A", "B", "G", "C", "Q", "R"].map(nothing), EntryPlaces::new()));
    let plants = Plants::Written(Box::new(patterns));
    let family = ExpressionFamily { parameters, quantities, names, time, plants };
    if complete {
        unused(table, &family);
    }
    Some(Read { family, entries, surroundings: Surroundings::default() })
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
