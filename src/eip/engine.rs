//! Upsilon of given plants against all models, for one actuator delay.

use std::sync::{Mutex, OnceLock, PoisonError};

use faer::Mat;

use crate::eip::Method;
use crate::eip::assembly::Assembly;
use crate::eip::batch::LoopBatch;
use crate::eip::delay::{DelayedBatch, Winding};
use crate::eip::doubling::Doubling;
use crate::eip::frequency::Frequency;
use crate::eip::modal::Modal;
use crate::eip::rates::Rates;
use crate::eip::sets;
use crate::eip::setup::{PairModel, Setup};
use crate::eip::stability::{Stability, delayed_stability, stability};
use crate::error::{Error, Result};
use crate::model::{DelayForm, block_states};
use crate::simd::LANES;
use crate::solve::{Mode, backend};

/// Relative error of the quadrature up to which it stands in for the doubling.
const UNPROVED: f64 = 1e-6;

/// A model whose Upsilon is within this share of the smallest may be the one that has it:
/// the separable form is good to 1e-9 as a rule.
const CONTENDS: f64 = 1e-5;

/// Upsilon of every model, NaN for those without one, or why there is none.
pub(crate) type Outcome = std::result::Result<Vec<f64>, Flaw>;

/// Why a plant has no Upsilon, if it has none.
pub(crate) type Found = std::result::Result<(), Flaw>;

/// What keeps a plant from having any Upsilon.
#[derive(Debug, Clone)]
pub(crate) enum Flaw {
    /// The mode that makes its loop unstable.
    Unstable(Mode),
    /// It cannot be built.
    Unbuilt(Error),
    /// Its loop is on the limit of stability, as near as can be told.
    Unknown,
}

/// One case of a study: the models prepared for one delay.
pub(crate) struct Engine<'a> {
    setup: &'a Setup,
    pub(crate) delay: f64,
    /// Frequency scale of loop and observers: the Cayley parameter.
    pub(crate) gamma: f64,
    doubling: Doubling,
    /// Set where the separable form is used.
    modal: Option<Modal>,
    pub(crate) method: Method,
    /// Names of the block's states.
    pub(crate) states: Vec<String>,
    /// The second route, prepared when first used.
    frequency: OnceLock<Frequency<'a>>,
    /// Decides stability where the blocks only approximate the delay.
    winding: Option<Winding>,
    /// Indices of the models that could be designed.
    pub(crate) designed: Vec<usize>,
    /// What the nominal measurement noise adds for each model, NaN for those without one.
    offsets: Vec<f64>,
    /// Buffers waiting for the next call.
    works: Mutex<Vec<Work>>,
}

/// Buffers of [`Engine::rows`]; what they held before leaves no trace.
struct Work {
    assembly: Assembly,
    batch: LoopBatch,
    /// The loops with their exact delay, and buffers for it.
    exact: Assembly,
    delayed: DelayedBatch,
    /// The measurement noise of each plant where it is not the nominal one.
    built: Vec<Result<Option<Mat<f64>>>>,
    energies: Vec<f64>,
}

impl Work {
    fn new() -> Self {
        let (built, energies) = Default::default();
        Self {
            assembly: Assembly::new(),
            batch: LoopBatch::new(),
            exact: Assembly::new(),
            delayed: DelayedBatch::new(),
            built,
            energies,
        }
    }
}

