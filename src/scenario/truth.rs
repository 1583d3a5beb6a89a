//! `[truth]`: the plant that is really there.

use faer::Mat;
use toml::de::DeValue;

use super::family::ExpressionFamily;
use super::matrix::{CONSTANT, Size};
use super::reader::{Reader, Value, all};
use super::table::Table;
use super::{bank, keys};
use crate::model::check_covariance;

/// A value from the start on, and others from later times on.
type Course<T> = Vec<(f64, T)>;

/// `[truth]`, read.
#[derive(Debug, Clone, Default)]
pub(super) struct Written {
    /// Parameters that differ from the nominal ones.
    pub(super) parameters: Vec<(String, Course<f64>)>,
    /// A model of the bank, from 0.
    pub(super) model: Option<Course<usize>>,
    pub(super) x0: Option<Vec<f64>>,
    pub(super) p0: Option<Mat<f64>>,
}

/// Reads `[truth]` of a plant with `n` states, filters counted, beside a bank of
/// `models` models.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    family: &ExpressionFamily,
    models: usize,
    n: usize,
) -> Option<Written> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("truth", value, "a table");
    };
    let table = Table::new(reader, "truth", value.span().start, map, keys::TRUTH);
    let parameters = match table.get("parameters") {
        None => Some(Vec::new()),
        Some(value) => parameters(reader, value, family),
    };
    let model = match table.get("model") {
        None => Some(None),
        Some(value) => model(reader, value, models).map(Some),
    };
    let x0 = match table.get("x0") {
        None => Some(None),
        Some(value) => match reader.numbers("truth.x0", value)? {
            x if x.len() == n => Some(Some(x)),
            x => {
                let message = format!("{} numbers for {n} states of the plant", x.len());
                table.error("x0", message, "give one number a state, filters included")
            }
        },
    };
    let p0 = match table.get("P0") {
        None => Some(None),
        Some(value) => {
            let size = Size::new(n, "states of the plant");
            let written = reader.covariance("truth.P0", value, CONSTANT, size)?;
            let p: Mat<f64> = written.evaluate(reader, "truth.P0", &[], &[])?;
            match check_covariance("truth.P0", p.as_ref(), false) {
                Ok(()) => Some(Some(p)),
                Err(e) => reader.engine(value.span().start, "truth.P0", e),
            }
        }
    };
    Some(Written { parameters: parameters?, model: model?, x0: x0?, p0: p0? })
}

fn parameters<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    family: &ExpressionFamily,
) -> Option<Vec<(String, Course<f64>)>> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("truth.parameters", value, "a table such as { L = 1.0 }");
    };
    let table = Table::named(reader, "truth.parameters", value.span().start, map)?;
    all(table.in_order().into_iter().map(|(name, span, value)| {
        let key = table.key(name);
        let known = bank::parameter(reader, family, name, &key, span.start);
        let course = course(reader, &key, value)?;
        known?;
        Some((name.to_string(), course))
    }))
}

fn model<'a>(reader: &Reader<'a>, value: &Value<'a>, models: usize) -> Option<Course<usize>> {
    let key = "truth.model";
    let course = course(reader, key, value)?;
    all(course.into_iter().map(|(t, number)| {
        if number >= 1.0 && number <= models as f64 && number.fract() == 0.0 {
            return Some((t, number as usize - 1));
        }
        let message = format!("{number} is not the number of a model");
        let remedy = format!("count the models from 1 to {models}");
        reader.error(value.span().start, key, message, remedy)
    }))
}

/// A number, or a list of `[time, value]` of which each holds until the next.
fn course<'a>(reader: &Reader<'a>, key: &str, value: &Value<'a>) -> Option<Course<f64>> {
    let DeValue::Array(list) = value.get_ref() else {
        return Some(vec![(0.0, reader.number(key, value)?)]);
    };
    let remedy = "write [[0, first], [time, next], ..], times in seconds, rising from 0";
    let course = all(list.iter().enumerate().map(|(i, pair)| {
        let key = format!("{key}[{i}]");
        match reader.numbers(&key, pair)?[..] {
            [t, v] => Some((t, v)),
            _ => reader.error(pair.span().start, &key, "not a time and a value", remedy),
        }
    }))?;
    let rising = course.windows(2).all(|w| w[0].0 < w[1].0);
    if course.first().is_some_and(|c| c.0 == 0.0) && rising {
        return Some(course);
    }
    reader.error(value.span().start, key, "the times do not rise from 0", remedy)
}
