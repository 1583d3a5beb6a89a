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
    pub(crate) b: &'a [f64],
    pub(crate) c: &'a [f64],
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
        let (b, rest) = rest.split_at(n * m);
        let (k, own) = moving[i * each..][..each].split_at(n * q);
        Filter { a, b, c: &rest[..q * n], k, w: &own[..q * q], log_norm: own[q * q] }
    }
}

/// Predicts where `moves`, innovates and corrects; returns `|W r|^2`.
///
/// ```text
/// x <- A x + B u,   r = y - C x,   x <- x + K r
/// ```
#[inline(always)]
pub(crate) fn filter_step<T: Real, const N: usize, const Q: usize, const V: usize>(
    f: Filter<'_>,
    moves: bool,
    u: &[[T; V]],
    y: &[[T; V]; Q],
    x: &mut [[T; V]; N],
) -> [T; V] {
    if moves {
        let (a, b) = (&f.a[..N * N], &f.b[..N * u.len()]);
        let mut next = [[T::zero(); V]; N];
        for i in 0..N {
            for j in 0..N {
                add::<T, V>(a[i * N + j], &x[j], &mut next[i]);
            }
            for j in 0..u.len() {
                add::<T, V>(b[i * u.len() + j], &u[j], &mut next[i]);
            }
        }
        *x = next;
    }
    let (c, k, w) = (&f.c[..Q * N], &f.k[..N * Q], &f.w[..Q * Q]);
    let mut r = *y;
    for p in 0..Q {
        for j in 0..N {
            let c = T::splat(c[p * N + j]);
            for v in 0..V {
                r[p][v] = c.neg_mul_add(x[j][v], r[p][v]);
            }
        }
    }
    let mut square = [T::zero(); V];
    for p in 0..Q {
        let mut z = [T::zero(); V];
        for j in 0..=p {
            add::<T, V>(w[p * Q + j], &r[j], &mut z);
        }
        for v in 0..V {
            square[v] = z[v].mul_add(z[v], square[v]);
        }
    }
    for j in 0..N {
        for p in 0..Q {
            add::<T, V>(k[j * Q + p], &r[p], &mut x[j]);
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
