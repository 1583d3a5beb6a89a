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
//! line, column, key and remedy. Every key is described in
//! [`guide::scenario`](crate::guide::scenario).

mod adaptive;
mod assemble;
mod bank;
mod course;
mod diagnostic;
mod estimator;
mod explicit;
mod expression;
mod family;
mod grid;
mod keys;
mod matrix;
mod operators;
mod parameters;
mod places;
mod plant;
mod reader;
mod rewrite;
mod run;
mod settings;
mod signals;
mod simulation;
pub(crate) mod source;
mod start;
mod suggest;
mod surroundings;
mod table;
mod template;
mod truth;
mod uneven;
mod weighting;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use toml::de::DeTable;

pub use adaptive::{AdaptiveCase, AdaptiveObserver, Physical};
pub use diagnostic::{Diagnostic, Error};
pub use estimator::Estimator;
pub use family::ExpressionFamily;
pub use rewrite::with_models;
pub use simulation::Simulation;
pub use template::{Template, template};
pub use uneven::{Refusal, Since, Uneven};

use crate::eip::{Bank, Study, WeightLaw};
use crate::engine::{Innovation, Mixing, Weighting};
use crate::model::{ActuatorBound, Family, Surroundings};
use crate::sim::Signals;
use crate::weight::Law;
use explicit::Explicit;
use places::Places;
use reader::Reader;
use settings::Settings;
use source::Source;
use start::Start;

/// The newest format of scenario files that this version reads.
pub const FORMAT: u64 = 1;

/// A scenario, read and checked.
pub struct Scenario {
    title: Option<String>,
    family: Arc<ExpressionFamily>,
    surroundings: Surroundings,
    /// Seconds from the command to the plant.
    delay: f64,
    unmodelled: Option<ActuatorBound>,
    bank: Option<Bank>,
    explicit: Option<Explicit>,
    start: Option<Start>,
    weighting: Option<Weighting>,
    truth: Option<truth::Written>,
    signals: Signals,
    run: Option<run::Run>,
    settings: Option<Settings>,
    adaptive: Option<adaptive::Section>,
    warnings: Vec<Diagnostic>,
    places: Places,
}

impl fmt::Debug for Scenario {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Scenario");
        shown.field("file", &self.places.file).field("title", &self.title).finish_non_exhaustive()
    }
}

impl Scenario {
    /// Reads the scenario at `path`.
    ///
    /// # Errors
    /// `Read` if it cannot be read or is not a regular file, `TooLarge` over
    /// 8 MiB (nothing is read then), and those of [`Scenario::parse`].
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let bytes = source::read(path, source::LIMIT)?;
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

    /// As [`Scenario::parse`], of a text that may not be UTF-8.
    pub(crate) fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, Error> {
        Self::read(name, bytes, None)
    }

    /// Reads the scenario `text` around the plants of `family`: the text has no
    /// `[plant]`, all else is as in a file.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mmae::model::{Family, systems};
    /// use mmae::scenario::Scenario;
    /// let text = "format = 1\n[bank]\nmodels = { wn = [1.0, 2.0] }\n";
    /// let scenario = Scenario::parse_with("bank", text, Arc::new(systems::oscillator()))?;
    /// assert_eq!(scenario.family().names(), systems::oscillator().names());
    /// # Ok::<(), mmae::scenario::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Scenario::parse`]; `Invalid` for a text with `[plant]`.
    pub fn parse_with(name: &str, text: &str, family: Arc<dyn Family>) -> Result<Self, Error> {
        Self::read(name, text.as_bytes(), Some(family))
    }

