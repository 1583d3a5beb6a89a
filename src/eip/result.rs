//! What an EIP study returns.

use crate::eip::{DelaySweep, Identification, Robust};
use crate::error::{Eigenvalue, Error};
use crate::model::Grid;

/// The measure of a model's output error; see the guide for the derivation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Convention {
    /// `1/2 tr(R^-1 E[eps eps'])`, `eps` the noise-free output error: the rate
    /// of the exact continuous likelihood, its common constant dropped.
    Ito,
    /// Baram's measure on discrete filters. Continuous plants are sampled
    /// every `dt` seconds; discrete plants bring their own.
    Baram {
        /// Sampling interval in seconds.
        dt: f64,
    },
    /// `1/2 tr(E[eps eps'])` in physical units, `S = I`.
    Identity,
}

impl Convention {
    /// `ito`, `baram` or `identity`, as scenario files spell it.
    pub fn name(self) -> &'static str {
        match self {
            Convention::Ito => "ito",
            Convention::Baram { .. } => "baram",
            Convention::Identity => "identity",
        }
    }
}

/// A model of the bank, as the study saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Label for tables and plots.
    pub label: String,
    /// Parameter values, in the order of [`Study::parameters`](super::EipSets::parameters).
    pub values: Vec<f64>,
    /// Why the model could not be used; it never wins and its Upsilon is NaN.
    pub failure: Option<Error>,
    /// Index of an earlier model with the same observer to rounding, if any:
    /// the earlier one wins every tie.
    pub duplicate_of: Option<usize>,
}

/// An interval of the parameter, ends included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
}

/// Where the winner changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boundary {
    /// Parameter value, refined.
    pub value: f64,
    /// Width of the bracket plus the distance within which the two models
    /// differ by less than their error estimate.
    pub uncertainty: f64,
    /// Model that wins below.
    pub left: usize,
    /// Model that wins above.
    pub right: usize,
}

/// A plant without a stationary output error.
#[derive(Debug, Clone, PartialEq)]
pub struct Unstable {
    /// Index on the grid.
    pub plant: usize,
    /// Parameter values.
    pub values: Vec<f64>,
    /// The least stable mode.
    pub mode: Eigenvalue,
    /// States that dominate it, by name.
    pub states: String,
}

/// A plant of the grid that could not be built.
#[derive(Debug, Clone, PartialEq)]
pub struct Failed {
    /// Index on the grid.
    pub plant: usize,
    /// Parameter values.
    pub values: Vec<f64>,
    /// Why.
    pub error: Error,
}

/// A plant with a stationary output error whose winner is withheld: neither
/// route is accurate enough to name it.
#[derive(Debug, Clone, PartialEq)]
pub struct Undecided {
    /// Index on the grid.
    pub plant: usize,
    /// Parameter values.
    pub values: Vec<f64>,
    /// What is in doubt.
    pub doubt: Doubt,
}

/// Why a winner is withheld.
#[derive(Debug, Clone, PartialEq)]
pub enum Doubt {
    /// Models for which neither route gives a number.
    NoNumber {
        /// Their indices.
        models: Vec<usize>,
    },
    /// Models that the error estimates do not tell apart.
    Margin {
        /// The one with the smallest Upsilon, and those as good, to the errors.
        models: Vec<usize>,
        /// By how much the first of them leads the closest.
        margin: f64,
        /// The errors of these two, added.
        error: f64,
    },
}

impl Doubt {
    /// The models in doubt.
    pub fn models(&self) -> &[usize] {
        match self {
            Doubt::NoNumber { models } | Doubt::Margin { models, .. } => models,
        }
    }
}

/// The study for one actuator delay.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Actuator delay in seconds.
    pub delay: f64,
    /// Upsilon, plants by models (models fastest); NaN for plants that are
    /// unstable or failed and models that failed.
    pub upsilon: Vec<f64>,
    /// Error estimate of each Upsilon: the difference of the two routes and the
    /// error of the quadrature where both were taken, the latter alone where
    /// the frequency integral replaces the Lyapunov route, NaN elsewhere. Empty where none
    /// is known of any pair.
    pub error: Vec<f64>,
    /// Winning model of each plant: the first of those within 1e-12 of the
    /// smallest Upsilon.
    pub winner: Vec<Option<usize>>,
    /// Upsilon of the runner-up less that of the winner (0 at a tie, less by
    /// rounding if need be; infinite with one model, NaN where there is no
    /// winner).
    pub margin: Vec<f64>,
    /// One parameter: the boundaries, in increasing order.
    pub boundaries: Vec<Boundary>,
    /// One parameter: the EIP set of each model, as disjoint intervals.
    pub sets: Vec<Vec<Interval>>,
    /// One parameter: stretches of the grid where the loop is unstable.
    pub unstable_intervals: Vec<Interval>,
    /// One parameter: stretches of the grid where the plant cannot be built.
    pub failed_intervals: Vec<Interval>,
    /// One parameter: stretches whose winner is withheld, from the last decided
    /// grid value before to the first one after.
    pub undecided_intervals: Vec<Interval>,
    /// The unstable plants of the grid.
    pub unstable: Vec<Unstable>,
    /// The plants of the grid that could not be built.
    pub failed: Vec<Failed>,
    /// The plants whose winner is withheld.
    pub undecided: Vec<Undecided>,
    /// Largest difference of the two routes, relative, over the pairs whose
    /// Lyapunov value was kept; a plant between two checked ones counts with
    /// what was found there.
    pub route_difference: f64,
    /// Number of pairs where both routes gave a number.
    pub checked_pairs: usize,
    /// Number of pairs whose Upsilon is the frequency integral's: the Lyapunov
    /// route had lost its digits there.
    pub replaced: usize,
}

