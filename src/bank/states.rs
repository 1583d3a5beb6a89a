//! What a step does to the states, written once for both lane axes.
//!
//! A [`Source`] gives the coefficients: [`Each`] loads those of eight models,
//! [`Repeat`] gives those of one model to eight trials. The order of the
//! operations is the same, and so are the bits.

use crate::real::Real;
use crate::simd::{Block, Grid, Walk};

/// Coefficients of a model, entry by entry in row order.
pub(crate) trait Source<T: Real>: Copy {
    /// Entry `e`.
    fn at(self, e: usize) -> T;

    /// `sum[r] += A(i + r, :) x`, or `-=`, entry after entry of a row; the rows are summed
    /// side by side, as a sum waits for itself at every entry.
    #[inline(always)]
    fn rows<const R: usize, const MINUS: bool>(self, i: usize, x: &[T], sum: &mut [T; R]) {
        let n = x.len();
        let mut sums = *sum;
        for j in 0..n {
            for r in 0..R {
                let entry = self.at((i + r) * n + j);
                sums[r] = if MINUS {
                    entry.neg_mul_add(x[j], sums[r])
                } else {
                    entry.mul_add(x[j], sums[r])
                };
            }
        }
        *sum = sums;
    }
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

    #[inline(always)]
    fn rows<const R: usize, const MINUS: bool>(self, i: usize, x: &[T], sum: &mut [T; R]) {
        let n = x.len();
        let (a, b) = (Grid::new(self.0, [i + R, n], [n, 1]), Grid::new(x, [n, 1], [1, 1]));
        let mut walk = Walk::<f64, T, R, 1>::new::<false>(a, b, (i, 0), (0, n));
        let (mut entry, mut of_x) = ([0.0; R], [T::zero()]);
        // in registers: behind the reference they would be written at every entry
        let mut sums = *sum;
        while walk.step(&mut entry, &mut of_x) {
            for r in 0..R {
                let entry = T::splat(entry[r]);
                sums[r] = if MINUS {
                    entry.neg_mul_add(of_x[0], sums[r])
                } else {
                    entry.mul_add(of_x[0], sums[r])
                };
            }
        }
        *sum = sums;
    }
}

/// `sum += A x`, or `sum -= A x`, four rows side by side.
#[inline(always)]
pub(crate) fn add_product<T: Real, const MINUS: bool>(a: impl Source<T>, x: &[T], sum: &mut [T]) {
    let (fours, rest) = sum.as_chunks_mut::<4>();
    for (k, sum) in fours.iter_mut().enumerate() {
        a.rows::<4, MINUS>(4 * k, x, sum);
    }
    let first = 4 * fours.len();
    let (pair, single) = rest.as_chunks_mut::<2>();
    for sum in pair.iter_mut() {
        a.rows::<2, MINUS>(first, x, sum);
    }
    let first = first + 2 * pair.len();
    for sum in single.as_chunks_mut::<1>().0 {
        a.rows::<1, MINUS>(first, x, sum);
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
