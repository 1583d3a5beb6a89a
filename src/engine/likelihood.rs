//! Log-likelihoods of many records under every model, without weights.

use super::arrays::Arrays;
use super::mmae::Mmae;
use super::weighting::Innovation;
use crate::bank::{Filter, Repeat, Schedule, correct, filter_step, innovate, propagate, whiten};
use crate::error::Result;
use crate::par::{RunControl, map_parts};
use crate::real::{LaneKernel, Real};
use crate::simd::{Kernel, LANES, dispatch};
use crate::weight::Law;

/// Records of a part of work.
const CHUNK: usize = 64;
/// Steps whose measurements are brought into lanes at a time.
const TILE: usize = 32;

impl Mmae {
    /// Log-likelihood of each record under each model, shape (record, model): what
    /// [`Mmae::run_arrays`] returns as
    /// [`Courses::log_lik_models`](super::Courses::log_lik_models), by bits, without
    /// weights and estimates.
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
        arrays.check(m, q)?;
        let schedule = if plain { Some(self.schedule(arrays.steps as u64)?) } else { None };
        let whole = schedule.as_ref().filter(|s| s.of_all(0).is_some());
        let Some(schedule) = whole else {
            let ends = Arrays { every: 0, ..*arrays };
            return Ok(self.run_arrays(&ends, control)?.log_lik_models);
        };
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
    /// finite, by the whole engine.
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
            match self.schedule.n {
                0..=3 => self.records::<T, 4>(),
                4..=6 => self.records::<T, 2>(),
                _ => self.records::<T, 1>(),
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
            for k in (0..self.arrays.steps).step_by(TILE) {
                let steps = TILE.min(self.arrays.steps - k);
                self.gather::<T, V>(from, count, k, &mut y[..steps * q * V]);
                T::outline(Tile::<T, V> {
                    schedule: self.schedule,
                    k: k as u64 + 1,
                    moves_first: bank.moves_first(),
                    y: &y[..steps * q * V],
                    x: &mut x,
                    total: &mut total,
                });
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
    /// there repeat the last.
    #[inline(always)]
    fn gather<T: Real, const V: usize>(&self, from: usize, count: usize, k: usize, y: &mut [T]) {
        let q = self.schedule.q;
        let each = self.arrays.steps * q;
        let len = y.len() / V;
        for v in 0..V {
            let rows: [&[f64]; LANES] = std::array::from_fn(|l| {
                let record = (from + v * T::LANES + l).min(count - 1);
                &self.arrays.y[(self.first + record) * each + k * q..][..len]
            });
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

/// Some steps of all models for `V` vectors of records.
///
/// ```text
/// x <- A x,   r = y - C x,   l <- l + log_norm - |W r|^2 / 2,   x <- x + K r
/// ```
/// Limited by the multiply-adds: the states of a model stay in registers for a
/// step, and each coefficient is broadcast once for `V` of them.
struct Tile<'a, T, const V: usize> {
    schedule: &'a Schedule,
    /// The first step, from 1.
    k: u64,
    moves_first: bool,
    y: &'a [T],
    /// Shape (model, state, vector).
    x: &'a mut [T],
    /// Shape (model, vector).
    total: &'a mut [T],
}

impl<T: Real, const V: usize> LaneKernel<T> for Tile<'_, T, V> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        if const { T::UNROLLS } {
            let (n, q) = (self.schedule.n, self.schedule.q);
            if const { V == 4 || T::TILE != 4 } {
                match (n, q) {
                    (1, 1) => return self.sized::<1, 1>(),
                    (2, 1) => return self.sized::<2, 1>(),
                    (3, 1) => return self.sized::<3, 1>(),
                    (2, 2) => return self.sized::<2, 2>(),
                    (3, 2) => return self.sized::<3, 2>(),
                    _ => {}
                }
            }
            if const { V == 2 || T::TILE != 4 } {
                match (n, q) {
                    (4, 1) => return self.sized::<4, 1>(),
                    (5, 1) => return self.sized::<5, 1>(),
                    (6, 1) => return self.sized::<6, 1>(),
                    (4, 2) => return self.sized::<4, 2>(),
                    (5, 2) => return self.sized::<5, 2>(),
                    (6, 2) => return self.sized::<6, 2>(),
                    _ => {}
                }
            }
        }
        self.any();
    }
}

impl<T: Real, const V: usize> Tile<'_, T, V> {
    #[inline(always)]
    fn sized<const N: usize, const Q: usize>(self) {
        let sizes = [N, self.schedule.m, Q];
        for (s, y) in self.y.as_chunks::<V>().0.as_chunks::<Q>().0.iter().enumerate() {
            let k = self.k + s as u64;
            let moves = k > 1 || self.moves_first;
            let Some([fixed, moving]) = self.schedule.of_all(self.schedule.place(k)) else {
                return;
            };
            let states = self.x.as_chunks_mut::<V>().0.as_chunks_mut::<N>().0;
            let totals = self.total.as_chunks_mut::<V>().0;
            for i in 0..totals.len() {
                let filter = Filter::of(i, fixed, moving, sizes);
                // in registers
                let mut x = states[i];
                let square = filter_step::<T, N, Q, V>(filter, moves, &[], y, &mut x);
                states[i] = x;
                let log_norm = T::splat(filter.log_norm);
                for v in 0..V {
                    let more = T::splat(0.5).neg_mul_add(square[v], log_norm);
                    totals[i][v] = totals[i][v] + more;
                }
            }
        }
    }

    /// The same for sizes of run time, a vector at a time.
    #[inline(always)]
    fn any(self) {
        let Schedule { n, m, q, .. } = *self.schedule;
        let steps = self.y.len() / (q * V);
        let room = |len: usize| vec![T::zero(); len];
        let (mut x, mut next, mut y, mut r) = (room(n), room(n), room(q), room(q));
        for s in 0..steps {
            let k = self.k + s as u64;
            let moves = k > 1 || self.moves_first;
            let Some([fixed, moving]) = self.schedule.of_all(self.schedule.place(k)) else {
                return;
            };
            for i in 0..self.total.len() / V {
                let f = Filter::of(i, fixed, moving, [n, m, q]);
                for v in 0..V {
                    for j in 0..n {
                        x[j] = self.x[(i * n + j) * V + v];
                    }
                    for p in 0..q {
                        y[p] = self.y[(s * q + p) * V + v];
                    }
                    if moves {
                        propagate(Repeat(f.a), Repeat(f.b), &[], &mut x, &mut next);
                    }
                    innovate(Repeat(f.c), &x, &y, &mut r);
                    let square = whiten(Repeat(f.w), &r);
                    let at = i * V + v;
                    let more = T::splat(0.5).neg_mul_add(square, T::splat(f.log_norm));
                    self.total[at] = self.total[at] + more;
                    correct(Repeat(f.k), &r, &mut x);
                    for j in 0..n {
                        self.x[(i * n + j) * V + v] = x[j];
                    }
                }
            }
        }
    }
}
