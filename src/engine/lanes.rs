//! Eight records at once through one engine.

use super::arrays::{Arrays, Part};
use super::mmae::{Mmae, mixture_log_lik};
use super::weighting::Innovation;
use crate::bank::{Repeat, Schedule, Tile, correct, innovate, propagate, whiten};
use crate::real::{Mask, Real, exp};
use crate::simd::{Kernel, LANES, groups};
use crate::weight::{Evidence, Law, Weights};

/// Records `start` to `start + valid - 1` of a part.
///
/// The order of all operations is that of [`Mmae::step`], and so are the bits.
/// Returns the lanes whose numbers stayed finite; the others are of no use.
pub(super) struct Eight<'a, 'b> {
    pub(super) engine: &'a Mmae,
    pub(super) arrays: &'a Arrays<'a>,
    pub(super) schedule: &'a Schedule,
    pub(super) start: usize,
    pub(super) valid: usize,
    pub(super) out: &'a mut Part<'b>,
}

/// Numbers of all models in lanes.
struct Numbers<T> {
    x: Vec<T>,
    next: Vec<T>,
    r: Vec<T>,
    y: Vec<T>,
    u: Vec<T>,
    log_lik: Vec<T>,
    increment: Vec<T>,
    energy: Vec<T>,
    total: Vec<T>,
    fused: Vec<T>,
    scratch: Vec<T>,
}

impl Kernel for Eight<'_, '_> {
    type Out = [bool; LANES];

    #[inline(always)]
    fn run<T: Real>(mut self) -> [bool; LANES] {
        let mut done = [false; LANES];
        for group in 0..groups::<T>() {
            let lanes = group * T::LANES;
            if lanes < self.valid {
                let good = self.group::<T>(lanes);
                for l in 0..T::LANES {
                    done[lanes + l] = good.lane(l);
                }
            }
        }
        done
    }
}

impl Eight<'_, '_> {
    /// The record in lane `l`; lanes without one repeat the first.
    #[inline(always)]
    fn record(&self, l: usize) -> usize {
        self.out.records.start + self.start + if l < self.valid { l } else { 0 }
    }

    /// Entry `j` of the signals at step `k` of `T::LANES` records.
    #[inline(always)]
    fn gather<T: Real>(&self, lanes: usize, k: usize, y: &mut [T], u: &mut [T]) {
        let mut row = [0.0; LANES];
        for j in 0..y.len() {
            for l in 0..T::LANES {
                row[l] = self.arrays.y(y.len(), self.record(lanes + l), k)[j];
            }
            y[j] = T::load(&row);
        }
        for j in 0..u.len() {
            for l in 0..T::LANES {
                // inputs that are not given are zero
                let of = self.arrays.u(u.len(), self.record(lanes + l), k);
                row[l] = if of.is_empty() { 0.0 } else { of[j] };
            }
            u[j] = T::load(&row);
        }
    }

    #[inline(always)]
    fn group<T: Real>(&mut self, lanes: usize) -> T::Mask {
        let Schedule { n, m, q, .. } = *self.schedule;
        let bank = self.engine.bank();
        let models = bank.models();
        let room = |len: usize| vec![T::zero(); len];
        let mut v = Numbers {
            x: room(models * n),
            next: room(n),
            r: room(q),
            y: room(q),
            u: room(m),
            log_lik: room(models),
            increment: room(models),
            energy: room(models),
            total: room(models),
            fused: room(n),
            scratch: Vec::new(),
        };
        let mut first = vec![0.0; n];
        for i in 0..models {
            bank.first_x_hat_into(i, &mut first);
            for j in 0..n {
                v.x[i * n + j] = T::splat(first[j]);
            }
        }
        let failed: Vec<bool> = bank.failures().iter().map(Option::is_some).collect();
        let mut weights: Weights<T> = self.engine.fresh_weights();
        weights.leave_out(&failed);
        let mut good = T::Mask::splat(true);
        let mut log_lik = T::zero();
        let reports = self.arrays.reports();
        let mut report = 0;
        for k in 0..self.arrays.steps {
            self.gather(lanes, k, &mut v.y, &mut v.u);
            let moves = k > 0 || bank.moves_first();
            if moves {
                weights.predict();
                weights.leave_out(&failed);
            }
            good = good & self.filters(k as u64 + 1, moves, &failed, &mut v);
            log_lik = log_lik + self.mixture(weights.log_p(), &v.log_lik);
            for i in 0..models {
                v.total[i] = v.total[i] + v.log_lik[i];
            }
            let _ = weights.step(&Evidence {
                log_lik: &v.log_lik,
                increment: &v.increment,
                energy: &v.energy,
                dt: 1.0,
                nodes: None,
            });
            weights.leave_out(&failed);
            if reports[report] == k + 1 {
                fuse(weights.log_p(), &v.x, &mut v.fused);
                for l in 0..T::LANES.min(self.valid - lanes) {
                    let row = (self.start + lanes + l) * reports.len() + report;
                    for i in 0..models {
                        self.out.log_p[row * models + i] = weights.log_p()[i].lane(l);
                    }
                    for j in 0..n {
                        self.out.x_hat[row * n + j] = v.fused[j].lane(l);
                    }
                }
                report += 1;
            }
        }
        for l in 0..T::LANES.min(self.valid - lanes) {
            let at = self.start + lanes + l;
            self.out.log_lik[at] = log_lik.lane(l);
            for i in 0..models {
                self.out.log_lik_models[at * models + i] = v.total[i].lane(l);
                self.out.failed[at * models + i] = failed[i];
            }
        }
        good
    }

