//! Upsilon of given plants against all models, for one actuator delay.

use crate::eip::Method;
use crate::eip::doubling::Doubling;
use crate::eip::frequency;
use crate::eip::modal::Modal;
use crate::eip::setup::{PairModel, Setup};
use crate::error::Result;
use crate::model::{DelayForm, LoopBlock, block_states};
use crate::solve::{Mode, backend, least_stable_mode};

/// Relative tolerance of the frequency integral. The estimate is pessimistic: the
/// routes agree to 1e-12 with it, and a delay's fast ripples cost less.
const QUADRATURE: f64 = 1e-10;

/// Upsilon of every model, or the mode that makes the loop unstable.
pub(crate) type Outcome = std::result::Result<Vec<f64>, Mode>;

/// One case of a study: the models prepared for one delay.
pub(crate) struct Engine<'a> {
    setup: &'a Setup,
    delay: f64,
    /// Frequency scale of loop and observers: the Cayley parameter.
    gamma: f64,
    doubling: Doubling,
    /// Set where the separable form is used.
    modal: Option<Modal>,
    pub(crate) method: Method,
    /// Names of the block's states.
    pub(crate) states: Vec<String>,
}

impl<'a> Engine<'a> {
    /// Prepares the models for `delay`; the frequency scale is taken from the
    /// observers and the first, middle and last plant of the grid.
    pub(crate) fn new(setup: &'a Setup, delay: f64) -> Result<Self> {
        let grid = &setup.study.grid;
        let mut rates = Rates::default();
        let mut order = 0;
        for index in [0, grid.len() / 2, grid.len() - 1] {
            let theta = setup.theta_at(&grid.point(index));
            let (block, _) = setup.block(&theta, delay, setup.delay_states())?;
            rates.add(&block)?;
            order = block.np();
        }
        let mut model_order = 1;
        for pair in setup.pairs.iter().flatten() {
            rates.add_matrix(pair.F.as_ref(), setup.time.is_continuous())?;
            model_order = pair.F.nrows();
        }
        let gamma = rates.centre();
        let doubling = Doubling::new(setup.time, gamma, setup.pairs.iter().flatten());
        let models = setup.pairs.iter().flatten().count();
        let mut method =
            setup.study.method.unwrap_or_else(|| Method::cheaper(order, model_order, models));
        let modal = match method {
            Method::Modal => Modal::new(setup.time.is_continuous(), setup.pairs.iter().flatten())?,
            Method::Doubling => None,
        };
        if modal.is_none() {
            method = Method::Doubling; // models with ill-conditioned eigenvectors
        }
        let plant_states = &setup.study.family.names().states;
        let states = block_states(plant_states, &setup.study.surroundings, order);
        Ok(Self { setup, delay, gamma, doubling, modal, method, states })
    }

    /// Upsilon of every model at parameter vectors `thetas`.
    ///
    /// # Errors
    /// A plant that cannot be built.
    pub(crate) fn rows(&self, thetas: &[Vec<f64>]) -> Result<Vec<Outcome>> {
        let setup = self.setup;
        let mut blocks = Vec::with_capacity(thetas.len());
        let mut noises = Vec::with_capacity(thetas.len());
        for theta in thetas {
            let (block, r) = setup.block(theta, self.delay, setup.delay_states())?;
            blocks.push(block);
            noises.push(r);
        }
        let energies = match &self.modal {
            Some(modal) => self.modal_energies(modal, &blocks)?,
            None => self.doubling.energies(&blocks),
        };
        let designed = setup.pairs.iter().flatten().count();
        blocks
            .iter()
            .zip(&noises)
            .enumerate()
            .map(|(k, (block, r))| {
                self.outcome(block, &energies[k * designed..(k + 1) * designed], r)
            })
            .collect()
    }

