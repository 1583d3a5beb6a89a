//! The bank engine that a scenario describes.

use super::{Error, Scenario};
use crate::bank::{Members, Settings};
use crate::engine::{Mmae, Weighting};
use crate::model::{Names, Plant, sample};
use crate::weight::Law;

/// A bank with its weighting, ready to be started.
#[derive(Debug, Clone)]
pub struct Estimator {
    /// The models.
    pub members: Members,
    /// Gains and interval.
    pub settings: Settings,
    /// The law of the weights.
    pub weighting: Weighting,
    /// Prior probability of each model.
    pub prior: Vec<f64>,
    /// Names of the parameters in which the models differ.
    pub parameters: Vec<String>,
    /// Their values, one list a model.
    pub values: Vec<Vec<f64>>,
    /// One label a model.
    pub labels: Vec<String>,
    /// Names of states, inputs and outputs.
    pub names: Names,
    /// Discrete filters of continuous plants: the plants.
    pub continuous: Option<Vec<Plant>>,
}

impl Estimator {
    /// The mean of each parameter over weights `p`, one a model.
    ///
    /// ```text
    /// theta_hat = sum p_i theta_i
    /// ```
    ///
    /// # Source
    /// Aguiar et al. (2007), (12).
    pub fn theta_hat(&self, p: &[f64]) -> Vec<f64> {
        let weighed = || p.iter().zip(&self.values).filter(|(p, _)| **p > 0.0);
        (0..self.parameters.len()).map(|k| weighed().map(|(p, v)| p * v[k]).sum()).collect()
    }

    /// Discrete filters of continuous plants: the models sampled over `seconds`, for
    /// [`Mmae::set_models`]; nothing for other banks. The measurement noise has the
    /// covariance `R / dt` of the scenario's interval, however long it is since the
    /// measurement before.
    ///
    /// # Errors
    /// `InvalidDt`, and `Range` for seconds that the fastest mode does not allow.
    pub fn models_over(&self, seconds: f64) -> crate::Result<Option<Vec<Plant>>> {
        let Some(plants) = &self.continuous else { return Ok(None) };
        let over = |(plant, nominal): (&Plant, &Plant)| {
            let (sampled, _) = sample(plant, seconds, 0.0)?;
            Ok(Plant { R: nominal.R.clone(), ..sampled })
        };
        plants.iter().zip(&self.members.plants).map(over).collect::<crate::Result<_>>().map(Some)
    }

    /// The engine at its start.
    ///
    /// # Errors
    /// As [`Mmae::new`].
    pub fn start(&self) -> crate::Result<Mmae> {
        Mmae::new(&self.members, &self.settings, &self.weighting, &self.prior)
    }
}

impl Scenario {
    /// The bank of observers that `[bank]` and `[weighting]` describe.
    ///
    /// # Errors
    /// `Invalid` without `[bank]`, or without `bank.dt` for continuous observers;
    /// `Engine` for a model that the family cannot build.
    pub fn estimator(&self) -> Result<Estimator, Error> {
        let (Some(bank), Some(start)) = (&self.bank, &self.start) else {
            return Err(self.missing("bank", "add [bank] with models and their observer"));
        };
        let (continuous, time) = (bank.observer.is_continuous(), self.family.time);
        if time.is_continuous() && start.dt.is_none() {
            let remedy = "give the seconds between measurements, as in dt = 0.01";
            return Err(self.missing("bank.dt", remedy));
        }
        let mut names = self.family.names.clone();
        let plants = match &self.explicit {
            Some(explicit) => explicit.plants.clone(),
            None => (0..bank.models.len())
                .map(|i| bank.design_plant(i, self.family.as_ref(), &self.surroundings))
                .collect::<crate::Result<_>>()
                .map_err(|e| self.explain(e))?,
        };
        if let Some(filter) = self.surroundings.disturbance.as_ref().filter(|_| bank.shaping) {
            names.states.extend(filter.states.iter().cloned());
        }
        let samples = time.is_continuous() && !continuous;
        let (plants, continuous_plants) = match (samples, start.dt) {
            (true, Some(dt)) => {
                let sampled = plants.iter().map(|p| sample(p, dt, 0.0).map(|s| s.0));
                let sampled: crate::Result<Vec<Plant>> = sampled.collect();
                (sampled.map_err(|e| self.explain(e))?, Some(plants))
            }
            _ => (plants, None),
        };
        let mut members = Members::new(bank.observer, plants);
        members.initial.clone_from(&start.initial);
        members.start = start.time;
        let law = if continuous { Law::Likelihood } else { Law::Bayes };
        let default = Weighting { law, ..Weighting::default() };
        Ok(Estimator {
            members,
            settings: Settings { gains: start.gains, dt: start.dt, ..Settings::default() },
            weighting: self.weighting.clone().unwrap_or(default),
            prior: start.prior.clone(),
            parameters: bank.parameters.clone(),
            values: bank.models.clone(),
            labels: (0..bank.models.len()).map(|i| bank.label(i)).collect(),
            names,
            continuous: continuous_plants,
        })
    }
}
