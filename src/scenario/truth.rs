//! `[truth]`: the plant that is really there.

use faer::Mat;
use toml::de::DeValue;

use super::course::Course;
use super::family::ExpressionFamily;
use super::matrix::{CONSTANT, Size};
use super::reader::{Reader, Value, all};
use super::table::Table;
use super::{bank, keys};
use crate::model::check_covariance;

/// `[truth]`, read.
#[derive(Debug, Clone, Default)]
pub(super) struct Written {
    /// Parameters that differ from the nominal ones.
    pub(super) parameters: Vec<(String, Course)>,
    /// A model of the bank, from 1.
    pub(super) model: Option<Course>,
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
) -> Option<Vec<(String, Course)>> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("truth.parameters", value, "a table such as { L = 1.0 }");
    };
    let table = Table::named(reader, "truth.parameters", value.span().start, map)?;
    all(table.in_order().into_iter().map(|(name, span, value)| {
        let key = table.key(name);
        let known = bank::parameter(reader, family, name, &key, span.start);
        let course = Course::read(reader, &key, value)?;
        known?;
        Some((name.to_string(), course))
    }))
}

fn model<'a>(reader: &Reader<'a>, value: &Value<'a>, models: usize) -> Option<Course> {
    let key = "truth.model";
    if let DeValue::Table(_) = value.get_ref() {
        return reader.wrong_type(key, value, "a number, or a list of [time, number]");
    }
    let course = Course::read(reader, key, value)?;
    let numbers = |v: &f64| *v >= 1.0 && *v <= models as f64 && v.fract() == 0.0;
    let wrong = course.values().find(|v| !numbers(v));
    match wrong {
        None => Some(course),
        Some(number) => {
            let message = format!("{number} is not the number of a model");
            let remedy = format!("count the models from 1 to {models}");
            reader.error(value.span().start, key, message, remedy)
        }
    }
}
