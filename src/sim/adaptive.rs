//! Monte-Carlo trials of an adaptive observer.

use super::field::{Field, Path};
use super::quantile::LEVELS;
use super::random::Streams;
use super::signal::Signal;
use crate::adaptive::{Adaptive, Courses, Estimate, Plan, Settings, Structure, Tuning};
use crate::error::{Error, Result};
use crate::par::{self, RunControl};
use crate::simd::{Block, LANES};

/// Most numbers that the reports of all trials may hold.
const LIMIT: u128 = 1 << 27;

/// One adaptive observer on a plant with measurement noise, many times.
///
/// The plant is simulated once ([`Field::path`]); trials differ in the noise on its
/// outputs and on the inputs that the observer is told.
#[derive(Debug, Clone)]
pub struct AdaptiveTrials {
    /// What is unknown.
    pub structure: Structure,
    /// How the observer is run.
    pub settings: Settings,
    /// The observer.
    pub tuning: Tuning,
    /// The plant that is really there.
    pub truth: Field,
    /// Its state at the start.
    pub x0: Vec<f64>,
    /// Known functions of time, one an input.
    pub inputs: Vec<Signal>,
    /// Standard deviation of the noise on each output, a sample.
    pub output_noise: Vec<f64>,
    /// The same on what the observer is told of each input.
    pub input_noise: Vec<f64>,
    /// Measurements of a trial, the one at the start included.
    pub samples: u64,
    /// Trials.
    pub trials: u64,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Measurements between two reports; 0 for the end only.
    pub every: u64,
}

/// What the trials say at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct AdaptiveMoment {
    /// Seconds.
    pub t: f64,
    /// Mean of each parameter over the trials.
    pub mean: Vec<f64>,
    /// Its standard deviation over the trials.
    pub spread: Vec<f64>,
    /// Its quantiles at 5, 25, 50, 75 and 95 %.
    pub quantiles: Vec<[f64; 5]>,
    /// Quantiles of the state estimate.
    pub x_quantiles: Vec<[f64; 5]>,
}

/// The first trial along time.
#[derive(Debug, Clone)]
pub struct AdaptiveCourse {
    /// Seconds.
    pub t: f64,
    /// The plant's state.
    pub x: Vec<f64>,
    /// Its outputs as measured.
    pub y: Vec<f64>,
    /// What the observer said.
    pub estimate: Estimate,
}

/// Results of all trials.
#[derive(Debug, Clone)]
pub struct AdaptiveSummary {
    /// Reports, the last that of the end.
    pub record: Vec<AdaptiveMoment>,
    /// The first trial at the same times.
    pub course: Vec<AdaptiveCourse>,
    /// Trials that ran away; they are left out of the statistics.
    pub failed: u64,
    /// Runge-Kutta steps of an interval of the plant, and their relative error.
    pub parts: u32,
    /// See [`Path::error`].
    pub truth_error: f64,
}

/// Every trial of every tuning along time.
#[derive(Debug, Clone)]
pub struct AdaptiveCourses {
    /// Seconds of the reports, the last that of the end.
    pub t: Vec<f64>,
    /// The plant's state, shape (report, state).
    pub x: Vec<f64>,
    /// What the observers said; a record is a trial.
    pub courses: Courses,
    /// Runge-Kutta steps of an interval of the plant.
    pub parts: u32,
    /// See [`Path::error`].
    pub truth_error: f64,
}

/// What the observers of eight trials are told.
struct Told<'a> {
    trials: &'a AdaptiveTrials,
    path: &'a Path,
    streams: Streams,
    noise: Vec<Block>,
}

impl<'a> Told<'a> {
    fn new(trials: &'a AdaptiveTrials, path: &'a Path, first: u64) -> Self {
        let noise = vec![Block::default(); trials.output_noise.len() + trials.input_noise.len()];
        Self { trials, path, streams: Streams::new(trials.seed, first), noise }
    }

    /// Sample `row`, the next: outputs of as many trials as `y` has room for, and inputs.
    fn next(&mut self, row: usize, u: &mut [f64], y: &mut [f64]) {
        let (outputs, inputs) = (&self.trials.output_noise, &self.trials.input_noise);
        let (q, m) = (outputs.len(), inputs.len());
        self.streams.normals::<f64>(&mut self.noise);
        for l in 0..y.len() / q {
            for j in 0..q {
                y[l * q + j] = outputs[j].mul_add(self.noise[j].0[l], self.path.y[row * q + j]);
            }
            for j in 0..m {
                u[l * m + j] = inputs[j].mul_add(self.noise[q + j].0[l], self.path.u[row * m + j]);
            }
        }
    }
}

