//! Courses of many observers: what each said, part by part of the work.

use std::ops::Range;

use super::batch::Adaptive;
use super::check;
use super::identify::{Identifiability, identifiability};
use super::plant::{Settings, Structure, Tuning};
use crate::error::{Error, Result};
use crate::par::{self, RunControl};
use crate::simd::LANES;

/// Most numbers that all courses together may hold.
const LIMIT: u128 = 1 << 27;
/// Tunings of a part of work.
const TUNINGS: usize = LANES;
/// Samples between two looks at whether to stop.
const PIECE: usize = 1024;

/// What observers said along records, arrays in C order with the dimensions (tuning,
/// record, report) in front.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Courses {
    /// `theta_hat`, shape (.., parameter).
    pub theta: Vec<f64>,
    /// Its standard deviations.
    pub theta_std: Vec<f64>,
    /// Its correlation, shape (.., parameter, parameter).
    pub correlation: Vec<f64>,
    /// Parameters that stand on a bound.
    pub at_bound: Vec<bool>,
    /// `x_hat`, shape (.., state).
    pub x_hat: Vec<f64>,
    /// Its standard deviations as far as they come from `theta_hat`.
    pub x_std: Vec<f64>,
    /// End of the last complete window in seconds, shape (..).
    pub window: Vec<f64>,
    /// Condition of the excitation in it.
    pub condition: Vec<f64>,
    /// Root mean square of the residuals in it.
    pub residual: Vec<f64>,
    /// Largest relative change of a parameter over it.
    pub drift: Vec<f64>,
    /// Where [`Estimate::is_settled`](super::Estimate::is_settled).
    pub settled: Vec<bool>,
    /// False for a course that ran away, or that there is none of; shape (tuning, record).
    pub sound: Vec<bool>,
    /// Outputs at the reports, shape (record, report, output).
    pub y: Vec<f64>,
    /// Why a tuning cannot be used.
    pub failures: Vec<Option<Error>>,
    /// What the rank test of each found, where it was made.
    pub identifiability: Vec<Option<Identifiability>>,
}

type Tested = (Vec<Option<Error>>, Vec<Option<Identifiability>>);

/// What the parts of work have in common.
pub(crate) struct Plan<'a> {
    pub(crate) structure: &'a Structure,
    pub(crate) settings: &'a Settings,
    pub(crate) tunings: &'a [Tuning],
    /// Records or trials.
    pub(crate) sources: usize,
    pub(crate) samples: usize,
    pub(crate) intervals: &'a [u64],
    pub(crate) reports: &'a [usize],
    pub(crate) tolerance: f64,
}

