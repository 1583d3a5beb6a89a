//! `[adaptive.observers.NAME]`: an observer, its regressors and its tuning.

use std::sync::Arc;

use faer::Mat;
use toml::de::DeValue;

use super::super::expression::Entry;
use super::super::keys;
use super::super::matrix::{Scope, Size};
use super::super::reader::{Reader, Value, all};
use super::super::suggest;
use super::super::table::Table;
use super::formulas::{Quantities, is_name, vector};
use super::truth::Truth;
use super::{AdaptiveObserver, Physical};
use crate::adaptive::{
    FnRegressor, Prior, Reading, Regressor, Settings, Structure, Tuning, Unknown,
};
use crate::model::Names;

/// An observer, read.
#[derive(Debug, Clone)]
pub(in super::super) struct Observer {
    pub(super) public: AdaptiveObserver,
    /// True values of the parameters, of the quantities of the truth.
    pub(super) truth: Option<Vec<Entry>>,
    pub(super) physical_truth: Option<Vec<Entry>>,
}

impl Observer {
    /// Names of its states.
    pub(in super::super) fn states(&self) -> &[String] {
        &self.public.structure.states
    }
}

/// What all observers of a file share.
pub(super) struct Shared<'s> {
    pub(super) dt: f64,
    pub(super) names: &'s Names,
    pub(super) quantities: &'s Quantities,
    pub(super) truth: Option<&'s Truth>,
}

/// A parameter, read.
struct Parameter {
    unknown: Unknown,
    column: Vec<Entry>,
    start: f64,
    bounds: [f64; 2],
    sigma: Option<f64>,
    truth: Option<Entry>,
}

