//! LU factorisation with pivoting by lane select, one matrix a lane.

use super::basic::identity;
use super::dim::{Const, Dim, Dyn, unrolls};
use super::tile::{GridMut, accumulate, chain, grid_mut};
use super::triangular::{solve_lower_unit, solve_upper};
use crate::real::{LaneKernel, Mask, Real};

/// Orders up to which the factorisation is unrolled at the call.
const UNROLL: usize = 3;

/// A diagonal entry is kept as pivot while it is at least this share of the
/// largest candidate. The choice is made lane by lane, so a lane never depends
/// on its neighbours; where all eight keep theirs nothing is moved.
const KEEP: f64 = 0.1;

/// How a factorisation went, lane by lane.
#[derive(Debug, Clone, Copy)]
pub struct LuInfo<T: Real> {
    /// Lanes whose pivots were all normal and finite. In the others a bad pivot
    /// was replaced by one: their factors are of no use, but harmless.
    pub ok: T::Mask,
    /// Smallest pivot over largest entry of the matrix, in magnitude: near zero
    /// for a matrix near a singular one (of use only where `ok`).
    pub pivot_ratio: T,
}

/// `P A = L U` in place, in every lane.
///
/// `a` (n x n, row-major) receives `U` on and above the diagonal and the factors
/// of `L` below it; `perm[k]` receives the number of the row that step `k`
/// exchanged with row `k`. Panics unless `a.len() == n * n` and
/// `perm.len() == n`.
#[inline(always)]
#[track_caller]
pub fn lu_factor<T: Real, N: Dim>(n: N, a: &mut [T], perm: &mut [T]) -> LuInfo<T> {
    let size = n.get();
    assert!(
        a.len() == size * size && perm.len() == size,
        "lu_factor: slices do not fit {size}x{size}"
    );
    if unrolls::<N, N, N>(UNROLL) {
        Factor { n, a, perm }.all()
    } else {
        T::outline(Factor { n: Dyn(size), a, perm })
    }
}

/// `X <- A^-1 X` from the factors of [`lu_factor`], `X` n x r.
///
/// Panics unless `lu.len() == n * n`, `perm.len() == n` and `x.len() == n * r`.
#[inline(always)]
#[track_caller]
pub fn lu_solve<T: Real, N: Dim, C: Dim>(n: N, r: C, lu: &[T], perm: &[T], x: &mut [T]) {
    let (size, width) = (n.get(), r.get());
    assert!(
        perm.len() == size && x.len() == size * width,
        "lu_solve: slices do not fit {size}x{size} and {size}x{width}"
    );
    T::outline(Permute { r: width, perm, x: &mut *x });
    solve_lower_unit(n, r, lu, x);
    solve_upper(n, r, lu, x);
}

/// `X <- A^-1 X`, destroying `A`; `A` n x n, `X` n x r, `perm` n numbers of
/// scratch.
///
/// Panics unless the slices have these sizes.
///
/// # Examples
/// ```
/// use mmae::small::{Const, solve};
/// let mut x = [3.0, 2.0];
/// let info = solve(Const::<2>, Const::<1>, &mut [0.0, 1.0, 2.0, 0.0], &mut x, &mut [0.0; 2]);
/// assert!(info.ok && x == [1.0, 3.0]);
/// ```
#[inline(always)]
#[track_caller]
pub fn solve<T: Real, N: Dim, C: Dim>(
    n: N,
    r: C,
    a: &mut [T],
    x: &mut [T],
    perm: &mut [T],
) -> LuInfo<T> {
    let info = lu_factor(n, a, perm);
    lu_solve(n, r, a, perm, x);
    info
}

/// `B = A^-1`, destroying `A`; both n x n, `perm` n numbers of scratch.
///
/// Panics unless the slices have these sizes.
#[inline(always)]
#[track_caller]
pub fn inverse<T: Real, N: Dim>(n: N, a: &mut [T], b: &mut [T], perm: &mut [T]) -> LuInfo<T> {
    identity(n, b);
    solve(n, n, a, b, perm)
}

