//! Products accumulated in twice the working precision, for residuals.
//!
//! A correction is only as good as the residual behind it. With the residual of
//! the stored `X` known to twice the precision, one Newton step leaves an error
//! near the rounding of `X` itself, whatever the condition of the equation.

use super::ops::outlined;
use crate::real::Real;

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
        let steps = if form == Form::Plain { [depth, 1] } else { [1, rows] };
        let (c_hi, c_lo) = (&mut c.hi[..rows * cols], &mut c.lo[..rows * cols]);
        let sign = T::splat(sign);
        let mut j = 0;
        while j + 4 <= cols {
            column::<T, 4>(sign, a, b, [&mut *c_hi, &mut *c_lo], [j, rows, depth, cols], steps);
            j += 4;
        }
        while j < cols {
            column::<T, 1>(sign, a, b, [&mut *c_hi, &mut *c_lo], [j, rows, depth, cols], steps);
            j += 1;
        }
    }
}

/// Columns `j..j + W` of the product.
#[inline(always)]
fn column<T: Real, const W: usize>(
    sign: T,
    a: Pair<'_, T>,
    b: Pair<'_, T>,
    [c_hi, c_lo]: [&mut [T]; 2],
    [j, rows, depth, cols]: [usize; 4],
    steps: [usize; 2],
) {
    // Numbers that carry twice the digits themselves have no such anchor.
    if T::EPSILON < f64::EPSILON {
        for i in 0..rows {
            let at = [i, j, depth, cols];
            strip::<T, W>(sign, a, b, [&mut *c_hi, &mut *c_lo], at, steps);
        }
        return;
    }
    let mut largest = [T::zero(); W];
    for k in 0..depth {
        let row = &b.hi[k * cols + j..][..W];
        for w in 0..W {
            largest[w] = largest[w].max(row[w].abs());
        }
    }
    for i in 0..rows {
        let at = [i, j, depth, cols];
        anchored::<T, W>(sign, a, b, [&mut *c_hi, &mut *c_lo], at, steps, largest);
    }
}

/// As [`strip`], with fewer operations: sums run beside an anchor `s` that is
/// four times what they can reach, so that what a step adds to `hi` is known
/// exactly, and what it leaves goes to `lo` (after Rump, Ogita, Oishi 2008).
///
/// ```text
/// s = 4 (|c| + sum |a| max|b|):   t = fl(hi + a b),  lo += a b - (t - hi),  hi = t
/// ```
#[inline(always)]
fn anchored<T: Real, const W: usize>(
    sign: T,
    a: Pair<'_, T>,
    b: Pair<'_, T>,
    [c_hi, c_lo]: [&mut [T]; 2],
    [i, j, depth, cols]: [usize; 4],
    [step_i, step_k]: [usize; 2],
    largest: [T; W],
) {
    let at = i * cols + j;
    let mut size = T::zero();
    for k in 0..depth {
        size = size + a.hi[i * step_i + k * step_k].abs();
    }
    let mut anchor = [T::zero(); W];
    let (mut hi, mut lo) = ([T::zero(); W], [T::zero(); W]);
    for w in 0..W {
        let c = c_hi[at + w];
        anchor[w] = T::splat(4.0) * size.mul_add(largest[w], c.abs());
        hi[w] = anchor[w] + c;
        lo[w] = c_lo[at + w] + (c - (hi[w] - anchor[w]));
    }
    for k in 0..depth {
        let x = sign * a.hi[i * step_i + k * step_k];
        let row = &b.hi[k * cols + j..][..W];
        for w in 0..W {
            let next = x.mul_add(row[w], hi[w]);
            lo[w] = lo[w] + x.mul_sub(row[w], next - hi[w]);
            hi[w] = next;
        }
        if !a.lo.is_empty() {
            let x = sign * a.lo[i * step_i + k * step_k];
            for w in 0..W {
                lo[w] = x.mul_add(row[w], lo[w]);
            }
        }
        if !b.lo.is_empty() {
            let row = &b.lo[k * cols + j..][..W];
            for w in 0..W {
                lo[w] = x.mul_add(row[w], lo[w]);
            }
        }
    }
    for w in 0..W {
        let (s, f) = two_sum(hi[w] - anchor[w], lo[w]);
        c_hi[at + w] = s;
        c_lo[at + w] = f;
    }
}

/// `W` neighbouring entries of one row of the product.
#[inline(always)]
fn strip<T: Real, const W: usize>(
    sign: T,
    a: Pair<'_, T>,
    b: Pair<'_, T>,
    [c_hi, c_lo]: [&mut [T]; 2],
    [i, j, depth, cols]: [usize; 4],
    [step_i, step_k]: [usize; 2],
) {
    let at = i * cols + j;
    let mut hi: [T; W] = std::array::from_fn(|w| c_hi[at + w]);
    let mut lo: [T; W] = std::array::from_fn(|w| c_lo[at + w]);
    for k in 0..depth {
        let x = sign * a.hi[i * step_i + k * step_k];
        let row = &b.hi[k * cols + j..][..W];
        for w in 0..W {
            let p = x * row[w];
            let e = x.mul_sub(row[w], p);
            let (s, f) = two_sum(hi[w], p);
            hi[w] = s;
            lo[w] = lo[w] + (e + f);
        }
        if !a.lo.is_empty() {
            let x = sign * a.lo[i * step_i + k * step_k];
            for w in 0..W {
                lo[w] = x.mul_add(row[w], lo[w]);
            }
        }
        if !b.lo.is_empty() {
            let row = &b.lo[k * cols + j..][..W];
            for w in 0..W {
                lo[w] = x.mul_add(row[w], lo[w]);
            }
        }
    }
    for w in 0..W {
        let (s, f) = two_sum(hi[w], lo[w]);
        c_hi[at + w] = s;
        c_lo[at + w] = f;
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
