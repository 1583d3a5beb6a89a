//! Measurements at uneven times.

use std::collections::HashMap;

use super::Estimator;
use crate::bank::GainMode;
use crate::engine::Mmae;
use crate::model::Plant;

/// Longest gap between measurements, in sampling intervals.
const GAP: f64 = 1e6;
/// Intervals whose models are kept.
const INTERVALS: usize = 1000;

/// Time since the measurement before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Since {
    /// So many sampling intervals.
    Steps(u64),
    /// Seconds, not a whole number of intervals (within a thousandth), or too many.
    Seconds(f64),
}

impl Since {
    /// From measurement to measurement at the times `t`, one each; the first comes after
    /// an interval of `dt` seconds.
    pub fn all(t: &[f64], dt: f64) -> impl Iterator<Item = Since> + '_ {
        let between = move |k: usize| match k {
            0 => Since::Steps(1),
            k => Since::of(t[k] - t[k - 1], dt),
        };
        (0..t.len()).map(between)
    }

    fn of(seconds: f64, dt: f64) -> Self {
        let whole = (seconds / dt).round();
        if (seconds / dt - whole).abs() > 1e-3 || !(1.0..=GAP).contains(&whole) {
            return Since::Seconds(seconds);
        }
        Since::Steps(whole as u64)
    }
}

/// Why a bank cannot take the measurements at these times.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// Number of the measurement, from 0.
    pub at: usize,
    /// What is wrong with its time.
    pub message: String,
    /// What helps.
    pub remedy: &'static str,
}

impl Estimator {
    /// The time from each measurement to the next, for measurements at the times `t`.
    ///
    /// A gap of whole sampling intervals is so many measurements that are missing. Other
    /// intervals suit filters with a covariance recursion on sampled continuous plants,
    /// which are sampled anew for each ([`Estimator::models_over`]).
    ///
    /// # Errors
    /// The first measurement that the bank cannot take at its time.
    pub fn intervals(&self, t: &[f64], dt: f64) -> Result<Vec<Since>, Refusal> {
        let any = self.continuous.is_some() && self.settings.gains == GainMode::Recursive;
        let each = Since::all(t, dt).enumerate();
        each.map(|(at, since)| match since {
            Since::Seconds(seconds) if !any => Err(self.refuse(at, seconds, dt)),
            since => Ok(since),
        })
        .collect()
    }

    fn refuse(&self, at: usize, seconds: f64, dt: f64) -> Refusal {
        let long = seconds / dt > GAP;
        let remedy = if long {
            "split the record there"
        } else if self.continuous.is_some() {
            "give bank.P0 or gains = \"recursive\": steady gains are those of one interval"
        } else if self.members.observer.is_continuous() {
            "give the interval of the record as dt, or use observer = \"kalman\", which takes a \
             measurement at any time"
        } else {
            "give the sampling interval of the record as dt, or leave out the times"
        };
        let message = match long {
            true => format!("a gap of {seconds} s, over the limit of {GAP} sampling intervals"),
            false => format!("{seconds} s after the sample before, not a multiple of dt = {dt} s"),
        };
        Refusal { at, message, remedy }
    }
}

/// Brings a bank to the times of its measurements.
///
/// ```text
/// x' = A x + ..  over each interval:   x <- e^{A s} x,   P <- e^{A s} P e^{A' s} + Q(s)
/// ```
///
/// ```
/// use mmae::scenario::{Scenario, Since, Uneven};
/// # let text = "format = 1\n[plant]\ntime = 'continuous'\nstates = ['x']\ndisturbances = ['w']\n\
/// #     outputs = ['y']\nA = '-a'\nG = 1\nC = 1\nQ = 2\nR = 0.05\n[plant.parameters]\na = 0.1\n\
/// #     [bank]\nobserver = 'kalman'\ndt = 0.5\nP0 = 1\nmodels = { a = [0.1, 0.7] }\n";
/// // two models of a walk, measured every 0.5 s or when it happens to be
/// let estimator = Scenario::parse("walk.toml", text)?.estimator()?;
/// let run = |intervals: &[Since]| -> mmae::Result<f64> {
///     let mut mmae = estimator.start()?;
///     let mut uneven = Uneven::new(&estimator, &mmae);
///     for (since, y) in intervals.iter().zip([0.3, 0.9]) {
///         uneven.reach(&mut mmae, *since, &[])?;
///         mmae.step(&[], &[y])?;
///     }
///     Ok(mmae.estimate().log_lik_models[1])
/// };
/// // a second in one, or as two steps of which the first is not measured
/// let one = run(&[Since::Steps(1), Since::Seconds(1.0)])?;
/// let two = run(&[Since::Steps(1), Since::Steps(2)])?;
/// assert!((one - two).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Uneven<'e> {
    estimator: &'e Estimator,
    dt: f64,
    now: f64,
    /// Sampled models by the bits of the interval.
    made: HashMap<u64, Vec<Plant>>,
    missing: Vec<f64>,
}

impl<'e> Uneven<'e> {
    /// For the bank that `estimator` started.
    pub fn new(estimator: &'e Estimator, mmae: &Mmae) -> Self {
        let (dt, [_, _, q]) = (mmae.bank().dt(), mmae.bank().sizes());
        Self { estimator, dt, now: dt, made: HashMap::new(), missing: vec![f64::NAN; q] }
    }

    /// Readies `mmae` for the measurement that comes so long after the one before; `before`
    /// is the input meanwhile. The step with the measurement is the caller's.
    ///
    /// # Errors
    /// As [`Mmae::step`], [`Mmae::set_models`] and [`Estimator::models_over`].
    pub fn reach(&mut self, mmae: &mut Mmae, since: Since, before: &[f64]) -> crate::Result<()> {
        match since {
            Since::Steps(steps) => {
                self.set(self.dt, mmae)?;
                for _ in 1..steps {
                    mmae.step(before, &self.missing)?;
                }
                Ok(())
            }
            Since::Seconds(seconds) => self.set(seconds, mmae),
        }
    }

    /// Puts the filters to models over `seconds`.
    fn set(&mut self, seconds: f64, mmae: &mut Mmae) -> crate::Result<()> {
        if seconds.to_bits() == self.now.to_bits() {
            return Ok(());
        }
        self.now = seconds;
        if seconds.to_bits() == self.dt.to_bits() {
            return mmae.set_models(&self.estimator.members.plants);
        }
        if let Some(models) = self.made.get(&seconds.to_bits()) {
            return mmae.set_models(models);
        }
        let Some(models) = self.estimator.models_over(seconds)? else { return Ok(()) };
        mmae.set_models(&models)?;
        if self.made.len() < INTERVALS {
            self.made.insert(seconds.to_bits(), models);
        }
        Ok(())
    }
}
