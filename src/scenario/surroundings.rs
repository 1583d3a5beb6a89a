//! `[disturbance]`, `[input]`, `[controller]` and `[actuator]`.

use faer::Mat;
use toml::de::DeValue;

use super::keys;
use super::matrix::{CONSTANT, Size, Written};
use super::reader::{Reader, Value};
use super::table::Table;
use crate::model::{ActuatorBound, Controller, Names, Shaping};

/// The actuator of a scenario.
#[derive(Clone, Default)]
pub(super) struct Actuator {
    /// Delay in seconds and where it is given, if it is.
    pub(super) delay: Option<(f64, usize)>,
    /// Pade order, 0 for the default.
    pub(super) pade: usize,
    /// Bound on what it does beyond the model.
    pub(super) unmodelled: Option<ActuatorBound>,
}

/// Highest Pade order: the approximation gains nothing beyond and its
/// coefficients lose digits.
const PADE: u64 = 10;

fn table<'r, 'a>(
    reader: &'r Reader<'a>,
    path: &'r str,
    value: &'r Value<'a>,
    known: &'static [&'static str],
) -> Option<Table<'r, 'a>> {
    match value.get_ref() {
        DeValue::Table(map) => Some(Table::new(reader, path, value.span().start, map, known)),
        _ => reader.wrong_type(path, value, "a table"),
    }
}

/// Reads the matrix `letter` of a table whose entries are constants.
fn constant(table: &Table<'_, '_>, letter: &str, size: [Size<'_>; 2]) -> Option<Mat<f64>> {
    let remedy = format!("give its rows, {} by {}", size[0].of, size[1].of);
    let value = table.need(letter, &remedy)?;
    let key = table.key(letter);
    let written = table.reader.matrix(&key, value, CONSTANT, size)?;
    written.evaluate(table.reader, &key, &[], &[])
}

/// Reads a covariance of order `n`; the identity when there is none.
fn intensity(table: &Table<'_, '_>, letter: &str, n: usize, of: &str) -> Option<Mat<f64>> {
    let Some(value) = table.get(letter) else { return Some(Mat::identity(n, n)) };
    let key = table.key(letter);
    let written: Written = table.reader.covariance(&key, value, CONSTANT, Size::new(n, of))?;
    written.evaluate(table.reader, &key, &[], &[])
}

/// Reads a shaping filter whose outputs are the channels `outputs`, which are
/// the plant's `kind`.
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(super) fn filter<'a>(
    reader: &Reader<'a>,
    path: &'static str,
    value: &Value<'a>,
    outputs: &[String],
    kind: &str,
) -> Option<Shaping> {
    let table = table(reader, path, value, keys::FILTER)?;
    if outputs.is_empty() {
        let remedy = format!("name them under plant.{kind}, or remove [{path}]");
        return reader.error(table.at, path, format!("the plant has no {kind}"), remedy);
    }
    let states = table.need("states", "name the filter's states, as in states = [\"d\"]")?;
    let states = reader.names(&table.key("states"), states)?;
    if states.is_empty() {
        return table.error("states", "the list is empty", "name at least one state");
    }
    let x = Size::new(states.len(), "filter states");
    let A = constant(&table, "A", [x, x]);
    let B = constant(&table, "B", [x, Size::free("noises")]);
    let C = constant(&table, "C", [Size::new(outputs.len(), kind), x]);
    let B = B?;
    let Q = intensity(&table, "Q", B.ncols(), "noises");
    Some(Shaping { A: A?, B, C: C?, Q: Q?, states })
}