impl Case {
    /// A case of which nothing is known yet.
    pub(crate) fn empty(delay: f64, plants: usize, models: usize) -> Self {
        Self {
            delay,
            upsilon: Vec::new(),
            error: Vec::new(),
            winner: Vec::with_capacity(plants),
            margin: Vec::with_capacity(plants),
            boundaries: Vec::new(),
            sets: vec![Vec::new(); models],
            unstable_intervals: Vec::new(),
            failed_intervals: Vec::new(),
            undecided_intervals: Vec::new(),
            unstable: Vec::new(),
            failed: Vec::new(),
            undecided: Vec::new(),
            route_difference: 0.0,
            checked_pairs: 0,
            replaced: 0,
        }
    }
}

/// A stretch of the parameter whose winner depends on the delay.
#[derive(Debug, Clone, PartialEq)]
pub struct Undecidable {
    /// The stretch.
    pub interval: Interval,
    /// Models that win somewhere in it for some delay, in increasing order.
    pub models: Vec<usize>,
}

/// How the Lyapunov route computed its couplings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Doubling in lanes over plants, powers shared by the models.
    Doubling,
    /// Separable modal form, one sum over eigenvalue pairs a pair.
    Modal,
}

/// Equivalently-identified-plant sets: which model each plant of the grid is
/// identified as.
#[derive(Debug, Clone, PartialEq)]
pub struct EipSets {
    /// Title for text and pictures, if the study has one.
    pub title: Option<String>,
    /// Names of the parameters of grid and models.
    pub parameters: Vec<String>,
    /// The bank.
    pub models: Vec<Model>,
    /// The measure.
    pub convention: Convention,
    /// The grid of plants.
    pub grid: Grid,
    /// One case a delay, in the order given (at least one).
    pub cases: Vec<Case>,
    /// One parameter, several delays: where the winner depends on the delay.
    pub undecidable: Vec<Undecidable>,
    /// Upsilon of model `i` (column) with the plant at the nominal value of
    /// model `j` (row), for the first delay; NaN where not defined. The
    /// diagonal is the matched Upsilon.
    pub at_nominals: Vec<f64>,
    /// How the couplings were computed.
    pub method: Method,
    /// What holds for every unmodelled actuator, if the study bounds it.
    pub robust: Option<Robust>,
    /// Where a delay matters that is only known to an interval.
    pub delay_sweep: Option<DelaySweep>,
    /// What the weights settle on, if the study says how the bank is weighed.
    pub identification: Option<Identification>,
}

impl EipSets {
    /// Pseudo-norm between models `i` and `j` with the plant at the nominal
    /// value of model `k`.
    ///
    /// ```text
    /// d(i, j) = |Upsilon_i - Upsilon_j|
    /// ```
    ///
    /// # Source
    /// Hassani et al. (2009), eq. (21).
    ///
    /// # Panics
    /// If an index is past the models.
    pub fn pseudo_norm(&self, k: usize, i: usize, j: usize) -> f64 {
        let n = self.models.len();
        assert!(i < n && j < n && k < n, "indices {k}, {i}, {j} of {n} models");
        (self.at_nominals[k * n + i] - self.at_nominals[k * n + j]).abs()
    }

    /// The pseudo-norms `d(i, j)` with the plant at the nominal value of model
    /// `j`: row `j`, column `i`; NaN where not defined.
    pub fn pseudo_norms(&self) -> Vec<f64> {
        let n = self.models.len();
        (0..n * n).map(|k| self.pseudo_norm(k / n, k % n, k / n)).collect()
    }

    /// The model that a plant at `value` is identified as in case `case`, for
    /// a study of one parameter; `None` outside the grid and where there is no
    /// winner.
    ///
    /// # Panics
    /// If there is no such case.
    pub fn model_at(&self, case: usize, value: f64) -> Option<usize> {
        let inside = |i: &Interval| i.from <= value && value <= i.to;
        self.cases[case].sets.iter().position(|set| set.iter().any(inside))
    }
}
