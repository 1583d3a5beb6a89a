//! Many records at once, for tools that sweep.

use std::ops::Range;

use super::lanes::Eight;
use super::mmae::Mmae;
use crate::bank::Schedule;
use crate::error::{Error, Result};
use crate::model::check_signals;
use crate::par::{RunControl, map_parts};
use crate::simd::{LANES, dispatch};

/// Records of a part of work.
const CHUNK: usize = 4 * LANES;

/// Signals of many records of one length, arrays in C order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Arrays<'a> {
    /// How many records.
    pub records: usize,
    /// Measurements of each, at least one.
    pub steps: usize,
    /// Outputs, shape (record, step, output); NaN for what is missing.
    pub y: &'a [f64],
    /// Inputs, shape (record, step, input), or (step, input) if all records have
    /// the same, or empty for zero.
    pub u: &'a [f64],
    /// Report every so many steps, 0 for the end only; the end always is.
    pub every: usize,
}

/// What the engine says of many records.
#[derive(Debug, Clone, PartialEq)]
pub struct Courses {
    /// The steps that are reported, from 1.
    pub steps: Vec<usize>,
    /// Logarithms of the weights, shape (record, report, model).
    pub log_p: Vec<f64>,
    /// Fused estimates, shape (record, report, state).
    pub x_hat: Vec<f64>,
    /// Log-likelihood of each record under the mixture, the sum of
    /// [`Estimate::log_lik`](super::Estimate::log_lik); NaN for laws that do not
    /// work with likelihoods.
    pub log_lik: Vec<f64>,
    /// Log-likelihood of each record under each model, shape (record, model).
    pub log_lik_models: Vec<f64>,
    /// Members that failed, shape (record, model). A record without any other has
    /// NaN from where the last one failed.
    pub failed: Vec<bool>,
}

impl Arrays<'_> {
    pub(super) fn reports(&self) -> Vec<usize> {
        let every = if self.every == 0 { self.steps } else { self.every };
        let mut steps: Vec<usize> = (every..=self.steps).step_by(every).collect();
        if steps.last() != Some(&self.steps) {
            steps.push(self.steps);
        }
        steps
    }

    /// The measurement of a record at a step, from 0.
    #[inline(always)]
    pub(super) fn y(&self, q: usize, record: usize, k: usize) -> &[f64] {
        &self.y[(record * self.steps + k) * q..][..q]
    }

    /// The input of a record at a step, from 0; empty for zero.
    #[inline(always)]
    pub(super) fn u(&self, m: usize, record: usize, k: usize) -> &[f64] {
        if self.u.is_empty() || m == 0 {
            return &[];
        }
        let shared = self.u.len() == self.steps * m;
        let row = if shared { k } else { record * self.steps + k };
        &self.u[row * m..][..m]
    }

    /// Fails for arrays of other shapes, or with numbers that no record can have.
    pub(super) fn check(&self, m: usize, q: usize) -> Result<()> {
        self.check_shapes(m, q)?;
        self.check_numbers(m, q)
    }

    pub(super) fn check_numbers(&self, m: usize, q: usize) -> Result<()> {
        check_signals(self.y, self.u, self.steps, [m, q])
    }

    pub(super) fn check_shapes(&self, m: usize, q: usize) -> Result<()> {
        if self.steps == 0 {
            let remedy = "give at least one".into();
            return Err(Error::Range { what: "steps".into(), value: 0.0, remedy });
        }
        let rows = self.records * self.steps;
        let shape = |what: &str, cols, got| {
            Err(Error::Shape { what: what.into(), want: [rows, cols], got: [1, got] })
        };
        if self.y.len() != rows * q {
            return shape("y of the records", q, self.y.len());
        }
        let inputs = self.u.len();
        if !(inputs == 0 || inputs == rows * m || inputs == self.steps * m) {
            return shape("u of the records", m, inputs);
        }
        Ok(())
    }
}

/// Where the results of some records go.
pub(super) struct Part<'a> {
    pub(super) records: Range<usize>,
    pub(super) log_p: &'a mut [f64],
    pub(super) x_hat: &'a mut [f64],
    pub(super) log_lik: &'a mut [f64],
    pub(super) log_lik_models: &'a mut [f64],
    pub(super) failed: &'a mut [bool],
}