/// Reads the observer `name` at the dotted path `path`.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    path: &str,
    name: &str,
    value: &Value<'a>,
    shared: &Shared<'_>,
) -> Option<Observer> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(path, value, "a table");
    };
    let table = Table::new(reader, path, value.span().start, map, keys::ADAPTIVE_OBSERVER);
    let states = table.need("states", "name them, as in states = [\"x1\", \"x2\"]")?;
    let states = reader.names(&table.key("states"), states)?;
    if states.is_empty() {
        return table.error("states", "the list is empty", "name one state or more");
    }
    let (n, names) = (states.len(), shared.names);
    let signals = names.inputs.iter().chain(&names.outputs);
    if let Some(bad) = signals.clone().find(|s| !is_name(s)) {
        let message = format!("'{bad}' cannot stand in an expression");
        return reader.error(table.at, path, message, "use letters, digits and _");
    }
    let constants: Vec<&str> = shared.quantities.names.iter().map(String::as_str).collect();
    let values = shared.quantities.values(|_| None);
    let mut known = constants.clone();
    known.push("t");
    known.extend(signals.map(String::as_str));
    let scope = Scope { names: &constants, otherwise: "name it under [adaptive.parameters]" };
    let matrix = |key: &str, rows: Size<'_>, cols: Size<'_>| {
        let value = table.need(key, "give its rows")?;
        let path = table.key(key);
        let written = reader.matrix(&path, value, scope, [rows, cols])?;
        written.evaluate(reader, &path, &constants, &values)
    };
    let q = names.outputs.len();
    let (a, c, k) = (
        matrix("A", Size::new(n, "states"), Size::new(n, "states")),
        matrix("C", Size::new(q, "outputs"), Size::new(n, "states")),
        matrix("K", Size::new(n, "states"), Size::new(q, "outputs")),
    );
    let numbers = |key: &str, count: usize, of: &str| -> Option<Option<Vec<f64>>> {
        let Some(value) = table.get(key) else { return Some(None) };
        let entries = vector(reader, &table.key(key), value, &constants, (count, of))?;
        Some(Some(entries.iter().map(|e| e.value(&values)).collect()))
    };
    let number = |key: &str| Some(numbers(key, 1, "number")?.map(|list| list[0]));
    let known_term = match table.get("known") {
        Some(value) => vector(reader, &table.key("known"), value, &known, (n, "states"))?,
        None => Vec::new(),
    };
    let context = Context { shared, states: &states, constants: &constants, known: &known };
    let parameters = parameters(&table, &context, &values)?;
    let names_of = |p: &Parameter| p.unknown.name.clone();
    let theta_names: Vec<String> = parameters.iter().map(names_of).collect();
    let (physical, physical_truth) = match table.get("physical") {
        Some(value) => physical(&table, value, &context, &values, &theta_names)?,
        None => (None, None),
    };
    let prior = prior(&table, &parameters, number("P0")?, number("sigma")?)?;
    let (x0, r) = (numbers("x0", n, "states")?, numbers("R", q, "outputs")?);
    let initial = numbers("x0_P0", n, "states")?;
    let resets = match table.get("resets") {
        Some(value) => reader.numbers(&table.key("resets"), value)?,
        None => Vec::new(),
    };
    let reading = match table.get("reading") {
        Some(value) => reader.choice(&table.key("reading"), value, &Reading::NAMES)?,
        None => Reading::Zhang,
    };
    let mut settings =
        Settings { reading, initial_state: initial.is_some(), ..Settings::new(shared.dt) };
    if let Some(seconds) = number("window")? {
        let count = (seconds / shared.dt).round();
        if !(1.0..=1e9).contains(&count) {
            let message = format!("{seconds} s are {count} samples");
            return table.error("window", message, "give a sample or more");
        }
        settings.window = count as u64;
    }
    let theta: Vec<f64> = parameters.iter().map(|p| p.start).collect();
    let plain = Tuning::new(a?, c?, k?, theta, prior);
    let tuning = Tuning {
        R: r.unwrap_or_else(|| vec![1.0; q]),
        lambda: number("lambda")?.unwrap_or(0.0),
        x_hat: x0.unwrap_or_else(|| vec![0.0; n]),
        initial_P0: initial.unwrap_or_else(|| vec![0.0; n]),
        bounds: parameters.iter().map(|p| p.bounds).collect(),
        trace_cap: number("trace_cap")?.unwrap_or(f64::INFINITY),
        resets,
        reset_growth: number("reset_growth")?.unwrap_or(f64::INFINITY),
        ..plain
    };
    let columns: Vec<Entry> = parameters.iter().flat_map(|p| p.column.clone()).collect();
    let structure = Structure {
        states,
        outputs: names.outputs.clone(),
        inputs: names.inputs.len(),
        unknown: parameters.iter().map(|p| p.unknown.clone()).collect(),
        regressor: Arc::new(regressor(n, columns, known_term, values)),
    };
    let truth = parameters.into_iter().map(|p| p.truth).collect();
    let public = AdaptiveObserver { name: name.into(), structure, settings, tuning, physical };
    Some(Observer { public, truth, physical_truth })
}

/// What expressions of an observer may mention.
struct Context<'s> {
    shared: &'s Shared<'s>,
    states: &'s [String],
    /// Parameters of `[adaptive]`.
    constants: &'s [&'s str],
    /// These, `t`, inputs and outputs.
    known: &'s [&'s str],
}

impl Context<'_> {
    /// Names that a true value may mention.
    fn of_truth(&self) -> Vec<&str> {
        let truth = self.shared.truth;
        truth.map_or_else(Vec::new, |t| t.quantities.names.iter().map(String::as_str).collect())
    }
}

/// Columns `[..]` of the regressor and the known term, as a closure.
fn regressor(
    n: usize,
    columns: Vec<Entry>,
    known: Vec<Entry>,
    constants: Vec<f64>,
) -> impl Regressor + use<> {
    FnRegressor::new(columns.len() / n, move |t, u, y, gamma, out| {
        // on the stack where it fits: this runs once a sample and observer
        let mut few = [0.0; 32];
        let mut many;
        let len = constants.len() + 1 + u.len() + y.len();
        let values = if len <= few.len() {
            &mut few[..len]
        } else {
            many = vec![0.0; len];
            &mut many[..]
        };
        let (head, tail) = values.split_at_mut(constants.len());
        head.copy_from_slice(&constants);
        tail[0] = t;
        tail[1..][..u.len()].copy_from_slice(u);
        tail[1 + u.len()..].copy_from_slice(y);
        for (out, entry) in gamma.iter_mut().zip(&columns) {
            *out = entry.value(values);
        }
        for (out, entry) in out.iter_mut().zip(&known) {
            *out = entry.value(values);
        }
    })
}

