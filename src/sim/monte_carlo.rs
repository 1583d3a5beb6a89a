//! Many trials of one bank.

use super::alone;
use super::consistency::{Spreads, chi_square_band};
use super::joint::{Joint, Unsampled};
use super::lanes::{Eight, Norm};
use super::moment::{Summary, moment};
use super::quantile::Sample;
use super::tally::{CHUNK, Shape, Tally, Trajectory};
use super::truth::{Source, Timing, Truth};
use crate::bank::{GainMode, Gains, Members, Schedule, Settings, StartTime, norm_factor};
use crate::engine::{Innovation, Mixing, Mmae, Weighting};
use crate::error::{Error, Result};
use crate::observer::ObserverKind;
use crate::par::{RunControl, map_chunks, map_parts};
use crate::simd::{LANES, dispatch};
use crate::weight::{Law, Modifiers, Transition};

/// Parts of a step of an integral along it; even.
const PARTS: usize = 8;
/// Chunks whose results are held at once, at most and at least.
const ROUND: usize = 256;
const LEAST: usize = 8;
/// Most bytes of results.
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
/// use mmae::sim::{Measurement, MonteCarlo, Truth};
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
///     measurement: Measurement::Sampled,
///     seed: 1,
///     every: 0,
///     keep: Vec::new(),
///     values: vec![vec![0.96], vec![1.0]],
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
    /// How the observers see the plant.
    pub measurement: Measurement,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Report every so many steps, 0 for the end only; the end always is.
    pub every: u64,
    /// Trials whose course is kept.
    pub keep: Vec<u64>,
    /// Parameter values, one list a model, for the estimate
    /// `theta_hat = sum p_i theta_i`; none if there are no lists.
    pub values: Vec<Vec<f64>>,
}

/// How the observers see the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Measurement {
    /// At the steps; continuous observers hold what they saw until the next.
    #[default]
    Sampled,
    /// All the time: continuous observers with steady gains and Dunn's laws,
    /// integrated together with the plant. White noise is held over a step.
    Continuous,
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
    /// False if the matrices `P` of the observers are no covariances.
    pub(super) covariances: bool,
    pub(super) shape: Shape,
    /// Continuous observers: seconds over which signals are held.
    pub(super) hold: Option<f64>,
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

    /// The last step that can be taken together with step `first`: up to a report or a
    /// multiple of `every`.
    pub(super) fn tile_end(&self, first: u64, every: u64) -> u64 {
        let end = first.next_multiple_of(every).min(self.steps);
        if self.every > 0 { end.min(first.next_multiple_of(self.every)) } else { end }
    }

    /// True if a step only adds to the logarithms of the weights.
    pub(super) fn only_adds(&self) -> bool {
        self.law == Law::Bayes
            && self.hold.is_none()
            && self.transition.is_none()
            && self.modifiers == Modifiers::default()
    }

    /// True if the course of the trial is wanted.
    pub(super) fn keeps(&self, trial: u64) -> bool {
        self.keep.binary_search(&trial).is_ok()
    }
}

/// How trials are run.
enum Route {
    /// Eight at a time, gains shared.
    Lanes { coefficients: Schedule, spreads: Spreads },
    /// Eight at a time, plant and observers as one system.
    Joint { joint: Box<Joint>, spreads: Spreads },
    /// One by one through the engine.
    Alone,
}

/// Results of a chunk of trials, see [`Tally`].
struct Part {
    trials: usize,
    sums: Vec<f64>,
    values: Vec<f64>,
    kept: Vec<Trajectory>,
}

/// Results of all.
struct Total {
    /// Shape (report, number).
    sums: Vec<f64>,
    /// Shape (report, quantity).
    samples: Vec<Sample>,
    kept: Vec<Trajectory>,
}