impl<'a> Engine<'a> {
    /// Prepares the models for `delay`; the frequency scale is taken from the
    /// observers and the first, middle and last plant of the grid that can be
    /// built.
    ///
    /// # Errors
    /// A mistake in the study; `AllFailed` if no plant of the grid can be built.
    pub(crate) fn new(setup: &'a Setup, delay: f64) -> Result<Self> {
        let grid = &setup.study.grid;
        let mut rates = Rates::default();
        let mut order = None;
        let mut near = Vec::new();
        let mut first_failure = None;
        let usual = [0, grid.len() / 2, grid.len() - 1];
        for (k, index) in usual.into_iter().chain(0..grid.len()).enumerate() {
            if k >= usual.len() && order.is_some() {
                break;
            }
            let theta = setup.theta_at(&grid.point(index));
            match setup.block(&theta, delay, setup.delay_states()) {
                Ok((block, _)) => {
                    let values = backend::eigenvalues(block.A.as_ref())?;
                    rates.add(&values, setup.time.is_continuous());
                    if order.is_none() || k == 1 {
                        near = values;
                    }
                    order = Some(block.np());
                }
                Err(e @ Error::Plant { .. }) => {
                    first_failure.get_or_insert(e);
                }
                Err(e) => return Err(e),
            }
        }
        let Some(order) = order else {
            let source = first_failure.unwrap_or(Error::Empty { what: "grid".into() });
            return Err(Error::AllFailed {
                what: "plants",
                count: grid.len(),
                source: Box::new(source),
            });
        };
        let mut model_order = 1;
        for pair in setup.pairs.iter().flatten() {
            rates.add(&backend::eigenvalues(pair.F.as_ref())?, setup.time.is_continuous());
            model_order = pair.F.nrows();
        }
        let gamma = rates.centre();
        let doubling = Doubling::new(setup.time, gamma, setup.pairs.iter().flatten());
        let models = setup.pairs.iter().flatten().count();
        let mut method =
            setup.study.method.unwrap_or_else(|| Method::cheaper(order, model_order, models));
        let modal = match method {
            Method::Modal => {
                Modal::new(setup.time.is_continuous(), setup.pairs.iter().flatten(), &near)?
            }
            Method::Doubling => None,
        };
        if modal.is_none() {
            method = Method::Doubling; // models with ill-conditioned eigenvectors
        }
        let plant_states = &setup.study.family.names().states;
        let states = block_states(plant_states, &setup.study.surroundings, order);
        let designed = (0..setup.pairs.len()).filter(|&i| setup.pairs[i].is_some()).collect();
        let offset = |pair: &PairModel| setup.offset(pair, &setup.nominal.R);
        let offsets = setup.pairs.iter().map(|p| p.as_ref().map_or(f64::NAN, offset)).collect();
        let works = Mutex::new(Vec::new());
        let delayed_feedback =
            setup.time.is_continuous() && delay > 0.0 && setup.controller.is_some();
        let winding = delayed_feedback.then(|| Winding::new(delay, gamma));
        let frequency = OnceLock::new();
        Ok(Self {
            setup,
            delay,
            gamma,
            doubling,
            modal,
            method,
            states,
            frequency,
            winding,
            designed,
            offsets,
            works,
        })
    }

    /// Upsilon of every model at parameter vectors `thetas`, into `out`, plants by models
    /// (NaN where there is none).
    ///
    /// # Errors
    /// A mistake in the study; a plant that cannot be built is an outcome.
    pub(crate) fn fill(&self, thetas: &[Vec<f64>], out: &mut [f64]) -> Result<Vec<Found>> {
        self.outcomes(thetas, &self.designed, out, |batch, energies| match &self.modal {
            Some(modal) => self.modal_energies(modal, batch, energies),
            None => self.doubling.energies(batch, None, energies),
        })
    }

    /// [`Engine::fill`], a row each.
    ///
    /// # Errors
    /// As [`Engine::fill`].
    pub(crate) fn rows(&self, thetas: &[Vec<f64>]) -> Result<Vec<Outcome>> {
        self.apart(thetas.len(), |out| self.fill(thetas, out))
    }

    /// True if a model that could be designed has no number in `row`.
    pub(crate) fn lost(&self, row: &[f64]) -> bool {
        if self.designed.len() == row.len() {
            // in vectors: no way out in between
            return row.iter().fold(false, |lost, u| lost | u.is_nan());
        }
        self.designed.iter().any(|&i| row[i].is_nan())
    }

    /// The rows that `fill` finds, one after the other.
    fn apart(
        &self,
        plants: usize,
        fill: impl FnOnce(&mut [f64]) -> Result<Vec<Found>>,
    ) -> Result<Vec<Outcome>> {
        let models = self.setup.pairs.len();
        let mut all = vec![f64::NAN; plants * models];
        let found = fill(&mut all)?.into_iter().zip(all.chunks(models));
        Ok(found.map(|(found, row)| found.map(|()| row.to_vec())).collect())
    }

    /// Upsilon by doubling whatever the method, for boundaries: it keeps the
    /// digits that the separable form loses. Only for `models` (indices in the
    /// bank, in increasing order); the others are NaN, as those that failed.
    /// Plants go eight at a time, at the price of one.
    ///
    /// # Errors
    /// As [`Engine::rows`].
    pub(crate) fn accurate_rows(
        &self,
        thetas: &[Vec<f64>],
        models: &[usize],
    ) -> Result<Vec<Outcome>> {
        let (designed, places) = self.places(models);
        self.apart(thetas.len(), |out| {
            self.outcomes(thetas, &designed, out, |batch, energies| {
                self.doubling.energies(batch, Some(&places), energies);
            })
        })
    }