/// Exchanges row `k` of `m`, `width` columns, with row `chosen`, which differs
/// from lane to lane: the exchanges of one step, out of line because they are
/// rare and would fill every caller.
struct Exchange<'a, T> {
    k: usize,
    width: usize,
    chosen: T,
    m: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Exchange<'_, T> {
    type Out = ();
    #[inline(always)]
    fn run(self) {
        let Exchange { k, width, chosen, m } = self;
        let (head, tail) = m[k * width..].split_at_mut(width);
        for (below, row) in tail.chunks_exact_mut(width).enumerate() {
            let here = chosen.eq(T::splat((k + 1 + below) as f64));
            // To skip rows that no lane chose changes no bits.
            if here.any() {
                for (p, q) in head.iter_mut().zip(row) {
                    (*p, *q) = (T::select(here, *q, *p), T::select(here, *p, *q));
                }
            }
        }
    }
}

/// The exchanges of [`lu_factor`] on `X`, n x r.
struct Permute<'a, T> {
    r: usize,
    perm: &'a [T],
    x: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Permute<'_, T> {
    type Out = ();
    #[inline(always)]
    fn run(self) {
        let Permute { r, perm, x } = self;
        if r == 0 {
            return;
        }
        for (k, &chosen) in perm.iter().enumerate() {
            if !chosen.eq(T::splat(k as f64)).all() {
                T::outline(Exchange { k, width: r, chosen, m: &mut *x });
            }
        }
    }
}

/// The factorisation, block column by block column, left to right.
///
/// ```text
/// U_IJ = L_II^-1 (A_IJ - sum_{P < I} L_IP U_PJ)      blocks above the diagonal
/// A_IJ <- A_IJ - sum_{P < J} L_IP U_PJ               blocks on and below it
/// then the panel of all rows from the diagonal down, column by column
/// ```
/// Each entry is one chain over the inner index, the same for every tile.
struct Factor<'a, T, N> {
    n: N,
    a: &'a mut [T],
    perm: &'a mut [T],
}

/// What the factorisation has seen of the pivots.
#[derive(Clone, Copy)]
struct Pivots<T: Real> {
    ok: T::Mask,
    smallest: T,
}

impl<T: Real, N: Dim> Factor<'_, T, N> {
    #[inline(always)]
    fn blocks<const R: usize>(mut self) -> LuInfo<T> {
        let n = self.n.get();
        let largest = magnitude(self.a);
        let mut seen = Pivots { ok: T::Mask::splat(true), smallest: T::splat(f64::INFINITY) };
        let full = n / R * R;
        for block in 0..n / R {
            let j = block * R;
            self.update::<R, R>(j);
            self.panel::<R>(j, &mut seen);
        }
        match n - full {
            3 => {
                self.update::<R, 3>(full);
                self.panel::<3>(full, &mut seen);
            }
            2 => {
                self.update::<R, 2>(full);
                self.panel::<2>(full, &mut seen);
            }
            1 => {
                self.update::<R, 1>(full);
                self.panel::<1>(full, &mut seen);
            }
            _ => {}
        }
        LuInfo { ok: seen.ok, pivot_ratio: seen.smallest / largest }
    }

    /// Columns `j..j + W` of all rows, by the columns to their left.
    #[inline(always)]
    fn update<const R: usize, const W: usize>(&mut self, j: usize) {
        if j == 0 {
            return;
        }
        let n = self.n.get();
        let full = n / R * R;
        let mut factors = grid_mut(self.a, [n, n]);
        for block in 0..n / R {
            let i = block * R;
            subtract::<_, R, W>(&mut factors, i, j);
        }
        match n - full {
            3 => subtract::<_, 3, W>(&mut factors, full, j),
            2 => subtract::<_, 2, W>(&mut factors, full, j),
            1 => subtract::<_, 1, W>(&mut factors, full, j),
            _ => {}
        }
    }

    /// Factors columns `j..j + W` of the rows from `j` down.
    #[inline(always)]
    fn panel<const W: usize>(&mut self, j: usize, seen: &mut Pivots<T>) {
        self.column::<W, 0>(j, seen);
        if W > 1 {
            self.column::<W, 1>(j, seen);
        }
        if W > 2 {
            self.column::<W, 2>(j, seen);
        }
        if W > 3 {
            self.column::<W, 3>(j, seen);
        }
    }

    /// Column `C` of the panel: pivot, factors, and the columns to its right.
    #[inline(always)]
    fn column<const W: usize, const C: usize>(&mut self, j: usize, seen: &mut Pivots<T>) {
        let n = self.n.get();
        let k = j + C;
        self.pivot(k);
        let (top, below) = self.a.split_at_mut((k + 1) * n);
        let pivot = &mut top[k * n + j..][..W];
        let size = pivot[C].abs();
        // False for NaN too; the reciprocal of a subnormal may overflow.
        let good = size.ge(T::splat(f64::MIN_POSITIVE)) & size.is_finite();
        seen.ok = seen.ok & good;
        seen.smallest = size.min(seen.smallest);
        pivot[C] = T::select(good, pivot[C], T::one());
        let inverse = pivot[C].recip();
        for row in below.chunks_exact_mut(n) {
            let row = &mut row[j..][..W];
            let factor = row[C] * inverse;
            row[C] = factor;
            for s in C + 1..W {
                row[s] = factor.neg_mul_add(pivot[s], row[s]);
            }
        }
    }

    /// Chooses the pivot of step `k` in each lane and brings it to row `k`.
    #[inline(always)]
    fn pivot(&mut self, k: usize) {
        let n = self.n.get();
        let diagonal = self.a[k * n + k].abs();
        let mut best = diagonal;
        for row in self.a[(k + 1) * n..].chunks_exact(n) {
            best = row[k].abs().max(best);
        }
        let mut number = T::splat(k as f64);
        let mut searching = !diagonal.ge(best * T::splat(KEEP));
        if searching.any() {
            for (below, row) in self.a[(k + 1) * n..].chunks_exact(n).enumerate() {
                let here = searching & row[k].abs().eq(best);
                searching = searching & !here;
                number = T::select(here, T::splat((k + 1 + below) as f64), number);
            }
            T::outline(Exchange { k, width: n, chosen: number, m: &mut *self.a });
        }
        self.perm[k] = number;
    }
}

