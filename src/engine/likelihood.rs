//! Log-likelihoods of many records under every model, without weights.

use super::arrays::Arrays;
use super::mmae::Mmae;
use super::weighting::Innovation;
use crate::bank::{Schedule, Tile};
use crate::error::Result;
use crate::par::{RunControl, map_parts};
use crate::real::Real;
use crate::simd::{Kernel, LANES, dispatch, prefetch};
use crate::weight::Law;

/// Records of a part of work.
const CHUNK: usize = 64;
/// Steps whose measurements are brought into lanes at a time.
const TILE: usize = 32;

impl Mmae {
    /// Log-likelihood of each record under each model, shape (record, model): what
    /// [`Mmae::run_arrays`] returns as
    /// [`Courses::log_lik_models`](super::Courses::log_lik_models), by bits, without
    /// weights and estimates; [`posterior`](crate::weight::posterior) makes weights of them.
    ///
    /// ```text
    /// l_i = sum_k ln N(r_i(k); 0, S_i(k)),   p_i ~ p_i(0) e^{l_i}
    /// ```
    /// Several times as fast where all models are discrete filters, nothing is mixed
    /// and the records have neither inputs nor missing samples.
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
    /// let mmae = Mmae::new(&members, &Default::default(), &weighting, &[1.0, 1.0])?;
    /// let y: Vec<f64> = (0..600).map(|k| ((k * k) as f64 * 0.7).sin()).collect();
    /// let arrays = Arrays { records: 20, steps: 30, y: &y, ..Arrays::default() };
    /// let control = RunControl::default();
    /// let log_lik = mmae.log_likelihoods(&arrays, &control)?;
    /// assert_eq!(log_lik, mmae.run_arrays(&arrays, &control)?.log_lik_models);
    /// # Ok::<(), mmae::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Mmae::run_arrays`].
    pub fn log_likelihoods(
        &self,
        arrays: &Arrays<'_>,
        control: &RunControl<'_>,
    ) -> Result<Vec<f64>> {
        let [_, m, q] = self.bank().sizes();
        let models = self.bank().models();
        let plain = self.in_lanes()
            && matches!(self.law(), Law::Bayes | Law::Dwsg { .. } | Law::Zhang { .. })
            && *self.innovation() == Innovation::Filter
            && arrays.u.is_empty();
        arrays.check_shapes(m, q)?;
        let schedule = if plain { Some(self.schedule(arrays.steps as u64)?) } else { None };
        let whole = schedule.as_ref().filter(|s| s.of_all(0).is_some());
        let Some(schedule) = whole else {
            let ends = Arrays { every: 0, ..*arrays };
            return Ok(self.run_arrays(&ends, control)?.log_lik_models);
        };
        // A number that is not finite shows in the totals of its record, if any model is left:
        // to look for it before would read all records once more, a tenth of the time.
        if self.bank().failures().iter().all(Option::is_some) {
            arrays.check_numbers(m, q)?;
        }
        let mut out = vec![f64::NAN; arrays.records * models];
        let parts: Vec<(usize, &mut [f64])> = out
            .chunks_mut(CHUNK * models)
            .enumerate()
            .map(|(i, totals)| (i * CHUNK, totals))
            .collect();
        let work = |_: usize, (first, totals): (usize, &mut [f64])| {
            dispatch(Totals { engine: self, arrays, schedule, first, totals: &mut *totals });
            self.repair(arrays, first, totals)
        };
        map_parts(control, parts, |part| part.1.len(), work)?
            .into_iter()
            .collect::<Result<()>>()?;
        Ok(out)
    }

    /// Does the records with missing samples, and those of which a number is not
    /// finite, by the whole engine; fails for an infinite measurement.
    fn repair(&self, arrays: &Arrays<'_>, first: usize, totals: &mut [f64]) -> Result<()> {
        let (models, q) = (self.bank().models(), self.bank().sizes()[2]);
        let failures = self.bank().failures();
        let each = arrays.steps * q;
        for (k, row) in totals.chunks_mut(models).enumerate() {
            for (total, failure) in row.iter_mut().zip(failures) {
                *total = if failure.is_some() { f64::NAN } else { *total };
            }
            let bad =
                |(total, failure): (&f64, &Option<_>)| failure.is_none() && !total.is_finite();
            if !row.iter().zip(failures).any(bad) {
                continue;
            }
            let y = &arrays.y[(first + k) * each..][..each];
            if y.iter().any(|v| v.is_infinite()) {
                arrays.check_numbers(0, q)?;
            }
            let one = Arrays { records: 1, y, every: 0, ..*arrays };
            let control = RunControl::default().threads(1);
            row.copy_from_slice(&self.run_arrays(&one, &control)?.log_lik_models);
        }
        Ok(())
    }
}

