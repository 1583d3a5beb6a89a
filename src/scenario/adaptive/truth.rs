//! `[adaptive.truth]` and `[adaptive.cases]`: the plant that is really there.

use std::sync::Arc;

use toml::de::DeValue;

use super::super::expression::Entry;
use super::super::keys;
use super::super::reader::{Reader, Value, all};
use super::super::table::Table;
use super::formulas::{Quantities, by_name, is_name, vector};
use crate::model::Names;
use crate::sim::Field;

/// `[adaptive.truth]`, read.
#[derive(Debug, Clone)]
pub(super) struct Truth {
    pub(super) states: Vec<String>,
    /// Parameters of `[adaptive]`, then those of the truth.
    pub(super) quantities: Quantities,
    inputs: usize,
    derivative: Arc<Vec<Entry>>,
    output: Arc<Vec<Entry>>,
    x0: Vec<Entry>,
    output_noise: Vec<Entry>,
    input_noise: Vec<Entry>,
}

/// A case: values in place of those of the truth.
#[derive(Debug, Clone)]
pub(super) struct Case {
    pub(super) name: String,
    /// By the index of the quantity.
    changes: Vec<(usize, Entry)>,
    pub(super) x0: Vec<Entry>,
    pub(super) output_noise: Vec<Entry>,
    pub(super) input_noise: Vec<Entry>,
}

/// Reads `[adaptive.truth]`.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    names: &Names,
    before: &Quantities,
) -> Option<Truth> {
    let path = "adaptive.truth";
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(path, value, "a table");
    };
    let table = Table::new(reader, path, value.span().start, map, keys::ADAPTIVE_TRUTH);
    let states = table.need("states", "name them, as in states = [\"x1\", \"x2\"]")?;
    let states = reader.names(&table.key("states"), states)?;
    if let Some(name) = states.iter().chain(&names.inputs).find(|n| !is_name(n)) {
        let message = format!("'{name}' cannot stand in an expression");
        return table.error("states", message, "use letters, digits and _");
    }
    let quantities = Quantities::read(&table, "parameters", before)?;
    let mut known: Vec<&str> = quantities.names.iter().map(String::as_str).collect();
    let constants = known.len();
    known.push("t");
    known.extend(names.inputs.iter().map(String::as_str));
    known.extend(states.iter().map(String::as_str));
    let formulas = |key: &str, count: usize, of: &str| {
        let value = table.need(key, &format!("give an expression each of {of}"))?;
        vector(reader, &table.key(key), value, &known, (count, of))
    };
    let derivative = formulas("derivative", states.len(), "states");
    let output = formulas("output", names.outputs.len(), "outputs");
    let (x0, output_noise, input_noise) =
        start(&table, &known[..constants], states.len(), names, None)?;
    Some(Truth {
        inputs: names.inputs.len(),
        derivative: Arc::new(derivative?),
        output: Arc::new(output?),
        states,
        quantities,
        x0,
        output_noise,
        input_noise,
    })
}

type Start = (Vec<Entry>, Vec<Entry>, Vec<Entry>);

/// `x0`, `noise` and `input_noise`; zero, or those of `truth`, where they are left out.
fn start(
    table: &Table<'_, '_>,
    known: &[&str],
    states: usize,
    names: &Names,
    truth: Option<&Truth>,
) -> Option<Start> {
    let reader = table.reader;
    let zero = |n: usize| vec![Entry::Constant(0.0); n];
    let x0 = match table.get("x0") {
        Some(value) => vector(reader, &table.key("x0"), value, known, (states, "states")),
        None => Some(truth.map_or_else(|| zero(states), |t| t.x0.clone())),
    };
    let noise = |key: &str, names: &[String], own: Option<&Vec<Entry>>| match table.get(key) {
        Some(value) => {
            let found = by_name(reader, &table.key(key), value, names, known)?;
            Some(found.into_iter().map(|e| e.unwrap_or(Entry::Constant(0.0))).collect())
        }
        None => Some(own.cloned().unwrap_or_else(|| zero(names.len()))),
    };
    let output = noise("noise", &names.outputs, truth.map(|t| &t.output_noise));
    let input = noise("input_noise", &names.inputs, truth.map(|t| &t.input_noise));
    Some((x0?, output?, input?))
}

