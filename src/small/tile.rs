//! The one inner loop of products, triangular solves and factorisations: a
//! register tile of sums, each a chain of fused multiply-adds.

use crate::real::Real;

/// A row-major matrix of `stride` columns.
#[derive(Clone, Copy)]
pub(super) struct Rows<'a, T> {
    pub(super) data: &'a [T],
    pub(super) stride: usize,
}

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
/// `b[j][p]` when `TB`. Slices are cut before the loop so that at most one
/// bounds check a factor is left in it.
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
    (i, j): (usize, usize),
    (low, high): (usize, usize),
    sum: &mut [[T; C]; R],
) {
    let len = high - low;
    let mut a_rows = [&a.data[..0]; R];
    let mut b_rows = [&b.data[..0]; C];
    if !TA {
        for r in 0..R {
            a_rows[r] = &a.data[(i + r) * a.stride + low..][..len];
        }
    }
    if TB {
        for s in 0..C {
            b_rows[s] = &b.data[(j + s) * b.stride + low..][..len];
        }
    }
    for step in 0..len {
        let q = if CHAIN == chain::SUB_DOWN { len - 1 - step } else { step };
        let p = low + q;
        let mut bp = [T::zero(); C];
        if TB {
            for s in 0..C {
                bp[s] = b_rows[s][q];
            }
        } else {
            bp.copy_from_slice(&b.data[p * b.stride + j..][..C]);
        }
        let mut ap = [T::zero(); R];
        if TA {
            ap.copy_from_slice(&a.data[p * a.stride + i..][..R]);
        } else {
            for r in 0..R {
                ap[r] = a_rows[r][q];
            }
        }
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
