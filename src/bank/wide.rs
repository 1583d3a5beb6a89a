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
    if !still {
        for sum in next.iter_mut() {
            *sum = [T::zero(); V];
        }
        add_product::<T, V, false>(f.a, x, next);
        if !u.is_empty() {
            add_product::<T, V, false>(f.b, u, next);
        }
        x.copy_from_slice(next);
    }
    r.copy_from_slice(y);
    add_product::<T, V, true>(f.c, x, r);
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
    add_product::<T, V, false>(f.k, r, x);
    square
}

/// `sum += A x`, or `sum -= A x`, four rows side by side.
#[inline(always)]
fn add_product<T: Real, const V: usize, const MINUS: bool>(
    a: &[f64],
    x: &[[T; V]],
    sum: &mut [[T; V]],
) {
    let (fours, rest) = sum.as_chunks_mut::<4>();
    let mut at = 0;
    for sum in fours {
        rows::<T, V, 4, MINUS>(&a[at..], x, sum);
        at += 4 * x.len();
    }
    let (pair, single) = rest.as_chunks_mut::<2>();
    for sum in pair {
        rows::<T, V, 2, MINUS>(&a[at..], x, sum);
        at += 2 * x.len();
    }
    for sum in single.as_chunks_mut::<1>().0 {
        rows::<T, V, 1, MINUS>(&a[at..], x, sum);
    }
}

/// The first `R` rows of `a` times `x`.
#[inline(always)]
fn rows<T: Real, const V: usize, const R: usize, const MINUS: bool>(
    a: &[f64],
    x: &[[T; V]],
    sum: &mut [[T; V]; R],
) {
    let n = x.len();
    let mut row: [&[f64]; R] = [&[]; R];
    for r in 0..R {
        row[r] = &a[r * n..][..n];
    }
    // in registers: behind the reference they would be written at every entry
    let mut sums = *sum;
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
    *sum = sums;
}
