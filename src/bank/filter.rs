//! A step of one discrete filter with sizes that the compiler sees.
//!
//! The states stay in registers, and each coefficient is broadcast once for `V` vectors
//! of records or trials. The order of the operations, and so the bits, are those of
//! [`propagate`](super::propagate), [`innovate`](super::innovate),
//! [`whiten`](super::whiten) and [`correct`](super::correct). Within a model every
//! multiply-add waits for the one before it; callers put models inside time, so that the
//! processor works on several models at once.

use crate::real::Real;

/// Coefficients of one model, as [`Schedule::of_all`](super::Schedule::of_all) has them
/// for all.
#[derive(Clone, Copy)]
pub(crate) struct Filter<'a> {
    pub(crate) a: &'a [f64],
    pub(crate) c: &'a [f64],
    pub(crate) b: &'a [f64],
    pub(crate) k: &'a [f64],
    /// `W' W = S^-1`, lower triangular.
    pub(crate) w: &'a [f64],
    /// `-(ln det S + q ln 2 pi) / 2`.
    pub(crate) log_norm: f64,
}

impl<'a> Filter<'a> {
    /// Model `i`; `fixed` and `moving` hold the numbers of all models, `[n, m, q]` the
    /// sizes. (As an iterator over the models it was no longer inlined, and the step took
    /// three times as long.)
    #[inline(always)]
    pub(crate) fn of(i: usize, fixed: &'a [f64], moving: &'a [f64], [n, m, q]: [usize; 3]) -> Self {
        let (may, each) = (n * n + n * m + q * n + q * q + 1, n * q + q * q + 1);
        let (a, rest) = fixed[i * may..][..may].split_at(n * n);
        let (c, rest) = rest.split_at(q * n);
        let (k, own) = moving[i * each..][..each].split_at(n * q);
        Filter { a, c, b: &rest[..n * m], k, w: &own[..q * q], log_norm: own[q * q] }
    }
}

/// The same with sizes that the compiler sees: `AC` and `KW` are those of [`by_size`].
#[derive(Clone, Copy)]
pub(crate) struct SizedFilter<'a, const AC: usize, const KW: usize> {
    /// `A`, `C`.
    ac: &'a [f64; AC],
    b: &'a [f64],
    /// `K`, `W`, `log_norm`.
    kw: &'a [f64; KW],
}

impl<'a, const AC: usize, const KW: usize> SizedFilter<'a, AC, KW> {
    /// Of what [`Filter::of`] takes, that of one model; `mn` entries of `B` are used.
    #[inline(always)]
    pub(crate) fn of(fixed: &'a [f64], kw: &'a [f64; KW], mn: usize) -> Self {
        let b = if mn == 0 { &[] } else { &fixed[AC..][..mn] };
        SizedFilter { ac: &fixed.as_chunks().0[0], b, kw }
    }

    #[inline(always)]
    pub(crate) fn log_norm(self) -> f64 {
        self.kw[KW - 1]
    }
}

/// Returns `$work.sized::<N, Q, AC, KW>()` if `($n, $q)` is among the sizes.
macro_rules! by_size {
    ($work:ident, $n:expr, $q:expr, $(($N:literal, $Q:literal)),*) => {
        match ($n, $q) {
            $(($N, $Q) => {
                return $work.sized::<$N, $Q, { $N * ($N + $Q) }, { $Q * ($N + $Q) + 1 }>()
            })*
            _ => {}
        }
    };
}
pub(crate) use by_size;

/// Predicts, innovates and corrects; returns `|W r|^2`.
///
/// ```text
/// x <- A x + B u,   r = y - C x,   x <- x + K r
/// ```
#[inline(always)]
pub(crate) fn filter_step<
    T: Real,
    const N: usize,
    const Q: usize,
    const V: usize,
    const AC: usize,
    const KW: usize,
>(
    f: SizedFilter<'_, AC, KW>,
    u: &[[T; V]],
    y: &[[T; V]; Q],
    x: &mut [[T; V]; N],
) -> [T; V] {
    const { assert!(AC == N * (N + Q) && KW == Q * (N + Q) + 1) };
    let SizedFilter { ac, kw, .. } = f;
    let mut next = [[T::zero(); V]; N];
    for i in 0..N {
        for j in 0..N {
            add::<T, V>(ac[i * N + j], &x[j], &mut next[i]);
        }
    }
    // apart: a loop of run-time length among the rows made the step twice as long
    if !u.is_empty() {
        let b = &f.b[..N * u.len()];
        for j in 0..u.len() {
            for i in 0..N {
                add::<T, V>(b[i * u.len() + j], &u[j], &mut next[i]);
            }
        }
    }
    *x = next;
    let mut r = *y;
    for p in 0..Q {
        for j in 0..N {
            let c = T::splat(ac[N * N + p * N + j]);
            for v in 0..V {
                r[p][v] = c.neg_mul_add(x[j][v], r[p][v]);
            }
        }
    }
    let mut square = [T::zero(); V];
    for p in 0..Q {
        let mut z = [T::zero(); V];
        for j in 0..=p {
            add::<T, V>(kw[N * Q + p * Q + j], &r[j], &mut z);
        }
        for v in 0..V {
            square[v] = z[v].mul_add(z[v], square[v]);
        }
    }
    for j in 0..N {
        for p in 0..Q {
            add::<T, V>(kw[j * Q + p], &r[p], &mut x[j]);
        }
    }
    square
}

/// `sum += a x`.
#[inline(always)]
fn add<T: Real, const V: usize>(a: f64, x: &[T; V], sum: &mut [T; V]) {
    let a = T::splat(a);
    for v in 0..V {
        sum[v] = a.mul_add(x[v], sum[v]);
    }
}
