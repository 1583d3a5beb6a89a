//! What the weights settle on, as a study returns it.

use crate::eip::Interval;

/// A law of the weights, as far as its long run depends on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WeightLaw {
    /// The posterior: Bayes's law, or Dunn's read as a likelihood.
    Posterior,
    /// Dunn's law read as an ordinary differential equation.
    Ode,
    /// The dynamic weighting signal generator.
    Dwsg {
        /// Rate, in 1/s or 1/sample: exponents are in the same unit.
        lambda: f64,
        /// Exponent of the likelihoods.
        tempering: f64,
        /// Sampling interval in seconds where the study has none: continuous
        /// plants are then taken as Kalman filters of their samples see them.
        dt: Option<f64>,
    },
}

impl WeightLaw {
    /// `posterior`, `ode` or `dwsg`.
    pub fn name(self) -> &'static str {
        match self {
            WeightLaw::Posterior => "posterior",
            WeightLaw::Ode => "ode",
            WeightLaw::Dwsg { .. } => "dwsg",
        }
    }
}

/// What the weights do at a plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutcomeKind {
    /// One weight tends to 1.
    Identifies,
    /// Several weights stay away from 0.
    Averages,
    /// Neither is shown: models are the same, or the exponent is zero.
    Undecided,
}

impl OutcomeKind {
    /// `identifies`, `averages` or `undecided`.
    pub fn name(self) -> &'static str {
        match self {
            OutcomeKind::Identifies => "identifies",
            OutcomeKind::Averages => "averages",
            OutcomeKind::Undecided => "undecided",
        }
    }
}

/// The long run of the weights at one plant.
///
/// ```text
/// posterior:  ln(p_j / p_i) moves at Upsilon_i - Upsilon_j
/// dwsg:       vertex i attracts iff lambda (E[l_j/l_i] - 1) < 0 for all j;
///             else argmax E ln(sum p_i l_i), of the winner and its strongest rival
/// ode:        argmin 1/2 p' Gamma p - 1/2 s' p over the simplex, s_i = tr(C_i L_i)
///             (smooth noise: without s)
/// ```
///
/// `Gamma_ij = E[(h_i - C x)' R^-1 (h_j - C x)]`. The second and third hold for
/// weights that are slow against the observers.
///
/// # Source
/// Hassani et al. (2009), theorem 1, as corrected in the guide (page "eip"); Aguiar
/// et al. (2007), (5), lemma 2.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// What they do.
    pub kind: OutcomeKind,
    /// The model that is identified, or the one nearest to it.
    pub model: usize,
    /// Largest rate at which another weight grows beside the model's, in 1/s or
    /// 1/sample: negative where the model attracts.
    pub exponent: f64,
    /// Where the weights tend to.
    pub weights: Vec<f64>,
    /// `ode`: the same for measurement noise that is smooth.
    pub smooth: Option<Vec<f64>>,
    /// `ode`: the corrected bound of lemma 2 for smooth noise.
    pub lemma: Option<Lemma>,
}

/// The bound of lemma 2, with the minimum over the simplex.
///
/// ```text
/// (1 - p_i)^2 <= 2 eps / mu,   mu = min v' Gamma_I v,  v >= 0, sum v = 1,  I without i
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lemma {
    /// `Gamma_ii` of the winner.
    pub eps: f64,
    /// The minimum.
    pub mu: f64,
    /// `p_i` is at least this.
    pub bound: f64,
}

/// A part of a model's set in which the law does one thing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// The part.
    pub interval: Interval,
    /// The model whose set it belongs to.
    pub model: usize,
    /// What the law does there.
    pub kind: OutcomeKind,
}

/// Where no model is stable under the dynamic weighting signal generator.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// The tempering.
    pub tempering: f64,
    /// The stretches of the parameter.
    pub intervals: Vec<Interval>,
}

/// What the weights of a study settle on.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// The law.
    pub law: WeightLaw,
    /// Sampling interval of the residuals in seconds, for sampled ones.
    pub dt: Option<f64>,
    /// One a plant; `None` without a winner.
    pub outcomes: Vec<Option<Outcome>>,
    /// One parameter: the sets, cut where the law does something else.
    pub stretches: Vec<Stretch>,
    /// One parameter, `dwsg`: bands without a stable model, from the largest
    /// tempering down, that of the study included.
    pub bands: Vec<Band>,
}