    /// Energies by the separable form; plants whose eigenvectors are
    /// ill-conditioned by doubling.
    fn modal_energies(&self, modal: &Modal, blocks: &[LoopBlock]) -> Result<Vec<f64>> {
        let models = modal.len();
        let mut energies = vec![f64::NAN; blocks.len() * models];
        let mut again = Vec::new();
        for (k, x) in self.doubling.gramians(blocks).into_iter().enumerate() {
            let Some(x) = x else { continue };
            let row = &mut energies[k * models..(k + 1) * models];
            match modal.energies(&blocks[k], x.as_ref())? {
                Some(found) => row.copy_from_slice(&found),
                None => again.push(k),
            }
        }
        if !again.is_empty() {
            let hard: Vec<LoopBlock> = again.iter().map(|&k| blocks[k].clone()).collect();
            let found = self.doubling.energies(&hard);
            for (found, &k) in found.chunks(models).zip(&again) {
                energies[k * models..(k + 1) * models].copy_from_slice(found);
            }
        }
        Ok(energies)
    }

    /// Upsilon by doubling whatever the method, for boundaries: it keeps the
    /// digits that the separable form loses.
    pub(crate) fn accurate_row(&self, theta: &[f64]) -> Result<Outcome> {
        let setup = self.setup;
        let (block, r) = setup.block(theta, self.delay, setup.delay_states())?;
        let energies = self.doubling.energies(std::slice::from_ref(&block));
        self.outcome(&block, &energies, &r)
    }

    fn outcome(&self, block: &LoopBlock, energies: &[f64], r: &faer::Mat<f64>) -> Result<Outcome> {
        Ok(if energies.first().is_some_and(|e| e.is_nan()) {
            Err(least_stable_mode(block.A.as_ref(), block.time.is_continuous())?)
        } else {
            Ok(self.scale(energies.iter().copied(), r))
        })
    }

    /// Upsilon by the frequency integral, with the exact delay, and the error
    /// estimate of its quadrature.
    pub(crate) fn frequency_row(&self, theta: &[f64]) -> Result<(Vec<f64>, Vec<f64>)> {
        let setup = self.setup;
        let (block, r) = setup.block(theta, self.delay, DelayForm::Exact)?;
        let models: Vec<&PairModel> = setup.pairs.iter().flatten().collect();
        let integrals = frequency::energies(&block, &models, self.gamma, QUADRATURE);
        let values = self.scale(integrals.iter().map(|i| i.value), &r);
        let upper = self.scale(integrals.iter().map(|i| i.value + i.error), &r);
        let errors = values.iter().zip(&upper).map(|(v, u)| u - v).collect();
        Ok((values, errors))
    }

    /// One Upsilon a model of the bank, NaN for the ones that failed.
    fn scale(&self, mut energies: impl Iterator<Item = f64>, r: &faer::Mat<f64>) -> Vec<f64> {
        self.setup
            .pairs
            .iter()
            .map(|pair| match pair {
                Some(p) => match energies.next() {
                    // an energy below zero is all rounding
                    Some(e) if e >= 0.0 => self.setup.upsilon(p, e, r),
                    _ => f64::NAN,
                },
                None => f64::NAN,
            })
            .collect()
    }
}

/// Slowest and fastest rate of the modes seen so far (rad/s, or rad/sample).
struct Rates {
    slowest: f64,
    fastest: f64,
}

impl Default for Rates {
    fn default() -> Self {
        Self { slowest: f64::INFINITY, fastest: 0.0 }
    }
}

impl Rates {
    fn add(&mut self, block: &LoopBlock) -> Result<()> {
        self.add_matrix(block.A.as_ref(), block.time.is_continuous())
    }

    fn add_matrix(&mut self, a: faer::MatRef<'_, f64>, continuous: bool) -> Result<()> {
        for v in backend::eigenvalues(a)? {
            let modulus = v.re.hypot(v.im);
            let rate = if continuous {
                modulus
            } else {
                // |ln lambda|; modes that vanish in a sample set no scale
                libm::log(modulus).hypot(v.im.atan2(v.re))
            };
            if rate.is_finite() && rate > 1e-9 {
                self.slowest = self.slowest.min(rate);
                self.fastest = self.fastest.max(rate);
            }
        }
        Ok(())
    }

    /// Geometric mean, one where nothing was seen.
    fn centre(&self) -> f64 {
        let centre = (self.slowest * self.fastest).sqrt();
        if centre.is_finite() && centre > 0.0 { centre } else { 1.0 }
    }
}
