//! `[adaptive]`: observers of states and parameters, and the plant they are shown.

mod formulas;
mod observer;
mod recentre;
mod truth;

use std::sync::Arc;

use toml::de::DeValue;

use super::expression::Entry;
use super::matrix::Scope;
use super::reader::{Reader, Value, all};
use super::run::{Length, Run};
use super::table::Table;
use super::{Error, Scenario, keys, signals};
use crate::adaptive::{Adaptive, Settings, Structure, Tuning};
use crate::model::Names;
use crate::sim::{AdaptiveTrials, Signal};
use formulas::Quantities;
pub(super) use observer::{Observer, stand_in};
use truth::{Case, Truth};

/// `[adaptive]`, read.
#[derive(Debug, Clone)]
pub(super) struct Section {
    dt: f64,
    pub(super) names: Names,
    pub(super) observers: Vec<Observer>,
    truth: Option<Truth>,
    cases: Vec<Case>,
    recentre: Option<recentre::Rule>,
}

/// An adaptive observer that a scenario describes.
#[derive(Debug, Clone)]
pub struct AdaptiveObserver {
    /// Its name in the file.
    pub name: String,
    /// What is unknown.
    pub structure: Structure,
    /// How it is run.
    pub settings: Settings,
    /// The observer.
    pub tuning: Tuning,
    /// Other parameters that follow from those that are estimated.
    pub physical: Option<Physical>,
}

/// Parameters that stand behind the estimated ones: `theta = map(phi)`.
#[derive(Clone)]
pub struct Physical {
    /// Their names.
    pub names: Vec<String>,
    /// Where the search for them starts.
    pub start: Vec<f64>,
    map: Arc<Vec<Entry>>,
    /// Values of the names before them.
    constants: Vec<f64>,
}

impl std::fmt::Debug for Physical {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut shown = f.debug_struct("Physical");
        shown.field("names", &self.names).field("start", &self.start).finish_non_exhaustive()
    }
}

impl Physical {
    /// `theta` of the physical parameters `phi`.
    pub fn map(&self, phi: &[f64], theta: &mut [f64]) {
        let values = [&self.constants[..], phi].concat();
        for (value, entry) in theta.iter_mut().zip(self.map.iter()) {
            *value = entry.value(&values);
        }
    }

    /// The physical parameters of `theta` with their standard deviations, from those of
    /// `theta` and its correlation.
    ///
    /// # Errors
    /// As [`solve_parameters`](crate::adaptive::solve_parameters).
    pub fn solve(
        &self,
        theta: &[f64],
        std: &[f64],
        correlation: &crate::Mat<f64>,
    ) -> crate::Result<(Vec<f64>, Vec<f64>)> {
        let map = |phi: &[f64], theta: &mut [f64]| self.map(phi, theta);
        let (phi, slope) = crate::adaptive::solve_parameters(map, theta, &self.start)?;
        let p = theta.len();
        let deviation = |i: usize| {
            let pairs = (0..p).flat_map(|j| (0..p).map(move |k| (j, k)));
            let square: f64 = pairs
                .map(|(j, k)| slope[(i, j)] * std[j] * correlation[(j, k)] * std[k] * slope[(i, k)])
                .sum();
            square.max(0.0).sqrt()
        };
        Ok((phi, (0..p).map(deviation).collect()))
    }
}

/// The plant and the noise of one case of `[adaptive]`.
#[derive(Debug, Clone)]
pub struct AdaptiveCase {
    /// Its name in the file.
    pub name: String,
    /// Names of the plant's states.
    pub states: Vec<String>,
    /// One experiment an observer, in their order.
    pub trials: Vec<AdaptiveTrials>,
    /// True values of the parameters of each observer, where the file gives them.
    pub theta: Vec<Option<Vec<f64>>>,
    /// The same of the physical parameters.
    pub physical: Vec<Option<Vec<f64>>>,
}

