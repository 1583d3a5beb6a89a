//! What the kernels hand over at the steps that are reported.

use super::consistency::Spread;
use super::monte_carlo::Plan;
use super::tally::{Report, Scratch, Tally, Trajectory};
use crate::real::Real;

/// Plant and bank of `T::LANES` trials after a step.
pub(super) struct Seen<'a, T> {
    /// State of the plant.
    pub(super) x: &'a [T],
    /// Measurement.
    pub(super) y: &'a [T],
    /// Command; nothing if nothing drives the plant.
    pub(super) u: &'a [T],
    /// Estimates, shape (model, state).
    pub(super) x_hat: &'a [T],
    pub(super) nis: &'a [T],
    pub(super) log_p: &'a [T],
    /// Covariances of the estimates.
    pub(super) spread: Spread<'a>,
}

/// Adds reports to a tally and keeps the courses that are wanted.
pub(super) struct Recorder<'a, T> {
    plan: &'a Plan,
    group: usize,
    report: usize,
    alive: Vec<T>,
    scratch: Scratch<T>,
    /// With the lane of each.
    kept: Vec<(usize, Trajectory)>,
}

impl<'a, T: Real> Recorder<'a, T> {
    /// Of group `group` of the trials `first` to `first + valid - 1`.
    pub(super) fn new(plan: &'a Plan, first: u64, valid: usize, group: usize) -> Self {
        let kept = (0..T::LANES)
            .filter(|l| group * T::LANES + l < valid)
            .map(|l| (l, first + (group * T::LANES + l) as u64))
            .filter(|(_, trial)| plan.keeps(*trial))
            .map(|(l, trial)| (l, Trajectory { trial, ..Trajectory::default() }))
            .collect();
        Self {
            plan,
            group,
            report: 0,
            alive: vec![T::zero(); plan.prior.len()],
            scratch: Scratch::new(&plan.shape),
            kept,
        }
    }

    /// Step `k`, if it is reported.
    #[inline(always)]
    pub(super) fn step(&mut self, k: u64, seen: &Seen<'_, T>, tally: &mut Tally<'_>) {
        if !self.plan.reports(k) {
            return;
        }
        let models = self.alive.len();
        let n = seen.x_hat.len() / models;
        for i in 0..models {
            // a member that ran away
            let mut good = seen.nis[i].eq(seen.nis[i]);
            for j in 0..n {
                good = good & seen.x_hat[i * n + j].is_finite();
            }
            self.alive[i] = T::select(good, T::zero(), T::splat(f64::NAN));
        }
        let report = Report {
            log_p: seen.log_p,
            nis: seen.nis,
            alive: &self.alive,
            x: seen.x,
            x_hat: seen.x_hat,
            spread: seen.spread,
        };
        tally.add(&report, &mut self.scratch, self.group, self.report);
        self.report += 1;
        for (l, kept) in &mut self.kept {
            let of = |values: &[T], out: &mut Vec<f64>| {
                for v in values {
                    out.push(v.lane(*l));
                }
            };
            of(seen.x, &mut kept.x);
            of(&self.scratch.fused, &mut kept.x_hat);
            of(seen.y, &mut kept.y);
            of(seen.u, &mut kept.u);
            of(seen.log_p, &mut kept.log_p);
        }
    }

    /// Hands over the courses.
    pub(super) fn finish(self, kept: &mut Vec<Trajectory>) {
        kept.extend(self.kept.into_iter().map(|(_, t)| t));
    }
}
