//! The laws and their modifiers, as data.

use crate::error::{Error, Result};

/// How evidence moves the weights.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Law {
    /// The posterior probability.
    ///
    /// ```text
    /// ln p_i += ln N(r_i; 0, S_i) - common
    /// ```
    #[default]
    Bayes,
    /// Dunn's law read as the likelihood of the continuous-time record, by
    /// increments along each interval: the posterior probability again, of
    /// strong order 1 in the step.
    ///
    /// ```text
    /// ln p_i += h_i' R^-1 o dy - 1/2 (|h_i|^2 + tr(C_i L_i)) dt - common
    /// ```
    Likelihood,
    /// Zhang's algorithms, on the sum of squared residuals `J_i` up to step `k`.
    ///
    /// ```text
    /// d_i = (J_i - J_min) / (k + J_i),   n_i = ceil(1 / d_i)
    /// ln p_i += min(n_i, n_max) ln(1 - d_i) - common
    /// ```
    /// `n_max = 1` is Algorithm 1, infinity is Algorithm 2. Their weights are not
    /// probabilities, and they depend on the units of the outputs.
    Zhang {
        /// Largest exponent, at least 1.
        n_max: f64,
    },
    /// Dunn's law read as an ordinary differential equation, by the classical
    /// Runge-Kutta method: it converges to a mixture of models, not to one.
    Ode {
        /// Runge-Kutta steps for each measurement, at least 1.
        substeps: usize,
    },
    /// The dynamic weighting signal generator with the likelihoods
    /// `l_i = (beta_i e^{-w_i})^tempering`.
    Dwsg {
        /// Rate in 1/s (1/sample with discrete observers).
        lambda: f64,
        /// Exponent of the likelihoods, in (0, 1]: a smaller one narrows the band
        /// of plants for which no single model wins.
        tempering: f64,
        /// How a step is taken.
        scheme: DwsgScheme,
    },
}

/// How the dynamic weighting signal generator is stepped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DwsgScheme {
    /// Exact for likelihoods frozen at the start of the step: for white
    /// residuals.
    #[default]
    Left,
    /// Exact for likelihoods frozen at the geometric mean of the ends of the
    /// step: second order for smooth residuals.
    Trapezoid,
    /// `p <- (1 - mu) p + mu Bayes(p)`, `mu = lambda dt` at most 1: the discrete
    /// form; `mu = 1` is Bayes.
    Mixture,
}

/// What of the past Zhang's sum of squares remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Window {
    /// All of it.
    #[default]
    All,
    /// The last so many steps.
    Sliding(usize),
    /// `J <- keep J + |r|^2`, `keep` in (0, 1).
    Exponential(f64),
}

/// Changes to any law.
#[derive(Debug, Clone, PartialEq)]
pub struct Modifiers {
    /// Weights below this, zeros excepted, are raised to it after each step, at
    /// most `1/N`; 0 for none. All are then divided by their sum, so that the
    /// smallest is a little below.
    pub floor: f64,
    /// Factor on `ln p` before each step, in (0, 1]: old evidence fades.
    pub forgetting: f64,
    /// Most that one measurement can speak against a model, in nats below the
    /// best; infinite for no limit.
    pub clip: f64,
    /// What Zhang's laws remember.
    pub window: Window,
}

impl Default for Modifiers {
    fn default() -> Self {
        Self { floor: 0.0, forgetting: 1.0, clip: f64::INFINITY, window: Window::All }
    }
}

fn range(what: &str, value: f64, remedy: &str) -> Error {
    Error::Range { what: what.into(), value, remedy: remedy.into() }
}

impl Law {
    /// The name as scenario files spell it.
    pub fn name(self) -> &'static str {
        match self {
            Law::Bayes => "bayes",
            Law::Likelihood => "dunn (likelihood)",
            Law::Zhang { n_max: 1.0 } => "zhang1",
            Law::Zhang { .. } => "zhang2",
            Law::Ode { .. } => "dunn (ode)",
            Law::Dwsg { .. } => "dwsg",
        }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// `Range`.
    pub fn check(self) -> Result<()> {
        match self {
            Law::Zhang { n_max } if n_max.is_nan() || n_max < 1.0 => {
                Err(range("n_max", n_max, "give 1 (Algorithm 1) or more"))
            }
            Law::Ode { substeps: 0 } => Err(range("substeps", 0.0, "give at least 1")),
            Law::Dwsg { lambda, .. } if !(lambda > 0.0 && lambda.is_finite()) => {
                Err(range("lambda", lambda, "give a positive rate"))
            }
            Law::Dwsg { tempering, .. } if !(tempering > 0.0 && tempering <= 1.0) => {
                Err(range("tempering", tempering, "give a number above 0, up to 1"))
            }
            _ => Ok(()),
        }
    }
}

impl Modifiers {
    /// Checks the numbers for `models` models.
    ///
    /// # Errors
    /// `Range`.
    pub fn check(&self, models: usize) -> Result<()> {
        if !(self.floor >= 0.0 && self.floor * models as f64 <= 1.0) {
            return Err(range(
                "floor",
                self.floor,
                "give zero or more, at most one over the number of models",
            ));
        }
        if !(self.forgetting > 0.0 && self.forgetting <= 1.0) {
            return Err(range(
                "forgetting",
                self.forgetting,
                "give a factor above 0, up to 1 (none)",
            ));
        }
        if self.clip.is_nan() || self.clip <= 0.0 {
            return Err(range("clip", self.clip, "give a positive number of nats"));
        }
        match self.window {
            Window::Sliding(0) => Err(range("window", 0.0, "give at least one step")),
            Window::Exponential(keep) if !(keep > 0.0 && keep < 1.0) => {
                Err(range("window", keep, "give a factor between 0 and 1"))
            }
            _ => Ok(()),
        }
    }
}