    /// Upsilon of every model at parameter vectors `thetas`, by doubling for those of
    /// `wanted` (one list a plant) and wherever the smallest may be: the separable form is
    /// good enough to tell the others.
    ///
    /// # Errors
    /// As [`Engine::fill`].
    pub(crate) fn probe(&self, thetas: &[Vec<f64>], wanted: &[&[usize]]) -> Result<Vec<Outcome>> {
        if self.modal.is_none() {
            return self.accurate_rows(thetas, &self.designed);
        }
        let mut outcomes = self.rows(thetas)?;
        let groups = thetas.chunks(LANES).zip(wanted.chunks(LANES));
        for ((thetas, wanted), outcomes) in groups.zip(outcomes.chunks_mut(LANES)) {
            let close: Vec<Vec<usize>> =
                outcomes.iter().zip(wanted).map(|(o, wanted)| self.close(o, wanted)).collect();
            // those of all plants: the lanes of a group cost what one costs
            let mut all = close.concat();
            all.sort_unstable();
            all.dedup();
            let accurate = self.accurate_rows(thetas, &all)?;
            for ((outcome, accurate), close) in outcomes.iter_mut().zip(accurate).zip(&close) {
                match (outcome, accurate) {
                    (Ok(row), Ok(accurate)) => close.iter().for_each(|&i| row[i] = accurate[i]),
                    (outcome, accurate) => *outcome = accurate,
                }
            }
        }
        Ok(outcomes)
    }

    /// The models that may have the smallest Upsilon of a row by the separable form, and
    /// those of `wanted`; all, where there is no row.
    fn close(&self, outcome: &Outcome, wanted: &[usize]) -> Vec<usize> {
        let mut close = self.designed.clone();
        if let Ok(row) = outcome {
            let least = sets::least(row);
            close.retain(|&i| {
                // beside the energies, which an offset may nearly cancel; false for NaN
                let size = least.abs() + self.offsets[i].abs() * self.setup.scale();
                let far = row[i] - least > CONTENDS * size;
                !far || wanted.contains(&i)
            });
        }
        close
    }

    /// Those of `models` that could be designed, and their places among all
    /// that could be.
    fn places(&self, models: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let found = models.iter().filter_map(|&i| Some((i, self.designed.binary_search(&i).ok()?)));
        found.unzip()
    }

    /// Builds the plants and takes `energies` of the blocks, `designed` a row; Upsilon goes
    /// into `out`, all models a row.
    fn outcomes(
        &self,
        thetas: &[Vec<f64>],
        designed: &[usize],
        out: &mut [f64],
        energies: impl FnOnce(&LoopBatch, &mut Vec<f64>),
    ) -> Result<Vec<Found>> {
        let spare = self.works.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut work = spare.unwrap_or_else(Work::new);
        let found = self.outcomes_in(&mut work, thetas, designed, out, energies);
        self.works.lock().unwrap_or_else(PoisonError::into_inner).push(work);
        found
    }

    fn outcomes_in(
        &self,
        work: &mut Work,
        thetas: &[Vec<f64>],
        designed: &[usize],
        out: &mut [f64],
        fill: impl FnOnce(&LoopBatch, &mut Vec<f64>),
    ) -> Result<Vec<Found>> {
        let Work { assembly, batch, exact, delayed, built, energies } = work;
        let form = self.setup.delay_states();
        let nominal = &self.setup.nominal.R;
        batch.clear();
        delayed.clear();
        built.clear();
        for theta in thetas {
            match self.setup.assemble(assembly, theta, self.delay, form) {
                Ok((block, r)) => {
                    batch.push(block);
                    built.push(Ok((r != nominal).then(|| r.clone())));
                    if self.winding.is_some() {
                        let form = DelayForm::Exact;
                        let (block, _) = self.setup.assemble(exact, theta, self.delay, form)?;
                        delayed.push(block);
                    }
                }
                Err(e @ Error::Plant { .. }) => built.push(Err(e)),
                Err(e) => return Err(e),
            }
        }
        fill(batch, energies);
        let counts = match &self.winding {
            Some(winding) => winding.counts(delayed),
            None => Vec::new(),
        };
        let mut next = 0;
        let mut all = Vec::with_capacity(thetas.len());
        let rows = out.chunks_mut(self.setup.pairs.len());
        for ((r, theta), out) in built.drain(..).zip(thetas).zip(rows) {
            let r = match r {
                Ok(r) => r,
                Err(e) => {
                    out.fill(f64::NAN);
                    all.push(Err(Flaw::Unbuilt(e)));
                    continue;
                }
            };
            let row = &energies[next * designed.len()..(next + 1) * designed.len()];
            let proved = !row.iter().all(|e| e.is_nan());
            let stability = match &self.winding {
                Some(winding) => {
                    delayed_stability(winding, batch, delayed, next, proved, counts[next])?
                }
                None => stability(batch, next, proved)?,
            };
            all.push(match stability {
                Stability::Unstable(mode) => Err(Flaw::Unstable(mode)),
                Stability::Unknown => Err(Flaw::Unknown),
                Stability::Stable if proved => {
                    self.scale(designed, row, r.as_ref(), out);
                    Ok(())
                }
                Stability::Stable => {
                    out.copy_from_slice(&self.unproved_row(theta, designed)?);
                    Ok(())
                }
            });
            if let Some(Err(_)) = all.last() {
                out.fill(f64::NAN);
            }
            next += 1;
        }
        Ok(all)
    }

