//! What a step does to the states, written once for both lane axes.
//!
//! A [`Source`] gives the coefficients: [`Each`] loads those of eight models,
//! [`Repeat`] gives those of one model to eight trials. The order of the
//! operations is the same, and so are the bits.

use crate::real::Real;
use crate::simd::Block;

/// Coefficients of a model, entry by entry in row order.
pub(crate) trait Source<T: Real>: Copy {
    /// Entry `e`.
    fn at(self, e: usize) -> T;
}

/// Eight models, one a lane.
#[derive(Clone, Copy)]
pub(crate) struct Each<'a> {
    pub(crate) blocks: &'a [Block],
    pub(crate) group: usize,
}

impl<T: Real> Source<T> for Each<'_> {
    #[inline(always)]
    fn at(self, e: usize) -> T {
        T::load(&self.blocks[e].0[self.group * T::LANES..])
    }
}

/// One model in every lane.
#[derive(Clone, Copy)]
pub(crate) struct Repeat<'a>(pub(crate) &'a [f64]);

impl<T: Real> Source<T> for Repeat<'_> {
    #[inline(always)]
    fn at(self, e: usize) -> T {
        T::splat(self.0[e])
    }
}

/// `x <- A x + B u`; `next` is scratch.
#[inline(always)]
pub(crate) fn propagate<T: Real>(
    a: impl Source<T>,
    b: impl Source<T>,
    u: &[T],
    x: &mut [T],
    next: &mut [T],
) {
    let (n, m) = (x.len(), u.len());
    for i in 0..n {
        let mut sum = T::zero();
        for j in 0..n {
            sum = a.at(i * n + j).mul_add(x[j], sum);
        }
        for j in 0..m {
            sum = b.at(i * m + j).mul_add(u[j], sum);
        }
        next[i] = sum;
    }
    x.copy_from_slice(&next[..n]);
}

/// `r = y - C x`.
#[inline(always)]
pub(crate) fn innovate<T: Real>(c: impl Source<T>, x: &[T], y: &[T], r: &mut [T]) {
    let n = x.len();
    for i in 0..r.len() {
        let mut sum = y[i];
        for j in 0..n {
            sum = c.at(i * n + j).neg_mul_add(x[j], sum);
        }
        r[i] = sum;
    }
}

/// `|W r|^2` for a lower triangular `W`.
#[inline(always)]
pub(crate) fn whiten<T: Real>(w: impl Source<T>, r: &[T]) -> T {
    let q = r.len();
    let mut square = T::zero();
    for i in 0..q {
        let mut z = T::zero();
        for j in 0..=i {
            z = w.at(i * q + j).mul_add(r[j], z);
        }
        square = z.mul_add(z, square);
    }
    square
}

/// `x <- x + K r`.
#[inline(always)]
pub(crate) fn correct<T: Real>(k: impl Source<T>, r: &[T], x: &mut [T]) {
    let q = r.len();
    for i in 0..x.len() {
        for j in 0..q {
            x[i] = k.at(i * q + j).mul_add(r[j], x[i]);
        }
    }
}
