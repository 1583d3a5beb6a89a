//! Many trials of one bank.

use super::alone;
use super::lanes::{Eight, Norm};
use super::tally::{self, Trajectory};
use super::truth::{Source, Timing, Truth};
use crate::bank::{Gains, Members, Schedule, Settings, StartTime, norm_factor};
use crate::engine::{Innovation, Mixing, Mmae, Weighting};
use crate::error::{Error, Result};
use crate::par::{RunControl, map_chunks};
use crate::simd::{Block, LANES, dispatch};
use crate::weight::{Law, Modifiers, Transition};

/// Trials of a chunk of work.
const CHUNK: usize = 64;
/// Chunks whose sums are held at once.
const ROUND: usize = 256;
/// Most bytes of sums.
const LIMIT: u128 = 4 << 30;

/// A Monte-Carlo experiment: a bank, the plant that is really there, and how
/// often.
///
/// ```
/// use mmae::bank::{GainMode, Initial, Members, Settings};
/// use mmae::engine::Weighting;
/// use mmae::model::{Family, systems};
/// use mmae::observer::ObserverKind;
/// use mmae::par::RunControl;
/// use mmae::sim::{MonteCarlo, Truth};
/// use mmae::{Mat, mat};
/// let family = systems::tracker();
/// let plant = |rho| family.plant(&family.theta_with(&[("rho", rho)])?);
/// let mut members = Members::new(ObserverKind::Kalman, vec![plant(0.96)?, plant(1.0)?]);
/// let x0 = vec![-100.0, 2.0, 200.0, 20.0];
/// members.initial = vec![Initial { x_hat: x0.clone(), P: Some(Mat::zeros(4, 4)) }];
/// let experiment = MonteCarlo {
///     members,
///     settings: Settings { gains: GainMode::Recursive, ..Settings::default() },
///     weighting: Weighting::default(),
///     prior: vec![1.0, 1.0],
///     truth: Truth { x0, ..Truth::new(plant(1.0)?) },
///     steps: 50,
///     trials: 100,
///     seed: 1,
///     every: 0,
///     keep: Vec::new(),
/// };
/// let summary = experiment.run(&RunControl::default())?;
/// let end = summary.last();
/// assert!(end.identified[1] > 0.9);
/// assert!((end.p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct MonteCarlo {
    /// The models.
    pub members: Members,
    /// Gains and interval.
    pub settings: Settings,
    /// The law of the weights.
    pub weighting: Weighting,
    /// Prior probability of each model.
    pub prior: Vec<f64>,
    /// The plant.
    pub truth: Truth,
    /// Measurements of each trial, at least one.
    pub steps: u64,
    /// Trials, at least one.
    pub trials: u64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Report every so many steps, 0 for the end only; the end always is.
    pub every: u64,
    /// Trials whose course is kept.
    pub keep: Vec<u64>,
}

/// Means over all trials at a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// The step, from 1.
    pub step: u64,
    /// Mean weight of each model.
    pub p: Vec<f64>,
    /// Standard deviation of the weight over the trials.
    pub p_std: Vec<f64>,
    /// Mean logarithm of each weight; minus infinity where a trial has weight
    /// zero.
    pub log_p: Vec<f64>,
    /// Fraction of trials in which the model has the largest weight.
    pub identified: Vec<f64>,
    /// Mean normalised innovation squared, `r' S^-1 r`, whose expectation is the
    /// number of outputs where the model is right; over the trials in which the
    /// member did not fail, NaN if there is none.
    pub nis: Vec<f64>,
    /// Fraction of trials in which the member failed.
    pub failed: Vec<f64>,
    /// `sqrt(mean |x - x_hat|^2)` of the fused estimate, over the states that the
    /// plant and the observers have in common.
    pub x_error_rms: f64,
}

impl Moment {
    /// `sum p_i values_i`: the mean estimate of a parameter.
    ///
    /// # Panics
    /// Unless there is a value a model.
    pub fn mean(&self, values: &[f64]) -> f64 {
        assert_eq!(values.len(), self.p.len(), "one value a model");
        self.p.iter().zip(values).filter(|(p, _)| **p > 0.0).map(|(p, v)| p * v).sum()
    }
}

/// What came out of all trials.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Trials run.
    pub trials: u64,
    /// Steps of each.
    pub steps: u64,
    /// Seed.
    pub seed: u64,
    /// The steps that were asked for; the last one is the end.
    pub record: Vec<Moment>,
    /// The trials that were asked for, in order.
    pub kept: Vec<Trajectory>,
    /// Models that could not be designed.
    pub failures: Vec<Option<Error>>,
}