impl AdaptiveTrials {
    /// Tests plant and observer, as a run would.
    ///
    /// # Errors
    /// As [`AdaptiveTrials::run`].
    pub fn check(&self) -> Result<Adaptive> {
        self.check_plant()?;
        let [n, _, _, p] = self.structure.sizes();
        let numbers = u128::from(self.trials) * self.reports() as u128 * (n + p) as u128;
        if numbers > LIMIT {
            return Err(Error::Limit {
                what: "the reports of all trials".into(),
                bytes: 8 * numbers,
                limit: 8 * LIMIT,
                remedy: "report less often, or run fewer trials",
            });
        }
        let one = vec![self.tuning.clone()];
        Adaptive::new(self.structure.clone(), self.settings.clone(), one).map_err(|e| match e {
            Error::AllFailed { source, .. } => *source,
            e => e,
        })
    }

    /// Checks what does not depend on the observer.
    fn check_plant(&self) -> Result<()> {
        let [_, m, q, _] = self.structure.sizes();
        let counts = [
            ("inputs", self.inputs.len(), m),
            ("noise of the inputs", self.input_noise.len(), m),
            ("noise of the outputs", self.output_noise.len(), q),
            ("outputs of the plant", self.truth.outputs, q),
        ];
        for (what, got, want) in counts {
            if got != want {
                return Err(Error::Shape { what: what.into(), want: [want, 1], got: [got, 1] });
            }
        }
        for &value in self.input_noise.iter().chain(&self.output_noise) {
            if !(value >= 0.0 && value.is_finite()) {
                let remedy = "give a standard deviation, zero or more".into();
                return Err(Error::Range { what: "noise".into(), value, remedy });
            }
        }
        if self.samples < 2 || self.trials == 0 {
            return Err(Error::Empty { what: "the run (two samples and one trial)".into() });
        }
        Ok(())
    }

    fn reports(&self) -> usize {
        let last = self.samples - 1;
        let regular = last.checked_div(self.every).unwrap_or(0);
        let extra = u64::from(self.every == 0 || !last.is_multiple_of(self.every));
        (regular + extra) as usize
    }

    /// True if sample `k`, from 0, is reported.
    fn reported(&self, k: u64) -> bool {
        k + 1 == self.samples || (self.every > 0 && k > 0 && k.is_multiple_of(self.every))
    }

    /// Runs the trials, eight to a block, blocks spread over threads.
    ///
    /// # Errors
    /// `Shape`, `Range`, `Empty`, `Limit`; what [`Field::path`] and [`Adaptive::new`]
    /// refuse, of the one observer; `AllFailed` if every trial runs away; `Cancelled`.
    pub fn run(&self, control: &RunControl<'_>) -> Result<AdaptiveSummary> {
        self.check()?;
        let samples = usize::try_from(self.samples).unwrap_or(usize::MAX);
        let path = self.truth.path(&self.x0, &self.inputs, self.settings.dt, samples, control)?;
        let tested = Settings { rank_test: false, ..self.settings.clone() };
        let eight =
            Adaptive::new(self.structure.clone(), tested, vec![self.tuning.clone(); LANES])?;
        let trials = usize::try_from(self.trials).unwrap_or(usize::MAX);
        let parts = par::try_map_chunks(control, trials, LANES, |range| {
            let mut course = Vec::new();
            let reports =
                self.block(&path, eight.clone(), range.start as u64, range.len(), &mut course)?;
            Ok((reports, course))
        })?;
        self.summary(&path, parts)
    }

    /// Every trial with every one of `tunings` in place of the observer's own, each whole:
    /// the plant, the noise and the bits of [`AdaptiveTrials::run`].
    ///
    /// `tolerance` is that of [`run_records`](crate::adaptive::run_records).
    ///
    /// # Errors
    /// `Shape`, `Range`, `Empty`, `Limit`; what [`Field::path`] refuses; as
    /// [`Adaptive::new`] where no tuning can be used; `Cancelled`.
    pub fn courses(
        &self,
        tunings: &[Tuning],
        tolerance: f64,
        control: &RunControl<'_>,
    ) -> Result<AdaptiveCourses> {
        self.check_plant()?;
        let samples = usize::try_from(self.samples).unwrap_or(usize::MAX);
        let reports: Vec<usize> = (0..samples).filter(|k| self.reported(*k as u64)).collect();
        let path = self.truth.path(&self.x0, &self.inputs, self.settings.dt, samples, control)?;
        let plan = Plan {
            structure: &self.structure,
            settings: &self.settings,
            tunings,
            sources: usize::try_from(self.trials).unwrap_or(usize::MAX),
            samples,
            intervals: &[],
            reports: &reports,
            tolerance,
        };
        let courses = plan.run(control, |trials| {
            let mut told = Told::new(self, &path, trials.start as u64);
            move |k: usize, u: &mut [f64], y: &mut [f64]| told.next(k, u, y)
        })?;
        let (n, settings) = (self.truth.states, &self.settings);
        Ok(AdaptiveCourses {
            t: reports.iter().map(|k| settings.t0 + *k as f64 * settings.dt).collect(),
            x: reports.iter().flat_map(|k| &path.x[k * n..][..n]).copied().collect(),
            courses,
            parts: path.parts,
            truth_error: path.error,
        })
    }

