//! Trials of a bank that is re-centred, beside the same bank left alone.

use std::sync::Arc;

use super::alone::Simulate;
use super::monte_carlo::MonteCarlo;
use crate::adaptive::{Adaptive, Settings, Structure, Tuning};
use crate::engine::{Mmae, Move, Recentre, Recentred};
use crate::error::{Error, Result};
use crate::par::{self, RunControl};
use crate::simd::{Block, LANES, dispatch, load_group};

/// Parameter values of a model at `theta_hat` of the adaptive observer.
pub type ValuesAt = Arc<dyn Fn(&[f64]) -> Vec<f64> + Send + Sync>;

/// A Monte-Carlo experiment with an adaptive observer beside the bank.
#[derive(Clone)]
pub struct RecentringTrials {
    /// Bank, truth and trials.
    pub experiment: MonteCarlo,
    /// What the adaptive observer does not know.
    pub structure: Structure,
    /// How it is run.
    pub settings: Settings,
    /// The observer.
    pub tuning: Tuning,
    /// When the bank is re-centred.
    pub rule: Recentre,
    /// Values of a model that is built at `theta_hat`, as in
    /// [`MonteCarlo::values`].
    pub values: ValuesAt,
}

/// One trial.
#[derive(Debug, Clone, PartialEq)]
pub struct RecentringTrial {
    /// Its number.
    pub trial: u64,
    /// Members that were replaced.
    pub moves: Vec<Move>,
    /// Values of the models at the end.
    pub values: Vec<Vec<f64>>,
    /// `sum p_i theta_i` of bank alone and re-centred, at the end.
    pub theta_hat: [Vec<f64>; 2],
    /// Root mean square of `|x - x_hat|` after the first move (over the second half of
    /// the trial where there was none).
    pub x_error: [f64; 2],
    /// The last estimate of the adaptive observer.
    pub adaptive: Vec<f64>,
}

impl RecentringTrials {
    /// Sees that the trials could begin.
    ///
    /// # Errors
    /// As [`Recentred::new`].
    pub fn check(&self) -> Result<()> {
        self.beside().map(|_| ())
    }

    /// The bank with the adaptive observer beside it, at the start.
    fn beside(&self) -> Result<Recentred> {
        let e = &self.experiment;
        let one = vec![self.tuning.clone()];
        let adaptive = Adaptive::new(self.structure.clone(), self.settings.clone(), one).map_err(
            |e| match e {
                Error::AllFailed { source, .. } => *source,
                e => e,
            },
        )?;
        let (members, rule) = (e.members.clone(), self.rule.clone());
        Recentred::new(members, e.settings.clone(), &e.weighting, &e.prior, adaptive, rule)
    }

    /// Runs the trials; the same bits for any number of threads.
    ///
    /// # Errors
    /// As [`MonteCarlo::run`] and [`Recentred::new`].
    pub fn run(&self, control: &RunControl<'_>) -> Result<Vec<RecentringTrial>> {
        let e = &self.experiment;
        let alone = Mmae::new(&e.members, &e.settings, &e.weighting, &e.prior)?;
        let beside = self.beside()?;
        let trials = usize::try_from(e.trials).unwrap_or(usize::MAX);
        let plan = e.plan(&alone, control)?;
        let parts = par::try_map_chunks(control, trials, LANES, |range| {
            let mut each: Vec<Pair> = range
                .clone()
                .map(|trial| Pair::new(trial as u64, &alone, &beside, e.steps))
                .collect();
            let mut sink = |k: u64, x: &[Block], u: &[Block], y: &[Block]| -> Result<()> {
                for (l, pair) in each.iter_mut().enumerate() {
                    pair.step(k, l, x, u, y)?;
                }
                Ok(())
            };
            dispatch(Simulate { plan: &plan, first: range.start as u64, sink: &mut sink })?;
            Ok(each)
        })?;
        Ok(parts.into_iter().flatten().map(|pair| pair.finish(self)).collect())
    }
}

/// The two banks of a trial.
struct Pair {
    trial: u64,
    alone: Mmae,
    beside: Recentred,
    steps: u64,
    u: Vec<f64>,
    y: Vec<f64>,
    x: Vec<f64>,
    /// Input of the step before.
    before: Option<Vec<f64>>,
    squares: [f64; 2],
    count: f64,
    /// The same over the second half.
    late: [f64; 2],
    late_count: f64,
}

impl Pair {
    fn new(trial: u64, alone: &Mmae, beside: &Recentred, steps: u64) -> Self {
        let [n, m, q] = alone.bank().sizes();
        Self {
            trial,
            alone: alone.clone(),
            beside: beside.clone(),
            steps,
            u: vec![0.0; m],
            y: vec![0.0; q],
            x: vec![0.0; n],
            before: None,
            squares: [0.0; 2],
            count: 0.0,
            late: [0.0; 2],
            late_count: 0.0,
        }
    }

    fn step(&mut self, k: u64, l: usize, x: &[Block], u: &[Block], y: &[Block]) -> Result<()> {
        if !u.is_empty() {
            load_group(u, l, &mut self.u);
        }
        load_group(y, l, &mut self.y);
        let mut state = vec![0.0; x.len()];
        load_group(x, l, &mut state);
        // the input is held: between two steps its line runs through the mean
        let before = self.before.get_or_insert_with(|| self.u.clone());
        let now: Vec<f64> = before.iter().zip(&self.u).map(|(a, b)| 0.5 * (a + b)).collect();
        before.copy_from_slice(&self.u);
        self.alone.step(&self.u, &self.y)?;
        self.beside.step(&self.u, &self.y, &now)?;
        let common = self.x.len().min(state.len());
        let error = |estimate: &[f64]| {
            let pairs = state[..common].iter().zip(estimate);
            pairs.map(|(x, e)| (x - e) * (x - e)).sum::<f64>()
        };
        let both =
            [error(&self.alone.estimate().x_hat), error(&self.beside.mmae().estimate().x_hat)];
        if !self.beside.moves().is_empty() {
            self.count += 1.0;
            self.squares.iter_mut().zip(both).for_each(|(sum, e)| *sum += e);
        }
        if 2 * k > self.steps {
            self.late_count += 1.0;
            self.late.iter_mut().zip(both).for_each(|(sum, e)| *sum += e);
        }
        Ok(())
    }

    fn finish(self, of: &RecentringTrials) -> RecentringTrial {
        let first = &of.experiment.values;
        let mut values = first.clone();
        for moved in self.beside.moves() {
            if let Some(place) = values.get_mut(moved.member) {
                *place = (of.values)(&moved.theta);
            }
        }
        let mean = |p: &[f64], values: &[Vec<f64>]| -> Vec<f64> {
            let width = values.first().map_or(0, Vec::len);
            let weighed = || p.iter().zip(values).filter(|(p, _)| **p > 0.0);
            (0..width).map(|k| weighed().map(|(p, v)| p * v[k]).sum()).collect()
        };
        let moved = self.count > 0.0;
        let (sums, count) =
            if moved { (self.squares, self.count) } else { (self.late, self.late_count) };
        RecentringTrial {
            trial: self.trial,
            moves: self.beside.moves().to_vec(),
            theta_hat: [
                mean(&self.alone.estimate().p, first),
                mean(&self.beside.mmae().estimate().p, &values),
            ],
            values,
            x_error: sums.map(|s| (s / count).sqrt()),
            adaptive: self.beside.adaptive().theta(0),
        }
    }
}
