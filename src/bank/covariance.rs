//! The covariance recursion, models in lanes.
//!
//! Limited by fused multiply-adds: about `4 n^3 + 3 n^2 q` of them a model and
//! step, once for all trials.

use super::matrices::{Matrices, Sizes};
use crate::real::{Mask, Real, ln};
use crate::simd::{Kernel, Panel, groups, load_group, store_group};
use crate::small::{
    Dyn, cholesky, cholesky_solve, mul, mul_sub, solve_lower, sym_mul_add_nt, sym_mul_nt,
    sym_update, transpose,
};

/// `ln(2 pi) / 2`.
pub(super) const HALF_LN_2_PI: f64 = 0.918_938_533_204_672_8;

/// `P <- A P A' + G Q G'`.
pub(super) struct Predict<'a> {
    pub(super) sizes: Sizes,
    pub(super) matrices: &'a Matrices,
    pub(super) p: &'a mut Panel,
}

impl Kernel for Predict<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let n = self.sizes.n;
        let room = |len: usize| vec![T::zero(); len];
        let (mut a, mut q, mut p) = (room(n * n), room(n * n), room(n * n));
        let (mut next, mut work) = (room(n * n), room(n * n));
        for block in 0..self.p.n_blocks() {
            for group in 0..groups::<T>() {
                load_group(self.matrices.a.block(block), group, &mut a);
                load_group(self.matrices.q.block(block), group, &mut q);
                load_group(self.p.block(block), group, &mut p);
                sym_update(Dyn(n), Dyn(n), &a, &p, &q, &mut next, &mut work);
                store_group(&next, group, self.p.block_mut(block));
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
}

impl Kernel for Update<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(mut self) {
        let Sizes { n, q, .. } = self.sizes;
        let room = |len: usize| vec![T::zero(); len];
        let (mut c, mut r, mut p) = (room(q * n), room(q * q), room(n * n));
        let (mut cp, mut s, mut w) = (room(q * n), room(q * q), room(q * q));
        let (mut k, mut joseph, mut next) = (room(n * q), room(n * n), room(n * n));
        let (mut half, mut kr) = (room(n * n), room(n * q));
        let mut kt = room(q * n);
        for block in 0..self.p.n_blocks() {
            for group in 0..groups::<T>() {
                load_group(self.matrices.c.block(block), group, &mut c);
                load_group(self.matrices.r.block(block), group, &mut r);
                load_group(self.p.block(block), group, &mut p);
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
                mul(Dyn(q), Dyn(n), Dyn(n), &c, &p, &mut cp);
                s.copy_from_slice(&r);
                sym_mul_add_nt(Dyn(q), Dyn(n), &cp, &c, &mut s);
                let definite = cholesky(Dyn(q), &mut s);
                let mut log_norm = T::zero();
                for j in 0..q {
                    if self.present[j] {
                        log_norm = log_norm - ln(s[j * q + j]) - T::splat(HALF_LN_2_PI);
                    }
                }
                // K' = S^-1 C P
                kt.copy_from_slice(&cp);
                cholesky_solve(Dyn(q), Dyn(n), &s, &mut kt);
                transpose(Dyn(q), Dyn(n), &kt, &mut k);
                for i in 0..q {
                    for j in 0..q {
                        let unit = if i == j && self.present[j] { 1.0 } else { 0.0 };
                        w[i * q + j] = T::splat(unit);
                    }
                }
                solve_lower(Dyn(q), Dyn(q), &s, &mut w);
                let bad = !definite;
                if bad.any() {
                    // a member without an innovation covariance: NaN marks it
                    log_norm = T::select(bad, T::splat(f64::NAN), log_norm);
                    for x in k.iter_mut().chain(w.iter_mut()) {
                        *x = T::select(bad, T::zero(), *x);
                    }
                }
                store_group(&k, group, self.k.block_mut(block));
                store_group(&w, group, self.w.block_mut(block));
                store_group(&[log_norm], group, self.log_norm.block_mut(block));
                if let Some(out) = &mut self.next {
                    // (I - K C) P (I - K C)' + K R K'
                    for i in 0..n {
                        for j in 0..n {
                            joseph[i * n + j] = T::splat(if i == j { 1.0 } else { 0.0 });
                        }
                    }
                    mul_sub(Dyn(n), Dyn(q), Dyn(n), &k, &c, &mut joseph);
                    mul(Dyn(n), Dyn(q), Dyn(q), &k, &r, &mut kr);
                    mul(Dyn(n), Dyn(n), Dyn(n), &joseph, &p, &mut half);
                    sym_mul_nt(Dyn(n), Dyn(n), &half, &joseph, &mut next);
                    sym_mul_add_nt(Dyn(n), Dyn(q), &kr, &k, &mut next);
                    store_group(&next, group, out.block_mut(block));
                }
            }
        }
    }
}