impl MonteCarlo {
    /// Equal priors, steady gains, the default weighting, seed 1, a report at the
    /// end only.
    pub fn new(members: Members, truth: Truth, steps: u64, trials: u64) -> Self {
        Self {
            prior: vec![1.0; members.plants.len()],
            members,
            settings: Settings::default(),
            weighting: Weighting::default(),
            truth,
            steps,
            trials,
            measurement: Measurement::Sampled,
            seed: 1,
            every: 0,
            keep: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Does what needs no trial: whatever keeps an experiment from starting shows.
    ///
    /// # Errors
    /// Those of [`MonteCarlo::run`] but for a record that does not fit in memory.
    pub fn check(&self, control: &RunControl<'_>) -> Result<()> {
        let engine = Mmae::new(&self.members, &self.settings, &self.weighting, &self.prior)?;
        let plan = self.plan(&engine, control)?;
        self.route(&engine, &plan).map(|_| ())
    }

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
        let plan = self.plan(&engine, control)?;
        let reports = self.steps.checked_div(self.every).unwrap_or(0)
            + u64::from(self.every == 0 || !self.steps.is_multiple_of(self.every));
        let axes = plan.shape.axes();
        let samples = axes.len() as u128 * u128::from(Sample::bytes(self.trials));
        let each = samples + self.held(&plan.shape) as u128 + self.keep.len() as u128 * 64;
        let bytes = u128::from(reports) * each;
        if bytes > LIMIT {
            return Err(Error::Limit {
                what: format!("a record of {reports} steps"),
                bytes,
                limit: LIMIT,
                remedy: "report fewer steps (every) or keep fewer trials",
            });
        }
        let route = self.route(&engine, &plan)?;
        let reports = reports as usize;
        let work = |first: u64, trials: usize| -> Result<Part> {
            let mut tally = Tally::new(&plan.shape, reports, trials);
            let mut kept = Vec::new();
            for start in (0..trials).step_by(LANES) {
                let (first, valid) = (first + start as u64, LANES.min(trials - start));
                tally.begin(start, valid);
                let (tally, kept, plan) = (&mut tally, &mut kept, &plan);
                match &route {
                    Route::Lanes { coefficients, spreads } => {
                        let eight =
                            Eight { plan, coefficients, first, valid, spreads, tally, kept };
                        dispatch(eight)?;
                    }
                    Route::Joint { joint, spreads } => {
                        dispatch(Unsampled { plan, joint, first, valid, spreads, tally, kept })?;
                    }
                    Route::Alone => alone::run(plan, &engine, first, valid, tally, kept)?,
                }
            }
            let (sums, values) = tally.finish();
            Ok(Part { trials, sums, values, kept })
        };
        let samples: Vec<Sample> =
            (0..reports).flat_map(|_| &axes).map(|a| Sample::new(*a)).collect();
        let total =
            Total { sums: vec![0.0; reports * plan.shape.sums()], samples, kept: Vec::new() };
        let total = self.gather(control, &plan.shape, reports, total, work)?;
        let mut record = Vec::with_capacity(reports);
        let mut samples = total.samples.into_iter();
        for (i, sums) in total.sums.chunks_exact(plan.shape.sums()).enumerate() {
            let at = i as u64 + 1;
            let step = if i + 1 == reports { self.steps } else { at * self.every };
            let of_step = samples.by_ref().take(axes.len()).map(Sample::quantiles);
            record.push(moment(step, sums, of_step.collect(), &plan.shape, self.trials as f64));
        }
        let [_, _, q] = engine.bank().sizes();
        let band = |freedom: usize| chi_square_band(freedom as f64, self.trials as f64);
        Ok(Summary {
            trials: self.trials,
            steps: self.steps,
            seed: self.seed,
            nis_band: band(q),
            nees_band: if plan.covariances { band(plan.shape.common) } else { [f64::NAN; 2] },
            record,
            kept: total.kept,
            failures: engine.bank().failures().to_vec(),
        })
    }

    /// Bytes a report of the chunks that are always held at once.
    fn held(&self, shape: &Shape) -> usize {
        let trials = usize::try_from(self.trials).unwrap_or(usize::MAX);
        LEAST.min(trials.div_ceil(CHUNK)) * shape.bytes(trials.min(CHUNK))
    }

    /// Runs chunks of trials and adds up their results, in the order of the trials.
    fn gather(
        &self,
        control: &RunControl<'_>,
        shape: &Shape,
        reports: usize,
        mut total: Total,
        work: impl Fn(u64, usize) -> Result<Part> + Sync,
    ) -> Result<Total> {
        // as many chunks at once as fit; the results do not depend on it
        let chunks =
            (LIMIT as usize / 16 / (reports * shape.bytes(CHUNK)).max(1)).clamp(LEAST, ROUND);
        let quantities = total.samples.len() / reports;
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
            let mut parts = parts.into_iter().collect::<Result<Vec<Part>>>()?;
            for part in &mut parts {
                for (sum, value) in total.sums.iter_mut().zip(&part.sums) {
                    *sum += value;
                }
                total.kept.append(&mut part.kept);
            }
            let quiet = RunControl { progress: None, ..*control };
            let of_reports: Vec<_> = total.samples.chunks_mut(quantities).collect();
            map_parts(
                &quiet,
                of_reports,
                |_| 1,
                |report, samples| {
                    for (j, sample) in samples.iter_mut().enumerate() {
                        for part in &parts {
                            let at = (report * quantities + j) * part.trials;
                            sample.extend(&part.values[at..][..part.trials]);
                        }
                    }
                },
            )?;
            first += trials as u64;
        }
        Ok(total)
    }

