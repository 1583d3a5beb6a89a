//! Cholesky factorisation, one matrix a lane.

use super::dim::{Const, Dim, Dyn, unrolls};
use super::tile::{accumulate, chain, grid, grid_mut};
use super::triangular::{solve_lower, solve_lower_t};
use crate::real::{LaneKernel, Mask, Real};

/// Orders up to which the factorisation is unrolled at the call.
const UNROLL: usize = 3;

/// `A = L L'` in place, in every lane.
///
/// ```text
/// l_jj = sqrt(a_jj - sum_{k<j} l_jk^2),   l_ij = (a_ij - sum_{k<j} l_ik l_jk) / l_jj
/// ```
/// Reads the lower triangle of `A` (n x n, row-major) and writes `L` there; the
/// strict upper triangle is left alone. Returns the lanes whose pivots were all
/// positive and finite. In the others a bad pivot is replaced by one, so `L` is
/// of no use but harmless, and nothing reaches the neighbours.
///
/// Panics unless `a.len() == n * n`.
///
/// # Examples
/// ```
/// use mmae::small::{Const, cholesky};
/// let mut a = [4.0, 9.9, 2.0, 10.0];
/// assert!(cholesky(Const::<2>, &mut a));
/// assert_eq!(a, [2.0, 9.9, 1.0, 3.0]);
/// assert!(!cholesky(Const::<2>, &mut [1.0, 0.0, 2.0, 1.0]));
/// ```
#[inline(always)]
#[track_caller]
#[must_use = "lanes that are false hold no factor"]
pub fn cholesky<T: Real, N: Dim>(n: N, a: &mut [T]) -> T::Mask {
    assert_eq!(a.len(), n.get() * n.get(), "cholesky: slice does not fit {n:?}");
    if unrolls::<N, N, N>(UNROLL) {
        Cholesky { n, a }.all()
    } else {
        T::outline(Cholesky { n: Dyn(n.get()), a })
    }
}

/// `X <- A^-1 X` from the factor `L` of [`cholesky`], `X` n x r.
///
/// Panics unless `l.len() == n * n` and `x.len() == n * r`.
#[inline(always)]
#[track_caller]
pub fn cholesky_solve<T: Real, N: Dim, C: Dim>(n: N, r: C, l: &[T], x: &mut [T]) {
    solve_lower(n, r, l, x);
    solve_lower_t(n, r, l, x);
}

struct Cholesky<'a, T, N> {
    n: N,
    a: &'a mut [T],
}

impl<T: Real, N: Dim> Cholesky<'_, T, N> {
    /// Block columns of width `R`, left to right.
    #[inline(always)]
    fn columns<const R: usize>(&mut self) -> T::Mask {
        let n = self.n.get();
        let full = n / R * R;
        let mut ok = T::Mask::splat(true);
        for block in 0..n / R {
            let j = block * R;
            ok = ok & self.column::<R, R>(j);
        }
        match n - full {
            3 => ok & self.column::<3, R>(full),
            2 => ok & self.column::<2, R>(full),
            1 => ok & self.column::<1, R>(full),
            _ => ok,
        }
    }

    /// Block column `j..j + W`: the diagonal block, then those below, `R` rows
    /// at a time.
    #[inline(always)]
    fn column<const W: usize, const R: usize>(&mut self, j: usize) -> T::Mask {
        let n = self.n.get();
        let (ok, inverse) = self.diagonal::<W>(j);
        // Only a full block column has rows below it, and the first starts on a
        // multiple of the tile.
        let full = n / R * R;
        for block in (j + W).div_ceil(R)..n / R {
            let i = block * R;
            self.below::<R, W>(i, j, &inverse);
        }
        if j + W <= full {
            match n - full {
                3 => self.below::<3, W>(full, j, &inverse),
                2 => self.below::<2, W>(full, j, &inverse),
                1 => self.below::<1, W>(full, j, &inverse),
                _ => {}
            }
        }
        ok
    }

    /// `A_jj - L_j L_j'` and its factor; returns the reciprocals of the roots.
    #[inline(always)]
    fn diagonal<const W: usize>(&mut self, j: usize) -> (T::Mask, [T; W]) {
        let n = self.n.get();
        let a = grid(self.a, [n, n]);
        let mut d = a.load::<W, W>(j, j);
        accumulate::<T, W, W, { chain::SUB }>(a, a.t(), (j, j), (0, j), &mut d);
        let mut ok = T::Mask::splat(true);
        let mut inverse = [T::one(); W];
        for c in 0..W {
            let pivot = d[c][c];
            // False for NaN too.
            let good = pivot.gt(T::zero()) & pivot.is_finite();
            ok = ok & good;
            d[c][c] = T::select(good, pivot, T::one()).sqrt();
            inverse[c] = d[c][c].recip();
            for r in c + 1..W {
                d[r][c] = d[r][c] * inverse[c];
            }
            for s in c + 1..W {
                for r in s..W {
                    d[r][s] = d[r][c].neg_mul_add(d[s][c], d[r][s]);
                }
            }
        }
        for r in 0..W {
            self.a[(j + r) * n + j..][..=r].copy_from_slice(&d[r][..=r]);
        }
        (ok, inverse)
    }

    /// `L_ij = (A_ij - L_i L_j') L_jj'^-1`.
    #[inline(always)]
    fn below<const R: usize, const W: usize>(&mut self, i: usize, j: usize, inverse: &[T; W]) {
        let n = self.n.get();
        let mut factor = grid_mut(self.a, [n, n]);
        let a = factor.view();
        let mut l = a.load::<R, W>(i, j);
        accumulate::<T, R, W, { chain::SUB }>(a, a.t(), (i, j), (0, j), &mut l);
        for c in 0..W {
            for r in 0..R {
                l[r][c] = l[r][c] * inverse[c];
            }
            for s in c + 1..W {
                let entry = a.at(j + s, j + c);
                for r in 0..R {
                    l[r][s] = l[r][c].neg_mul_add(entry, l[r][s]);
                }
            }
        }
        factor.store(&l, (i, j));
    }
}

impl<T: Real, N: Dim> LaneKernel<T> for Cholesky<'_, T, N> {
    type Out = T::Mask;
    #[inline(always)]
    fn run(self) -> T::Mask {
        if T::UNROLLS {
            match self.n.get() {
                2 => return self.fixed::<2>(),
                3 => return self.fixed::<3>(),
                4 => return self.fixed::<4>(),
                5 => return self.fixed::<5>(),
                6 => return self.fixed::<6>(),
                8 => return self.fixed::<8>(),
                _ => {}
            }
        }
        self.all()
    }
}

impl<T: Real, N: Dim> Cholesky<'_, T, N> {
    /// The same with a size that the compiler sees.
    #[inline(always)]
    fn fixed<const S: usize>(self) -> T::Mask {
        // Of no effect but to let bounds checks go.
        Cholesky { n: Const::<S>, a: &mut self.a[..S * S] }.all()
    }

    #[inline(always)]
    fn all(mut self) -> T::Mask {
        match T::TILE {
            4 => self.columns::<4>(),
            2 => self.columns::<2>(),
            _ => self.columns::<1>(),
        }
    }
}
