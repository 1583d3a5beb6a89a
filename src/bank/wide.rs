//! A step of one discrete filter of any size, for some vectors of records or trials.
//!
//! Four rows are summed side by side, and each coefficient is broadcast once for `V`
//! vectors: with `V` = 4 sixteen sums of which none waits for another, so that the
//! multiply-adds limit the step. The order of the operations, and so the bits, are those of
//! [`filter_step`](super::filter::filter_step).

use super::filter::Filter;
use crate::real::Real;

/// Predicts (unless the states stay, `still`), innovates and corrects; returns `|W r|^2`.
/// `next` and `r` are scratch.
///
/// ```text
/// x <- A x + B u,   r = y - C x,   x <- x + K r
/// ```
#[inline(always)]
pub(super) fn wide_step<T: Real, const V: usize>(
    f: Filter<'_>,
    still: bool,
    u: &[[T; V]],
    y: &[[T; V]],
    x: &mut [[T; V]],
    next: &mut [[T; V]],
    r: &mut [[T; V]],
) -> [T; V] {
    if still {
        next.copy_from_slice(x);
    } else {
        product::<T, V, false>(f.a, x, Start::Zero, next);
        if !u.is_empty() {
            product::<T, V, false>(f.b, u, Start::Here, next);
        }
    }
    product::<T, V, true>(f.c, next, Start::At(y), r);
    let q = r.len();
    let mut square = [T::zero(); V];
    for p in 0..q {
        let mut z = [T::zero(); V];
        for (&w, r) in f.w[p * q..][..=p].iter().zip(&*r) {
            let w = T::splat(w);
            for v in 0..V {
                z[v] = w.mul_add(r[v], z[v]);
            }
        }
        for v in 0..V {
            square[v] = z[v].mul_add(z[v], square[v]);
        }
    }
    product::<T, V, false>(f.k, r, Start::At(next), x);
    square
}

/// What a product is added to, or subtracted from.
#[derive(Clone, Copy)]
enum Start<'a, T, const V: usize> {
    Zero,
    At(&'a [[T; V]]),
    /// What is in the place of the result.
    Here,
}

/// `out = start + A x`, or `start - A x`, four rows side by side.
#[inline(always)]
fn product<T: Real, const V: usize, const MINUS: bool>(
    a: &[f64],
    x: &[[T; V]],
    start: Start<'_, T, V>,
    out: &mut [[T; V]],
) {
    let len = out.len();
    let mut i = 0;
    while i + 4 <= len {
        rows::<T, V, 4, MINUS>(a, x, start, out, i);
        i += 4;
    }
    if i + 2 <= len {
        rows::<T, V, 2, MINUS>(a, x, start, out, i);
        i += 2;
    }
    if i < len {
        rows::<T, V, 1, MINUS>(a, x, start, out, i);
    }
}

/// Rows `i` to `i + R - 1`.
#[inline(always)]
fn rows<T: Real, const V: usize, const R: usize, const MINUS: bool>(
    a: &[f64],
    x: &[[T; V]],
    start: Start<'_, T, V>,
    out: &mut [[T; V]],
    i: usize,
) {
    let n = x.len();
    let mut row: [&[f64]; R] = [&[]; R];
    for r in 0..R {
        row[r] = &a[(i + r) * n..][..n];
    }
    let out = &mut out[i..][..R];
    // in registers: behind the reference they would be written at every entry
    let mut sums = [[T::zero(); V]; R];
    match start {
        Start::Zero => {}
        Start::At(start) => sums.copy_from_slice(&start[i..][..R]),
        Start::Here => sums.copy_from_slice(out),
    }
    for (j, x) in x.iter().enumerate() {
        for r in 0..R {
            let entry = T::splat(row[r][j]);
            for v in 0..V {
                sums[r][v] = if MINUS {
                    entry.neg_mul_add(x[v], sums[r][v])
                } else {
                    entry.mul_add(x[v], sums[r][v])
                };
            }
        }
    }
    out.copy_from_slice(&sums);
}
