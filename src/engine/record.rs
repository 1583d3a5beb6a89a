//! A whole record at once.

use super::mmae::Mmae;
use crate::error::{Error, Result};

/// What the engine said along a record, one row a measurement.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Record {
    /// Measurements.
    pub steps: usize,
    /// Weights, shape (step, model).
    pub p: Vec<f64>,
    /// Their logarithms.
    pub log_p: Vec<f64>,
    /// Fused estimates, shape (step, state).
    pub x_hat: Vec<f64>,
    /// `ln sum p_i N(y; ..)` of each measurement, NaN for laws that do not work
    /// with likelihoods.
    pub log_lik: Vec<f64>,
    /// Normalised innovations squared, shape (step, model).
    pub nis: Vec<f64>,
    /// Innovations, shape (step, model, output).
    pub r: Vec<f64>,
}

impl Record {
    /// `sum p_i values_i` at every step: the mean estimate of a parameter.
    ///
    /// # Panics
    /// Unless there is a value a model.
    pub fn mean(&self, values: &[f64]) -> Vec<f64> {
        let models = self.p.len() / self.steps.max(1);
        assert_eq!(values.len(), models, "one value a model");
        let row = |p: &[f64]| {
            p.iter().zip(values).filter(|(p, _)| **p > 0.0).map(|(p, v)| p * v).sum::<f64>()
        };
        self.p.chunks_exact(models.max(1)).map(row).collect()
    }

    /// Adds what the engine says now.
    fn append(&mut self, engine: &Mmae) {
        let e = engine.estimate();
        self.steps += 1;
        self.p.extend(&e.p);
        self.log_p.extend(&e.log_p);
        self.x_hat.extend(&e.x_hat);
        self.log_lik.push(e.log_lik);
        self.nis.extend(&e.nis);
        self.r.extend(&e.r);
    }
}

impl Mmae {
    /// Takes in a record from where the engine stands: as many calls of
    /// [`Mmae::step`], whose results come back together.
    ///
    /// `y` has shape (step, output), NaN for what is missing; `u` has shape (step,
    /// input), or is empty for inputs that are zero. A record in two parts gives
    /// the same bits as in one.
    ///
    /// ```
    /// use mmae::bank::Members;
    /// use mmae::engine::{Mmae, Weighting};
    /// use mmae::model::{Plant, Time};
    /// use mmae::observer::ObserverKind;
    /// use mmae::{Mat, mat};
    /// // a level that is noisy or very noisy
    /// let level = |r: f64| Plant {
    ///     time: Time::Discrete { dt: 1.0 },
    ///     A: mat![[1.0]], B: Mat::zeros(1, 0), G: mat![[1.0]], C: mat![[1.0]],
    ///     Q: mat![[0.01]], R: mat![[r]],
    /// };
    /// let members = Members::new(ObserverKind::Kalman, vec![level(0.1), level(10.0)]);
    /// let weighting = Weighting::default();
    /// let mut mmae = Mmae::new(&members, &Default::default(), &weighting, &[1.0, 1.0])?;
    /// let record = mmae.run(&[], &[0.1, -0.2, f64::NAN, 0.3, 0.0, -0.1])?;
    /// assert_eq!(record.p.len(), 6 * 2);
    /// assert!(record.p[10] > 0.9); // the quiet one
    /// assert_eq!(record.p[4..6], record.p[2..4]); // nothing seen, nothing learnt
    /// # Ok::<(), mmae::Error>(())
    /// ```
    ///
    /// # Errors
    /// `Shape` unless `y` and `u` hold whole rows, as many of each; as
    /// [`Mmae::step`], the engine then stands before the measurement at fault.
    pub fn run(&mut self, u: &[f64], y: &[f64]) -> Result<Record> {
        let [_, m, q] = self.bank().sizes();
        let steps = y.len() / q.max(1);
        if y.len() != steps * q {
            let (want, got) = ([steps + 1, q], [1, y.len()]);
            return Err(Error::Shape { what: "y of a record".into(), want, got });
        }
        if !u.is_empty() && u.len() != steps * m {
            let (want, got) = ([steps, m], [1, u.len()]);
            return Err(Error::Shape { what: "u of a record".into(), want, got });
        }
        let idle = vec![0.0; m];
        let mut record = Record::default();
        for k in 0..steps {
            let u = if u.is_empty() { &idle } else { &u[k * m..][..m] };
            self.step(u, &y[k * q..][..q])?;
            record.append(self);
        }
        Ok(record)
    }
}