/// Reads the table `theta`: the parameters in the order of the file.
fn parameters(
    table: &Table<'_, '_>,
    context: &Context<'_>,
    values: &[f64],
) -> Option<Vec<Parameter>> {
    let reader = table.reader;
    let remedy = "name them, as in theta = { b = { column = [0, \"u\"] } }";
    let value = table.need("theta", remedy)?;
    let path = table.key("theta");
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(&path, value, "a table of parameters by name");
    };
    let inner = Table::named(reader, &path, value.span().start, map)?;
    let found = all(inner.in_order().into_iter().map(|(name, _, value)| {
        let path = inner.key(name);
        let DeValue::Table(map) = value.get_ref() else {
            return reader.wrong_type(&path, value, "a table with column or entry");
        };
        let own = Table::new(reader, &path, value.span().start, map, keys::ADAPTIVE_THETA);
        parameter(&own, name, context, values)
    }))?;
    if found.is_empty() {
        return table.error("theta", "no parameters", remedy);
    }
    Some(found)
}

fn parameter(
    own: &Table<'_, '_>,
    name: &str,
    context: &Context<'_>,
    values: &[f64],
) -> Option<Parameter> {
    let reader = own.reader;
    let n = context.states.len();
    let (unknown, column) = match (own.get("column"), own.get("entry")) {
        (Some(_), Some(_)) => {
            return own.error("entry", "both column and entry are given", "keep one of them");
        }
        (None, None) => {
            let remedy = "give its column of expressions, or the entry of A";
            return own.need("column", remedy).and(None);
        }
        (Some(value), None) => {
            let column = vector(reader, &own.key("column"), value, context.known, (n, "states"))?;
            (Unknown::given(name), column)
        }
        (None, Some(value)) => {
            let path = own.key("entry");
            let list = reader.list(&path, value, "two names of states: row and column")?;
            let [row, col] = list.iter().collect::<Vec<_>>()[..] else {
                let message = format!("{} names", list.len());
                return own.error("entry", message, "name the states of row and column");
            };
            let state = |value| {
                let name = reader.string(&path, value)?;
                let at = context.states.iter().position(|s| s == name);
                let known: Vec<&str> = context.states.iter().map(String::as_str).collect();
                let remedy = suggest::remedy(name, &known, "the states are");
                at.or_else(|| own.error("entry", format!("no state is called '{name}'"), remedy))
            };
            (Unknown::entry(name, state(row)?, state(col)?), Vec::new())
        }
    };
    let number = |key: &str| -> Option<Option<f64>> {
        let Some(value) = own.get(key) else { return Some(None) };
        let entry = vector(reader, &own.key(key), value, context.constants, (1, "number"))?;
        Some(Some(entry[0].value(values)))
    };
    let truth = match own.get("truth") {
        Some(value) => {
            let known = context.of_truth();
            vector(reader, &own.key("truth"), value, &known, (1, "number"))?.pop()
        }
        None => None,
    };
    Some(Parameter {
        unknown,
        column,
        start: number("start")?.unwrap_or(0.0),
        bounds: [
            number("min")?.unwrap_or(f64::NEG_INFINITY),
            number("max")?.unwrap_or(f64::INFINITY),
        ],
        sigma: number("sigma")?,
        truth,
    })
}