/// Reads `[adaptive]`.
pub(super) fn read<'a>(reader: &Reader<'a>, value: &Value<'a>) -> Option<Section> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("adaptive", value, "a table");
    };
    let table = Table::new(reader, "adaptive", value.span().start, map, keys::ADAPTIVE);
    let dt = interval(&table);
    let list = |key: &str| match table.get(key) {
        Some(value) => reader.names(&table.key(key), value),
        None => Some(Vec::new()),
    };
    let inputs = list("inputs");
    let outputs = table.need("outputs", "name them, as in outputs = [\"y\"]");
    let outputs = outputs.and_then(|value| reader.names("adaptive.outputs", value));
    let quantities = Quantities::read(&table, "parameters", &Quantities::default());
    let names = Names { inputs: inputs?, outputs: outputs?, ..Names::default() };
    let (dt, quantities) = (dt?, quantities?);
    if names.outputs.is_empty() {
        return table.error("outputs", "the list is empty", "name one output or more");
    }
    let truth = match table.get("truth") {
        Some(value) => Some(truth::read(reader, value, &names, &quantities)?),
        None => None,
    };
    let cases = truth::cases(&table, truth.as_ref(), &names, &quantities);
    let remedy = "describe one, as in [adaptive.observers.name]";
    let value = table.need("observers", remedy)?;
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("adaptive.observers", value, "a table of observers by name");
    };
    let inner = Table::named(reader, "adaptive.observers", value.span().start, map)?;
    let shared =
        observer::Shared { dt, names: &names, quantities: &quantities, truth: truth.as_ref() };
    let observers = all(inner
        .in_order()
        .into_iter()
        .map(|(name, _, value)| observer::read(reader, &inner.key(name), name, value, &shared)))?;
    if observers.is_empty() {
        return table.error("observers", "no observers", remedy);
    }
    let recentre = match table.get("recentre") {
        Some(value) => Some(recentre::read(reader, value, &quantities, &observers)?),
        None => None,
    };
    Some(Section { dt, names, observers, truth, cases: cases?, recentre })
}

fn interval(table: &Table<'_, '_>) -> Option<f64> {
    let value = table.need("dt", "give the seconds between measurements")?;
    match table.reader.number(&table.key("dt"), value)? {
        dt if dt > 0.0 => Some(dt),
        dt => {
            let message = format!("{dt} is not a sampling interval");
            table.error("dt", message, "give positive seconds")
        }
    }
}

/// `[signals]` of a file without a bank: inputs only.
pub(super) fn signals<'a>(
    table: &Table<'_, 'a>,
    value: &Value<'a>,
    names: &Names,
) -> Option<crate::sim::Signals> {
    let signals = signals::read(table.reader, value, names, false)?;
    if !signals.noise.is_empty() {
        let at = table.place("signals", "noise");
        let remedy = "give standard deviations under [adaptive.truth.noise]";
        return table.reader.error(at, "signals.noise", "noise of an adaptive observer", remedy);
    }
    Some(signals)
}

/// The key of what the engine calls `what`.
fn key_of(what: &str) -> &str {
    match what {
        "P(0)" => "P0",
        "x_hat(0)" => "x0",
        "P(0) of x(0)" => "x0_P0",
        what => what,
    }
}

/// A number or an expression of `known` names.
fn entry<'a>(
    reader: &Reader<'a>,
    key: &str,
    value: &Value<'a>,
    known: &[&str],
    otherwise: &'static str,
) -> Option<Entry> {
    reader.entry(key, value, Scope { names: known, otherwise })
}

impl Scenario {
    /// The adaptive observers that `[adaptive]` describes; none without it.
    pub fn adaptive_observers(&self) -> Vec<AdaptiveObserver> {
        let observers = self.adaptive.iter().flat_map(|section| &section.observers);
        observers.map(|observer| observer.public.clone()).collect()
    }

    /// True if the file describes adaptive observers and no bank.
    pub fn is_adaptive(&self) -> bool {
        self.adaptive.is_some() && self.bank.is_none()
    }

    /// Names of inputs and outputs of `[adaptive]`.
    pub fn adaptive_names(&self) -> Option<&Names> {
        self.adaptive.as_ref().map(|section| &section.names)
    }

