//! Scenario files: a parameterised plant, its surroundings, a bank of models
//! and a study, in TOML with matrix entries as expressions.
//!
//! ```
//! use mmae::model::Family;
//! use mmae::scenario::{Scenario, Template, template};
//! let scenario = Scenario::parse("pendulum.toml", template(Template::Pendulum))?;
//! assert_eq!(scenario.family().names().states, ["x", "theta", "x_dot", "theta_dot"]);
//! assert_eq!(scenario.study()?.grid.len(), 401);
//! # Ok::<(), mmae::scenario::Error>(())
//! ```
//!
//! Whatever is wrong with a file is an [`Error`] whose diagnostics name file,
//! line, column, key and remedy. The language follows.
//!
#![doc = include_str!("../guide/scenario.md")]

mod bank;
mod diagnostic;
mod expression;
mod family;
mod grid;
mod keys;
mod matrix;
mod operators;
mod places;
mod plant;
mod reader;
mod settings;
mod source;
mod suggest;
mod surroundings;
mod template;

use std::path::Path;
use std::sync::Arc;

use toml::de::{DeTable, DeValue};

pub use diagnostic::{Diagnostic, Error};
pub use family::ExpressionFamily;
pub use template::{Template, template};

use crate::eip::{Bank, Study};
use crate::model::{Family, Surroundings};
use places::Places;
use reader::{Reader, Table, Value, clip};
use settings::Settings;
use source::Source;

/// The newest format of scenario files that this version reads.
pub const FORMAT: u64 = 1;

/// A scenario, read and checked.
pub struct Scenario {
    title: Option<String>,
    family: Arc<ExpressionFamily>,
    surroundings: Surroundings,
    bank: Option<Bank>,
    settings: Option<Settings>,
    warnings: Vec<Diagnostic>,
    places: Places,
}

impl Scenario {
    /// Reads the scenario at `path`.
    ///
    /// # Errors
    /// `Read` if it cannot be read or is not a regular file, `TooLarge` over
    /// 8 MiB (nothing is read then), and those of [`Scenario::parse`].
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let bytes = source::read(path)?;
        Self::from_bytes(&path.display().to_string(), &bytes)
    }

    /// Reads the scenario `text`; diagnostics call it `name`.
    ///
    /// # Errors
    /// `Invalid` with every diagnostic of a text that is not a scenario,
    /// `Engine` for one whose matrices, grid or bank the engine refuses.
    pub fn parse(name: &str, text: &str) -> Result<Self, Error> {
        Self::from_bytes(name, text.as_bytes())
    }

    fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, Error> {
        let source = Source::new(name, bytes)?;
        let reader = Reader::new(&source);
        let root = DeTable::parse(source.text).map_err(|e| syntax(&reader, &e))?;
        let parts = read(&reader, root.get_ref());
        let warnings = reader.finish()?;
        // without diagnostics every part is there
        let Some(scenario) = parts else { return Err(Error::Invalid(Vec::new())) };
        Ok(Self { warnings, ..scenario })
    }

    /// The title, if the file gives one.
    pub fn title(&self) -> Option<&str> {
        self.title.as_deref()
    }

    /// The plants.
    pub fn family(&self) -> &ExpressionFamily {
        &self.family
    }

    /// What surrounds the plants.
    pub fn surroundings(&self) -> &Surroundings {
        &self.surroundings
    }

    /// What is odd about the file but no error: a missing format, parameters
    /// without effect.
    pub fn warnings(&self) -> &[Diagnostic] {
        &self.warnings
    }

    /// The study that `[bank]` and `[eip]` describe.
    ///
    /// # Errors
    /// `Invalid` if one of the two is missing.
    pub fn study(&self) -> Result<Study<'_>, Error> {
        let missing = |table: &str, remedy: &str| {
            Error::Invalid(vec![Diagnostic {
                file: self.places.file.clone(),
                line: 1,
                column: 1,
                key: table.into(),
                message: "missing".into(),
                remedy: remedy.into(),
            }])
        };
        let bank = self.bank.as_ref().ok_or_else(|| {
            missing("bank", "add [bank] with models, the nominal values of the observers")
        })?;
        let settings = self
            .settings
            .as_ref()
            .ok_or_else(|| missing("eip", "add [eip] with grid, the plants of the study"))?;
        Ok(Study {
            family: &*self.family,
            surroundings: self.surroundings.clone(),
            bank: bank.clone(),
            grid: settings.grid.clone(),
            convention: settings.convention,
            delays: settings.delays.clone(),
            verify: settings.verify,
            method: settings.method,
            memory_limit: settings.memory_limit,
        })
    }

    /// An error of the engine together with the key that is responsible, for
    /// errors of the study that this scenario describes.
    pub fn explain(&self, error: crate::Error) -> Error {
        self.places.explain(error)
    }
}

/// A syntax error of the parser as an `Error`.
fn syntax(reader: &Reader<'_>, error: &toml::de::Error) -> Error {
    let span = error.span().unwrap_or(0..0);
    let text = reader.source.text;
    let message = error.message();
    let word = clip(text.get(span.clone()).unwrap_or("").trim());
    let (key, remedy) = match message {
        "duplicate key" => (word, "keep one of them"),
        _ => (String::new(), "see toml.io for the syntax"),
    };
    let message = format!("TOML: {message}");
    Error::Invalid(vec![reader.diagnostic(span.start, &key, message, remedy)])
}

