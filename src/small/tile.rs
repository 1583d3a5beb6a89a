//! The one inner loop of products, triangular solves and factorisations: a
//! register tile of sums, each a chain of fused multiply-adds.

pub(super) use crate::simd::Rows;

use crate::real::Real;
use crate::simd::Walk;

/// How the chain of a sum grows.
pub(super) mod chain {
    /// `sum + a b`, inner index rising.
    pub(in crate::small) const ADD: u8 = 0;
    /// `sum - a b`, inner index rising.
    pub(in crate::small) const SUB: u8 = 1;
    /// `sum - a b`, inner index falling.
    pub(in crate::small) const SUB_DOWN: u8 = 2;
}

/// ```text
/// for p in range: sum[r][s] <- sum[r][s] +- A(i + r, p) B(p, j + s)
/// ```
/// `A(i, p)` is `a[i][p]`, or `a[p][i]` when `TA`; `B(p, j)` is `b[p][j]`, or
/// `b[j][p]` when `TB`. The walk checks its slices once and not at every step: at
/// order 8 the checks took more instructions than the arithmetic.
#[inline(always)]
pub(super) fn accumulate<
    T: Real,
    const R: usize,
    const C: usize,
    const TA: bool,
    const TB: bool,
    const CHAIN: u8,
>(
    a: Rows<'_, T>,
    b: Rows<'_, T>,
    at: (usize, usize),
    range: (usize, usize),
    sum: &mut [[T; C]; R],
) {
    let mut walk = if CHAIN == chain::SUB_DOWN {
        Walk::<T, T, R, C>::new::<TA, TB, true>(a, b, at, range)
    } else {
        Walk::<T, T, R, C>::new::<TA, TB, false>(a, b, at, range)
    };
    let (mut ap, mut bp) = ([T::zero(); R], [T::zero(); C]);
    while walk.step(&mut ap, &mut bp) {
        for r in 0..R {
            for s in 0..C {
                sum[r][s] = if CHAIN == chain::ADD {
                    ap[r].mul_add(bp[s], sum[r][s])
                } else {
                    ap[r].neg_mul_add(bp[s], sum[r][s])
                };
            }
        }
    }
}

/// Entries `i..i + R`, `j..j + C`.
#[inline(always)]
pub(super) fn load<T: Real, const R: usize, const C: usize>(
    m: Rows<'_, T>,
    (i, j): (usize, usize),
) -> [[T; C]; R] {
    let mut out = [[T::zero(); C]; R];
    for r in 0..R {
        out[r].copy_from_slice(&m.data[(i + r) * m.stride + j..][..C]);
    }
    out
}

/// Writes entries `i..i + R`, `j..j + C` of a matrix of `stride` columns.
#[inline(always)]
pub(super) fn store<T: Real, const R: usize, const C: usize>(
    tile: &[[T; C]; R],
    m: &mut [T],
    stride: usize,
    (i, j): (usize, usize),
) {
    for r in 0..R {
        m[(i + r) * stride + j..][..C].copy_from_slice(&tile[r]);
    }
}