    /// The experiments that `[adaptive]`, `[signals]` and `[run]` describe: one a case.
    ///
    /// `changes` replace parameters of the truth by name, in every case.
    ///
    /// # Errors
    /// `Invalid` without `[adaptive]`, `[adaptive.truth]` or `[run]`, and for a change
    /// that names no parameter.
    pub fn adaptive_cases(&self, changes: &[(String, f64)]) -> Result<Vec<AdaptiveCase>, Error> {
        let Some(section) = &self.adaptive else {
            return Err(self.missing("adaptive", "add [adaptive] with its observers"));
        };
        let Some(truth) = &section.truth else {
            let remedy = "add the plant: states, derivative and output";
            return Err(self.missing("adaptive.truth", remedy));
        };
        let Some(run) = &self.run else {
            return Err(self.missing("run", "add [run] with duration, and perhaps trials and seed"));
        };
        let samples = self.samples(run, section.dt)?;
        let mut inputs = self.signals.inputs.clone();
        inputs.resize(section.names.inputs.len(), Signal::default());
        let case = |case: &Case| {
            let values = case.values(truth, changes).map_err(|name| {
                let known = truth.parameter_names().join(", ");
                self.fault(
                    "adaptive.truth",
                    &format!("the truth has no parameter '{name}'"),
                    &format!("it has {known}"),
                )
            })?;
            let numbers = |entries: &[Entry]| -> Vec<f64> {
                entries.iter().map(|e| e.value(&values)).collect()
            };
            let trials = |observer: &Observer| AdaptiveTrials {
                structure: observer.public.structure.clone(),
                settings: observer.public.settings.clone(),
                tuning: observer.public.tuning.clone(),
                truth: truth.field(&values),
                x0: numbers(&case.x0),
                inputs: inputs.clone(),
                output_noise: numbers(&case.output_noise),
                input_noise: numbers(&case.input_noise),
                samples,
                trials: run.trials,
                seed: run.seed,
                every: run.every,
            };
            let known = |entries: &Option<Vec<Entry>>| entries.as_ref().map(|e| numbers(e));
            Ok(AdaptiveCase {
                name: case.name.clone(),
                states: truth.states.clone(),
                trials: section.observers.iter().map(trials).collect(),
                theta: section.observers.iter().map(|o| known(&o.truth)).collect(),
                physical: section.observers.iter().map(|o| known(&o.physical_truth)).collect(),
            })
        };
        section.cases.iter().map(case).collect()
    }

    /// Measurements of a run, the one at the start included.
    fn samples(&self, run: &Run, dt: f64) -> Result<u64, Error> {
        let steps = match run.length {
            Length::Steps(steps) => steps as f64,
            Length::Duration(seconds) => (seconds / dt).round(),
        };
        if !(1.0..=1e8).contains(&steps) {
            let message = format!("{steps} steps of {dt} s");
            return Err(self.fault("run", &message, "give one step or more, up to 1e8"));
        }
        Ok(steps as u64 + 1)
    }

    /// An error of an adaptive observer together with its key.
    pub fn explain_adaptive(&self, error: crate::Error, observer: &str) -> Error {
        let at = format!("adaptive.observers.{observer}");
        let key = match &error {
            crate::Error::Shape { what, .. }
            | crate::Error::NonFinite { what, .. }
            | crate::Error::Range { what, .. } => format!("{at}.{}", key_of(what)),
            crate::Error::ObserverUnstable { .. } => format!("{at}.K"),
            crate::Error::NotObservable { .. } => format!("{at}.C"),
            crate::Error::NotIdentifiable { .. } => format!("{at}.theta"),
            _ => at.clone(),
        };
        let place = self.places.keys.get(&key).or_else(|| self.places.keys.get(&at));
        let (line, column) = place.copied().unwrap_or((1, 1));
        let (message, remedy) = super::places::split(&error);
        let file = self.places.file.clone();
        let diagnostic = super::Diagnostic { file, line, column, key, message, remedy };
        Error::Engine { at: Box::new(diagnostic), source: error }
    }

    /// Builds the adaptive observers, each by itself.
    pub fn build_adaptive(&self) -> Vec<crate::Result<Adaptive>> {
        let build = |o: AdaptiveObserver| {
            Adaptive::new(o.structure, o.settings, vec![o.tuning]).map_err(|e| match e {
                crate::Error::AllFailed { source, .. } => *source,
                e => e,
            })
        };
        self.adaptive_observers().into_iter().map(build).collect()
    }
}
