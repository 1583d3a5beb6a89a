//! Trials one by one through the engine, for what does not fit in lanes: states
//! that are mixed, Dunn's law as a differential equation.

use super::consistency::{Spread, leading};
use super::monte_carlo::Plan;
use super::tally::{Report, Scratch, Tally, Trajectory};
use super::truth::Walk;
use crate::engine::Mmae;
use crate::error::Result;
use crate::real::Real;
use crate::simd::{Block, Kernel, groups, load_group, store_group};

/// Takes in step, state, command and measurement of eight trials.
pub(super) type Sink<'a> = dyn FnMut(u64, &[Block], &[Block], &[Block]) -> Result<()> + 'a;

/// Simulates eight trials and hands every step to `sink`.
pub(super) struct Simulate<'a> {
    pub(super) plan: &'a Plan,
    pub(super) first: u64,
    pub(super) sink: &'a mut Sink<'a>,
}

impl Kernel for Simulate<'_> {
    type Out = Result<()>;

    #[inline(always)]
    fn run<T: Real>(self) -> Result<()> {
        let source = &self.plan.source;
        // no closure, which would be compiled without the instructions of the tier
        let mut walks: Vec<Walk<'_, T>> = Vec::with_capacity(groups::<T>());
        for group in 0..groups::<T>() {
            walks.push(Walk::new(source, self.plan.seed, self.first, group));
        }
        let room = |len: usize| vec![Block::default(); len];
        let inputs = walks.first().map_or(0, |w| w.u.len());
        let (mut x, mut y, mut u) = (room(source.n), room(source.q), room(inputs));
        let mut seen = vec![T::zero(); source.q];
        for k in 1..=self.plan.steps {
            for (group, walk) in walks.iter_mut().enumerate() {
                walk.step(&mut seen);
                store_group(&walk.x, group, &mut x);
                store_group(&walk.u, group, &mut u);
                store_group(&seen, group, &mut y);
            }
            (self.sink)(k, &x, &u, &y)?;
        }
        Ok(())
    }
}

/// Trials `first` to `first + valid - 1`.
pub(super) fn run(
    plan: &Plan,
    engine: &Mmae,
    first: u64,
    valid: usize,
    tally: &mut Tally<'_>,
    kept: &mut Vec<Trajectory>,
) -> Result<()> {
    let [n, m, q] = engine.bank().sizes();
    let models = plan.prior.len();
    let mut scratch = Scratch::<f64>::new(&plan.shape);
    let c = plan.shape.common;
    let mut estimates = vec![0.0; models * n];
    let (mut p, mut white) = (Vec::new(), Vec::new());
    let mut engines = vec![engine.clone(); valid];
    let mut own: Vec<Option<Trajectory>> = (first..first + valid as u64)
        .map(|trial| plan.keeps(trial).then(|| Trajectory { trial, ..Trajectory::default() }))
        .collect();
    let (mut u, mut y) = (vec![0.0; m], vec![0.0; q]);
    let mut report = 0;
    let mut sink = |k: u64, x: &[Block], sent: &[Block], measured: &[Block]| -> Result<()> {
        let reports = plan.reports(k);
        for (l, engine) in engines.iter_mut().enumerate() {
            if !sent.is_empty() {
                load_group(sent, l, &mut u);
            }
            load_group(measured, l, &mut y);
            // a plant that has run away measures nothing, and drives nothing
            for v in &mut y {
                *v = if v.is_finite() { *v } else { f64::NAN };
            }
            for v in &mut u {
                *v = if v.is_finite() { *v } else { 0.0 };
            }
            engine.step(&u, &y)?;
            let e = engine.estimate();
            if !reports {
                continue;
            }
            let mut state = vec![0.0; x.len()];
            load_group(x, l, &mut state);
            let alive: Vec<f64> =
                e.failed.iter().map(|&f| if f { f64::NAN } else { 0.0 }).collect();
            let (bank, estimates) = (engine.bank(), &mut estimates[..]);
            p.clear();
            white.clear();
            for i in 0..models {
                bank.x_hat_into(i, &mut estimates[i * n..][..n]);
                let of_model = bank.covariance(i);
                let rows: Vec<f64> = (0..n * n).map(|e| of_model[(e / n, e % n)]).collect();
                leading(n, c, &rows, plan.covariances, &mut p, &mut white);
            }
            let seen = Report {
                log_p: &e.log_p,
                nis: &e.nis,
                alive: &alive,
                x: &state,
                x_hat: estimates,
                spread: Spread { p: &p, white: &white },
            };
            tally.add(&seen, &mut scratch, l, report);
            if let Some(kept) = &mut own[l] {
                kept.x.extend(&state);
                kept.x_hat.extend(&e.x_hat);
                kept.y.extend(&y);
                kept.u.extend(&u[..sent.len()]);
                kept.log_p.extend(&e.log_p);
            }
        }
        report += usize::from(reports);
        Ok(())
    };
    let simulate = Simulate { plan, first, sink: &mut sink };
    crate::simd::dispatch(simulate)?;
    kept.extend(own.into_iter().flatten());
    Ok(())
}