/// Reads the controller of a plant with channels `names`.
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(super) fn controller<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    names: &Names,
) -> Option<Controller> {
    let table = table(reader, "controller", value, keys::CONTROLLER)?;
    if names.inputs.is_empty() {
        let remedy = "name them under plant.inputs, or remove [controller]";
        return reader.error(table.at, "controller", "the plant has no inputs", remedy);
    }
    let u = Size::new(names.inputs.len(), "inputs");
    let y = Size::new(names.outputs.len(), "outputs");
    let dynamic = ["A", "B", "C"].iter().any(|k| table.get(k).is_some());
    if !dynamic && table.get("D").is_none() {
        let remedy = "give A, B, C (and D), or D alone for a static gain";
        return reader.error(table.at, "controller", "no matrices", remedy);
    }
    let D = match table.get("D") {
        Some(_) => constant(&table, "D", [u, y]),
        None => Some(Mat::zeros(names.inputs.len(), names.outputs.len())),
    };
    if !dynamic {
        let (nu, ny) = (names.inputs.len(), names.outputs.len());
        return Some(Controller {
            A: Mat::zeros(0, 0),
            B: Mat::zeros(0, ny),
            C: Mat::zeros(nu, 0),
            D: D?,
        });
    }
    let free = Size::free("controller states");
    let A = constant(&table, "A", [free, free])?;
    if A.nrows() != A.ncols() {
        let message = format!("{} by {}, not square", A.nrows(), A.ncols());
        return table.error("A", message, "give as many rows as columns");
    }
    let x = Size::new(A.nrows(), "controller states");
    let (B, C) = (constant(&table, "B", [x, y]), constant(&table, "C", [u, x]));
    Some(Controller { A, B: B?, C: C?, D: D? })
}

/// Reads `[actuator]`.
pub(super) fn actuator<'a>(reader: &Reader<'a>, value: &Value<'a>) -> Option<Actuator> {
    let table = table(reader, "actuator", value, keys::ACTUATOR)?;
    let delay = match table.get("delay") {
        Some(value) => Some((delay(reader, "actuator.delay", value)?, value.span().start)),
        None => None,
    };
    let pade = match table.get("pade") {
        Some(value) => match reader.integer("actuator.pade", value, 1)? {
            order @ 1..=PADE => order as usize,
            order => {
                let remedy = format!("at most {PADE}; 4 is accurate to 1e-8 on most loops");
                return table.error("pade", format!("{order} is too high an order"), remedy);
            }
        },
        None => 0,
    };
    let unmodelled = match table.get("W") {
        Some(value) => Some(bound(reader, value)?),
        None => None,
    };
    Some(Actuator { delay, pade, unmodelled })
}

/// `W` of `[actuator]`: polynomials, or matrices of a filter with one input.
#[expect(non_snake_case, reason = "capital letters are matrices")]
fn bound<'a>(reader: &Reader<'a>, value: &Value<'a>) -> Option<ActuatorBound> {
    let path = "actuator.W";
    let table = table(reader, path, value, keys::BOUND)?;
    let given = |keys: &[&str]| keys.iter().any(|k| table.get(k).is_some());
    let (polynomials, matrices) =
        (given(&["numerator", "denominator"]), given(&["A", "B", "C", "D"]));
    if polynomials == matrices {
        let message = if matrices { "both polynomials and matrices" } else { "nothing is given" };
        let remedy = "give numerator and denominator, or A, B, C (and D), or D alone";
        return reader.error(table.at, path, message, remedy);
    }
    if polynomials {
        let remedy = "give the coefficients of falling powers of s, as in [1, 50] for s + 50";
        let [numerator, denominator] = ["numerator", "denominator"]
            .map(|k| reader.numbers(&table.key(k), table.need(k, remedy)?));
        let made = ActuatorBound::from_polynomials(&numerator?, &denominator?);
        return made.map_or_else(|e| reader.engine(table.at, path, e), Some);
    }
    let one = Size::new(1, "output");
    let D = match table.get("D") {
        Some(_) => constant(&table, "D", [one, one]),
        None => Some(Mat::zeros(1, 1)),
    };
    let mut made =
        ActuatorBound { A: Mat::zeros(0, 0), B: Mat::zeros(0, 1), C: Mat::zeros(1, 0), D: D? };
    if given(&["A", "B", "C"]) {
        let free = Size::free("states of W");
        made.A = constant(&table, "A", [free, free])?;
        let x = Size::new(made.A.nrows(), "states of W");
        let (B, C) = (constant(&table, "B", [x, one]), constant(&table, "C", [one, x]));
        (made.B, made.C) = (B?, C?);
    }
    match made.check() {
        Ok(()) => Some(made),
        Err(e) => reader.engine(table.at, path, e),
    }
}

/// A delay in seconds.
pub(super) fn delay(reader: &Reader<'_>, key: &str, value: &Value<'_>) -> Option<f64> {
    let delay = reader.number(key, value)?;
    if delay >= 0.0 {
        // -0.0 is a delay of nothing
        return Some(delay.abs());
    }
    let message = format!("{delay} s would be a prediction");
    reader.error(value.span().start, key, message, "give a delay of 0 s or more")
}
