//! The one inner loop of products, triangular solves and factorisations: a tile of
//! sums in registers, each a chain of fused multiply-adds.

pub(super) use crate::simd::{Grid, GridMut};

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

/// A row-major matrix without gaps.
#[inline(always)]
#[track_caller]
pub(crate) fn grid<T: Real>(m: &[T], [rows, cols]: [usize; 2]) -> Grid<'_, T> {
    Grid::new(m, [rows, cols], [cols, 1])
}

/// As [`grid`], to write.
#[inline(always)]
#[track_caller]
pub(crate) fn grid_mut<T: Real>(m: &mut [T], [rows, cols]: [usize; 2]) -> GridMut<'_, T> {
    GridMut::new(m, [rows, cols], [cols, 1])
}

/// ```text
/// for p in range: sum[r][s] <- sum[r][s] +- A(i + r, p) B(p, j + s)
/// ```
#[inline(always)]
pub(super) fn accumulate<T: Real, const R: usize, const C: usize, const CHAIN: u8>(
    a: Grid<'_, T>,
    b: Grid<'_, T>,
    at: (usize, usize),
    range: (usize, usize),
    sum: &mut [[T; C]; R],
) {
    let mut walk = if CHAIN == chain::SUB_DOWN {
        Walk::<T, T, R, C>::new::<true>(a, b, at, range)
    } else {
        Walk::<T, T, R, C>::new::<false>(a, b, at, range)
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