    fn read(name: &str, bytes: &[u8], family: Option<Arc<dyn Family>>) -> Result<Self, Error> {
        let source = Source::new(name, bytes)?;
        let reader = Reader::new(&source);
        let root = DeTable::parse(source.text).map_err(|e| assemble::syntax(&reader, &e))?;
        let parts = assemble::read(&reader, root.get_ref(), family);
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
    pub fn study(&self) -> Result<Study, Error> {
        let bank = self.bank.as_ref().ok_or_else(|| {
            self.missing("bank", "add [bank] with models, the nominal values of the observers")
        })?;
        if self.explicit.is_some() {
            return Err(Error::Invalid(vec![Diagnostic {
                message: "models given by matrices have no family to sweep".into(),
                remedy: "write the plant with parameters, and the models as their values".into(),
                key: "bank.models".into(),
                file: self.places.file.clone(),
                line: 1,
                column: 1,
            }]));
        }
        if self.family.time.is_continuous() && !bank.observer.is_continuous() {
            let message = "the sets of continuous plants take continuous observers";
            let remedy = "write \"kalman-bucy\"; eip.convention = \"baram\" samples it";
            return Err(self.fault("bank.observer", message, remedy));
        }
        let settings = self
            .settings
            .as_ref()
            .ok_or_else(|| self.missing("eip", "add [eip] with grid, the plants of the study"))?;
        Ok(Study {
            title: self.title.clone(),
            family: self.family.clone(),
            surroundings: self.surroundings.clone(),
            bank: bank.clone(),
            grid: settings.grid.clone(),
            convention: settings.convention,
            delays: settings.delays.clone(),
            unmodelled: self.unmodelled.clone(),
            delay_interval: settings.delay_interval,
            law: self.law(),
            verify: settings.verify,
            method: settings.method,
            memory_limit: settings.memory_limit,
        })
    }

    /// What the long run of `[weighting]` depends on; nothing for laws and settings
    /// whose long run is not described.
    fn law(&self) -> Option<WeightLaw> {
        let weighting = self.weighting.as_ref()?;
        let plain = weighting.mixing == Mixing::None
            && weighting.modifiers.forgetting == 1.0
            && weighting.modifiers.clip.is_infinite()
            && !matches!(weighting.innovation, Innovation::Common(_));
        if !plain {
            return None;
        }
        match weighting.law {
            Law::Bayes | Law::Likelihood => Some(WeightLaw::Posterior),
            Law::Ode { .. } => Some(WeightLaw::Ode),
            Law::Dwsg { lambda, tempering, .. } => {
                let dt = self.start.as_ref().and_then(|s| s.dt);
                Some(WeightLaw::Dwsg { lambda, tempering, dt })
            }
            Law::Zhang { .. } => None,
        }
    }

    /// The error for a key that a command needs and the file lacks.
    fn missing(&self, key: &str, remedy: &str) -> Error {
        self.fault(key, "missing", remedy)
    }

    /// An error at `key`, or at the top of the file where it has none.
    fn fault(&self, key: &str, message: &str, remedy: &str) -> Error {
        let (line, column) = self.places.keys.get(key).copied().unwrap_or((1, 1));
        Error::Invalid(vec![Diagnostic {
            file: self.places.file.clone(),
            line,
            column,
            key: key.into(),
            message: message.into(),
            remedy: remedy.into(),
        }])
    }

    /// True if the file describes trials of a bank, with `[run]`.
    pub fn has_run(&self) -> bool {
        self.run.is_some()
    }

    /// Seed of the random numbers of `[run]`, if the file has it.
    pub fn seed(&self) -> Option<u64> {
        self.run.as_ref().map(|run| run.seed)
    }

    /// True if the file describes a study of plants, with `[eip]`.
    pub fn has_study(&self) -> bool {
        self.settings.is_some()
    }

    /// An error of the engine together with the key that is responsible, for
    /// errors of the study that this scenario describes.
    pub fn explain(&self, error: crate::Error) -> Error {
        self.places.explain(error, "eip")
    }

    /// The same for errors of a bank that runs, on trials or on recorded data.
    pub fn explain_run(&self, error: crate::Error) -> Error {
        let table = ["run", "bank"].into_iter().find(|t| self.places.keys.contains_key(*t));
        self.places.explain(error, table.unwrap_or("bank"))
    }
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
            keys::BOUND,
            keys::BANK,
            keys::MODEL,
            keys::MODEL_KOOPMAN,
            keys::WEIGHTING,
            keys::TRUTH,
            keys::COURSE,
            keys::SIGNALS,
            keys::WAVE,
            keys::RUN,
            keys::EIP,
            keys::ADAPTIVE,
            keys::ADAPTIVE_TRUTH,
            keys::ADAPTIVE_CASE,
            keys::ADAPTIVE_OBSERVER,
            keys::ADAPTIVE_THETA,
            keys::ADAPTIVE_PHYSICAL,
            keys::ADAPTIVE_RECENTRE,
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
