//! Ranges and lists of values of one parameter.

use toml::de::DeValue;

use super::keys;
use super::reader::{Reader, Value};
use super::table::Table;
use crate::model::Axis;

/// Reads the values of one parameter: a list, or a range with `points` or
/// `step`.
pub(super) fn axis<'a>(reader: &Reader<'a>, key: &str, value: &Value<'a>) -> Option<Axis> {
    match value.get_ref() {
        DeValue::Array(_) => reader.numbers(key, value).map(Axis::Explicit),
        DeValue::Table(map) => {
            let at = value.span().start;
            range(&Table::new(reader, key, at, map, keys::RANGE))
        }
        _ => {
            let wanted = "a list or a range { from = .., to = .., points = .. }";
            reader.wrong_type(key, value, wanted)
        }
    }
}

fn range(table: &Table<'_, '_>) -> Option<Axis> {
    let reader = table.reader;
    let end = |key: &str| {
        let value = table.need(key, "give both ends of the range")?;
        reader.number(&table.key(key), value)
    };
    let logarithmic = match table.get("scale") {
        Some(value) => {
            let choices = [("linear", false), ("log", true)];
            reader.choice(&table.key("scale"), value, &choices)
        }
        None => Some(false),
    };
    let (from, to) = (end("from"), end("to"));
    let (from, to, logarithmic) = (from?, to?, logarithmic?);
    if from > to {
        let remedy = format!("write from = {to}, to = {from}");
        return table.error("from", format!("the range runs down, from {from} to {to}"), remedy);
    }
    if logarithmic && from <= 0.0 {
        let message = format!("a logarithmic range cannot start at {from}");
        return table.error("from", message, "start above 0, or use scale = \"linear\"");
    }
    let points = match (table.get("points"), table.get("step")) {
        (Some(_), Some(_)) => {
            return table.error("step", "both points and step are given", "keep one");
        }
        (None, None) => {
            let remedy = "give points = 101, say, or step = 0.01";
            return reader.error(table.at, table.path, "neither points nor step is given", remedy);
        }
        (Some(value), None) => reader.integer(&table.key("points"), value, 1)?,
        (None, Some(_)) if logarithmic => {
            return table.error("step", "a logarithmic range has no step", "give points instead");
        }
        (None, Some(value)) => {
            let step = reader.number(&table.key("step"), value)?;
            steps(table, from, to, step)?
        }
    };
    if from == to && points > 1 {
        let remedy = format!("widen the range, or write the list [{from}]");
        return table.error("to", format!("{points} points between {from} and itself"), remedy);
    }
    if points == 1 && from < to {
        let remedy = "give at least 2 points, or a list of one value";
        return table.error("points", "one point cannot be at both ends", remedy);
    }
    let points = usize::try_from(points).unwrap_or(usize::MAX);
    Some(if logarithmic {
        Axis::Logarithmic { from, to, points }
    } else {
        Axis::Linear { from, to, points }
    })
}

/// Number of points of a range in steps: both ends belong to it, so the step
/// must divide it (to 1e-9 of a step a step).
fn steps(table: &Table<'_, '_>, from: f64, to: f64, step: f64) -> Option<u64> {
    if step <= 0.0 {
        return table.error(
            "step",
            format!("a step of {step} leads nowhere"),
            "give a positive step",
        );
    }
    let width = to - from;
    let exact = width / step;
    if exact >= 1e15 {
        let remedy = "give a larger step";
        return table.error("step", format!("a step of {step} makes too many points"), remedy);
    }
    let whole = exact.round();
    if (exact - whole).abs() <= 1e-9 * whole {
        return Some(whole as u64 + 1);
    }
    let coarse = exact.floor().max(1.0);
    let fine = coarse + 1.0;
    let remedy = if step > width {
        format!("the range is {width} wide: use step = {width} or points = 2")
    } else {
        format!(
            "nearest are step = {} ({} points) and step = {} ({} points), or give points",
            width / coarse,
            coarse + 1.0,
            width / fine,
            fine + 1.0
        )
    };
    table.error("step", format!("a step of {step} does not divide {from} .. {to}"), remedy)
}
