//! LU factorisation with pivoting by lane select, one matrix a lane.

use super::basic::{identity, norm_max};
use super::dim::{Dim, Dyn, unrolls};
use super::triangular::{solve_lower_unit, solve_upper};
use crate::real::{LaneKernel, Mask, Real};

/// Orders up to which the factorisation is unrolled at the call.
const UNROLL: usize = 4;

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
        Factor { n, a, perm }.run()
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
    for k in 0..size {
        exchange(k, size, width, perm[k], x);
    }
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

/// Exchanges row `k` of `X` (n x r) with row `chosen`, which differs from lane
/// to lane.
#[inline(always)]
fn exchange<T: Real>(k: usize, n: usize, r: usize, chosen: T, x: &mut [T]) {
    if r == 0 || chosen.eq(T::splat(k as f64)).all() {
        return;
    }
    let (head, tail) = x[k * r..n * r].split_at_mut(r);
    for (below, row) in tail.chunks_exact_mut(r).enumerate() {
        swap_where(chosen.eq(T::splat((k + 1 + below) as f64)), head, row);
    }
}

/// Exchanges two rows in the lanes of `here`. To skip the work where there are
/// none changes no bits.
#[inline(always)]
fn swap_where<T: Real>(here: T::Mask, p: &mut [T], q: &mut [T]) {
    if here.any() {
        for (p, q) in p.iter_mut().zip(q) {
            let (old_p, old_q) = (*p, *q);
            *p = T::select(here, old_q, old_p);
            *q = T::select(here, old_p, old_q);
        }
    }
}

struct Factor<'a, T, N> {
    n: N,
    a: &'a mut [T],
    perm: &'a mut [T],
}

impl<T: Real, N: Dim> Factor<'_, T, N> {
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
            let (head, tail) = self.a[k * n..].split_at_mut(n);
            for (below, row) in tail.chunks_exact_mut(n).enumerate() {
                let here = searching & row[k].abs().eq(best);
                searching = searching & !here;
                number = T::select(here, T::splat((k + 1 + below) as f64), number);
                swap_where(here, head, row);
            }
        }
        self.perm[k] = number;
    }

    /// Subtracts from `R` rows below step `k` their multiples of the pivot row.
    #[inline(always)]
    fn eliminate<const R: usize>(n: usize, k: usize, inverse: T, pivot: &[T], rows: &mut [T]) {
        let mut factor = [T::zero(); R];
        for r in 0..R {
            factor[r] = rows[r * n + k] * inverse;
            rows[r * n + k] = factor[r];
        }
        let mut tails: [&mut [T]; R] = std::array::from_fn(|_| Default::default());
        for (tail, row) in tails.iter_mut().zip(rows.chunks_exact_mut(n)) {
            *tail = &mut row[k + 1..];
        }
        let width = n - k - 1;
        let pivot = &pivot[k + 1..];
        for r in 0..R {
            tails[r] = &mut std::mem::take(&mut tails[r])[..width];
        }
        for j in 0..width {
            let p = pivot[j];
            for r in 0..R {
                tails[r][j] = factor[r].neg_mul_add(p, tails[r][j]);
            }
        }
    }
}

impl<T: Real, N: Dim> LaneKernel<T> for Factor<'_, T, N> {
    type Out = LuInfo<T>;
    #[inline(always)]
    fn run(mut self) -> LuInfo<T> {
        let n = self.n.get();
        let largest = norm_max(self.a);
        let mut smallest = T::splat(f64::INFINITY);
        let mut ok = T::Mask::splat(true);
        for k in 0..n {
            self.pivot(k);
            let (top, below) = self.a.split_at_mut((k + 1) * n);
            let pivot_row = &mut top[k * n..];
            let size = pivot_row[k].abs();
            // False for NaN too; the reciprocal of a subnormal may overflow.
            let good = size.ge(T::splat(f64::MIN_POSITIVE)) & size.is_finite();
            ok = ok & good;
            smallest = size.min(smallest);
            pivot_row[k] = T::select(good, pivot_row[k], T::one());
            let inverse = pivot_row[k].recip();
            let pivot_row = &pivot_row[..n];
            let mut fours = below.chunks_exact_mut(4 * n);
            for rows in &mut fours {
                Self::eliminate::<4>(n, k, inverse, pivot_row, rows);
            }
            let rest = fours.into_remainder();
            match rest.len() / n {
                3 => Self::eliminate::<3>(n, k, inverse, pivot_row, rest),
                2 => Self::eliminate::<2>(n, k, inverse, pivot_row, rest),
                1 => Self::eliminate::<1>(n, k, inverse, pivot_row, rest),
                _ => {}
            }
        }
        LuInfo { ok, pivot_ratio: smallest / largest }
    }
}
