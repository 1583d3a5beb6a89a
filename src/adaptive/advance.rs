//! A sample of eight observers: filters, least squares, state.
//!
//! ```text
//! psi_0' = A_k psi_0 + K y + f,   psi_i' = A_k psi_i + g_i,   A_k = A - K C
//! psi(k+1) = Phi psi(k) + G0 g(k) + G1 g(k+1)                first-order hold
//! phi = C Psi,  e = y - C psi_0 - phi theta,  theta <- theta + P phi' e / (..)
//! ```
//! Columns `E_row x_hat_col` take the state of a predictor that holds `x_hat`, once
//! corrected. The sum of the least squares ends a half step ahead of its last sample
//! (a rectangle a step): `theta` of the step before is therefore that of its middle,
//! which makes the readings `reg` and `obs`, whose state integrates it, of second order.

use super::layout::{Kind, Layout};
use super::plant::Reading;
use super::ud;
use crate::real::Real;
use crate::simd::{Block, Kernel, groups, load_group, store_group};

/// Largest magnitude of a regressor of `x(0)` that has died out.
const GONE: f64 = 1e-12;

/// One sample of a group.
pub(super) struct Advance<'a> {
    pub(super) layout: &'a Layout,
    /// The first sample: the filters only take in their inputs.
    pub(super) first: bool,
    pub(super) fixed: &'a [Block],
    pub(super) state: &'a mut [Block],
    pub(super) sample: &'a [Block],
    pub(super) scratch: &'a mut [Block],
}

impl Kernel for Advance<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Self { layout, first, fixed, state, sample, scratch } = self;
        if let (Some(fixed), Some(sample)) = (T::view(fixed), T::view(sample))
            && let (Some(state), Some(scratch)) = (T::view_mut(state), T::view_mut(scratch))
        {
            step(layout, first, fixed, state, sample, scratch);
            return;
        }
        // the oracle: one observer after the other
        let room = |len: usize| vec![T::zero(); len];
        let (mut own, mut moving) = (room(fixed.len()), room(state.len()));
        let (mut seen, mut work) = (room(sample.len()), room(scratch.len()));
        for group in 0..groups::<T>() {
            load_group(fixed, group, &mut own);
            load_group(state, group, &mut moving);
            load_group(sample, group, &mut seen);
            step(layout, first, &own, &mut moving, &seen, &mut work);
            store_group(&moving, group, state);
        }
    }
}

/// The first `len` numbers of what is left.
#[inline(always)]
fn cut<'a, T>(rest: &mut &'a mut [T], len: usize) -> &'a mut [T] {
    let (part, after) = std::mem::take(rest).split_at_mut(len);
    *rest = after;
    part
}

/// `out <- out + M v`, `M` n by n.
#[inline(always)]
fn add_product<T: Real>(m: &[T], v: &[T], out: &mut [T]) {
    let n = out.len();
    for i in 0..n {
        for j in 0..n {
            out[i] = m[i * n + j].mul_add(v[j], out[i]);
        }
    }
}

/// `out <- out + M E_row v`.
#[inline(always)]
fn add_column<T: Real>(m: &[T], row: usize, v: T, out: &mut [T]) {
    let n = out.len();
    for i in 0..n {
        out[i] = m[i * n + row].mul_add(v, out[i]);
    }
}

/// `out <- out + a v`.
#[inline(always)]
fn add_scaled<T: Real>(a: T, v: &[T], out: &mut [T]) {
    for (o, v) in out.iter_mut().zip(v) {
        *o = a.mul_add(*v, *o);
    }
}

/// `sum a_i b_i` on top of `from`.
#[inline(always)]
fn dot<T: Real>(a: &[T], b: &[T], from: T) -> T {
    a.iter().zip(b).fold(from, |sum, (a, b)| a.mul_add(*b, sum))
}

