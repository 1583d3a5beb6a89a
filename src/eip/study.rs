//! A study: family, surroundings, bank, grid; checked, costed, run.

use faer::Mat;

use crate::eip::{Convention, EipSets, Method};
use crate::error::Result;
use crate::model::{Family, Grid, Surroundings};
use crate::observer::ObserverKind;
use crate::par::RunControl;

/// The bank of a study: its observer and one parameter vector a model.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Bank {
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
    /// Disturbance weight of the design, in place of the plant's.
    pub Q: Option<Mat<f64>>,
    /// Measurement weight of the design, in place of the plant's.
    pub R: Option<Mat<f64>>,
}

/// How many pairs are computed by both routes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Verify {
    /// Every pair when that is cheap, an even sample otherwise.
    #[default]
    Auto,
    /// Every pair.
    All,
    /// None: no error estimate.
    None,
}

/// What a run will take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    /// Plants on the grid.
    pub plants: usize,
    /// Models in the bank.
    pub models: usize,
    /// Delays.
    pub delays: usize,
    /// Order of the plant block (loop, filters, delay approximation).
    pub order: usize,
    /// Order of the observers.
    pub model_order: usize,
    /// Bytes of the largest arrays held at once.
    pub bytes: u128,
    /// Floating-point operations, roughly.
    pub flops: f64,
    /// How the couplings would be computed.
    pub method: Method,
}

/// An EIP study, ready to run.
pub struct Study<'a> {
    /// The plants.
    pub family: &'a dyn Family,
    /// What surrounds them.
    pub surroundings: Surroundings,
    /// The models.
    pub bank: Bank,
    /// The parameter values of the plants.
    pub grid: Grid,
    /// The measure.
    pub convention: Convention,
    /// Actuator delays in seconds; empty means no delay.
    pub delays: Vec<f64>,
    /// How much is computed twice.
    pub verify: Verify,
    /// Force a method; `None` lets the cost model choose.
    pub method: Option<Method>,
    /// Largest number of bytes the run may hold.
    pub memory_limit: u128,
}

impl Study<'_> {
    /// What the run will take, without running it.
    ///
    /// # Errors
    /// As [`Study::run`], for what can be seen before the run.
    pub fn cost(&self) -> Result<Cost> {
        Err(crate::Error::Cancelled)
    }

    /// Runs the study.
    ///
    /// # Errors
    /// Bad input, a grid over the memory limit, `Cancelled`.
    pub fn run(&self, _control: &RunControl<'_>) -> Result<EipSets> {
        Err(crate::Error::Cancelled)
    }
}