    /// Energies by the separable form; plants whose eigenvectors are
    /// ill-conditioned by doubling.
    fn modal_energies(&self, modal: &Modal, batch: &LoopBatch, energies: &mut Vec<f64>) {
        let again = modal.energies(&self.doubling, batch, energies);
        if again.is_empty() {
            return;
        }
        let mut blocks = LoopBatch::new();
        for &k in &again {
            blocks.push(&batch.block(k));
        }
        let mut found = Vec::new();
        self.doubling.energies(&blocks, None, &mut found);
        let models = modal.len();
        for (found, &k) in found.chunks(models).zip(&again) {
            energies[k * models..(k + 1) * models].copy_from_slice(found);
        }
    }

    /// Upsilon by the frequency integral of a stable loop that the doubling could
    /// not show to be so; NaN where the integral is not accurate either.
    fn unproved_row(&self, theta: &[f64], designed: &[usize]) -> Result<Vec<f64>> {
        let (mut row, errors) = self.frequency_row(theta, designed)?;
        for (value, error) in row.iter_mut().zip(errors) {
            if error > UNPROVED * value.abs() {
                *value = f64::NAN;
            }
        }
        Ok(row)
    }

    /// Upsilon of `models` (indices in the bank, in increasing order) by the
    /// frequency integral, with the exact delay, and the error estimate of its
    /// quadrature; NaN for the others.
    ///
    /// # Errors
    /// A plant that cannot be built.
    pub(crate) fn frequency_row(
        &self,
        theta: &[f64],
        models: &[usize],
    ) -> Result<(Vec<f64>, Vec<f64>)> {
        let setup = self.setup;
        let (block, r) = setup.block(theta, self.delay, DelayForm::Exact)?;
        let (designed, places) = self.places(models);
        let integrals = self.second_route().energies(&block, &places);
        let scaled = |energies: Vec<f64>| {
            let mut row = vec![f64::NAN; self.setup.pairs.len()];
            self.scale(&designed, &energies, Some(&r), &mut row);
            row
        };
        let values = scaled(integrals.iter().map(|i| i.value).collect());
        let upper = scaled(integrals.iter().map(|i| i.value + i.error).collect());
        let errors = values.iter().zip(&upper).map(|(v, u)| u - v).collect();
        Ok((values, errors))
    }

    /// The frequency route; its mesh is that of a plant from the middle of the
    /// grid.
    pub(crate) fn second_route(&self) -> &Frequency<'a> {
        self.frequency.get_or_init(|| {
            let (setup, grid) = (self.setup, &self.setup.study.grid);
            let built = |index: usize| {
                let theta = setup.theta_at(&grid.point(index));
                Some(setup.block(&theta, self.delay, DelayForm::Exact).ok()?.0)
            };
            let sample = [grid.len() / 2, 0, grid.len() - 1].into_iter().find_map(built);
            let models: Vec<&PairModel> = setup.pairs.iter().flatten().collect();
            Frequency::new(setup.time, self.gamma, models, sample.as_ref())
        })
    }

    /// One Upsilon a model of the bank from the energies of `designed`, NaN for
    /// the others, at a plant with measurement noise `r` (`None`: the nominal one).
    fn scale(&self, designed: &[usize], energies: &[f64], r: Option<&Mat<f64>>, row: &mut [f64]) {
        let scale = self.setup.scale();
        // an energy below zero is all rounding
        let upsilon = |energy: f64, offset: f64| {
            let value = (0.5 * energy + offset) * scale;
            if energy >= 0.0 { value } else { f64::NAN }
        };
        if r.is_none() && designed.len() == row.len() {
            // in vectors
            for ((out, &energy), &offset) in row.iter_mut().zip(energies).zip(&self.offsets) {
                *out = upsilon(energy, offset);
            }
            return;
        }
        row.fill(f64::NAN);
        for (&i, &energy) in designed.iter().zip(energies) {
            let offset = match (r, &self.setup.pairs[i]) {
                (Some(r), Some(pair)) => self.setup.offset(pair, r),
                _ => self.offsets[i],
            };
            row[i] = upsilon(energy, offset);
        }
    }
}
