//! `[bank]`: the models and their observer.

use faer::Mat;
use toml::de::DeValue;

use super::explicit::Explicit;
use super::family::{ExpressionFamily, Origin};
use super::matrix::{CONSTANT, Size};
use super::reader::{Reader, Value, all, clip};
use super::start::{self, Start};
use super::table::Table;
use super::{grid, keys, suggest};
use crate::bank::{GainMode, StartTime};
use crate::eip::Bank;
use crate::error::Error;
use crate::model::{Axis, check_covariance};
use crate::observer::ObserverKind;

/// Most models of a bank.
const MODELS: usize = 1_000_000;

/// Reads `[bank]`; `shaped` when a filter colours the disturbance,
/// `filter_states` the number of its states.
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    family: &ExpressionFamily,
    shaped: bool,
    filter_states: usize,
    weight_given: bool,
) -> Option<(Bank, Start)> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("bank", value, "a table");
    };
    let table = Table::new(reader, "bank", value.span().start, map, keys::BANK);
    let observer = observer(&table, family);
    let models = models(&table, family);
    let shaping = match table.get("shaping") {
        None => Some(shaped),
        Some(value) => match reader.boolean("bank.shaping", value)? {
            true if !shaped => {
                let remedy = "add [disturbance], or remove this key";
                table.error("shaping", "there is no disturbance filter to carry", remedy)
            }
            shaping => Some(shaping),
        },
    };
    let names = &family.names;
    let continuous = family.time.is_continuous();
    let Q = weight(&table, "Q", names.disturbances.len(), "disturbances", continuous);
    let R = weight(&table, "R", names.outputs.len(), "outputs", continuous);
    if shaped && shaping == Some(false) && !weight_given && table.get("Q").is_none() {
        let remedy =
            "give bank.Q, the intensity of the white noise that stands for the disturbance";
        return table.error("shaping", "a design without the filter needs a weight", remedy);
    }
    let (parameters, models) = models?;
    let labels = labels(&table, models.len());
    let shaping = shaping?;
    let filter = if shaping { filter_states } else { 0 };
    let observer = observer?;
    let times = [continuous, observer.is_continuous()];
    let start = start::read(&table, models.len(), names.states.len() + filter, times);
    let bank = Bank { observer, parameters, models, labels: labels?, shaping, Q: Q?, R: R? };
    Some((bank, start?))
}

/// Reads `[bank]` around models that are given by matrices.
pub(super) fn explicit<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    family: &ExpressionFamily,
    found: &Explicit,
) -> Option<(Bank, Start)> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("bank", value, "a table");
    };
    let table = Table::new(reader, "bank", value.span().start, map, keys::BANK);
    if let Some(key) = ["shaping", "Q", "R"].into_iter().find(|k| table.get(k).is_some()) {
        let message = "models given by matrices have their own";
        return table.error(key, message, "remove it");
    }
    let observer = observer(&table, family)?;
    let models = found.plants.len();
    let labels = labels(&table, models)?;
    let (n, continuous) = (family.names.states.len(), family.time.is_continuous());
    let mut start = start::read(&table, models, n, [continuous, observer.is_continuous()])?;
    if let Some(initial) = &found.initial {
        start.initial.clone_from(initial);
        if table.get("gains").is_none() && initial.iter().all(|i| i.P.is_some()) {
            start.gains = GainMode::Recursive;
        }
    }
    if found.before_first && table.get("start").is_none() {
        start.time = StartTime::FirstMeasurement;
    }
    let labels = if labels.is_empty() {
        (1..=models).map(|i| format!("model {i}")).collect()
    } else {
        labels
    };
    let bank = Bank {
        observer,
        parameters: Vec::new(),
        models: vec![Vec::new(); models],
        labels,
        shaping: false,
        Q: None,
        R: None,
    };
    Some((bank, start))
}

fn labels(table: &Table<'_, '_>, models: usize) -> Option<Vec<String>> {
    let Some(value) = table.get("labels") else { return Some(Vec::new()) };
    match table.reader.names("bank.labels", value)? {
        labels if labels.len() == models => Some(labels),
        labels => {
            let message = format!("{} labels for {models} models", labels.len());
            table.error("labels", message, "give one label a model")
        }
    }
}

fn observer(table: &Table<'_, '_>, family: &ExpressionFamily) -> Option<ObserverKind> {
    let continuous = family.time.is_continuous();
    let Some(value) = table.get("observer") else {
        return Some(if continuous { ObserverKind::KalmanBucy } else { ObserverKind::Kalman });
    };
    let choices = [
        ("kalman-bucy", ObserverKind::KalmanBucy),
        ("krener", ObserverKind::Krener),
        ("kalman", ObserverKind::Kalman),
    ];
    let kind = table.reader.choice("bank.observer", value, &choices)?;
    if !continuous && kind != ObserverKind::Kalman {
        let message = "the observer is for continuous plants, and this one is discrete";
        return table.error("observer", message, "write observer = \"kalman\"");
    }
    Some(kind)
}

/// Reads a design weight of order `n`.
fn weight(
    table: &Table<'_, '_>,
    letter: &str,
    n: usize,
    of: &str,
    continuous: bool,
) -> Option<Option<Mat<f64>>> {
    let Some(value) = table.get(letter) else { return Some(None) };
    let key = table.key(letter);
    if n == 0 {
        let message = format!("the plant has no {of}");
        return table.error(letter, message, format!("remove {key}"));
    }
    let written = table.reader.covariance(&key, value, CONSTANT, Size::new(n, of))?;
    let matrix = written.evaluate(table.reader, &key, &[], &[])?;
    let definite = letter == "R" && continuous;
    match check_covariance(&key, matrix.as_ref(), definite) {
        Ok(()) => Some(Some(matrix)),
        Err(error) => table.reader.engine(value.span().start, &key, error),
    }
}

