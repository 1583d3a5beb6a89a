//! A study: family, surroundings, models, grid; checked, costed, run.

use std::sync::Arc;

use crate::eip::setup::Setup;
use crate::eip::{Convention, EipSets, Method, WeightLaw};
use crate::error::{Error, Result};
use crate::model::{ActuatorBound, Family, Grid, Surroundings};
use crate::observer::ModelSet;
use crate::par::RunControl;

/// How many pairs are computed by both routes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Verify {
    /// Every pair of up to 512 plants, evenly spread over the grid.
    #[default]
    Auto,
    /// Every pair.
    All,
    /// None but those that the Lyapunov route has no number for: no error
    /// estimate, and a loss of digits goes unseen.
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
///
/// [`Study::new`] gives the usual settings; the fields change them.
#[derive(Clone)]
pub struct Study {
    /// Title for text and pictures.
    pub title: Option<String>,
    /// The plants.
    pub family: Arc<dyn Family>,
    /// What surrounds them.
    pub surroundings: Surroundings,
    /// The models.
    pub bank: ModelSet,
    /// The parameter values of the plants.
    pub grid: Grid,
    /// The measure.
    pub convention: Convention,
    /// Actuator delays in seconds; empty means no delay.
    pub delays: Vec<f64>,
    /// Bound on the unmodelled dynamics of the actuator, about the first delay:
    /// the sets that hold for all of them are computed as well.
    pub unmodelled: Option<ActuatorBound>,
    /// Shortest and longest actuator delay in seconds, between which it is not
    /// known: where that matters is computed as well (one parameter, continuous).
    pub delay_interval: Option<[f64; 2]>,
    /// How the bank is weighed: what its weights settle on is told as well.
    pub law: Option<WeightLaw>,
    /// How much is computed twice.
    pub verify: Verify,
    /// Force a method; `None` lets the cost model choose.
    pub method: Option<Method>,
    /// Largest number of bytes the run may hold.
    pub memory_limit: u128,
}

impl Study {
    /// A study without surroundings and delay: Ito convention for continuous
    /// plants, Baram's for discrete ones, 4 GiB at most.
    pub fn new(family: Arc<dyn Family>, bank: ModelSet, grid: Grid) -> Self {
        let convention = match family.time() {
            crate::model::Time::Continuous => Convention::Ito,
            crate::model::Time::Discrete { dt } => Convention::Baram { dt },
        };
        Self {
            title: None,
            family,
            surroundings: Surroundings::default(),
            bank,
            grid,
            convention,
            delays: Vec::new(),
            unmodelled: None,
            delay_interval: None,
            law: None,
            verify: Verify::Auto,
            method: None,
            memory_limit: 4 << 30,
        }
    }

    /// The study of the sets alone, computed once: no second route, nothing on
    /// unmodelled actuators, delay intervals and weights.
    #[must_use]
    pub fn bare(&self) -> Self {
        Self {
            verify: Verify::None,
            unmodelled: None,
            delay_interval: None,
            law: None,
            ..self.clone()
        }
    }

    /// What the run will take, without running it: evaluates one plant and
    /// allocates nothing that grows with the grid.
    ///
    /// # Errors
    /// Bad input that shows without running; `Limit` for a run over
    /// `memory_limit`.
    pub fn cost(&self) -> Result<Cost> {
        let (plants, models) = (self.grid.len(), self.bank.models.len());
        let delays = self.delays.len().max(1);
        let (order, model_order) = crate::eip::setup::check(self)?;
        let bytes = self.bytes(plants, order);
        if bytes > self.memory_limit {
            return Err(Error::Limit {
                what: format!(
                    "a study with {plants} x {models} x {delays} (plants x models x delays)"
                ),
                bytes,
                limit: self.memory_limit,
                remedy: "use a smaller grid, raise memory_limit, or compute it in blocks (--shard)",
            });
        }
        let method = self.method.unwrap_or_else(|| Method::cheaper(order, model_order, models));
        let per_plant = Method::flops_per_plant(method, order, model_order, models);
        let checked = match self.verify {
            Verify::All => plants,
            Verify::Auto => plants.min(crate::eip::judge::SAMPLE),
            Verify::None => 0,
        };
        let second: f64 = if self.delays.is_empty() { vec![0.0] } else { self.delays.clone() }
            .iter()
            .map(|&delay| Method::flops_per_check(delay > 0.0, order, model_order, models))
            .sum();
        let search =
            self.boundaries(models) * Method::flops_per_boundary(order, model_order, models);
        Ok(Cost {
            plants,
            models,
            delays,
            order,
            model_order,
            bytes,
            flops: (per_plant * plants as f64 + search) * delays as f64 + second * checked as f64,
            method,
        })
    }

    /// Bytes that a run holds for `plants` plants of blocks of order `order`.
    fn bytes(&self, plants: usize, order: usize) -> u128 {
        let (models, delays) = (self.bank.models.len(), self.delays.len().max(1));
        let pairs = plants as u128 * models as u128 * delays as u128;
        // upsilon and error, then winner, margin and bookkeeping of each plant,
        // and what the refinement copies, the table at the nominal values, and
        // the blocks and lanes of a chunk on each thread
        let chunk = (64 + 8 * 100) * (order as u128).pow(2) * 8 * 16;
        pairs * 32
            + plants as u128 * (delays as u128 * 64 + 320)
            + 16 * (models as u128).pow(2)
            + chunk
    }

    /// What a run in blocks of `plants` plants holds; as [`Study::cost`].
    pub(crate) fn block_bytes(&self, plants: usize) -> Result<u128> {
        // a block is also a table before it is written
        let (order, _) = crate::eip::setup::check(self)?;
        Ok(2 * self.bytes(plants.min(self.grid.len()), order))
    }

    /// Boundaries that a study of one parameter with `models` models is taken
    /// to have.
    fn boundaries(&self, models: usize) -> f64 {
        let searched = self.grid.axes().len() == 1;
        if searched { models.min(self.grid.len()).saturating_sub(1) as f64 } else { 0.0 }
    }

    /// The search for boundaries as a number of plants that take as long.
    pub(crate) fn search_in_plants(&self, (order, model_order): (usize, usize)) -> u64 {
        let models = self.bank.models.len();
        let method = self.method.unwrap_or_else(|| Method::cheaper(order, model_order, models));
        let one = Method::flops_per_plant(method, order, model_order, models);
        let all = self.boundaries(models) * Method::flops_per_boundary(order, model_order, models);
        (all / one).ceil() as u64
    }

    /// Designs the observers and computes what does not depend on the plant.
    ///
    /// # Errors
    /// Bad input: names, shapes, surroundings, a convention that does not fit.
    /// A model that cannot be designed is flagged; `AllFailed` if none can.
    pub fn prepare(&self) -> Result<Setup> {
        self.cost()?;
        Setup::new(self)
    }

    /// Runs the study.
    ///
    /// # Errors
    /// Bad input, a grid over the memory limit, `AllFailed` if no model can be
    /// designed or no plant built, `Cancelled`. Other failed models, plants that
    /// are unstable or cannot be built, and winners that neither route can
    /// vouch for are reported in the result.
    pub fn run(&self, control: &RunControl<'_>) -> Result<EipSets> {
        self.prepare()?.run(control)
    }
}