#[inline(always)]
fn step<T: Real>(
    l: &Layout,
    first: bool,
    fixed: &[T],
    mut state: &mut [T],
    sample: &[T],
    mut scratch: &mut [T],
) {
    let (n, q, x0, all) = (l.n, l.q, l.x0, l.all());
    let rest = &mut state;
    let psi = cut(rest, l.psi.len());
    let psi_0 = cut(rest, n);
    let x_hat = cut(rest, n);
    let g = cut(rest, l.g.len());
    let known = cut(rest, l.known.len());
    let theta = cut(rest, all);
    let ud = cut(rest, all * all);
    let gram = cut(rest, l.gram.len());
    let sums = cut(rest, 2);
    let residuals = cut(rest, q);
    let rest = &mut scratch;
    let [inputs, next, flow, guess] = [n; 4].map(|len| cut(rest, len));
    let phi = cut(rest, all);
    let gain = cut(rest, all);
    let work = cut(rest, ud::SCRATCH * all);
    let (hold, g0, g1) = (&fixed[l.phi.clone()], &fixed[l.g0.clone()], &fixed[l.g1.clone()]);
    let k = &fixed[l.k.clone()];
    let factor = &fixed[l.factor.clone()];
    let (y, gamma) = (&sample[l.y.clone()], &sample[l.gamma.clone()]);

    // K y + f
    inputs.copy_from_slice(&sample[l.term.clone()]);
    for i in 0..n {
        inputs[i] = dot(&k[i * q..][..q], y, inputs[i]);
    }
    if first {
        known.copy_from_slice(inputs);
        let mut at = 0;
        for (i, kind) in l.kinds.iter().enumerate() {
            match *kind {
                Kind::Measured { output, .. } => g[at] = factor[i] * y[output],
                Kind::Estimated { .. } => {}
                Kind::Given(j) => g[at..at + n].copy_from_slice(&gamma[j * n..][..n]),
            }
            at += kind.kept(n);
        }
        return;
    }
    // psi_0, and the state of the readings that integrate it
    let follows = l.reading == Reading::Zhang;
    next.fill(T::zero());
    add_product(g0, known, next);
    add_product(g1, inputs, next);
    flow.copy_from_slice(next);
    add_product(hold, x_hat, flow);
    add_product(hold, psi_0, next);
    psi_0.copy_from_slice(next);
    known.copy_from_slice(inputs);
    guess.copy_from_slice(psi_0);
    for i in 0..x0 {
        let column = &mut psi[i * n..][..n];
        next.fill(T::zero());
        add_product(hold, column, next);
        column.copy_from_slice(next);
        add_scaled(theta[i], column, guess);
    }
    // the columns; those of x_hat without their last term
    let mut at = 0;
    for (i, kind) in l.kinds.iter().enumerate() {
        let column = &mut psi[(x0 + i) * n..][..n];
        let value = theta[x0 + i];
        next.fill(T::zero());
        let mut held = T::zero();
        match *kind {
            Kind::Measured { row, output, .. } => {
                let now = factor[i] * y[output];
                add_column(g0, row, g[at], next);
                add_column(g1, row, now, next);
                g[at] = now;
            }
            Kind::Estimated { row, col } => {
                held = x_hat[col];
                add_column(g0, row, held, next);
            }
            Kind::Given(j) => {
                let now = &gamma[j * n..][..n];
                add_product(g0, &g[at..at + n], next);
                add_product(g1, now, next);
                g[at..at + n].copy_from_slice(now);
            }
        }
        at += kind.kept(n);
        add_scaled(value, next, flow);
        add_product(hold, column, next);
        column.copy_from_slice(next);
        if let Kind::Estimated { row, .. } = *kind {
            add_column(g1, row, held, next);
        }
        add_scaled(value, next, guess);
    }
    // the predicted state: that of the reading
    if !follows {
        guess.copy_from_slice(flow);
        for (i, kind) in l.kinds.iter().enumerate() {
            if let Kind::Estimated { row, col } = *kind {
                add_column(g1, row, theta[x0 + i] * x_hat[col], guess);
            }
        }
    }
    // the corrector
    for (i, kind) in l.kinds.iter().enumerate() {
        if let Kind::Estimated { row, col } = *kind {
            add_column(g1, row, guess[col], &mut psi[(x0 + i) * n..][..n]);
            add_column(g1, row, theta[x0 + i] * guess[col], flow);
        }
    }
    least_squares(
        l,
        fixed,
        sample,
        Filtered { psi, psi_0, flow },
        Fit { theta, ud, gram, sums, residuals, phi, gain, work },
    );
    if follows {
        x_hat.copy_from_slice(psi_0);
        for i in 0..all {
            add_scaled(theta[i], &psi[i * n..][..n], x_hat);
        }
    } else {
        x_hat.copy_from_slice(flow);
    }
}