    /// Predicts, innovates and corrects every model; returns the lanes where all
    /// numbers are finite.
    #[inline(always)]
    fn filters<T: Real>(
        &self,
        k: u64,
        moves: bool,
        failed: &[bool],
        v: &mut Numbers<T>,
    ) -> T::Mask {
        let Schedule { n, q, .. } = *self.schedule;
        let place = self.schedule.place(k);
        let (engine, norm) = (self.engine, self.engine.bank().norm());
        let mut good = T::Mask::splat(true);
        if engine.law() == Law::Bayes
            && *engine.innovation() == Innovation::Filter
            && self.schedule.of_all(place).is_some()
        {
            v.log_lik.fill(T::zero());
            T::outline(Tile::<T, 1> {
                schedule: self.schedule,
                k,
                still: !moves,
                u: &v.u,
                y: &v.y,
                x: &mut v.x,
                total: &mut v.log_lik,
                nis: &mut [],
                scratch: &mut v.scratch,
            });
            for i in 0..failed.len() {
                if failed[i] {
                    v.log_lik[i] = T::splat(f64::NAN);
                    continue;
                }
                good = good & v.log_lik[i].is_finite();
                for j in 0..n {
                    good = good & v.x[i * n + j].is_finite();
                }
            }
            return good;
        }
        for i in 0..failed.len() {
            let c = self.schedule.at(i, place);
            let x = &mut v.x[i * n..][..n];
            if moves {
                propagate(Repeat(c.a), Repeat(c.b), &v.u, x, &mut v.next);
            }
            innovate(Repeat(c.c), x, &v.y, &mut v.r);
            let energy = if norm.is_empty() {
                let mut sum = T::zero();
                for j in 0..q {
                    sum = v.r[j].mul_add(v.r[j], sum);
                }
                sum
            } else {
                whiten(Repeat(norm), &v.r)
            };
            let nis = whiten(Repeat(c.w), &v.r);
            let filter = T::splat(0.5).neg_mul_add(nis, T::splat(c.log_norm));
            let second = whiten(Repeat(c.white), &v.r);
            let steady = T::splat(-0.5).mul_add(second, T::splat(-c.bias));
            correct(Repeat(c.k), &v.r, x);
            if failed[i] {
                let gone = T::splat(f64::NAN);
                (v.log_lik[i], v.increment[i], v.energy[i]) = (gone, gone, gone);
                continue;
            }
            v.increment[i] = steady;
            v.energy[i] = energy;
            v.log_lik[i] = match engine.innovation() {
                Innovation::Filter => filter,
                Innovation::Steady => steady,
                Innovation::Common(_) => T::splat(-0.5) * energy,
            };
            good = good & nis.is_finite() & filter.is_finite() & v.log_lik[i].is_finite();
            for j in 0..n {
                good = good & x[j].is_finite();
            }
        }
        good
    }

    #[inline(always)]
    fn mixture<T: Real>(&self, log_p: &[T], log_lik: &[T]) -> T {
        match self.engine.law() {
            Law::Zhang { .. } | Law::Ode { .. } => T::splat(f64::NAN),
            Law::Bayes | Law::Likelihood | Law::Dwsg { .. } => mixture_log_lik(log_p, log_lik),
        }
    }
}

/// `x_hat = sum p_i x_i`.
#[inline(always)]
fn fuse<T: Real>(log_p: &[T], x: &[T], fused: &mut [T]) {
    let n = fused.len();
    for j in 0..n {
        fused[j] = T::zero();
    }
    for i in 0..log_p.len() {
        let p = exp(log_p[i]);
        let counts = p.gt(T::zero());
        for j in 0..n {
            let sum = p.mul_add(x[i * n + j], fused[j]);
            fused[j] = T::select(counts, sum, fused[j]);
        }
    }
}
