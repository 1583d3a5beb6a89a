//! A step of every model on one stream, models in lanes.

use super::gains::Coefficients;
use super::matrices::Sizes;
use super::states::{Each, Repeat, Source, correct, innovate, propagate, whiten};
use crate::real::Real;
use crate::simd::{Block, Kernel, Panel, groups, load_group, store_group};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// `x <- A x + B u`.
    Predict,
    /// `r = y - C x`, `x <- x + K r`.
    Update,
    /// Both ends of an interval with signals that are held:
    /// `r_0 = y - C x`, `x <- A x + B u + K r_0`, `r_1 = y - C x`.
    Hold,
}

/// Blocks that [`Advance::scratch`] holds.
pub(super) fn scratch_len(s: Sizes) -> usize {
    2 * s.n + 3 * s.q + s.m
}

pub(super) struct Advance<'a> {
    pub(super) part: Part,
    /// Length of the step in seconds.
    pub(super) dt: f64,
    pub(super) c: &'a Coefficients,
    /// Norm of the energy, lower triangular and row-major; empty for the
    /// identity.
    pub(super) norm: &'a [f64],
    pub(super) u: &'a [f64],
    pub(super) y: &'a [f64],
    /// Outputs without a number have `y = 0` and are left out of everything.
    pub(super) present: &'a [bool],
    pub(super) x: &'a mut Panel,
    pub(super) r: &'a mut Panel,
    /// `log_lik`, `nis`, `energy`, `increment`.
    pub(super) numbers: &'a mut Panel,
    /// Whitened `C x` at every node of an interval that is cut into equal parts
    /// (`c` is then that of a part).
    pub(super) nodes: Option<&'a mut Panel>,
    pub(super) scratch: &'a mut [Block],
}

impl Kernel for Advance<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(mut self) {
        let (n, q, m) = (self.x.rows(), self.r.rows(), self.u.len());
        let mut own = Vec::new();
        let scratch = match T::view_mut(self.scratch) {
            Some(lanes) => lanes,
            None => {
                // the oracle: one number in place of eight
                own.resize(2 * n + 3 * q + m, T::zero());
                &mut own[..]
            }
        };
        let (x, rest) = scratch.split_at_mut(n);
        let (next, rest) = rest.split_at_mut(n);
        let (y, rest) = rest.split_at_mut(q);
        let (r, rest) = rest.split_at_mut(q);
        let (end, rest) = rest.split_at_mut(q);
        let u = &mut rest[..m];
        for j in 0..q {
            y[j] = T::splat(self.y[j]);
        }
        for j in 0..m {
            u[j] = T::splat(self.u[j]);
        }
        let c = self.c;
        for block in 0..self.x.n_blocks() {
            for group in 0..groups::<T>() {
                let a = Each { blocks: c.a.block(block), group };
                let b = Each { blocks: c.b.block(block), group };
                let out = Each { blocks: c.c.block(block), group };
                let k = Each { blocks: c.k.block(block), group };
                let w = Each { blocks: c.w.block(block), group };
                let white = Each { blocks: c.white.block(block), group };
                let number = |panel: &Panel| panel.block(block)[0].0;
                let bias = T::load(&number(&c.bias)[group * T::LANES..]);
                let log_norm = T::load(&number(&c.log_norm)[group * T::LANES..]);
                load_group(self.x.block(block), group, x);
                if self.part == Part::Predict {
                    propagate(a, b, u, x, next);
                    store_group(x, group, self.x.block_mut(block));
                    continue;
                }
                innovate(out, x, y, r);
                leave_out(self.present, r);
                let energy = if self.norm.is_empty() {
                    let mut sum = T::zero();
                    for j in 0..q {
                        sum = r[j].mul_add(r[j], sum);
                    }
                    sum
                } else {
                    whiten(Repeat(self.norm), r)
                };
                let nis = whiten(w, r);
                let log_lik = T::splat(0.5).neg_mul_add(nis, log_norm);
                let second = whiten(white, r);
                let increment;
                if self.part == Part::Update {
                    increment = T::splat(-0.5).mul_add(second, -bias);
                    correct(k, r, x);
                } else {
                    let parts = self.nodes.as_ref().map_or(1, |h| h.rows() / q - 1);
                    end.copy_from_slice(r);
                    for part in 0..parts {
                        if let Some(nodes) = &mut self.nodes {
                            let h = &mut nodes.block_mut(block)[part * q..][..q];
                            whitened_output(white, y, end, h, group);
                        }
                        propagate(a, b, u, x, next);
                        correct(k, end, x);
                        innovate(out, x, y, end);
                        leave_out(self.present, end);
                    }
                    if let Some(nodes) = &mut self.nodes {
                        let h = &mut nodes.block_mut(block)[parts * q..][..q];
                        whitened_output(white, y, end, h, group);
                    }
                    // -(|r_0|^2 + |r_1|^2) / 4 - tr(C L) / 2, times dt
                    let ends = T::splat(0.25) * (second + whiten(white, end));
                    increment = -(ends + bias) * T::splat(self.dt);
                }
                store_group(x, group, self.x.block_mut(block));
                store_group(r, group, self.r.block_mut(block));
                let numbers = [log_lik, nis, energy, increment];
                store_group(&numbers, group, self.numbers.block_mut(block));
            }
        }
    }
}

/// Zero residuals for outputs that are missing.
#[inline(always)]
fn leave_out<T: Real>(present: &[bool], r: &mut [T]) {
    for j in 0..r.len() {
        if !present[j] {
            r[j] = T::zero();
        }
    }
}

/// `W C x = W (y - r)`.
#[inline(always)]
fn whitened_output<T: Real>(white: Each<'_>, y: &[T], r: &[T], out: &mut [Block], group: usize) {
    let q = y.len();
    for i in 0..q {
        let mut sum = T::zero();
        for j in 0..=i {
            let entry: T = white.at(i * q + j);
            sum = entry.mul_add(y[j] - r[j], sum);
        }
        store_group(&[sum], group, &mut out[i..=i]);
    }
}
