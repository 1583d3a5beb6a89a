//! Eigenvectors of a root by inverse iteration, left and right, from one factorisation.

use super::{CONDITION, Spectrum, reciprocal};
use crate::real::Real;
use crate::small::Cx;

impl<T: Real> Spectrum<T> {
    /// Factors `H - z I`; pivots below `least` become `least`.
    #[inline(always)]
    pub(super) fn factor(&mut self, z: Cx<T>, least: T) {
        let n = self.n;
        let upper = &mut self.upper[..];
        for i in 0..n {
            for j in i.saturating_sub(1)..n {
                upper[i * n + j] = Cx::real(self.h[i * n + j]);
            }
            upper[i * n + i] = upper[i * n + i] - z;
        }
        for k in 0..n {
            let (top, below) = upper.split_at_mut((k + 1) * n);
            let row = &mut top[k * n..];
            if k + 1 < n {
                let next = &mut below[..n];
                let swap = row[k].abs1().lt(next[k].abs1());
                for j in k..n {
                    let (p, q) = (row[j], next[j]);
                    (row[j], next[j]) = (Cx::select(swap, q, p), Cx::select(swap, p, q));
                }
                self.exchanged[k] = swap;
            }
            row[k] = Cx::select(row[k].abs1().lt(least), Cx::real(least), row[k]);
            self.inverse[k] = reciprocal(row[k]);
            if k + 1 < n {
                let next = &mut below[..n];
                let factor = next[k] * self.inverse[k];
                for j in k + 1..n {
                    next[j] = factor.neg_mul_add(row[j], next[j]);
                }
                self.factor[k] = factor;
            }
        }
    }

    /// `x <- U^-1 x`, to a size of one.
    #[inline(always)]
    fn solve_upper(&mut self) {
        let n = self.n;
        for i in (0..n).rev() {
            let mut sum = self.x[i];
            for j in i + 1..n {
                sum = self.upper[i * n + j].neg_mul_add(self.x[j], sum);
            }
            self.x[i] = sum * self.inverse[i];
        }
        even_out(&mut self.x);
    }

    /// `x <- L^-1 P x`.
    #[inline(always)]
    fn solve_lower(&mut self) {
        for k in 0..self.n - 1 {
            swap_where(self.exchanged[k], &mut self.x[k..k + 2]);
            self.x[k + 1] = self.factor[k].neg_mul_add(self.x[k], self.x[k + 1]);
        }
    }

    /// `x <- (H - z I)^-T x`, to a size of one.
    #[inline(always)]
    fn solve_transposed(&mut self) {
        let n = self.n;
        for i in 0..n {
            let mut sum = self.x[i];
            for j in 0..i {
                sum = self.upper[j * n + i].neg_mul_add(self.x[j], sum);
            }
            self.x[i] = sum * self.inverse[i];
        }
        for k in (0..n - 1).rev() {
            self.x[k] = self.factor[k].neg_mul_add(self.x[k + 1], self.x[k]);
            swap_where(self.exchanged[k], &mut self.x[k..k + 2]);
        }
        even_out(&mut self.x);
    }

    /// The vectors of root `k`, of which the matrix is factored, and the root again from
    /// them; false in lanes where it is ill-conditioned.
    #[inline(always)]
    pub(super) fn vectors(&mut self, k: usize) -> T::Mask {
        let n = self.n;
        self.x.fill(Cx::real(T::one()));
        self.solve_upper();
        self.solve_lower();
        self.solve_upper();
        times(&self.q, &self.x, &mut self.right[k * n..][..n]);
        self.x.fill(Cx::real(T::one()));
        self.solve_transposed();
        self.solve_transposed();
        times(&self.q, &self.x, &mut self.left[k * n..][..n]);

        let (right, left) = (&self.right[k * n..][..n], &mut self.left[k * n..][..n]);
        let mut product = Cx::zero();
        let (mut size_x, mut size_u) = (T::zero(), T::zero());
        for (&x, &u) in right.iter().zip(&*left) {
            product = u.mul_add(x, product);
            size_x = size_x + x.norm_sqr();
            size_u = size_u + u.norm_sqr();
        }
        let allowed = product.norm_sqr() * T::splat(CONDITION * CONDITION);
        let over = reciprocal(product);
        for u in left.iter_mut() {
            *u = *u * over;
        }
        times(&self.a, right, &mut self.x);
        let mut value = Cx::zero();
        for (&x, &u) in self.x.iter().zip(&*left) {
            value = u.mul_add(x, value);
        }
        self.values[k] = value;
        (size_x * size_u).lt(allowed)
    }
}

/// Exchanges two neighbours in the lanes of `here`.
#[inline(always)]
fn swap_where<T: Real>(here: T::Mask, x: &mut [Cx<T>]) {
    let (p, q) = (x[0], x[1]);
    (x[0], x[1]) = (Cx::select(here, q, p), Cx::select(here, p, q));
}

/// Brings a vector to a size near one.
#[inline(always)]
fn even_out<T: Real>(x: &mut [Cx<T>]) {
    let mut largest = T::zero();
    for x in x.iter() {
        largest = x.abs1().max(largest);
    }
    let over = largest.recip();
    for x in x {
        *x = x.scale(over);
    }
}

/// `out = M x`, `M` real.
#[inline(always)]
fn times<T: Real>(m: &[T], x: &[Cx<T>], out: &mut [Cx<T>]) {
    for (row, out) in m.chunks_exact(x.len()).zip(out) {
        let mut sum = Cx::zero();
        for (&m, x) in row.iter().zip(x) {
            sum = Cx::new(m.mul_add(x.re, sum.re), m.mul_add(x.im, sum.im));
        }
        *out = sum;
    }
}
