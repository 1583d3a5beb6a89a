//! Products accumulated in twice the working precision, for residuals.
//!
//! A correction is only as good as the residual behind it. With the residual of
//! the stored `X` known to twice the precision, one Newton step leaves an error
//! near the rounding of `X` itself, whatever the condition of the equation.

use super::ops::outlined;
use crate::real::Real;
use crate::simd::{Grid, GridMut, Walk};
use crate::small::{grid, grid_mut};

/// A matrix held as an unevaluated sum, `hi + lo`; `lo` may be empty for zero.
#[derive(Clone, Copy)]
pub(crate) struct Pair<'a, T> {
    pub(crate) hi: &'a [T],
    pub(crate) lo: &'a [T],
}

/// A matrix that takes a sum, `hi + lo`.
pub(crate) struct PairMut<'a, T> {
    pub(crate) hi: &'a mut [T],
    pub(crate) lo: &'a mut [T],
}

impl<'a, T> From<&'a [T]> for Pair<'a, T> {
    #[inline(always)]
    fn from(hi: &'a [T]) -> Self {
        Pair { hi, lo: &[] }
    }
}

/// How the factors are stored.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// `A B`.
    Plain,
    /// `A' B`.
    LeftTransposed,
}

/// `s + e = a + b` exactly (Knuth).
#[inline(always)]
pub(crate) fn two_sum<T: Real>(a: T, b: T) -> (T, T) {
    let s = a + b;
    let z = s - a;
    (s, (a - (s - z)) + (b - z))
}

outlined! {
    /// `C += sign A B` or `sign A' B`; `size` is rows, depth, columns.
    ///
    /// ```text
    /// p + e = a b exactly,  hi + f = hi + p exactly,  lo += e + f     (Dot2, Ogita et al. 2005)
    /// ```
    pub(crate) fn mul_add_two(form: Form, sign: f64, a: Pair<'a, T>, b: Pair<'a, T>, c: PairMut<'a, T>, size: [usize; 3]) {
        let [rows, depth, cols] = size;
        let (transposed, of_a) = match form {
            Form::Plain => (false, [rows, depth]),
            Form::LeftTransposed => (true, [depth, rows]),
        };
        // where there is no low part the high one stands in its place, and is not read
        let low = [if a.lo.is_empty() { a.hi } else { a.lo }, if b.lo.is_empty() { b.hi } else { b.lo }];
        let (left, left_low) = (grid(a.hi, of_a), grid(low[0], of_a));
        let of_b = [depth, cols];
        let mut sum = Sum {
            sign: T::splat(sign),
            depth,
            a: if transposed { [left.t(), left_low.t()] } else { [left, left_low] },
            b: [grid(b.hi, of_b), grid(low[1], of_b)],
            has_low: [!a.lo.is_empty(), !b.lo.is_empty()],
            c: [grid_mut(c.hi, [rows, cols]), grid_mut(c.lo, [rows, cols])],
        };
        let mut j = 0;
        while j + 4 <= cols {
            sum.columns::<4>(rows, j);
            j += 4;
        }
        while j < cols {
            sum.columns::<1>(rows, j);
            j += 1;
        }
    }
}

