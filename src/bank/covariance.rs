//! The covariance recursion, models in lanes.
//!
//! Limited by fused multiply-adds: about `4 n^3 + 3 n^2 q` of them a model and
//! step, once for all trials.

use super::matrices::{Matrices, Sizes};
use crate::real::{Mask, Real, ln};
use crate::simd::{Block, Kernel, Panel, groups, load_group, store_group};
use crate::small::{
    Dyn, cholesky, cholesky_solve, mul, mul_sub, solve_lower, sym_mul_add_nt, sym_mul_nt,
    sym_update, transpose,
};

/// `ln(2 pi) / 2`.
pub(super) const HALF_LN_2_PI: f64 = 0.918_938_533_204_672_8;

/// Blocks of scratch that [`Predict`] and [`Update`] take.
pub(super) fn scratch_len(s: Sizes) -> usize {
    let Sizes { n, q, .. } = s;
    (5 * n * n).max(4 * n * n + 5 * n * q + 3 * q * q)
}

/// Blocks seen as numbers; the oracle, one number in place of eight, takes its own.
#[inline(always)]
fn scratch<'a, T: Real>(blocks: &'a mut [Block], own: &'a mut Vec<T>) -> &'a mut [T] {
    let len = blocks.len();
    match T::view_mut(blocks) {
        Some(lanes) => lanes,
        None => {
            own.resize(len, T::zero());
            own
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

/// `P <- A P A' + G Q G'`.
pub(super) struct Predict<'a> {
    pub(super) sizes: Sizes,
    pub(super) matrices: &'a Matrices,
    pub(super) p: &'a mut Panel,
    pub(super) scratch: &'a mut [Block],
}

impl Kernel for Predict<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let n = self.sizes.n;
        let mut own = Vec::new();
        let mut rest = scratch::<T>(self.scratch, &mut own);
        let (a, q, p) = (cut(&mut rest, n * n), cut(&mut rest, n * n), cut(&mut rest, n * n));
        let (next, work) = (cut(&mut rest, n * n), cut(&mut rest, n * n));
        for block in 0..self.p.n_blocks() {
            for group in 0..groups::<T>() {
                load_group(self.matrices.a.block(block), group, a);
                load_group(self.matrices.q.block(block), group, q);
                load_group(self.p.block(block), group, p);
                sym_update(Dyn(n), Dyn(n), a, p, q, next, work);
                store_group(next, group, self.p.block_mut(block));
            }
        }
    }
}

/// The measurement update in Joseph's form, for the outputs that are present.
///
/// ```text
/// S = C P C' + R,  K = P C' S^-1,  W = L^-1 with S = L L'
/// P <- (I - K C) P (I - K C)' + K R K'
/// log_norm = -1/2 ln det S - q/2 ln 2 pi
/// ```
/// Rows and columns of outputs that are missing count as if they were not
/// there: their columns of `K` and rows of `W` are zero.
pub(super) struct Update<'a> {
    pub(super) sizes: Sizes,
    pub(super) matrices: &'a Matrices,
    pub(super) present: &'a [bool],
    pub(super) p: &'a Panel,
    /// The updated covariance, unless only the gain is wanted.
    pub(super) next: Option<&'a mut Panel>,
    pub(super) k: &'a mut Panel,
    pub(super) w: &'a mut Panel,
    pub(super) log_norm: &'a mut Panel,
    pub(super) scratch: &'a mut [Block],
}

impl Kernel for Update<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(mut self) {
        let Sizes { n, q, .. } = self.sizes;
        let mut own = Vec::new();
        let mut rest = scratch::<T>(self.scratch, &mut own);
        let (c, cp) = (cut(&mut rest, q * n), cut(&mut rest, q * n));
        let (k, kr, kt) = (cut(&mut rest, n * q), cut(&mut rest, n * q), cut(&mut rest, q * n));
        let (r, s, w) = (cut(&mut rest, q * q), cut(&mut rest, q * q), cut(&mut rest, q * q));
        let (p, joseph) = (cut(&mut rest, n * n), cut(&mut rest, n * n));
        let (next, half) = (cut(&mut rest, n * n), cut(&mut rest, n * n));
        for block in 0..self.p.n_blocks() {
            for group in 0..groups::<T>() {
                load_group(self.matrices.c.block(block), group, c);
                load_group(self.matrices.r.block(block), group, r);
                load_group(self.p.block(block), group, p);
                // an output that is missing is one of unit variance that sees nothing
                for j in 0..q {
                    if !self.present[j] {
                        for i in 0..n {
                            c[j * n + i] = T::zero();
                        }
                        for i in 0..q {
                            r[j * q + i] = T::zero();
                            r[i * q + j] = T::zero();
                        }
                        r[j * q + j] = T::one();
                    }
                }
                mul(Dyn(q), Dyn(n), Dyn(n), c, p, cp);
                s.copy_from_slice(r);
                sym_mul_add_nt(Dyn(q), Dyn(n), cp, c, s);
                let definite = cholesky(Dyn(q), s);
                let mut log_norm = T::zero();
                for j in 0..q {
                    if self.present[j] {
                        log_norm = log_norm - ln(s[j * q + j]) - T::splat(HALF_LN_2_PI);
                    }
                }
                // K' = S^-1 C P
                kt.copy_from_slice(cp);
                cholesky_solve(Dyn(q), Dyn(n), s, kt);
                transpose(Dyn(q), Dyn(n), kt, k);
                for i in 0..q {
                    for j in 0..q {
                        let unit = if i == j && self.present[j] { 1.0 } else { 0.0 };
                        w[i * q + j] = T::splat(unit);
                    }
                }
                solve_lower(Dyn(q), Dyn(q), s, w);
                let bad = !definite;
                if bad.any() {
                    // a member without an innovation covariance: NaN marks it
                    log_norm = T::select(bad, T::splat(f64::NAN), log_norm);
                    for x in k.iter_mut().chain(w.iter_mut()) {
                        *x = T::select(bad, T::zero(), *x);
                    }
                }
                store_group(k, group, self.k.block_mut(block));
                store_group(w, group, self.w.block_mut(block));
                store_group(&[log_norm], group, self.log_norm.block_mut(block));
                if let Some(out) = &mut self.next {
                    // (I - K C) P (I - K C)' + K R K'
                    for i in 0..n {
                        for j in 0..n {
                            joseph[i * n + j] = T::splat(if i == j { 1.0 } else { 0.0 });
                        }
                    }
                    mul_sub(Dyn(n), Dyn(q), Dyn(n), k, c, joseph);
                    mul(Dyn(n), Dyn(q), Dyn(q), k, r, kr);
                    mul(Dyn(n), Dyn(n), Dyn(n), joseph, p, half);
                    sym_mul_nt(Dyn(n), Dyn(n), half, joseph, next);
                    sym_mul_add_nt(Dyn(n), Dyn(q), kr, k, next);
                    store_group(next, group, out.block_mut(block));
                }
            }
        }
    }
}
