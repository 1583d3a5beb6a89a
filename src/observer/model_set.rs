//! The models of a bank: one parameter vector each, one observer for all.

use faer::Mat;

use crate::error::{Error, Result};
use crate::model::{Family, Plant, Surroundings, describe};
use crate::observer::ObserverKind;

/// The models of a bank and the observer that each of them runs.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct ModelSet {
    /// The observer that every model runs.
    pub observer: ObserverKind,
    /// Names of the parameters in which the models differ.
    pub parameters: Vec<String>,
    /// One vector of values a model, in the order of `parameters`.
    pub models: Vec<Vec<f64>>,
    /// One label a model; empty for labels made from the values.
    pub labels: Vec<String>,
    /// Whether the design model carries the disturbance filter's state
    /// (true), or takes the disturbance for white (false).
    pub shaping: bool,
    /// Disturbance weight of the design, in place of the plant's (or, with
    /// `shaping`, the filter's).
    pub Q: Option<Mat<f64>>,
    /// Measurement weight of the design, in place of the plant's.
    pub R: Option<Mat<f64>>,
}

impl ModelSet {
    /// Models at the given values of one parameter, the disturbance filter
    /// part of the design.
    ///
    /// ```
    /// use mmae::observer::{ModelSet, ObserverKind};
    /// let bank = ModelSet::along(ObserverKind::KalmanBucy, "L", &[1.025, 1.287]);
    /// assert_eq!(bank.label(1), "L = 1.287");
    /// ```
    pub fn along(observer: ObserverKind, parameter: &str, values: &[f64]) -> Self {
        Self {
            observer,
            parameters: vec![parameter.into()],
            models: values.iter().map(|&v| vec![v]).collect(),
            labels: Vec::new(),
            shaping: true,
            Q: None,
            R: None,
        }
    }

    /// Label of model `i`: the one given, or its parameter values.
    ///
    /// # Panics
    /// If there is no model `i`.
    pub fn label(&self, i: usize) -> String {
        self.labels.get(i).cloned().unwrap_or_else(|| describe(&self.parameters, &self.models[i]))
    }

    /// The design model of model `i`: the plant at its parameters, with the
    /// disturbance filter's state and the design weights where set.
    ///
    /// # Errors
    /// `Shape` for a value missing, what the family returns, what the checks
    /// of the plant find.
    pub fn design_plant(
        &self,
        i: usize,
        family: &dyn Family,
        surroundings: &Surroundings,
    ) -> Result<Plant> {
        let values = &self.models[i];
        if values.len() != self.parameters.len() {
            return Err(Error::Shape {
                what: "values of the model".into(),
                want: [1, self.parameters.len()],
                got: [1, values.len()],
            });
        }
        let named: Vec<(&str, f64)> =
            self.parameters.iter().map(String::as_str).zip(values.iter().copied()).collect();
        let plant = family.plant(&family.theta_with(&named)?)?;
        plant.check()?;
        let filter = surroundings.disturbance.as_ref().filter(|_| self.shaping);
        let mut design = plant.with_disturbance(filter);
        if let Some(q) = &self.Q {
            design.Q.clone_from(q);
        }
        if let Some(r) = &self.R {
            design.R.clone_from(r);
        }
        design.check()?;
        Ok(design)
    }
}
