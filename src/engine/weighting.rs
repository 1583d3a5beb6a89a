//! How a bank is weighed, as data.

use faer::Mat;

use crate::error::{Error, Result};
use crate::weight::{Law, Modifiers, Transition};

/// A law of weights with everything that changes it.
#[derive(Debug, Clone, Default)]
pub struct Weighting {
    /// The law.
    pub law: Law,
    /// Whose covariance the residuals are judged by.
    pub innovation: Innovation,
    /// Floor, forgetting, clip, window.
    pub modifiers: Modifiers,
    /// What happens between the models.
    pub mixing: Mixing,
}

/// The covariance `S` in the log-likelihood of [`Law::Bayes`] and [`Law::Dwsg`].
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Innovation {
    /// That of the running filter, `S(k)`, with `ln det S`.
    #[default]
    Filter,
    /// The steady-state `S` of each model, with `ln det S`.
    Steady,
    /// One `W = S^-1` for all models, without a determinant: then a model with
    /// large errors of its own is not charged for them. In Zhang's laws it is
    /// the norm of the residuals.
    Common(Mat<f64>),
}

/// What happens between the models.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Mixing {
    /// Nothing: the plant is one model for ever.
    #[default]
    None,
    /// The plant may change model; only the weights know.
    Markov(Transition),
    /// The plant may change model, and each filter starts a step from the
    /// mixture of all that could have come to it (interacting multiple models).
    ///
    /// # Source
    /// Blom, Bar-Shalom (1988), IEEE Trans. Automatic Control 33, 780-783.
    Imm(Transition),
    /// A member whose weight is below the threshold is put to the fused
    /// estimate, so that it can come back when its model is right again.
    Reseed {
        /// Weight below which a member is put back.
        threshold: f64,
    },
}

impl Mixing {
    /// The transition of the weights, if models may change.
    pub(super) fn transition(&self) -> Option<&Transition> {
        match self {
            Mixing::Markov(t) | Mixing::Imm(t) => Some(t),
            Mixing::None | Mixing::Reseed { .. } => None,
        }
    }

    pub(super) fn check(&self) -> Result<()> {
        match *self {
            Mixing::Reseed { threshold } if !(threshold > 0.0 && threshold < 1.0) => {
                Err(Error::Range {
                    what: "threshold of re-seeding".into(),
                    value: threshold,
                    remedy: "give a weight between 0 and 1".into(),
                })
            }
            _ => Ok(()),
        }
    }
}