/// Reads `[adaptive.cases]`; without it there is one case, the truth as it is.
pub(super) fn cases(
    table: &Table<'_, '_>,
    truth: Option<&Truth>,
    names: &Names,
    before: &Quantities,
) -> Option<Vec<Case>> {
    let Some(truth) = truth else {
        if table.get("cases").is_some() {
            return table.error(
                "cases",
                "cases of a plant that is not given",
                "add [adaptive.truth]",
            );
        }
        return Some(Vec::new());
    };
    let Some(value) = table.get("cases") else {
        return Some(vec![Case {
            name: "truth".into(),
            changes: Vec::new(),
            x0: truth.x0.clone(),
            output_noise: truth.output_noise.clone(),
            input_noise: truth.input_noise.clone(),
        }]);
    };
    let reader = table.reader;
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("adaptive.cases", value, "a table of cases by name");
    };
    let inner = Table::named(reader, "adaptive.cases", value.span().start, map)?;
    let read = all(inner.in_order().into_iter().map(|(name, _, value)| {
        let path = inner.key(name);
        let DeValue::Table(map) = value.get_ref() else {
            return reader.wrong_type(&path, value, "a table");
        };
        let case = Table::new(reader, &path, value.span().start, map, keys::ADAPTIVE_CASE);
        let own: Vec<String> = truth.quantities.names[before.names.len()..].to_vec();
        let constants: Vec<&str> = before.names.iter().map(String::as_str).collect();
        let changes = match case.get("parameters") {
            Some(value) => by_name(reader, &case.key("parameters"), value, &own, &constants)?,
            None => Vec::new(),
        };
        let numbered = changes.into_iter().enumerate();
        let changes = numbered.filter_map(|(i, e)| Some((before.names.len() + i, e?))).collect();
        let known: Vec<&str> = truth.quantities.names.iter().map(String::as_str).collect();
        let (x0, output_noise, input_noise) =
            start(&case, &known, truth.states.len(), names, Some(truth))?;
        Some(Case { name: name.into(), changes, x0, output_noise, input_noise })
    }))?;
    if read.is_empty() {
        return table.error("cases", "no cases", "give one, or leave [adaptive.cases] out");
    }
    Some(read)
}

impl Case {
    /// The value of every quantity; the error is the name of a change that fits none.
    pub(super) fn values(
        &self,
        truth: &Truth,
        changes: &[(String, f64)],
    ) -> Result<Vec<f64>, String> {
        let names = &truth.quantities.names;
        if let Some((name, _)) = changes.iter().find(|(n, _)| !names.contains(n)) {
            return Err(name.clone());
        }
        // expressions of a case know the parameters of [adaptive], which stand first
        let plain = truth.quantities.values(|_| None);
        Ok(truth.quantities.values(|name| {
            let asked = changes.iter().rev().find(|(n, _)| n == name).map(|(_, v)| *v);
            let index = names.iter().position(|n| n == name)?;
            let own = self.changes.iter().find(|(i, _)| *i == index);
            asked.or_else(|| own.map(|(_, entry)| entry.value(&plain)))
        }))
    }
}

impl Truth {
    /// Names that a change may have.
    pub(super) fn parameter_names(&self) -> Vec<&str> {
        self.quantities.names.iter().map(String::as_str).collect()
    }

    /// The plant at the values of its quantities.
    pub(super) fn field(&self, constants: &[f64]) -> Field {
        let (n, m) = (self.states.len(), self.inputs);
        let make = |formulas: &Arc<Vec<Entry>>| {
            let formulas = formulas.clone();
            let template = [constants, &vec![0.0; 1 + m + n]].concat();
            let first = constants.len();
            move |t: f64, u: &[f64], x: &[f64], out: &mut [f64]| {
                let mut values = template.clone();
                values[first] = t;
                values[first + 1..][..m].copy_from_slice(u);
                values[first + 1 + m..].copy_from_slice(x);
                for (out, formula) in out.iter_mut().zip(formulas.iter()) {
                    *out = formula.value(&values);
                }
            }
        };
        Field {
            states: n,
            outputs: self.output.len(),
            derivative: Arc::new(make(&self.derivative)),
            output: Arc::new(make(&self.output)),
        }
    }
}