/// A product in twice the precision.
struct Sum<'a, T> {
    sign: T,
    depth: usize,
    /// High and low.
    a: [Grid<'a, T>; 2],
    b: [Grid<'a, T>; 2],
    has_low: [bool; 2],
    c: [GridMut<'a, T>; 2],
}

impl<T: Real> Sum<'_, T> {
    /// Numbers that carry twice the digits themselves have no anchor.
    const ANCHORED: bool = T::EPSILON == f64::EPSILON;

    /// Columns `j..j + W` of all rows.
    #[inline(always)]
    fn columns<const W: usize>(&mut self, rows: usize, j: usize) {
        let mut largest = [T::zero(); W];
        if Self::ANCHORED {
            for k in 0..self.depth {
                let [row] = self.b[0].load::<1, W>(k, j);
                for w in 0..W {
                    largest[w] = largest[w].max(row[w].abs());
                }
            }
        }
        for i in 0..rows {
            let at = (i, j);
            let ([mut hi], [mut lo]) = (self.c[0].view().load(i, j), self.c[1].view().load(i, j));
            if Self::ANCHORED {
                self.beside_anchors::<W>(at, &largest, &mut hi, &mut lo);
            } else {
                self.plain::<W>(at, &mut hi, &mut lo);
            }
            if self.has_low[0] {
                self.low::<W>(self.a[1], self.b[0], at, &mut lo);
            }
            if self.has_low[1] {
                self.low::<W>(self.a[0], self.b[1], at, &mut lo);
            }
            for w in 0..W {
                (hi[w], lo[w]) = two_sum(hi[w], lo[w]);
            }
            self.c[0].store(&[hi], at);
            self.c[1].store(&[lo], at);
        }
    }

    /// `lo += sign A B`.
    #[inline(always)]
    fn low<const W: usize>(
        &self,
        a: Grid<'_, T>,
        b: Grid<'_, T>,
        at: (usize, usize),
        lo: &mut [T; W],
    ) {
        let mut walk = Walk::<T, T, 1, W>::new::<false>(a, b, at, (0, self.depth));
        let (mut x, mut row, mut sum) = ([T::zero()], [T::zero(); W], *lo);
        while walk.step(&mut x, &mut row) {
            let x = self.sign * x[0];
            for w in 0..W {
                sum[w] = x.mul_add(row[w], sum[w]);
            }
        }
        *lo = sum;
    }

    /// As [`Sum::plain`], with fewer operations: sums run beside an anchor `s` that is
    /// four times what they can reach, so that what a step adds to `hi` is known
    /// exactly, and what it leaves goes to `lo` (after Rump, Ogita, Oishi 2008).
    ///
    /// ```text
    /// s = 4 (|c| + sum |a| max|b|):   t = fl(hi + a b),  lo += a b - (t - hi),  hi = t
    /// ```
    #[inline(always)]
    fn beside_anchors<const W: usize>(
        &self,
        at: (usize, usize),
        largest: &[T; W],
        out_hi: &mut [T; W],
        out_lo: &mut [T; W],
    ) {
        let mut size = T::zero();
        for k in 0..self.depth {
            size = size + self.a[0].at(at.0, k).abs();
        }
        let (mut hi, mut lo) = (*out_hi, *out_lo);
        let mut anchor = [T::zero(); W];
        for w in 0..W {
            let c = hi[w];
            anchor[w] = T::splat(4.0) * size.mul_add(largest[w], c.abs());
            hi[w] = anchor[w] + c;
            lo[w] = lo[w] + (c - (hi[w] - anchor[w]));
        }
        let mut walk = Walk::<T, T, 1, W>::new::<false>(self.a[0], self.b[0], at, (0, self.depth));
        let (mut x, mut row) = ([T::zero()], [T::zero(); W]);
        while walk.step(&mut x, &mut row) {
            let x = self.sign * x[0];
            for w in 0..W {
                let next = x.mul_add(row[w], hi[w]);
                lo[w] = lo[w] + x.mul_sub(row[w], next - hi[w]);
                hi[w] = next;
            }
        }
        for w in 0..W {
            (out_hi[w], out_lo[w]) = (hi[w] - anchor[w], lo[w]);
        }
    }

    /// `hi + lo += sign A B` of the high parts.
    #[inline(always)]
    fn plain<const W: usize>(&self, at: (usize, usize), out_hi: &mut [T; W], out_lo: &mut [T; W]) {
        let mut walk = Walk::<T, T, 1, W>::new::<false>(self.a[0], self.b[0], at, (0, self.depth));
        let (mut x, mut row) = ([T::zero()], [T::zero(); W]);
        let (mut hi, mut lo) = (*out_hi, *out_lo);
        while walk.step(&mut x, &mut row) {
            let x = self.sign * x[0];
            for w in 0..W {
                let p = x * row[w];
                let e = x.mul_sub(row[w], p);
                let (s, f) = two_sum(hi[w], p);
                hi[w] = s;
                lo[w] = lo[w] + (e + f);
            }
        }
        (*out_hi, *out_lo) = (hi, lo);
    }
}

/// `out = base + (M + M')/2` for the symmetric n by n `base`, added up before it
/// is rounded.
#[inline(always)]
pub(crate) fn symmetric_sum<T: Real>(n: usize, m: Pair<'_, T>, base: &[T], out: &mut [T]) {
    let half = T::splat(0.5);
    for i in 0..n {
        for j in 0..=i {
            let (u, v) = (i * n + j, j * n + i);
            let (s, e) = two_sum(m.hi[u], m.hi[v]);
            let low = half * (e + (m.lo[u] + m.lo[v]));
            let (t, f) = two_sum(base[u], half * s);
            let x = t + (f + low);
            out[u] = x;
            out[v] = x;
        }
    }
}
