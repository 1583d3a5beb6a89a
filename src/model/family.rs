//! A plant family: parameters in, matrices out.

use crate::error::{Error, Result};
use crate::model::{Names, Plant, Time};

/// A named parameter and its nominal value.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// The value where a grid or a model does not say otherwise.
    pub nominal: f64,
}

/// A family of plants over named parameters.
///
/// Implement it for plants that come from your own code; scenario files give
/// one whose entries are expressions; [`FnFamily`] wraps a closure.
///
/// Every plant of a family has the same sizes and the same [`Time`].
pub trait Family: Send + Sync {
    /// The parameters, in the order of `theta`.
    fn parameters(&self) -> &[Parameter];

    /// The channels, by name.
    fn names(&self) -> &Names;

    /// Continuous or discrete.
    fn time(&self) -> Time;

    /// The plant at `theta`, one value a parameter.
    ///
    /// # Errors
    /// Whatever keeps the plant from being built; the caller adds the
    /// parameter values.
    fn plant(&self, theta: &[f64]) -> Result<Plant>;

    /// Turns `plant`, which is this family's plant at `from`, into the one at
    /// `to`; after an error `plant` is not to be used.
    ///
    /// Sweeps call it for one plant after the other. The default builds the
    /// plant anew; override it where only some entries change.
    ///
    /// # Errors
    /// As [`Family::plant`].
    fn update(&self, plant: &mut Plant, from: &[f64], to: &[f64]) -> Result<()> {
        let _ = from;
        *plant = self.plant(to)?;
        Ok(())
    }

    /// The nominal parameter vector with some values replaced by name.
    ///
    /// # Errors
    /// `UnknownParameter`.
    fn theta_with(&self, values: &[(&str, f64)]) -> Result<Vec<f64>> {
        let parameters = self.parameters();
        let mut theta: Vec<f64> = parameters.iter().map(|p| p.nominal).collect();
        for (name, value) in values {
            let at = parameters.iter().position(|p| p.name == *name).ok_or_else(|| {
                Error::UnknownParameter {
                    name: (*name).into(),
                    known: parameters
                        .iter()
                        .map(|p| p.name.as_str())
                        .collect::<Vec<_>>()
                        .join(", "),
                }
            })?;
            theta[at] = *value;
        }
        Ok(theta)
    }
}

/// `L = 1.025, m = 0.75`: parameter values as messages print them.
pub fn describe(names: &[String], values: &[f64]) -> String {
    let pairs: Vec<String> = names.iter().zip(values).map(|(n, v)| format!("{n} = {v}")).collect();
    pairs.join(", ")
}

/// A family from a closure.
///
/// ```
/// use mmae::model::{Family, FnFamily, Names, Plant, Time};
/// use mmae::mat;
/// let family = FnFamily::new(
///     &[("k", 1.0)],
///     Names::numbered(2, 1, 1, 1),
///     Time::Continuous,
///     |theta| {
///         Ok(Plant {
///             time: Time::Continuous,
///             A: mat![[0.0, 1.0], [-theta[0], -0.4]],
///             B: mat![[0.0], [1.0]],
///             G: mat![[0.0], [1.0]],
///             C: mat![[1.0, 0.0]],
///             Q: mat![[0.1]],
///             R: mat![[0.01]],
///         })
///     },
/// );
/// let plant = family.plant(&family.theta_with(&[("k", 2.2)])?)?;
/// plant.check()?;
/// assert_eq!(plant.A[(1, 0)], -2.2);
/// # Ok::<(), mmae::Error>(())
/// ```
pub struct FnFamily<F> {
    parameters: Vec<Parameter>,
    names: Names,
    time: Time,
    build: F,
}

impl<F: Fn(&[f64]) -> Result<Plant> + Send + Sync> FnFamily<F> {
    /// A family with the given parameters (name, nominal value).
    pub fn new(parameters: &[(&str, f64)], names: Names, time: Time, build: F) -> Self {
        let parameters = parameters
            .iter()
            .map(|(name, nominal)| Parameter { name: (*name).into(), nominal: *nominal })
            .collect();
        Self { parameters, names, time, build }
    }
}

impl<F: Fn(&[f64]) -> Result<Plant> + Send + Sync> Family for FnFamily<F> {
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn names(&self) -> &Names {
        &self.names
    }

    fn time(&self) -> Time {
        self.time
    }

    fn plant(&self, theta: &[f64]) -> Result<Plant> {
        (self.build)(theta)
    }
}
