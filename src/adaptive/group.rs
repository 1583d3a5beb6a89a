//! Eight observers: their lanes, and what is done to each by itself.

use std::sync::Arc;

use faer::Mat;

use super::advance::Advance;
use super::estimate::Window;
use super::layout::{Kind, Layout};
use super::plant::{Settings, Structure, Tuning};
use super::scheme::Scheme;
use crate::error::{Error, Result};
use crate::simd::{Block, LANES, dispatch};
use crate::solve::backend;

/// What does not change.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) structure: Structure,
    pub(super) settings: Settings,
    pub(super) layout: Layout,
    pub(super) len: usize,
    pub(super) failures: Vec<Option<Error>>,
    /// Noise of a sample in units of `sqrt(R)` where it is stated.
    pub(super) noise: Vec<Option<f64>>,
    pub(super) tunings: Vec<Tuning>,
}

impl Shared {
    pub(super) fn time(&self, step: u64) -> f64 {
        self.settings.t0 + step as f64 * self.settings.dt
    }

    /// The item's description, unless it cannot be used or is padding.
    fn sound(&self, item: usize) -> Option<&Tuning> {
        let good = item < self.len && self.failures[item].is_none();
        good.then(|| &self.tunings[item])
    }
}

/// Eight observers.
#[derive(Debug, Clone)]
pub(super) struct Group {
    /// Number of its first item.
    pub(super) from: usize,
    pub(super) fixed: Arc<Vec<Block>>,
    pub(super) first_state: Arc<Vec<Block>>,
    pub(super) state: Vec<Block>,
    pub(super) sample: Vec<Block>,
    pub(super) scratch: Vec<Block>,
    pub(super) items: Vec<Item>,
    pub(super) u: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) gamma: Vec<f64>,
    pub(super) known: Vec<f64>,
}

/// What is kept of an observer beside the lanes.
#[derive(Debug, Clone, Default)]
pub(super) struct Item {
    pub(super) window: Window,
    /// `theta` at the start of the window.
    pub(super) theta: Vec<f64>,
    /// Resets that were made.
    pub(super) resets: usize,
}

/// Writes a list, one block an entry, of eight items.
fn put(blocks: &mut [Block], lane: usize, values: impl IntoIterator<Item = f64>) {
    for (block, value) in blocks.iter_mut().zip(values) {
        block.0[lane] = value;
    }
}

/// A matrix row by row.
fn rows(m: &Mat<f64>) -> impl Iterator<Item = f64> + '_ {
    (0..m.nrows()).flat_map(move |i| (0..m.ncols()).map(move |j| m[(i, j)]))
}

impl Group {
    pub(super) fn new(
        from: usize,
        l: &Layout,
        settings: &Settings,
        eight: &[&Tuning],
    ) -> Result<Self> {
        let room = |len: usize| vec![Block::default(); len];
        let (mut fixed, mut state) = (room(l.fixed), room(l.state));
        for (lane, t) in eight.iter().enumerate() {
            let s = Scheme::new(t, settings.dt)?;
            put(&mut fixed[l.phi.clone()], lane, s.phi);
            put(&mut fixed[l.g0.clone()], lane, s.g0);
            put(&mut fixed[l.g1.clone()], lane, s.g1);
            put(&mut fixed[l.c.clone()], lane, rows(&t.C));
            put(&mut fixed[l.k.clone()], lane, rows(&t.K));
            let factors = l.kinds.iter().map(|kind| match *kind {
                Kind::Measured { col, output, .. } => 1.0 / t.C[(output, col)],
                _ => 0.0,
            });
            put(&mut fixed[l.factor.clone()], lane, factors);
            put(&mut fixed[l.r.clone()], lane, t.R.iter().map(|r| r / s.weight));
            put(&mut fixed[l.rates.clone()], lane, [s.mu, s.mu.sqrt(), t.trace_cap]);
            put(&mut fixed[l.low.clone()], lane, t.bounds.iter().map(|b| b[0]));
            put(&mut fixed[l.high.clone()], lane, t.bounds.iter().map(|b| b[1]));
            let n = l.n;
            let unit = (0..l.x0 * n).map(|e| if e / n == e % n { 1.0 } else { 0.0 });
            put(&mut state[l.psi.clone()], lane, unit);
            put(&mut state[l.psi_0.clone()], lane, t.x_hat.iter().copied());
            put(&mut state[l.x_hat.clone()], lane, t.x_hat.iter().copied());
            let theta = vec![0.0; l.x0].into_iter().chain(t.theta.iter().copied());
            put(&mut state[l.theta.clone()], lane, theta);
            let x0 = t.initial_P0.iter().copied().take(l.x0);
            for (i, d) in x0.chain(t.prior.p0(settings.dt)).enumerate() {
                state[l.ud.start + i * l.all() + i].0[lane] = d;
            }
        }
        let item = |t: &&Tuning| Item { theta: t.theta.clone(), ..Item::default() };
        Ok(Self {
            from,
            fixed: Arc::new(fixed),
            first_state: Arc::new(state.clone()),
            state,
            sample: room(l.sample),
            scratch: room(l.scratch),
            items: eight.iter().map(item).collect(),
            u: vec![0.0; LANES * l.m],
            y: vec![0.0; LANES * l.q],
            gamma: vec![0.0; l.given * l.n],
            known: vec![0.0; l.n],
        })
    }

    pub(super) fn restart(&mut self, l: &Layout) {
        self.state.copy_from_slice(&self.first_state);
        for lane in 0..LANES {
            let mut theta = vec![0.0; l.p];
            self.theta(l, lane, &mut theta);
            self.items[lane] = Item { theta, ..Item::default() };
        }
    }