fn read<'a>(reader: &Reader<'a>, root: &DeTable<'a>) -> Option<Scenario> {
    let table = Table::new(reader, "", 0, root, keys::TOP);
    format(&table)?;
    let title = match table.get("title") {
        Some(value) => Some(reader.string("title", value)?.to_string()),
        None => None,
    };
    let shaped = table.get("disturbance").is_some();
    let plant = table.need("plant", "add [plant] with time, states, outputs, A, C and R");
    let (family, entries) = plant::read(reader, plant?, shaped)?;
    let names = family.names();
    let disturbance = table.get("disturbance").map(|value| {
        surroundings::filter(reader, "disturbance", value, &names.disturbances, "disturbances")
    });
    let input = table
        .get("input")
        .map(|value| surroundings::filter(reader, "input", value, &names.inputs, "inputs"));
    let controller =
        table.get("controller").map(|value| surroundings::controller(reader, value, names));
    let actuator = table.get("actuator").map(|value| surroundings::actuator(reader, value));
    let settings = table.get("eip").map(|value| settings::read(reader, value, &family));
    let weighted = plant.is_some_and(|p| has(p, "Q"));
    let bank = table.get("bank").map(|value| bank::read(reader, value, &family, shaped, weighted));
    // each has had its say
    let actuator = actuator.map_or(Some(Default::default()), |a| a)?;
    let mut settings = maybe(settings)?;
    if let (Some((delay, at)), Some(settings)) = (actuator.delay, &mut settings) {
        if !settings.delays.is_empty() {
            let remedy = "keep eip.delays for a family, actuator.delay for one";
            let message = "both actuator.delay and eip.delays are given";
            return reader.error(at, "actuator.delay", message, remedy);
        }
        settings.delays = vec![delay];
    }
    let scenario = Scenario {
        title,
        surroundings: Surroundings {
            controller: maybe(controller)?,
            disturbance: maybe(disturbance)?,
            input: maybe(input)?,
            pade_order: actuator.pade,
        },
        bank: maybe(bank)?,
        settings,
        warnings: Vec::new(),
        places: Places { entries, ..places(reader, root) },
        family: Arc::new(family),
    };
    check(reader, &scenario);
    Some(scenario)
}

/// An optional part: `None` when it is there and wrong.
fn maybe<T>(part: Option<Option<T>>) -> Option<Option<T>> {
    match part {
        None => Some(None),
        Some(None) => None,
        Some(value) => Some(value),
    }
}

fn has(value: &Value<'_>, key: &str) -> bool {
    matches!(value.get_ref(), DeValue::Table(map) if map.get(key).is_some())
}

fn format(table: &Table<'_, '_>) -> Option<()> {
    let Some(value) = table.get("format") else {
        let remedy = "add format = 1 at the top";
        table.reader.warn(0, "format", "missing, taken for 1", remedy);
        return Some(());
    };
    match table.reader.integer("format", value, 1)? {
        1..=FORMAT => Some(()),
        newer => {
            let message = format!("format {newer} needs a newer mmae; this one reads {FORMAT}");
            table.error("format", message, "update mmae, or write the file in the older format")
        }
    }
}

/// The engine's own checks, at the nominal values.
fn check(reader: &Reader<'_>, scenario: &Scenario) {
    let names = scenario.family.names();
    let theta: Vec<f64> = scenario.family.parameters().iter().map(|p| p.nominal).collect();
    let around = &scenario.surroundings;
    let (nu, ny, nw) = (names.inputs.len(), names.outputs.len(), names.disturbances.len());
    let checked = scenario
        .family
        .plant(&theta)
        .and_then(|plant| plant.check())
        .and_then(|()| around.controller.as_ref().map_or(Ok(()), |k| k.check(nu, ny)))
        .and_then(|()| around.disturbance.as_ref().map_or(Ok(()), |f| f.check("disturbance", nw)))
        .and_then(|()| around.input.as_ref().map_or(Ok(()), |f| f.check("input", nu)));
    if let Err(error) = checked
        && let Error::Engine { at, source } = scenario.explain(error)
    {
        reader.refuse(*at, source);
    }
}

/// Places of the keys of the upper three levels, and of matrix entries.
fn places(reader: &Reader<'_>, root: &DeTable<'_>) -> Places {
    fn walk(reader: &Reader<'_>, path: &str, map: &DeTable<'_>, places: &mut Places) {
        for (key, value) in map {
            let path = if path.is_empty() {
                key.get_ref().to_string()
            } else {
                format!("{path}.{}", key.get_ref())
            };
            places.keys.insert(path.clone(), reader.source.position(value.span().start));
            if let DeValue::Table(inner) = value.get_ref() {
                walk(reader, &path, inner, places);
            }
        }
    }
    let mut places = Places { file: reader.source.name.into(), ..Places::default() };
    walk(reader, "", root, &mut places);
    places
}

#[cfg(test)]
mod tests {
    use super::{keys, operators};

    #[test]
    fn the_guide_names_every_key_function_and_constant() {
        let guide = include_str!("../guide/scenario.md");
        let tables = [
            keys::TOP,
            keys::PLANT,
            keys::FILTER,
            keys::CONTROLLER,
            keys::ACTUATOR,
            keys::BANK,
            keys::EIP,
        ];
        let functions = operators::FUNCTIONS.iter().map(|f| f.name);
        let constants = operators::CONSTANTS.iter().map(|(name, _)| *name);
        for word in tables.concat().into_iter().chain(functions).chain(constants) {
            let shown =
                ["`{}`", "`[{}]`", "`{}("].iter().any(|f| guide.contains(&f.replace("{}", word)));
            assert!(shown, "{word} is missing from the guide");
        }
        for word in keys::RANGE {
            assert!(guide.contains(&format!("{word} = ")), "{word} is missing from the guide");
        }
    }
}
