//! Eight trials at once: truth, bank and weights in lanes.
//!
//! Bayes's law without modifiers only adds up log-likelihoods: it is normalised
//! every [`LAZY`] steps and for reports, which saves an exponential a model and
//! step. What is reported of a step does not depend on the other reports.

use super::consistency::Spreads;
use super::monte_carlo::Plan;
use super::recorder::{Recorder, Seen};
use super::tally::{Tally, Trajectory};
use super::truth::{AHEAD, Walk};
use crate::bank::{Repeat, Schedule, Tile, correct, innovate, propagate, whiten};
use crate::error::Result;
use crate::real::Real;
use crate::simd::{Kernel, groups};
use crate::weight::{Evidence, Law, Weights};

/// Steps between two normalisations of weights that only add up.
const LAZY: u64 = AHEAD as u64;

/// Which norm the residuals of the law are judged by.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Norm {
    /// `S(k)` of the running filter.
    Filter,
    /// The steady `S`.
    Steady,
    /// A factor of one `W` for all models, row by row.
    Common(Vec<f64>),
}

/// Trials `first` to `first + valid - 1`, from the start to the end.
pub(super) struct Eight<'a, 'b> {
    pub(super) plan: &'a Plan,
    pub(super) coefficients: &'a Schedule,
    pub(super) first: u64,
    pub(super) valid: usize,
    pub(super) spreads: &'a Spreads,
    pub(super) tally: &'a mut Tally<'b>,
    pub(super) kept: &'a mut Vec<Trajectory>,
}

impl Kernel for Eight<'_, '_> {
    type Out = Result<()>;

    #[inline(always)]
    fn run<T: Real>(mut self) -> Result<()> {
        for group in 0..groups::<T>() {
            if group * T::LANES < self.valid {
                self.group::<T>(group)?;
            }
        }
        Ok(())
    }
}

/// The filters of all models.
struct Filters<'a, T> {
    plan: &'a Plan,
    coefficients: &'a Schedule,
    /// States, shape (model, state).
    x: Vec<T>,
    next: Vec<T>,
    r: Vec<T>,
    end: Vec<T>,
    /// What the law takes for the log-likelihood.
    log_lik: Vec<T>,
    energy: Vec<T>,
    nis: Vec<T>,
    scratch: Vec<T>,
}

impl<T: Real> Filters<'_, T> {
    /// True if steps can be taken several at a time.
    fn in_tiles(&self) -> bool {
        let Plan { zhang, hold, norm, .. } = self.plan;
        !zhang && hold.is_none() && *norm == Norm::Filter && self.coefficients.of_all(0).is_some()
    }

    /// The steps from `k` on of every model; adds log-likelihoods to `total`. One step if
    /// it does not predict (`still`), and unless [`Filters::in_tiles`].
    #[inline(always)]
    fn steps(&mut self, k: u64, still: bool, u: &[T], y: &[T], total: &mut [T]) {
        T::outline(Tile::<T, 1> {
            schedule: self.coefficients,
            k,
            still,
            u,
            y,
            x: &mut self.x,
            total,
            nis: &mut self.nis,
            scratch: &mut self.scratch,
        });
        self.mark_failed();
        for i in 0..total.len() {
            if self.plan.failed[i] {
                total[i] = T::splat(f64::NAN);
            }
        }
    }

    /// Predicts (unless `moves` is false), innovates and corrects every model.
    ///
    /// ```text
    /// discrete     x <- A x + B u,   r = y - C x,   x <- x + K r
    /// continuous   r = y - C x,   x <- A x + B u + K r
    /// ```
    #[inline(always)]
    fn step(&mut self, k: u64, moves: bool, u: &[T], y: &[T]) {
        let q = self.coefficients.q;
        let n = self.coefficients.n;
        let place = self.coefficients.place(k);
        let (zhang, hold) = (self.plan.zhang, self.plan.hold);
        for i in 0..self.nis.len() {
            let c = self.coefficients.at(i, place);
            let x = &mut self.x[i * n..][..n];
            if moves && hold.is_none() {
                propagate(Repeat(c.a), Repeat(c.b), u, x, &mut self.next);
            }
            let r = &mut self.r[..q];
            innovate(Repeat(c.c), x, y, r);
            let nis = whiten(Repeat(c.w), r);
            self.nis[i] = nis;
            let common = match &self.plan.norm {
                Norm::Common(w) => Some(whiten(Repeat(w), r)),
                _ => None,
            };
            self.log_lik[i] = match (&self.plan.norm, common) {
                (_, Some(energy)) => T::splat(-0.5) * energy,
                (Norm::Steady, _) => {
                    let second = whiten(Repeat(c.white), r);
                    T::splat(-0.5).mul_add(second, T::splat(-c.bias))
                }
                _ => T::splat(0.5).neg_mul_add(nis, T::splat(c.log_norm)),
            };
            if zhang {
                self.energy[i] = match common {
                    Some(energy) => energy,
                    None => {
                        let mut sum = T::zero();
                        for j in 0..q {
                            sum = r[j].mul_add(r[j], sum);
                        }
                        sum
                    }
                };
            }
            if hold.is_some() {
                propagate(Repeat(c.a), Repeat(c.b), u, x, &mut self.next);
            }
            correct(Repeat(c.k), r, x);
            if let (Some(dt), Law::Likelihood) = (hold, self.plan.law) {
                // -(|r_0|^2 + |r_1|^2) / 4 - tr(C L) / 2, times dt
                innovate(Repeat(c.c), x, y, &mut self.end);
                let ends = whiten(Repeat(c.white), r) + whiten(Repeat(c.white), &self.end);
                let rate = T::splat(0.25) * ends + T::splat(c.bias);
                self.log_lik[i] = -rate * T::splat(dt);
            }
        }
        self.mark_failed();
    }

    /// Members that failed say nothing.
    #[inline(always)]
    fn mark_failed(&mut self) {
        for i in 0..self.nis.len() {
            if self.plan.failed[i] {
                let gone = T::splat(f64::NAN);
                (self.log_lik[i], self.energy[i], self.nis[i]) = (gone, gone, gone);
            }
        }
    }
}