impl Summary {
    /// Means at the end.
    ///
    /// # Panics
    /// Never for a summary that [`MonteCarlo::run`] returned.
    pub fn last(&self) -> &Moment {
        &self.record[self.record.len() - 1]
    }
}

/// All that is the same for every trial.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) source: Source,
    pub(super) law: Law,
    pub(super) zhang: bool,
    pub(super) norm: Norm,
    pub(super) modifiers: Modifiers,
    pub(super) transition: Option<Transition>,
    /// Models that cannot be used have none.
    pub(super) prior: Vec<f64>,
    pub(super) failed: Vec<bool>,
    /// Estimates at the start, shape (model, state).
    pub(super) x_hat: Vec<f64>,
    pub(super) moves_first: bool,
    pub(super) seed: u64,
    pub(super) steps: u64,
    every: u64,
    keep: Vec<u64>,
}

impl Plan {
    /// True if step `k` is reported.
    #[inline(always)]
    pub(super) fn reports(&self, k: u64) -> bool {
        k == self.steps || (self.every > 0 && k.is_multiple_of(self.every))
    }

    /// True if the course of the trial is wanted.
    pub(super) fn keeps(&self, trial: u64) -> bool {
        self.keep.binary_search(&trial).is_ok()
    }
}

/// Sums and courses of a chunk of trials.
struct Part {
    sums: Vec<f64>,
    kept: Vec<Trajectory>,
}

impl MonteCarlo {
    /// Runs all trials.
    ///
    /// The result has the same bits for any number of threads; a trial is the
    /// same in whatever company it runs.
    ///
    /// # Errors
    /// As [`Mmae::new`]; those of the truth; `Range` without steps or trials;
    /// `Limit` for more reports than fit in memory, or gains of more steps than
    /// do; `Cancelled`.
    pub fn run(&self, control: &RunControl<'_>) -> Result<Summary> {
        for (what, value) in [("steps", self.steps), ("trials", self.trials)] {
            if value == 0 {
                let remedy = "give at least one".into();
                return Err(Error::Range { what: what.into(), value: 0.0, remedy });
            }
        }
        let engine = Mmae::new(&self.members, &self.settings, &self.weighting, &self.prior)?;
        let plan = self.plan(&engine)?;
        let models = plan.prior.len();
        let reports = self.steps.checked_div(self.every).unwrap_or(0)
            + u64::from(self.every == 0 || !self.steps.is_multiple_of(self.every));
        let width = tally::width(models);
        let each = u128::from(reports) * width as u128 * 8;
        // a thread has a block and a row of it, and so has the total
        let bytes = each * (8 + 2) + u128::from(reports) * self.keep.len() as u128 * 64;
        if bytes > LIMIT {
            return Err(Error::Limit {
                what: format!("a record of {reports} steps"),
                bytes,
                limit: LIMIT,
                remedy: "report fewer steps (every) or keep fewer trials",
            });
        }
        let coefficients = if self.in_lanes(&engine) {
            let (mut gains, _) = Gains::new(&self.members, &self.settings)?;
            let sizes = engine.bank().sizes();
            let made = Schedule::new(&mut gains, sizes, models, self.steps, plan.moves_first)?;
            Some(made)
        } else {
            None
        };
        let size = reports as usize * width;
        let work = |first: u64, trials: usize| -> Result<Part> {
            let mut sums = vec![Block::default(); size];
            let mut kept = Vec::new();
            for start in (0..trials).step_by(LANES) {
                let (first, valid) = (first + start as u64, LANES.min(trials - start));
                match &coefficients {
                    Some(coefficients) => dispatch(Eight {
                        plan: &plan,
                        coefficients,
                        first,
                        valid,
                        sums: &mut sums,
                        kept: &mut kept,
                    })?,
                    None => alone::run(&plan, &engine, first, valid, &mut sums, &mut kept)?,
                }
            }
            Ok(Part { sums: tally::across(&sums), kept })
        };
        let total = self.gather(control, size, work)?;
        let count = self.trials as f64;
        let mut record = Vec::with_capacity(reports as usize);
        let steps = (1..=reports).map(|i| if i == reports { self.steps } else { i * self.every });
        for (step, sums) in steps.zip(total.sums.chunks_exact(width)) {
            record.push(moment(step, sums, models, count));
        }
        Ok(Summary {
            trials: self.trials,
            steps: self.steps,
            seed: self.seed,
            record,
            kept: total.kept,
            failures: engine.bank().failures().to_vec(),
        })
    }