    /// How the trials are run: in lanes if all that differs between them is states
    /// and weights.
    fn route(&self, engine: &Mmae, plan: &Plan) -> Result<Route> {
        let joint = self.measurement == Measurement::Continuous;
        let parts = if joint { self.parts(engine)? } else { 0 };
        let ode = matches!(self.weighting.law, Law::Ode { .. });
        let alike = matches!(self.weighting.mixing, Mixing::None | Mixing::Markov(_));
        if !joint && (ode || !alike) {
            return Ok(Route::Alone);
        }
        let (mut gains, _) = Gains::new(&self.members, &self.settings)?;
        let (sizes, models) = (engine.bank().sizes(), plan.prior.len());
        let coefficients = Schedule::new(&mut gains, sizes, models, self.steps, plan.moves_first)?;
        let spreads = Spreads::new(&coefficients, models, plan.shape.common, plan.covariances);
        if !joint {
            return Ok(Route::Lanes { coefficients, spreads });
        }
        let dt = engine.bank().dt();
        let span = [dt, dt * self.steps as f64];
        let joint = Joint::new(&self.truth, &self.members, &plan.failed, span, parts)?;
        Ok(Route::Joint { joint: Box::new(joint), spreads })
    }

    /// Parts of a step in which observers see the plant all the time.
    fn parts(&self, engine: &Mmae) -> Result<usize> {
        let conflict = |problem: &str, remedy: &str| {
            let (problem, remedy) = (problem.into(), remedy.into());
            Err(Error::Conflict { problem, remedy })
        };
        if !engine.bank().is_continuous() {
            let remedy = "use sampled measurement";
            return conflict("discrete filters with continuous measurement", remedy);
        }
        if self.settings.gains == GainMode::Recursive {
            let remedy = "use steady gains (no P0), or sampled measurement";
            return conflict("gains that vary with continuous measurement", remedy);
        }
        if !matches!(self.weighting.mixing, Mixing::None | Mixing::Markov(_)) {
            let remedy = "mix the weights only (markov), or use sampled measurement";
            return conflict("states that are mixed with continuous measurement", remedy);
        }
        match self.weighting.law {
            Law::Likelihood => Ok(PARTS),
            Law::Ode { substeps } => Ok(2 * substeps),
            Law::Bayes | Law::Zhang { .. } | Law::Dwsg { .. } => {
                let remedy = "use Dunn's laws, or sampled measurement";
                conflict("a law of samples with continuous measurement", remedy)
            }
        }
    }

    pub(super) fn plan(&self, engine: &Mmae, control: &RunControl<'_>) -> Result<Plan> {
        let bank = engine.bank();
        let [n, m, q] = bank.sizes();
        let moves_first = self.members.start == StartTime::StepBefore;
        let timing = match (bank.is_continuous(), moves_first) {
            (true, _) => Timing::Hold,
            (false, true) => Timing::MoveFirst,
            (false, false) => Timing::MeasureAtStart,
        };
        let source = Source::new(&self.truth, timing, bank.dt(), control)?;
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
        let models = prior.len();
        let lists = &self.values;
        if let Some(list) = lists.iter().find(|v| v.len() != lists[0].len()) {
            let (want, got) = ([lists[0].len(), 1], [list.len(), 1]);
            return Err(Error::Shape { what: "values of a model".into(), want, got });
        }
        if !lists.is_empty() && lists.len() != models {
            let (want, got) = ([models, 1], [lists.len(), 1]);
            return Err(Error::Shape { what: "lists of values".into(), want, got });
        }
        let shape = Shape::new([n, q], source.n, models, lists);
        Ok(Plan {
            source,
            law: self.weighting.law,
            zhang: matches!(self.weighting.law, Law::Zhang { .. }),
            norm: match &self.weighting.innovation {
                Innovation::Filter => Norm::Filter,
                // a sample of a continuous observer has one norm
                Innovation::Steady if bank.is_continuous() => Norm::Filter,
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
            covariances: self.members.observer != ObserverKind::Krener,
            shape,
            hold: bank.is_continuous().then(|| bank.dt()),
            seed: self.seed,
            steps: self.steps,
            every: self.every,
            keep,
        })
    }
}