/// `P0`, or a standard deviation a parameter and that of the noise.
fn prior(
    table: &Table<'_, '_>,
    parameters: &[Parameter],
    p0: Option<f64>,
    noise: Option<f64>,
) -> Option<Prior> {
    let stated: Vec<f64> = parameters.iter().filter_map(|p| p.sigma).collect();
    match (p0, noise) {
        (Some(_), _) if !stated.is_empty() => {
            let remedy = "keep P0, or sigma of the parameters and of the noise";
            table.error("P0", "both P0 and sigma of parameters are given", remedy)
        }
        (Some(_), Some(_)) => {
            let remedy = "keep P0, or give sigma of every parameter too";
            table.error("sigma", "both P0 and sigma are given", remedy)
        }
        (Some(p0), None) => Some(Prior::uniform(p0, parameters.len())),
        (None, Some(noise)) if stated.len() == parameters.len() => {
            Some(Prior::Sigma { theta: stated, noise })
        }
        (None, Some(_)) => {
            let remedy = "give the prior deviation of every parameter as theta.NAME.sigma";
            table.error("sigma", "the noise without the prior of the parameters", remedy)
        }
        (None, None) => {
            let remedy = "give P0, or sigma of the noise and of every parameter";
            table.need("P0", remedy).and(None)
        }
    }
}

type Read = (Option<Physical>, Option<Vec<Entry>>);

/// Reads `physical`: other parameters behind `theta`.
fn physical<'a>(
    above: &Table<'_, 'a>,
    value: &Value<'a>,
    context: &Context<'_>,
    constants: &[f64],
    theta: &[String],
) -> Option<Read> {
    let reader = above.reader;
    let path = above.key("physical");
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(&path, value, "a table with start and map");
    };
    let table = Table::new(reader, &path, value.span().start, map, keys::ADAPTIVE_PHYSICAL);
    let inner = |key: &str, remedy: &str| {
        let value = table.need(key, remedy)?;
        match value.get_ref() {
            DeValue::Table(map) => Some((value.span().start, map)),
            _ => reader.wrong_type(&table.key(key), value, "a table by name"),
        }
    };
    let (at, map) = inner("start", "give a value each, as in start = { m = 1 }")?;
    let start_path = table.key("start");
    let start = Table::named(reader, &start_path, at, map)?;
    let (mut names, mut values) = (Vec::new(), Vec::new());
    for (name, _, value) in start.in_order() {
        let entry = vector(reader, &start.key(name), value, context.constants, (1, "number"))?;
        values.push(entry[0].value(constants));
        names.push(name.to_string());
    }
    if names.len() != theta.len() {
        let message = format!("{} physical parameters for {} of theta", names.len(), theta.len());
        return table.error("start", message, "give as many as there are parameters");
    }
    let taken = |n: &String| !is_name(n) || context.constants.contains(&n.as_str());
    if let Some(name) = names.iter().find(|n| taken(n)) {
        let message = format!("'{name}' is no name, or is taken");
        return table.error("start", message, "choose another name");
    }
    let mut known = context.constants.to_vec();
    known.extend(names.iter().map(String::as_str));
    let map_of = |key: &str, wanted: &[String], known: &[&str]| {
        let value = table.need(key, "give an expression each")?;
        let found = super::formulas::by_name(reader, &table.key(key), value, wanted, known)?;
        let missing = found.iter().position(Option::is_none);
        if let Some(i) = missing {
            let message = format!("{} is missing", wanted[i]);
            return table.error(key, message, "give an expression each");
        }
        Some(found.into_iter().flatten().collect::<Vec<Entry>>())
    };
    let map = map_of("map", theta, &known)?;
    let truth = match table.get("truth") {
        Some(_) => Some(map_of("truth", &names, &context.of_truth())?),
        None => None,
    };
    let physical =
        Physical { names, start: values, map: Arc::new(map), constants: constants.to_vec() };
    Some((Some(physical), truth))
}

/// A plant that stands for the observers where no `[plant]` is given.
pub(in super::super) fn stand_in(observer: &Observer) -> crate::model::Plant {
    let tuning = &observer.public.tuning;
    let (n, q) = (tuning.A.nrows(), tuning.C.nrows());
    crate::model::Plant {
        time: crate::model::Time::Continuous,
        A: tuning.A.clone(),
        B: Mat::zeros(n, observer.public.structure.inputs),
        G: Mat::zeros(n, 0),
        C: tuning.C.clone(),
        Q: Mat::zeros(0, 0),
        R: Mat::identity(q, q),
    }
}
