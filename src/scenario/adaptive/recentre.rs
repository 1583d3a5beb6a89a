//! `[adaptive.recentre]`: a bank that takes a model from the adaptive observer.

use std::sync::Arc;

use toml::de::DeValue;

use super::super::expression::Entry;
use super::super::reader::{Reader, Value};
use super::super::simulation::Simulation;
use super::super::table::Table;
use super::super::{Error, Scenario, keys, suggest};
use super::formulas::Quantities;
use super::observer::Observer;
use crate::engine::{Build, Recentre};
use crate::model::sample;
use crate::sim::{RecentringTrials, ValuesAt, chi_square_band};

/// `[adaptive.recentre]`, read.
#[derive(Debug, Clone)]
pub(in super::super) struct Rule {
    observer: usize,
    /// Parameters of the bank, of those of `[adaptive]` and then `theta`.
    parameters: Vec<(String, Entry)>,
    constants: Vec<f64>,
    /// Seconds.
    window: f64,
    tolerance: f64,
    floor: f64,
    most: usize,
}

/// Reads `[adaptive.recentre]`.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    quantities: &Quantities,
    observers: &[Observer],
) -> Option<Rule> {
    let path = "adaptive.recentre";
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(path, value, "a table");
    };
    let table = Table::new(reader, path, value.span().start, map, keys::ADAPTIVE_RECENTRE);
    let names: Vec<&str> = observers.iter().map(|o| o.public.name.as_str()).collect();
    let observer = match table.get("observer") {
        None => 0,
        Some(value) => {
            let name = reader.string(&table.key("observer"), value)?;
            match names.iter().position(|n| *n == name) {
                Some(at) => at,
                None => {
                    let remedy = suggest::remedy(name, &names, "there are");
                    return table.error("observer", "no such observer", remedy);
                }
            }
        }
    };
    let mut known: Vec<&str> = quantities.names.iter().map(String::as_str).collect();
    let unknown = &observers[observer].public.structure.unknown;
    if let Some(twice) = unknown.iter().find(|u| known.contains(&u.name.as_str())) {
        let message = format!("'{}' names a parameter of [adaptive] and of theta", twice.name);
        return table.error("parameters", message, "rename one of them");
    }
    known.extend(unknown.iter().map(|u| u.name.as_str()));
    let remedy = "give each parameter of the bank, as in parameters = { wn = \"sqrt(k)\" }";
    let value = table.need("parameters", remedy)?;
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(&table.key("parameters"), value, "a table by name");
    };
    let inner_path = table.key("parameters");
    let inner = Table::named(reader, &inner_path, value.span().start, map)?;
    let mut parameters = Vec::new();
    for (name, _, value) in inner.in_order() {
        let otherwise = "expressions here know parameters and theta";
        let entry = super::entry(reader, &inner.key(name), value, &known, otherwise)?;
        parameters.push((name.to_string(), entry));
    }
    let number = |key: &str, default: Option<f64>, low: f64, high: f64, wanted: &str| {
        let value = match (table.get(key), default) {
            (Some(value), _) => reader.number(&table.key(key), value)?,
            (None, Some(default)) => default,
            (None, None) => return table.need(key, wanted).and(None),
        };
        if value > low && value < high {
            return Some(value);
        }
        table.error(key, format!("{value} is out of range"), wanted)
    };
    let most = match table.get("most") {
        Some(value) => reader.integer(&table.key("most"), value, 1)?,
        None => 1,
    };
    Some(Rule {
        observer,
        parameters,
        constants: quantities.values(|_| None),
        window: number("window", None, 0.0, f64::INFINITY, "give positive seconds")?,
        tolerance: number("tolerance", Some(0.02), 0.0, f64::INFINITY, "give a positive share")?,
        floor: number("floor", Some(1e-3), 0.0, 1.0, "give a weight between 0 and 1")?,
        most: usize::try_from(most).unwrap_or(usize::MAX),
    })
}

impl Scenario {
    /// The experiment of `simulation` with the adaptive observer beside its bank, where
    /// `[adaptive.recentre]` asks for it.
    ///
    /// # Errors
    /// `Invalid` for parameters of the bank that are not given, and for signals or an
    /// interval that are not those of the bank.
    pub fn recentring(&self, simulation: &Simulation) -> Result<Option<RecentringTrials>, Error> {
        let (Some(section), Some(bank)) = (&self.adaptive, &self.bank) else { return Ok(None) };
        let Some(rule) = &section.recentre else { return Ok(None) };
        let key = "adaptive.recentre";
        let estimator = &simulation.estimator;
        let wanted = &estimator.parameters;
        let given: Vec<&String> = rule.parameters.iter().map(|(n, _)| n).collect();
        if self.explicit.is_some()
            || given.len() != wanted.len()
            || wanted.iter().any(|w| !given.contains(&w))
        {
            let message = format!("the bank differs in {}", wanted.join(", "));
            return Err(self.fault(key, &message, "give an expression for each, and no other"));
        }
        for (what, own, of_bank) in [
            ("inputs", &section.names.inputs, &estimator.names.inputs),
            ("outputs", &section.names.outputs, &estimator.names.outputs),
        ] {
            if own != of_bank {
                let message = format!("{what} other than those of the plant");
                return Err(self.fault(&format!("adaptive.{what}"), &message, "name the same"));
            }
        }
        if ((section.dt - simulation.dt) / simulation.dt).abs() > 1e-12 {
            let message =
                format!("{} s, but the bank measures every {} s", section.dt, simulation.dt);
            return Err(self.fault("adaptive.dt", &message, "give the same interval"));
        }
        let observer = &section.observers[rule.observer].public;
        let (entries, constants) = (rule.parameters.clone(), rule.constants.clone());
        let order = wanted.clone();
        let values: ValuesAt = Arc::new(move |theta: &[f64]| {
            let all = [&constants[..], theta].concat();
            let of = |name: &String| entries.iter().find(|(n, _)| n == name);
            order.iter().map(|n| of(n).map_or(f64::NAN, |(_, e)| e.value(&all))).collect()
        });
        let (family, around) = (self.family.clone(), self.surroundings.clone());
        let (set, at) = (bank.clone(), values.clone());
        let sampled = estimator.continuous.as_ref().map(|_| simulation.dt);
        let build: Build = Arc::new(move |theta: &[f64]| {
            let set = crate::observer::ModelSet { models: vec![at(theta)], ..set.clone() };
            let plant = set.design_plant(0, family.as_ref(), &around)?;
            Ok(match sampled {
                Some(dt) => sample(&plant, dt, 0.0)?.0,
                None => plant,
            })
        });
        let samples = (rule.window / simulation.dt).round().clamp(1.0, 1e9);
        let outputs = section.names.outputs.len() as f64;
        Ok(Some(RecentringTrials {
            experiment: simulation.experiment(Vec::new()),
            structure: observer.structure.clone(),
            settings: observer.settings.clone(),
            tuning: observer.tuning.clone(),
            rule: Recentre {
                window: samples as usize,
                band: chi_square_band(outputs, samples),
                tolerance: rule.tolerance,
                floor: rule.floor,
                most: rule.most,
                build,
            },
            values,
        }))
    }
}