impl Plan<'_> {
    /// All courses. `open` gives what writes sample `k` of its sources, eight at most: the
    /// inputs and the outputs, a row a source.
    pub(crate) fn run<S: FnMut(usize, &mut [f64], &mut [f64])>(
        &self,
        control: &RunControl<'_>,
        open: impl Fn(Range<usize>) -> S + Sync,
    ) -> Result<Courses> {
        self.check()?;
        let (failures, found) = self.test(control)?;
        let usable: Vec<usize> = (0..failures.len()).filter(|i| failures[*i].is_none()).collect();
        let columns = self.sources.div_ceil(LANES);
        let parts = usable.len().div_ceil(TUNINGS) * columns;
        let done = par::try_map_chunks(control, parts, 1, |part| {
            let (row, column) = (part.start / columns, part.start % columns);
            let own = &usable[row * TUNINGS..usable.len().min((row + 1) * TUNINGS)];
            let sources = column * LANES..self.sources.min((column + 1) * LANES);
            let read = open(sources.clone());
            Ok((own, sources.clone(), self.part(own, sources.len(), read, control)?))
        })?;
        let mut all = self.blank(failures.len(), self.sources);
        (all.failures, all.identifiability) = (failures, found);
        for (own, sources, part) in done {
            for (i, tuning) in own.iter().enumerate() {
                let to = tuning * self.sources + sources.start;
                all.take(&part, to, i * sources.len(), sources.len());
            }
            if own.first() == usable.first() {
                let width = part.y.len() / sources.len();
                all.y[sources.start * width..][..part.y.len()].copy_from_slice(&part.y);
            }
        }
        Ok(all)
    }

    /// Tests the tunings; an error if none can be used. Rank tests take milliseconds: those
    /// of many gains are spread over threads.
    fn test(&self, control: &RunControl<'_>) -> Result<Tested> {
        let quick = Settings { rank_test: false, ..self.settings.clone() };
        let whole = Adaptive::new(self.structure.clone(), quick, self.tunings.to_vec())?;
        let mut failures = whole.failures().to_vec();
        let mut found = vec![None; failures.len()];
        if !self.settings.rank_test {
            return Ok((failures, found));
        }
        // one test for all that differ in how they adapt alone
        let sound: Vec<usize> = (0..failures.len()).filter(|i| failures[*i].is_none()).collect();
        let mut firsts: Vec<usize> = Vec::new();
        let mut test_of = vec![0; failures.len()];
        for &i in &sound {
            let alike = |j: &usize| check::alike(&self.tunings[i], &self.tunings[*j]);
            let known = firsts.iter().position(alike);
            test_of[i] = known.unwrap_or(firsts.len());
            if known.is_none() {
                firsts.push(i);
            }
        }
        let quiet = RunControl { progress: None, ..*control };
        let tests = par::map_chunks(&quiet, firsts.len(), 1, |k| {
            identifiability(self.structure, &self.tunings[firsts[k.start]])
        })?;
        for &i in &sound {
            match &tests[test_of[i]] {
                Ok(test) => {
                    failures[i] = check::verdict(test);
                    found[i] = Some(test.clone());
                }
                Err(error) => failures[i] = Some(error.clone()),
            }
        }
        match failures.iter().flatten().next() {
            Some(first) if failures.iter().all(Option::is_some) => Err(Error::AllFailed {
                what: "observers",
                count: failures.len(),
                source: Box::new(first.clone()),
            }),
            _ => Ok((failures, found)),
        }
    }

    fn check(&self) -> Result<()> {
        let falls = self.reports.windows(2).any(|w| w[0] >= w[1]);
        let past = self.reports.last().is_none_or(|last| *last >= self.samples);
        if falls || past {
            let value = self.reports.last().map_or(f64::NAN, |v| *v as f64);
            let remedy = format!("give samples from 0 to {}, rising", self.samples - 1);
            return Err(Error::Range { what: "the samples to report".into(), value, remedy });
        }
        if self.tolerance.is_nan() || self.tolerance < 0.0 {
            let remedy = "give a relative drift, zero or more".into();
            return Err(Error::Range { what: "tolerance".into(), value: self.tolerance, remedy });
        }
        let [n, _, _, p] = self.structure.sizes();
        let courses = (self.tunings.len() * self.sources) as u128;
        let numbers = courses * self.reports.len() as u128 * (p * p + 3 * p + 2 * n + 5) as u128;
        if numbers > LIMIT {
            return Err(Error::Limit {
                what: "the courses".into(),
                bytes: 8 * numbers,
                limit: 8 * LIMIT,
                remedy: "report less often, or run fewer at once",
            });
        }
        Ok(())
    }

    /// Room for so many courses; NaN where nothing is written.
    fn blank(&self, tunings: usize, sources: usize) -> Courses {
        let [n, _, q, p] = self.structure.sizes();
        let rows = tunings * sources * self.reports.len();
        let numbers = |width: usize| vec![f64::NAN; rows * width];
        Courses {
            theta: numbers(p),
            theta_std: numbers(p),
            correlation: numbers(p * p),
            at_bound: vec![false; rows * p],
            x_hat: numbers(n),
            x_std: numbers(n),
            window: numbers(1),
            condition: numbers(1),
            residual: numbers(1),
            drift: numbers(1),
            settled: vec![false; rows],
            sound: vec![false; tunings * sources],
            y: vec![f64::NAN; sources * self.reports.len() * q],
            failures: Vec::new(),
            identifiability: Vec::new(),
        }
    }

    /// The courses of some tunings along `count` sources.
    fn part(
        &self,
        own: &[usize],
        count: usize,
        mut read: impl FnMut(usize, &mut [f64], &mut [f64]),
        control: &RunControl<'_>,
    ) -> Result<Courses> {
        let [_, m, q, _] = self.structure.sizes();
        let each = |i: &usize| std::iter::repeat_n(self.tunings[*i].clone(), count);
        let tested = Settings { rank_test: false, ..self.settings.clone() };
        let items: Vec<Tuning> = own.iter().flat_map(each).collect();
        let mut observers = Adaptive::new(self.structure.clone(), tested, items)?;
        let mut out = self.blank(own.len(), count);
        let (mut u, mut y) = (vec![0.0; count * m], vec![0.0; count * q]);
        let mut before = Vec::new();
        let mut report = 0;
        for k in 0..self.samples {
            if k % PIECE == 0 && control.is_cancelled() {
                return Err(Error::Cancelled);
            }
            read(k, &mut u, &mut y);
            let (all_u, all_y) = (u.repeat(own.len()), y.repeat(own.len()));
            let intervals = self.intervals.get(k).map_or(1, |n| *n);
            observers.step_after(if k == 0 { 1 } else { intervals }, &before, &all_u, &all_y)?;
            before = all_u;
            if self.reports.get(report) == Some(&k) {
                self.write(&mut out, &observers, report);
                for source in 0..count {
                    let to = (source * self.reports.len() + report) * q;
                    out.y[to..][..q].copy_from_slice(&y[source * q..][..q]);
                }
                report += 1;
            }
        }
        for (item, sound) in out.sound.iter_mut().enumerate() {
            *sound = observers.is_sound(item);
        }
        Ok(out)
    }

    /// What every observer says now.
    fn write(&self, out: &mut Courses, observers: &Adaptive, report: usize) {
        let [n, _, _, p] = self.structure.sizes();
        for item in 0..observers.len() {
            let e = observers.estimate(item);
            let row = item * self.reports.len() + report;
            out.theta[row * p..][..p].copy_from_slice(&e.theta);
            out.theta_std[row * p..][..p].copy_from_slice(&e.std);
            for (k, entry) in out.correlation[row * p * p..][..p * p].iter_mut().enumerate() {
                *entry = e.correlation[(k / p, k % p)];
            }
            out.at_bound[row * p..][..p].copy_from_slice(&e.at_bound);
            out.x_hat[row * n..][..n].copy_from_slice(&e.x_hat);
            out.x_std[row * n..][..n].copy_from_slice(&e.x_std);
            out.window[row] = e.window.t;
            out.condition[row] = e.window.condition;
            out.residual[row] = e.window.residual;
            out.drift[row] = e.window.drift;
            out.settled[row] = e.is_settled(self.tolerance);
        }
    }
}

impl Courses {
    /// Copies `count` courses of `part` from number `from` on to number `to` on.
    fn take(&mut self, part: &Self, to: usize, from: usize, count: usize) {
        fn copy<T: Copy>(to: &mut [T], from: &[T], [a, b, count, all]: [usize; 4]) {
            let width = from.len() / all;
            to[a * width..][..count * width].copy_from_slice(&from[b * width..][..count * width]);
        }
        let at = [to, from, count, part.sound.len()];
        copy(&mut self.theta, &part.theta, at);
        copy(&mut self.theta_std, &part.theta_std, at);
        copy(&mut self.correlation, &part.correlation, at);
        copy(&mut self.at_bound, &part.at_bound, at);
        copy(&mut self.x_hat, &part.x_hat, at);
        copy(&mut self.x_std, &part.x_std, at);
        copy(&mut self.window, &part.window, at);
        copy(&mut self.condition, &part.condition, at);
        copy(&mut self.residual, &part.residual, at);
        copy(&mut self.drift, &part.drift, at);
        copy(&mut self.settled, &part.settled, at);
        copy(&mut self.sound, &part.sound, at);
    }
}