impl Mmae {
    /// Runs many records, each from the start, whatever the engine went through:
    /// by bits what [`Mmae::reset`] and [`Mmae::step`] make of each.
    ///
    /// Records stand in lanes, eight at a time, where covariances do not depend on
    /// the data: discrete filters, states that are not mixed. Records with missing
    /// samples or a member that runs away, and all records of other engines, go
    /// through [`Mmae::step`] one by one. A record is the same in any company and
    /// for any number of threads.
    ///
    /// ```
    /// use mmae::bank::Members;
    /// use mmae::engine::{Arrays, Mmae, Weighting};
    /// use mmae::model::{Plant, Time};
    /// use mmae::observer::ObserverKind;
    /// use mmae::par::RunControl;
    /// use mmae::{Mat, mat};
    /// let level = |r: f64| Plant {
    ///     time: Time::Discrete { dt: 1.0 },
    ///     A: mat![[1.0]], B: Mat::zeros(1, 0), G: mat![[1.0]], C: mat![[1.0]],
    ///     Q: mat![[0.01]], R: mat![[r]],
    /// };
    /// let members = Members::new(ObserverKind::Kalman, vec![level(0.1), level(10.0)]);
    /// let weighting = Weighting::default();
    /// let mut mmae = Mmae::new(&members, &Default::default(), &weighting, &[1.0, 1.0])?;
    /// // 20 records of 30 samples
    /// let y: Vec<f64> = (0..600).map(|k| ((k * k) as f64 * 0.7).sin()).collect();
    /// let arrays = Arrays { records: 20, steps: 30, y: &y, ..Arrays::default() };
    /// let all = mmae.run_arrays(&arrays, &RunControl::default())?;
    /// assert_eq!(all.log_p.len(), 20 * 1 * 2);
    /// let one = mmae.run(&[], &y[90..120])?; // the fourth
    /// assert_eq!(all.log_p[6..8], one.log_p[58..60]);
    /// # Ok::<(), mmae::Error>(())
    /// ```
    ///
    /// # Errors
    /// `Shape`; `Range` without steps; `NonFinite` for an infinite output or an
    /// input that is no number; `Limit` for gains of more steps than fit in
    /// memory; `Cancelled`.
    pub fn run_arrays(&self, arrays: &Arrays<'_>, control: &RunControl<'_>) -> Result<Courses> {
        let [n, m, q] = self.bank().sizes();
        let models = self.bank().models();
        arrays.check(m, q)?;
        let steps = arrays.reports();
        let (records, reports) = (arrays.records, steps.len());
        let mut out = Courses {
            log_p: vec![f64::NAN; records * reports * models],
            x_hat: vec![f64::NAN; records * reports * n],
            log_lik: vec![0.0; records],
            log_lik_models: vec![0.0; records * models],
            failed: vec![false; records * models],
            steps,
        };
        let schedule = match self.in_lanes() {
            true => Some(self.schedule(arrays.steps as u64)?),
            false => None,
        };
        let parts: Vec<Part<'_>> = out
            .log_p
            .chunks_mut(CHUNK * reports * models)
            .zip(out.x_hat.chunks_mut(CHUNK * reports * n))
            .zip(out.log_lik.chunks_mut(CHUNK))
            .zip(out.log_lik_models.chunks_mut(CHUNK * models))
            .zip(out.failed.chunks_mut(CHUNK * models))
            .enumerate()
            .map(|(i, ((((log_p, x_hat), log_lik), log_lik_models), failed))| {
                let records = i * CHUNK..i * CHUNK + log_lik.len();
                Part { records, log_p, x_hat, log_lik, log_lik_models, failed }
            })
            .collect();
        let work = |_: usize, part: Part<'_>| self.part(arrays, schedule.as_ref(), part);
        map_parts(control, parts, |part| part.records.len(), work)?
            .into_iter()
            .collect::<Result<()>>()?;
        Ok(out)
    }

    /// Some records: in lanes what can be, the rest one by one.
    fn part(
        &self,
        arrays: &Arrays<'_>,
        schedule: Option<&Schedule>,
        mut part: Part<'_>,
    ) -> Result<()> {
        let count = part.records.len();
        let q = self.bank().sizes()[2];
        let mut left = vec![true; count];
        if let Some(schedule) = schedule {
            for start in (0..count).step_by(LANES) {
                let valid = LANES.min(count - start);
                let whole = |l: usize| {
                    let first = (part.records.start + start + l) * arrays.steps * q;
                    arrays.y[first..][..arrays.steps * q].iter().all(|v| !v.is_nan())
                };
                let whole: [bool; LANES] = std::array::from_fn(|l| l < valid && whole(l));
                if !whole.contains(&true) {
                    continue;
                }
                let done = dispatch(Eight {
                    engine: self,
                    arrays,
                    schedule,
                    start,
                    valid,
                    out: &mut part,
                });
                for l in 0..valid {
                    left[start + l] = !(whole[l] && done[l]);
                }
            }
        }
        if !left.contains(&true) {
            return Ok(());
        }
        let mut engine = self.clone();
        for i in (0..count).filter(|&i| left[i]) {
            engine.alone(arrays, i, &mut part)?;
        }
        Ok(())
    }

    /// One record, number `i` of the part, by [`Mmae::step`].
    fn alone(&mut self, arrays: &Arrays<'_>, i: usize, part: &mut Part<'_>) -> Result<()> {
        let [n, m, q] = self.bank().sizes();
        let models = self.bank().models();
        let record = part.records.start + i;
        let idle = vec![0.0; m];
        let reports = arrays.reports();
        let mut report = 0;
        let mut log_lik = 0.0;
        self.reset();
        for k in 0..arrays.steps {
            let u = arrays.u(m, record, k);
            match self.step(if u.is_empty() { &idle } else { u }, arrays.y(q, record, k)) {
                Ok(e) => log_lik += e.log_lik,
                // no estimate is left: what follows stays NaN
                Err(Error::AllFailed { .. }) => {
                    log_lik = f64::NAN;
                    for at in report..reports.len() {
                        let row = i * reports.len() + at;
                        part.log_p[row * models..][..models].fill(f64::NAN);
                        part.x_hat[row * n..][..n].fill(f64::NAN);
                    }
                    break;
                }
                Err(e) => return Err(e),
            }
            if reports[report] == k + 1 {
                let e = self.estimate();
                let row = i * reports.len() + report;
                part.log_p[row * models..][..models].copy_from_slice(&e.log_p);
                part.x_hat[row * n..][..n].copy_from_slice(&e.x_hat);
                report += 1;
            }
        }
        let e = self.estimate();
        part.log_lik[i] = log_lik;
        part.log_lik_models[i * models..][..models].copy_from_slice(&e.log_lik_models);
        part.failed[i * models..][..models].copy_from_slice(&e.failed);
        Ok(())
    }
}