    pub(super) fn theta(&self, l: &Layout, lane: usize, theta: &mut [f64]) {
        assert_eq!(theta.len(), l.p, "theta holds a number a parameter");
        let blocks = &self.state[l.theta.start + l.x0..l.theta.end];
        for (x, block) in theta.iter_mut().zip(blocks) {
            *x = block.0[lane];
        }
    }

    /// Copies the signals of the first `count` items, and the last of them into the
    /// padding.
    pub(super) fn take(&mut self, m: usize, q: usize, count: usize, u: &[f64], y: &[f64]) {
        self.u[..count * m].copy_from_slice(&u[..count * m]);
        self.y[..count * q].copy_from_slice(&y[..count * q]);
        self.pad(m, q, count);
    }

    pub(super) fn pad(&mut self, m: usize, q: usize, count: usize) {
        for l in count..LANES {
            self.u.copy_within((count - 1) * m..count * m, l * m);
            self.y.copy_within((count - 1) * q..count * q, l * q);
        }
    }

    /// Sample `k`, from 0.
    pub(super) fn advance(&mut self, shared: &Shared, k: u64) {
        let (l, t) = (&shared.layout, shared.time(k));
        let [_, m, q, _] = shared.structure.sizes();
        for lane in 0..LANES {
            self.fill_in(l, lane);
            // padding has the signals of the last item, and its regressors
            if lane == 0 || self.from + lane < shared.len {
                let (u, y) = (&self.u[lane * m..][..m], &self.y[lane * q..][..q]);
                self.known.fill(0.0);
                self.gamma.fill(0.0);
                let regressor = &shared.structure.regressor;
                regressor.evaluate(t, u, y, &mut self.gamma, &mut self.known);
            }
            put(&mut self.sample[l.gamma.clone()], lane, self.gamma.iter().copied());
            put(&mut self.sample[l.term.clone()], lane, self.known.iter().copied());
        }
        self.restore(shared, t);
        dispatch(Advance {
            layout: l,
            first: k == 0,
            fixed: &self.fixed,
            state: &mut self.state,
            sample: &self.sample,
            scratch: &mut self.scratch,
        });
        if k > 0 && k.is_multiple_of(shared.settings.window) {
            self.judge(shared, t);
        }
    }

    /// Outputs that are missing: those of the estimate before.
    fn fill_in(&mut self, l: &Layout, lane: usize) {
        for j in 0..l.q {
            let at = lane * l.q + j;
            let missing = self.y[at].is_nan();
            if missing {
                let entry = |i: usize| self.fixed[l.c.start + j * l.n + i].0[lane];
                let state = |i: usize| self.state[l.x_hat.start + i].0[lane];
                self.y[at] = (0..l.n).map(|i| entry(i) * state(i)).sum();
            }
            self.sample[l.y.start + j].0[lane] = self.y[at];
            self.sample[l.present.start + j].0[lane] = if missing { 0.0 } else { 1.0 };
        }
    }

    /// Resets that are due at `t`.
    fn restore(&mut self, shared: &Shared, t: f64) {
        let due = |tuning: &Tuning, made: usize| {
            tuning.resets.get(made).is_some_and(|at| *at <= t + 1e-9 * shared.settings.dt)
        };
        for lane in 0..LANES {
            let Some(tuning) = shared.sound(self.from + lane) else { continue };
            while due(tuning, self.items[lane].resets) {
                self.items[lane].resets += 1;
                self.put_back(&shared.layout, lane);
            }
        }
    }

    /// `P` of an item as it was at the start.
    fn put_back(&mut self, l: &Layout, lane: usize) {
        for e in l.ud.clone() {
            self.state[e].0[lane] = self.first_state[e].0[lane];
        }
    }

    /// The end of a window at `t`.
    fn judge(&mut self, shared: &Shared, t: f64) {
        let l = &shared.layout;
        for lane in 0..LANES {
            let Some(tuning) = shared.sound(self.from + lane) else { continue };
            let number = |at: usize| self.state[at].0[lane];
            let weight = Scheme::weight(tuning.lambda, shared.settings.dt);
            let [sum, count] = [0, 1].map(|i| number(l.sums.start + i));
            let residual = (sum / (weight * count)).sqrt();
            let gram = |i: usize, j: usize| number(l.gram.start + i.max(j) * l.p + i.min(j));
            let condition = condition(l.p, gram);
            let mut theta = vec![0.0; l.p];
            self.theta(l, lane, &mut theta);
            let item = &mut self.items[lane];
            let change = |i: usize| {
                let size = theta[i].abs().max(tuning.theta[i].abs()).max(f64::MIN_POSITIVE);
                (theta[i] - item.theta[i]).abs() / size
            };
            let drift = (0..l.p).map(change).fold(0.0, f64::max);
            let grown = residual / item.window.residual > tuning.reset_growth.sqrt();
            item.window = Window { t, condition, residual, drift };
            item.theta = theta;
            if grown {
                self.put_back(l, lane);
            }
            for at in l.gram.clone().chain(l.sums.clone()) {
                self.state[at].0[lane] = 0.0;
            }
        }
    }
}

/// Condition of a Gram matrix scaled to a unit diagonal; infinite for a singular one.
fn condition(p: usize, gram: impl Fn(usize, usize) -> f64) -> f64 {
    let root: Vec<f64> = (0..p).map(|i| gram(i, i).sqrt()).collect();
    if root.iter().any(|r| !(*r > 0.0 && r.is_finite())) {
        return f64::INFINITY;
    }
    let scaled = Mat::from_fn(p, p, |i, j| gram(i, j) / (root[i] * root[j]));
    match backend::symmetric_eigenvalues(scaled.as_ref()).as_deref() {
        Ok([low, .., high]) if *low > 0.0 => high / low,
        Ok([_]) => 1.0,
        _ => f64::INFINITY,
    }
}
