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

    /// `len` entries from `first` on.
    fn part(self, first: usize, len: usize) -> Self;
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

    #[inline(always)]
    fn part(self, first: usize, len: usize) -> Self {
        Each { blocks: &self.blocks[first..][..len], group: self.group }
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

    #[inline(always)]
    fn part(self, first: usize, len: usize) -> Self {
        Repeat(&self.0[first..][..len])
    }
}

/// Rows that are summed side by side: a sum waits for itself at every entry.
const SIDE: usize = 4;

/// `sum[r] += sign A(i + r, :) x`, entry after entry of a row.
#[inline(always)]
fn rows<T: Real, S: Source<T>, const R: usize, const MINUS: bool>(
    a: S,
    i: usize,
    x: &[T],
    sum: &mut [T; R],
) {
    let n = x.len();
    let mut row = [a; R];
    for r in 0..R {
        row[r] = a.part((i + r) * n, n);
    }
    for j in 0..n {
        for r in 0..R {
            let entry = row[r].at(j);
            sum[r] =
                if MINUS { entry.neg_mul_add(x[j], sum[r]) } else { entry.mul_add(x[j], sum[r]) };
        }
    }
}

/// `sum += A x`, or `sum -= A x`.
#[inline(always)]
pub(crate) fn add_product<T: Real, const MINUS: bool>(a: impl Source<T>, x: &[T], sum: &mut [T]) {
    let (several, single) = sum.as_chunks_mut::<SIDE>();
    for (k, sum) in several.iter_mut().enumerate() {
        rows::<T, _, SIDE, MINUS>(a, k * SIDE, x, sum);
    }
    let first = several.len() * SIDE;
    for (k, sum) in single.as_chunks_mut::<1>().0.iter_mut().enumerate() {
        rows::<T, _, 1, MINUS>(a, first + k, x, sum);
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
    let next = &mut next[..x.len()];
    for i in 0..next.len() {
        next[i] = T::zero();
    }
    add_product::<T, false>(a, x, next);
    if !u.is_empty() {
        add_product::<T, false>(b, u, next);
    }
    x.copy_from_slice(next);
}

/// `r = y - C x`.
#[inline(always)]
pub(crate) fn innovate<T: Real>(c: impl Source<T>, x: &[T], y: &[T], r: &mut [T]) {
    r.copy_from_slice(&y[..r.len()]);
    add_product::<T, true>(c, x, r);
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
    add_product::<T, false>(k, r, x);
}