impl Eight<'_, '_> {
    #[inline(always)]
    fn group<T: Real>(&mut self, group: usize) -> Result<()> {
        let plan = self.plan;
        let Schedule { n, q, .. } = *self.coefficients;
        let models = plan.prior.len();
        let mut walk = Walk::<T>::new(&plan.source, plan.seed, self.first, group);
        let mut filters = Filters {
            plan,
            coefficients: self.coefficients,
            x: plan.x_hat.iter().map(|&v| T::splat(v)).collect(),
            next: vec![T::zero(); n],
            r: vec![T::zero(); q],
            end: vec![T::zero(); q],
            log_lik: vec![T::zero(); models],
            energy: vec![T::zero(); models],
            nis: vec![T::zero(); models],
            scratch: Vec::new(),
        };
        let mut weights = Weights::<T>::new(
            plan.law,
            plan.modifiers.clone(),
            plan.transition.clone(),
            &plan.prior,
        )?;
        let lazy = plan.only_adds();
        // What `weights` has not taken in yet; the weights with it.
        let mut waiting = vec![T::zero(); models];
        let mut shown = weights.clone();
        let (mut y, mut u) = (vec![T::zero(); AHEAD * q], vec![T::zero(); AHEAD * walk.u.len()]);
        let mut recorder = Recorder::new(plan, self.first, self.valid, group);
        let tiles = filters.in_tiles();
        let mut k = 0;
        while k < plan.steps {
            let moves = k > 0 || plan.moves_first || plan.hold.is_some();
            // up to the next normalisation or report
            let first = k + 1;
            k = if tiles && lazy && moves { plan.tile_end(first, LAZY) } else { first };
            let count = (k - first + 1) as usize;
            let (y, u) = (&mut y[..count * q], &mut u[..count * walk.u.len()]);
            walk.steps(y, u);
            if moves && !lazy {
                weights.predict();
            }
            let dt = plan.hold.unwrap_or(1.0);
            let folds = !lazy || k.is_multiple_of(LAZY);
            let reports = plan.reports(k);
            if tiles && lazy {
                filters.steps(first, !moves, u, y, &mut waiting);
            } else if tiles {
                let mut total = std::mem::take(&mut filters.log_lik);
                total.fill(T::zero());
                filters.steps(first, !moves, u, y, &mut total);
                filters.log_lik = total;
            } else {
                filters.step(k, moves, u, y);
                if lazy {
                    for i in 0..models {
                        waiting[i] = waiting[i] + filters.log_lik[i];
                    }
                }
            }
            if lazy && reports && !folds {
                shown.log_p_mut().copy_from_slice(weights.log_p());
                let _ = shown.step(&evidence(&waiting, &filters.energy, dt));
            }
            if folds {
                let log_lik = if lazy { &waiting } else { &filters.log_lik };
                let _ = weights.step(&evidence(log_lik, &filters.energy, dt));
                if lazy {
                    waiting.fill(T::zero());
                }
            }
            if !reports {
                continue;
            }
            let seen = Seen {
                x: &walk.x,
                y: &y[(count - 1) * q..],
                u: &walk.u,
                x_hat: &filters.x,
                nis: &filters.nis,
                log_p: if folds { weights.log_p() } else { shown.log_p() },
                spread: self.spreads.at(self.coefficients.place(k)),
            };
            recorder.step(k, &seen, self.tally);
        }
        recorder.finish(self.kept);
        Ok(())
    }
}

/// What a step of length `dt` says in lanes.
#[inline(always)]
fn evidence<'a, T>(log_lik: &'a [T], energy: &'a [T], dt: f64) -> Evidence<'a, T> {
    Evidence { log_lik, increment: log_lik, energy, dt, nodes: None }
}