/// Checks that `name`, used as key `key` at byte `at`, is a free parameter.
pub(super) fn parameter(
    reader: &Reader<'_>,
    family: &ExpressionFamily,
    name: &str,
    key: &str,
    at: usize,
) -> Option<()> {
    let quantity = family.quantities.iter().find(|q| q.name == name);
    match quantity.map(|q| &q.value) {
        Some(Origin::Free(_)) => Some(()),
        Some(Origin::Derived(entry)) => {
            let names: Vec<&str> =
                entry.variables().iter().map(|&v| family.quantities[v].name.as_str()).collect();
            let message = format!("'{name}' follows from {}", names.join(", "));
            reader.error(at, key, message, "vary one of those, or make it a number of its own")
        }
        None => {
            let known: Vec<&str> = family.parameters.iter().map(|p| p.name.as_str()).collect();
            let message = format!("no parameter is called '{}'", clip(name));
            reader.error(at, key, message, suggest::remedy(name, &known, "the plant has"))
        }
    }
}

type Models = (Vec<String>, Vec<Vec<f64>>);

fn models(table: &Table<'_, '_>, family: &ExpressionFamily) -> Option<Models> {
    let value =
        table.need("models", "give the nominal values, as in models = { L = [1.0, 1.5] }")?;
    match value.get_ref() {
        DeValue::Table(map) => {
            let inner = Table::named(table.reader, "bank.models", value.span().start, map)?;
            columns(&inner, family)
        }
        DeValue::Array(list) => {
            let row = |(i, v)| row(table.reader, family, &format!("bank.models[{i}]"), v);
            let rows = all(list.iter().enumerate().map(row))?;
            let Some((names, _)) = rows.first() else {
                return table.error("models", "the bank is empty", "give at least one model");
            };
            let names = names.clone();
            let mut models = Vec::with_capacity(rows.len());
            for (i, (other, values)) in rows.into_iter().enumerate() {
                // the same parameters, in whatever order
                let find = |n| other.iter().position(|o| o == n).map(|k| values[k]);
                match names.iter().map(find).collect::<Option<Vec<f64>>>() {
                    Some(model) if other.len() == names.len() => models.push(model),
                    _ => {
                        let message = format!("the model has {}", other.join(", "));
                        let remedy = format!("give {} as in the first model", names.join(", "));
                        let key = format!("bank.models[{i}]");
                        return table.reader.error(list[i].span().start, &key, message, remedy);
                    }
                }
            }
            Some((names, models))
        }
        _ => {
            let wanted = "a table of lists or a list of tables";
            table.reader.wrong_type("bank.models", value, wanted)
        }
    }
}

/// `models = { L = [..], m = [..] }`: one list a parameter, zipped.
fn columns(table: &Table<'_, '_>, family: &ExpressionFamily) -> Option<Models> {
    let reader = table.reader;
    let mut names = Vec::new();
    let columns = all(table.in_order().into_iter().map(|(name, span, value)| {
        let key = table.key(name);
        let known = parameter(reader, family, name, &key, span.start);
        let axis = grid::axis(reader, &key, value)?;
        known?;
        names.push(name.to_string());
        if axis.len() > MODELS {
            let what = format!("a bank of {} models", axis.len());
            let (bytes, limit) = (axis.len() as u128 * 64, MODELS as u128 * 64);
            let remedy = "give at most a million models";
            let error = Error::Limit { what, bytes, limit, remedy };
            return reader.engine(value.span().start, &key, error);
        }
        Some((key, value.span().start, axis))
    }))?;
    let Some((_, _, first)) = columns.first() else {
        return reader.error(
            table.at,
            "bank.models",
            "the bank is empty",
            "give at least one model",
        );
    };
    let n = first.len();
    if let Some((key, at, axis)) = columns.iter().find(|(_, _, axis)| axis.len() != n) {
        let message = format!("{} values, but {} has {n}", axis.len(), names[0]);
        return reader.error(*at, key, message, "give every parameter one value a model");
    }
    let axes: Vec<&Axis> = columns.iter().map(|(_, _, axis)| axis).collect();
    let models = (0..n).map(|i| axes.iter().map(|axis| axis.value(i)).collect()).collect();
    Some((names, models))
}

/// `{ L = 1.0, m = 2.0 }`: one model.
fn row<'a>(
    reader: &Reader<'a>,
    family: &ExpressionFamily,
    path: &str,
    value: &Value<'a>,
) -> Option<(Vec<String>, Vec<f64>)> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(path, value, "a table such as { L = 1.0 }");
    };
    let table = Table::named(reader, path, value.span().start, map)?;
    let each = table.in_order().into_iter().map(|(name, span, value)| {
        let key = table.key(name);
        let known = parameter(reader, family, name, &key, span.start);
        let number = reader.number(&key, value)?;
        known?;
        Some((name.to_string(), number))
    });
    let pairs = all(each)?;
    if pairs.is_empty() {
        return reader.error(
            table.at,
            path,
            "the model has no parameters",
            "give { L = 1.0 }, say",
        );
    }
    Some(pairs.into_iter().unzip())
}