/// The records from `first` on, as many as there are rows of totals.
struct Totals<'a> {
    engine: &'a Mmae,
    arrays: &'a Arrays<'a>,
    schedule: &'a Schedule,
    first: usize,
    /// Shape (record, model).
    totals: &'a mut [f64],
}

impl Kernel for Totals<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(mut self) {
        // a coefficient that is loaded serves so many vectors of records
        if const { T::TILE == 4 } {
            match (self.schedule.n, self.schedule.q) {
                (4..=6, 1..=2) => self.records::<T, 2>(),
                _ => self.records::<T, 4>(),
            }
        } else {
            // eight lanes are two registers already, and there are sixteen
            self.records::<T, 1>();
        }
    }
}

impl Totals<'_> {
    #[inline(always)]
    fn records<T: Real, const V: usize>(&mut self) {
        let Schedule { n, q, .. } = *self.schedule;
        let bank = self.engine.bank();
        let models = bank.models();
        let count = self.totals.len() / models;
        let room = |len: usize| vec![T::zero(); len * V];
        let (mut x, mut total, mut y) = (room(models * n), room(models), room(TILE * q));
        let mut scratch = Vec::new();
        let mut start = vec![0.0; n];
        for from in (0..count).step_by(V * T::LANES) {
            for i in 0..models {
                bank.first_x_hat_into(i, &mut start);
                for j in 0..n {
                    for v in 0..V {
                        x[(i * n + j) * V + v] = T::splat(start[j]);
                    }
                }
            }
            for t in total.iter_mut() {
                *t = T::zero();
            }
            let mut k = 0;
            while k < self.arrays.steps {
                // the first step may differ: alone
                let most = if k == 0 && !bank.moves_first() { 1 } else { TILE };
                let steps = most.min(self.arrays.steps - k);
                self.gather::<T, V>(from, count, k, &mut y[..steps * q * V]);
                T::outline(Tile::<T, V> {
                    schedule: self.schedule,
                    k: k as u64 + 1,
                    still: k == 0 && !bank.moves_first(),
                    u: &[],
                    y: &y[..steps * q * V],
                    x: &mut x,
                    total: &mut total,
                    nis: &mut [],
                    scratch: &mut scratch,
                });
                k += steps;
            }
            for v in 0..V {
                for l in 0..T::LANES {
                    let record = from + v * T::LANES + l;
                    for i in 0..models {
                        if record < count {
                            self.totals[record * models + i] = total[i * V + v].lane(l);
                        }
                    }
                }
            }
        }
    }

    /// Measurements of a tile, shape (step, output, vector); records that are not
    /// there repeat the last. Those of the next tile are asked for: so many records are
    /// more than the processor follows by itself.
    #[inline(always)]
    fn gather<T: Real, const V: usize>(&self, from: usize, count: usize, k: usize, y: &mut [T]) {
        let q = self.schedule.q;
        let each = self.arrays.steps * q;
        let len = y.len() / V;
        for v in 0..V {
            let mut rows: [&[f64]; LANES] = [&[]; LANES];
            for (l, row) in rows.iter_mut().enumerate() {
                let record = self.first + (from + v * T::LANES + l).min(count - 1);
                let whole = &self.arrays.y[record * each..][..each];
                let (now, later) = whole[k * q..].split_at(len);
                prefetch(&later[..later.len().min(len)]);
                *row = now;
            }
            let mut e = 0;
            while e + 8 <= len {
                let columns = T::load_columns(&rows, e);
                for c in 0..8 {
                    y[(e + c) * V + v] = columns[c];
                }
                e += 8;
            }
            while e < len {
                y[e * V + v] = T::from_fn(|l| rows[l][e]);
                e += 1;
            }
        }
    }
}