/// What the filters say at a sample.
struct Filtered<'a, T> {
    psi: &'a [T],
    psi_0: &'a [T],
    flow: &'a [T],
}

/// What the least squares change, and their scratch.
struct Fit<'a, T> {
    theta: &'a mut [T],
    ud: &'a mut [T],
    gram: &'a mut [T],
    sums: &'a mut [T],
    residuals: &'a mut [T],
    phi: &'a mut [T],
    gain: &'a mut [T],
    work: &'a mut [T],
}

/// Forgets, takes in the outputs one after the other, and keeps `theta` in its box.
#[inline(always)]
fn least_squares<T: Real>(
    l: &Layout,
    fixed: &[T],
    sample: &[T],
    at: Filtered<'_, T>,
    fit: Fit<'_, T>,
) {
    let (n, q, x0, p, all) = (l.n, l.q, l.x0, l.p, l.all());
    let Fit { theta, ud, gram, sums, residuals, phi, gain, work } = fit;
    let (c, r) = (&fixed[l.c.clone()], &fixed[l.r.clone()]);
    let (y, present) = (&sample[l.y.clone()], &sample[l.present.clone()]);
    let [mu, half, cap] = [0, 1, 2].map(|i| fixed[l.rates.start + i]);
    let one = T::one();
    let some = present.iter().fold(T::zero(), |most, x| x.max(most));
    let forgets = some.gt(T::zero()) & ud::trace(all, x0, ud).le(cap);
    let inverse = T::select(forgets, mu, one).recip();
    let half = T::select(forgets, half, one);
    for i in 0..all {
        let mut growth = inverse;
        if i < x0 {
            // what no regressor reaches any more would only grow
            let size = at.psi[i * n..][..n].iter().fold(T::zero(), |m, x| x.abs().max(m));
            growth = T::select(size.gt(T::splat(GONE)), inverse, one);
        }
        ud[i * all + i] = ud[i * all + i] * growth;
    }
    for j in 0..q {
        let row = &c[j * n..][..n];
        for i in 0..all {
            phi[i] = dot(row, &at.psi[i * n..][..n], T::zero()) * present[j];
        }
        let plain = y[j] - dot(row, at.psi_0, T::zero());
        let e = (plain - dot(phi, theta, T::zero())) * present[j];
        let total = ud::update(ud, phi, r[j], gain, work);
        let step = if l.reading == Reading::Obs {
            // led by the state: P of the middle of the step
            let led = (y[j] - dot(row, at.flow, T::zero())) * present[j];
            let middle = (T::splat(0.5) * half).mul_add(total - r[j], r[j]);
            half * led / middle
        } else {
            e / total
        };
        for i in 0..all {
            theta[i] = gain[i].mul_add(step, theta[i]);
        }
        for a in 0..p {
            for b in 0..=a {
                gram[a * p + b] = phi[x0 + a].mul_add(phi[x0 + b], gram[a * p + b]);
            }
        }
        // R / w, which is the same for all outputs but for R
        sums[0] = (e * e / r[j]) + sums[0];
        sums[1] = sums[1] + present[j];
        residuals[j] = e;
    }
    let bounds = [&fixed[l.low.clone()], &fixed[l.high.clone()]];
    ud::project(x0, ud, bounds, theta, work);
}