    /// Runs chunks of trials and adds up their sums, in the order of the trials.
    fn gather(
        &self,
        control: &RunControl<'_>,
        size: usize,
        work: impl Fn(u64, usize) -> Result<Part> + Sync,
    ) -> Result<Part> {
        let mut total = Part { sums: vec![0.0; size], kept: Vec::new() };
        // as many chunks at once as fit; the sums do not depend on it
        let chunks = (LIMIT as usize / 16 / (size * 8).max(1)).clamp(1, ROUND);
        let mut first = 0;
        while first < self.trials {
            let left = self.trials - first;
            let trials = usize::try_from(left).unwrap_or(usize::MAX).min(chunks * CHUNK);
            let report = |done: u64, _: u64| {
                if let Some(progress) = control.progress {
                    progress(first + done, self.trials);
                }
            };
            let round = control.progress(&report);
            let parts =
                map_chunks(&round, trials, CHUNK, |r| work(first + r.start as u64, r.len()))?;
            for part in parts {
                let part = part?;
                for (sum, value) in total.sums.iter_mut().zip(&part.sums) {
                    *sum += value;
                }
                total.kept.extend(part.kept);
            }
            first += trials as u64;
        }
        Ok(total)
    }

    /// True if the trials can run in lanes: all that differs between them is
    /// states and weights.
    fn in_lanes(&self, engine: &Mmae) -> bool {
        !engine.bank().is_continuous()
            && matches!(self.weighting.mixing, Mixing::None | Mixing::Markov(_))
    }

    fn plan(&self, engine: &Mmae) -> Result<Plan> {
        let bank = engine.bank();
        let [n, m, q] = bank.sizes();
        let moves_first = self.members.start == StartTime::StepBefore;
        let timing = match (bank.is_continuous(), moves_first) {
            (true, _) => Timing::Hold,
            (false, true) => Timing::MoveFirst,
            (false, false) => Timing::MeasureAtStart,
        };
        let source = Source::new(&self.truth, timing, bank.dt())?;
        if source.q != q || source.m != m {
            let plant = [source.q, source.m];
            return Err(Error::Shape {
                what: "outputs and inputs of the truth".into(),
                want: [q, m],
                got: plant,
            });
        }
        let failed: Vec<bool> = bank.failures().iter().map(Option::is_some).collect();
        let prior: Vec<f64> =
            self.prior.iter().zip(&failed).map(|(p, f)| if *f { 0.0 } else { *p }).collect();
        let mut x_hat = vec![0.0; prior.len() * n];
        for i in 0..prior.len() {
            bank.x_hat_into(i, &mut x_hat[i * n..][..n]);
        }
        let mut keep = self.keep.clone();
        keep.sort_unstable();
        Ok(Plan {
            source,
            law: self.weighting.law,
            zhang: matches!(self.weighting.law, Law::Zhang { .. }),
            norm: match &self.weighting.innovation {
                Innovation::Filter => Norm::Filter,
                Innovation::Steady => Norm::Steady,
                Innovation::Common(w) => Norm::Common(norm_factor(w, q)?),
            },
            modifiers: self.weighting.modifiers.clone(),
            transition: match &self.weighting.mixing {
                Mixing::Markov(t) | Mixing::Imm(t) => Some(t.clone()),
                Mixing::None | Mixing::Reseed { .. } => None,
            },
            prior,
            failed,
            x_hat,
            moves_first,
            seed: self.seed,
            steps: self.steps,
            every: self.every,
            keep,
        })
    }
}

/// Means from sums over `count` trials.
fn moment(step: u64, sums: &[f64], models: usize, count: f64) -> Moment {
    let mean =
        |j: usize| -> Vec<f64> { sums[j * models..][..models].iter().map(|s| s / count).collect() };
    let (p, squares, failed) = (mean(0), mean(1), mean(5));
    let p_std = p.iter().zip(&squares).map(|(p, s)| (s - p * p).max(0.0).sqrt()).collect();
    Moment {
        step,
        p,
        p_std,
        log_p: mean(2),
        identified: mean(3),
        nis: mean(4).iter().zip(&failed).map(|(nis, f)| nis / (1.0 - f)).collect(),
        failed,
        x_error_rms: (sums[6 * models] / count).sqrt(),
    }
}