/// One tile of [`Factor::update`], rows `i..i + R` of columns `j..j + W`.
#[inline(always)]
fn subtract<T: Real, const R: usize, const W: usize>(
    factors: &mut GridMut<'_, T>,
    i: usize,
    j: usize,
) {
    let a = factors.view();
    let mut sum = a.load::<R, W>(i, j);
    accumulate::<_, R, W, { chain::SUB }>(a, a, (i, j), (0, i.min(j)), &mut sum);
    if i < j {
        for r in 1..R {
            for p in 0..r {
                let factor = a.at(i + r, i + p);
                for s in 0..W {
                    sum[r][s] = factor.neg_mul_add(sum[p][s], sum[r][s]);
                }
            }
        }
    }
    factors.store(&sum, (i, j));
}

/// Largest magnitude, NaN left out: a NaN reaches the pivots anyway.
#[inline(always)]
fn magnitude<T: Real>(a: &[T]) -> T {
    // Four chains: one would wait for the latency of every comparison.
    let mut parts = [T::zero(); 4];
    let (fours, rest) = a.as_chunks::<4>();
    for four in fours {
        for (part, x) in parts.iter_mut().zip(four) {
            *part = x.abs().max(*part);
        }
    }
    for (part, x) in parts.iter_mut().zip(rest) {
        *part = x.abs().max(*part);
    }
    parts[0].max(parts[1]).max(parts[2].max(parts[3]))
}

impl<T: Real, N: Dim> LaneKernel<T> for Factor<'_, T, N> {
    type Out = LuInfo<T>;
    #[inline(always)]
    fn run(self) -> LuInfo<T> {
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

impl<T: Real, N: Dim> Factor<'_, T, N> {
    /// The same with a size that the compiler sees.
    #[inline(always)]
    fn fixed<const S: usize>(self) -> LuInfo<T> {
        // Of no effect but to let bounds checks go.
        let (a, perm) = (&mut self.a[..S * S], &mut self.perm[..S]);
        Factor { n: Const::<S>, a, perm }.all()
    }

    #[inline(always)]
    fn all(self) -> LuInfo<T> {
        match T::TILE {
            4 => self.blocks::<4>(),
            2 => self.blocks::<2>(),
            _ => self.blocks::<1>(),
        }
    }
}