    /// Trials from `first` on: parameters and states at every report, shape (trial,
    /// report, p + n).
    fn block(
        &self,
        path: &Path,
        mut observers: Adaptive,
        first: u64,
        count: usize,
        course: &mut Vec<AdaptiveCourse>,
    ) -> Result<Vec<f64>> {
        let [n, m, q, p] = self.structure.sizes();
        let states = self.truth.states;
        let mut told = Told::new(self, path, first);
        let (mut u, mut y) = (vec![0.0; LANES * m], vec![0.0; LANES * q]);
        let reports = self.reports();
        let mut out = vec![f64::NAN; count * reports * (p + n)];
        let mut report = 0;
        for k in 0..self.samples {
            let row = k as usize;
            told.next(row, &mut u, &mut y);
            observers.step(&u, &y)?;
            if !self.reported(k) {
                continue;
            }
            for l in 0..count {
                let place = &mut out[(l * reports + report) * (p + n)..][..p + n];
                observers.theta_into(l, &mut place[..p]);
                place[p..].copy_from_slice(&observers.x_hat(l));
            }
            if first == 0 {
                course.push(AdaptiveCourse {
                    t: observers.time(),
                    x: path.x[row * states..][..states].to_vec(),
                    y: y[..q].to_vec(),
                    estimate: observers.estimate(0),
                });
            }
            report += 1;
        }
        Ok(out)
    }

    fn summary(
        &self,
        path: &Path,
        parts: Vec<(Vec<f64>, Vec<AdaptiveCourse>)>,
    ) -> Result<AdaptiveSummary> {
        let [n, _, _, p] = self.structure.sizes();
        let reports = self.reports();
        let mut course = Vec::new();
        let mut trials: Vec<Vec<f64>> = Vec::new();
        for (out, own) in parts {
            trials.extend(out.chunks_exact(reports * (p + n)).map(<[f64]>::to_vec));
            course.extend(own);
        }
        let sound: Vec<&Vec<f64>> =
            trials.iter().filter(|t| t.iter().all(|v| v.is_finite())).collect();
        let failed = (trials.len() - sound.len()) as u64;
        if sound.is_empty() {
            return Err(Error::AllFailed {
                what: "trials",
                count: trials.len(),
                source: Box::new(Error::NonFinite { what: "theta_hat".into(), row: 0, col: 0 }),
            });
        }
        let moment = |(r, at): (usize, &AdaptiveCourse)| {
            let column =
                |i: usize| -> Vec<f64> { sound.iter().map(|t| t[r * (p + n) + i]).collect() };
            let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
            let spread = |v: &[f64]| {
                let middle = mean(v);
                let squares: f64 = v.iter().map(|x| (x - middle) * (x - middle)).sum();
                (squares / (v.len().max(2) - 1) as f64).sqrt()
            };
            let columns: Vec<Vec<f64>> = (0..p + n).map(column).collect();
            AdaptiveMoment {
                t: at.t,
                mean: columns[..p].iter().map(|v| mean(v)).collect(),
                spread: columns[..p].iter().map(|v| spread(v)).collect(),
                quantiles: columns[..p].iter().map(|v| quantiles(v)).collect(),
                x_quantiles: columns[p..].iter().map(|v| quantiles(v)).collect(),
            }
        };
        Ok(AdaptiveSummary {
            record: course.iter().enumerate().map(moment).collect(),
            course,
            failed,
            parts: path.parts,
            truth_error: path.error,
        })
    }
}

/// Quantiles of a sample at [`LEVELS`], between neighbours in straight lines.
fn quantiles(values: &[f64]) -> [f64; 5] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    LEVELS.map(|level| {
        let at = level * (sorted.len() - 1) as f64;
        let low = at.floor() as usize;
        let high = (low + 1).min(sorted.len() - 1);
        sorted[low] + (at - low as f64) * (sorted[high] - sorted[low])
    })
}
