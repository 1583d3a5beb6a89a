//! Scaling by powers of two, lane by lane, so that units do not matter.

use super::ops::{largest, outlined};
use crate::real::{Mask, Real};

/// Sweeps over the states; units that differ by many decades need a few.
const SWEEPS: usize = 6;

/// Exponent of the largest entry, 0 where there is none but zeros.
#[inline(always)]
pub(crate) fn exponent_of<T: Real>(x: &[T]) -> T {
    let largest = largest(x);
    let (_, e) = largest.split();
    T::select(largest.gt(T::zero()), e, T::zero())
}

/// Exponents up to which a power of two is a normal number.
const REACH: f64 = 1000.0;

/// The factors whose product is `2^e`, the second one wherever `e` is within the
/// range of the first.
#[inline(always)]
fn factors<T: Real>(e: T) -> (T, T) {
    let half = (e * T::splat(0.5)).round_ties_even();
    let first = T::select(e.abs().le(T::splat(REACH)), e, half);
    (T::pow2i(first), T::pow2i(e - first))
}

outlined! {
    /// `x *= 2^e`.
    pub(crate) fn shift(x: &'a mut [T], e: T) {
        let (u, v) = factors(e);
        if v.eq(T::one()).all() {
            // As the other branch has it, where `v` is one.
            for x in x {
                *x = *x * u;
            }
            return;
        }
        for x in x {
            *x = *x * u * v;
        }
    }
}

/// `log2` of a magnitude to a tenth, and its absence.
#[inline(always)]
fn log2<T: Real>(x: T) -> (T, T::Mask) {
    let (significand, exponent) = x.split();
    (exponent + (significand - T::one()), x.ge(T::splat(f64::MIN_POSITIVE)))
}

outlined! {
    /// Exponents `k` of the symplectic scaling `x = D x_s`, `D = diag(2^k)`, that
    /// evens out the Hamiltonian of a Riccati equation.
    ///
    /// ```text
    /// A -> D^-1 A D,  G -> D^-1 G D^-1,  Q -> D Q D
    /// per state i, choose f with   f a + f^2 q = p / f + g / f^2:
    /// a = sum |A_ji| + |Q_ji|,  q = |Q_ii|,  p = sum |A_ij| + |G_ij|,  g = |G_ii|   (j != i)
    /// ```
    /// The diagonals of `G` and `Q` take part, so a common factor of both is
    /// absorbed too. `a`, `g`, `q` are overwritten with the scaled magnitudes;
    /// with empty `g` and `q` the scaling is that of a plain matrix `A`
    /// (Osborne 1960).
    pub(crate) fn balance(n: usize, a: &'a mut [T], g: &'a mut [T], q: &'a mut [T], k: &'a mut [T]) {
        k.fill(T::zero());
        for x in a.iter_mut().chain(g.iter_mut()).chain(q.iter_mut()) {
            *x = x.abs();
        }
        let mut active = T::Mask::splat(true);
        for _ in 0..SWEEPS {
            // A sweep that changed nothing by more than a factor of two was the last.
            let mut changed = T::Mask::splat(false);
            for i in 0..n {
                let e = T::select(active, exponent(n, i, [&*a, &*g, &*q]), T::zero());
                changed = changed | e.abs().gt(T::one());
                if !e.abs().gt(T::zero()).any() {
                    continue;
                }
                k[i] = k[i] + e;
                let (up, down) = (T::pow2i(e), T::pow2i(-e));
                for j in 0..n {
                    a[j * n + i] = a[j * n + i] * up;
                    a[i * n + j] = a[i * n + j] * down;
                    if !g.is_empty() {
                        g[j * n + i] = g[j * n + i] * down;
                        g[i * n + j] = g[i * n + j] * down;
                        q[j * n + i] = q[j * n + i] * up;
                        q[i * n + j] = q[i * n + j] * up;
                    }
                }
            }
            active = changed;
            if !active.any() {
                break;
            }
        }
    }
}

/// The exponent that evens out state `i`, 0 where one side is empty.
#[inline(always)]
fn exponent<T: Real>(n: usize, i: usize, [a, g, q]: [&[T]; 3]) -> T {
    let (mut column, mut row) = (T::zero(), T::zero());
    if g.is_empty() {
        for j in 0..n {
            if j != i {
                column = column + a[j * n + i];
                row = row + a[i * n + j];
            }
        }
        let e = (log2(row), log2(column));
        let e = T::select(e.0.1 & e.1.1, (e.0.0 - e.1.0) * T::splat(0.5), T::zero());
        return e.round_ties_even().min(T::splat(500.0)).max(T::splat(-500.0));
    }
    for j in 0..n {
        if j != i {
            column = column + a[j * n + i];
            row = row + a[i * n + j];
            column = column + q[j * n + i];
            row = row + g[j * n + i];
        }
    }
    let (zero, far) = (T::zero(), T::splat(4000.0));
    let columns = [log2(column), log2(q[i * n + i])];
    let rows = [log2(row), log2(g[i * n + i])];
    // Where the larger of two rising lines meets the larger of two falling ones.
    let mut best = -far;
    for (falling, (r, has_row)) in rows.into_iter().enumerate() {
        let mut meet = far;
        for (rising, (c, has_column)) in columns.into_iter().enumerate() {
            let at = (r - c) * T::splat(1.0 / (2 + falling + rising) as f64);
            meet = T::select(has_column, at.min(meet), meet);
        }
        best = T::select(has_row, meet.max(best), best);
    }
    let there = (columns[0].1 | columns[1].1) & (rows[0].1 | rows[1].1);
    let e = T::select(there, best, zero).round_ties_even();
    e.min(T::splat(500.0)).max(T::splat(-500.0))
}

outlined! {
    /// Applies the exponents `k`: `x_ij *= 2^(row k_i + col k_j)`, `x` rows by
    /// cols; `row` and `col` are -1, 0 or 1.
    pub(crate) fn apply(k: &'a [T], sides: [f64; 2], x: &'a mut [T], size: [usize; 2]) {
        let ([row, col], [rows, cols]) = (sides, size);
        let (mut any, mut near) = (T::Mask::splat(false), T::Mask::splat(true));
        for &k in k {
            any = any | k.abs().gt(T::zero());
            near = near & k.abs().le(T::splat(0.5 * REACH));
        }
        if !any.any() {
            return;
        }
        let near = near.all();
        for i in 0..rows {
            let row = side_of(k, row, i);
            for j in 0..cols {
                let x = &mut x[i * cols + j];
                let e = row + side_of(k, col, j);
                // The same bits: there the second factor is one.
                *x = if near {
                    *x * T::pow2i(e)
                } else {
                    let (u, v) = factors(e);
                    *x * u * v
                };
            }
        }
    }
}

/// The exponent of one side, zero where that is not scaled.
#[inline(always)]
fn side_of<T: Real>(k: &[T], side: f64, at: usize) -> T {
    if side == 0.0 { T::zero() } else { k[at] * T::splat(side) }
}
