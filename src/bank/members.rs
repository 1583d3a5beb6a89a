//! What a bank is made of, before it runs.

use faer::Mat;

use super::matrices::Sizes;
use crate::error::{Error, Result};
use crate::model::{Plant, check_covariance, check_finite, check_shape};
use crate::observer::ObserverKind;

/// The models of a bank: one plant a model, and what is known at the start.
#[derive(Debug, Clone)]
pub struct Members {
    /// The observer that every model runs.
    pub observer: ObserverKind,
    /// The models, all of one size.
    pub plants: Vec<Plant>,
    /// What each filter believes at the start: one for all models, or one each.
    pub initial: Vec<Initial>,
    /// Which moment that is.
    pub start: StartTime,
}

/// State estimate and covariance at the start.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Initial {
    /// `x_hat`, n numbers.
    pub x_hat: Vec<f64>,
    /// `P`, n by n; `None` for the steady covariance of each model.
    pub P: Option<Mat<f64>>,
}

/// The moment of [`Initial`], for discrete filters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StartTime {
    /// `x_hat(0|0)`: the first step predicts, then measures.
    #[default]
    StepBefore,
    /// `x_hat(1|0)`: the first step only measures.
    FirstMeasurement,
}

impl Members {
    /// Models that start at `x_hat = 0` with their steady covariance.
    pub fn new(observer: ObserverKind, plants: Vec<Plant>) -> Self {
        let n = plants.first().map_or(0, Plant::nx);
        let initial = vec![Initial { x_hat: vec![0.0; n], P: None }];
        Self { observer, plants, initial, start: StartTime::StepBefore }
    }

    /// Start of model `i`.
    pub(super) fn initial(&self, i: usize) -> &Initial {
        if self.initial.len() == 1 { &self.initial[0] } else { &self.initial[i] }
    }

    /// Sizes of the models, and why a model cannot be used.
    ///
    /// # Errors
    /// `Empty` without models, `Shape` for a wrong number of initial values.
    pub(super) fn check(&self) -> Result<(Sizes, Vec<Option<Error>>)> {
        let models = self.plants.len();
        let Some(first) = self.plants.first() else {
            return Err(Error::Empty { what: "the set of models".into() });
        };
        if self.initial.len() != 1 && self.initial.len() != models {
            return Err(Error::Shape {
                what: "initial (models by 1)".into(),
                want: [models, 1],
                got: [self.initial.len(), 1],
            });
        }
        let sizes = Sizes::of(first);
        let failures = (0..models).map(|i| self.check_model(i, sizes).err()).collect();
        Ok((sizes, failures))
    }

    fn check_model(&self, i: usize, sizes: Sizes) -> Result<()> {
        let (plant, initial) = (&self.plants[i], self.initial(i));
        let Sizes { n, m, q } = sizes;
        check_shape("A", plant.A.as_ref(), [n, n])?;
        check_shape("B", plant.B.as_ref(), [n, m])?;
        check_shape("C", plant.C.as_ref(), [q, n])?;
        plant.check()?;
        if plant.time.is_continuous() != self.observer.is_continuous() {
            return Err(Error::Conflict {
                problem: format!("the {} does not fit the time of the plant", self.observer.name()),
                remedy: "sample the plant, or choose the other observer".into(),
            });
        }
        if initial.x_hat.len() != n {
            let got = [initial.x_hat.len(), 1];
            return Err(Error::Shape { what: "x_hat(0)".into(), want: [n, 1], got });
        }
        if let Some(row) = initial.x_hat.iter().position(|v| !v.is_finite()) {
            return Err(Error::NonFinite { what: "x_hat(0)".into(), row, col: 0 });
        }
        if let Some(p) = &initial.P {
            check_shape("P(0)", p.as_ref(), [n, n])?;
            check_finite("P(0)", p.as_ref())?;
            check_covariance("P(0)", p.as_ref(), false)?;
        }
        Ok(())
    }
}
