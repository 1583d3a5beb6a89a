//! Least squares as `P = U D U'`, one problem a lane: no square root, no branch.
//!
//! `U` is unit upper triangular; a square array holds it above its diagonal and `D`
//! on it. Limited by fused multiply-adds: `p^2` for the products with `U`, `p^2` for
//! its update, and `p` divisions, which the multiplications hide from `p = 6` on.

use crate::real::{Mask, Real};

/// Scratch of [`update`] and [`project`]: so many numbers a parameter.
pub(super) const SCRATCH: usize = 3;

/// `P <- (P^-1 + phi' phi / r)^-1`; afterwards `gain` holds `P phi` with the `P` before,
/// and the result is `r + phi P phi'`, so that the gain of the least squares is their
/// quotient.
///
/// ```text
/// f = U' phi,  v = D f,  a_0 = r
/// for j:  a_j = a_(j-1) + f_j v_j,   d_j <- d_j a_(j-1) / a_j,
///         for i < j:  u_ij <- u_ij - b_i f_j / a_(j-1),   b_i <- b_i + u_ij v_j   (old u)
///         b_j = v_j
/// ```
///
/// # Source
/// Bierman (1976), Measurement updating using the U-D factorization, Automatica 12.
#[inline(always)]
pub(super) fn update<T: Real>(
    ud: &mut [T],
    phi: &[T],
    r: T,
    gain: &mut [T],
    scratch: &mut [T],
) -> T {
    let p = phi.len();
    let (f, v) = scratch[..2 * p].split_at_mut(p);
    for j in 0..p {
        let mut sum = phi[j];
        for i in 0..j {
            sum = ud[i * p + j].mul_add(phi[i], sum);
        }
        f[j] = sum;
        v[j] = ud[j * p + j] * sum;
    }
    let mut total = r;
    let mut inverse = r.recip();
    for j in 0..p {
        let next = f[j].mul_add(v[j], total);
        let ratio = f[j] * inverse;
        inverse = next.recip();
        ud[j * p + j] = ud[j * p + j] * (total * inverse);
        for i in 0..j {
            let u = ud[i * p + j];
            ud[i * p + j] = ratio.neg_mul_add(gain[i], u);
            gain[i] = u.mul_add(v[j], gain[i]);
        }
        gain[j] = v[j];
        total = next;
    }
    total
}

/// Trace of `U D U'` over the parameters from `first` on.
#[inline(always)]
pub(super) fn trace<T: Real>(p: usize, first: usize, ud: &[T]) -> T {
    let mut sum = T::zero();
    for i in first..p {
        sum = sum + ud[i * p + i];
        for k in i + 1..p {
            let u = ud[i * p + k];
            sum = (u * u).mul_add(ud[k * p + k], sum);
        }
    }
    sum
}

/// Column `i` of `U D U'`, divided by its entry `i`.
#[inline(always)]
fn column<T: Real>(p: usize, i: usize, ud: &[T], out: &mut [T]) {
    for l in 0..p {
        let mut sum = T::zero();
        for k in l.max(i)..p {
            let left = if k == l { T::one() } else { ud[l * p + k] };
            let right = if k == i { T::one() } else { ud[i * p + k] };
            sum = (left * ud[k * p + k]).mul_add(right, sum);
        }
        out[l] = sum;
    }
    let scale = out[i];
    let scale = T::select(scale.gt(T::zero()), scale, T::one()).recip();
    for x in &mut out[..p] {
        *x = *x * scale;
    }
}

/// Puts `theta` (from parameter `first` on) into the box of `low` and `high`.
///
/// Bound by bound, with the step of least `step' P^-1 step`, which takes the other
/// parameters along as the data want it; then each by itself, so that the result is
/// inside. What is inside stays as it is; a NaN stays one.
#[inline(always)]
pub(super) fn project<T: Real>(
    first: usize,
    ud: &[T],
    [low, high]: [&[T]; 2],
    theta: &mut [T],
    scratch: &mut [T],
) {
    let p = theta.len();
    for i in first..p {
        let bounds = [low[i - first], high[i - first]];
        let wanted = inside(theta[i], bounds);
        let out = theta[i].lt(bounds[0]) | theta[i].gt(bounds[1]);
        if !out.any() {
            continue;
        }
        column(p, i, ud, scratch);
        let excess = theta[i] - wanted;
        for l in 0..p {
            let moved = scratch[l].neg_mul_add(excess, theta[l]);
            theta[l] = T::select(out, moved, theta[l]);
        }
        theta[i] = T::select(out, wanted, theta[i]);
    }
    for i in first..p {
        theta[i] = inside(theta[i], [low[i - first], high[i - first]]);
    }
}

/// The number of `[low, high]` that is nearest to `x`; NaN for NaN.
#[inline(always)]
fn inside<T: Real>(x: T, [low, high]: [T; 2]) -> T {
    let x = T::select(x.lt(low), low, x);
    T::select(x.gt(high), high, x)
}

/// `U D U'` over the parameters from `first` on, row by row.
pub(super) fn covariance(p: usize, first: usize, ud: &[f64]) -> Vec<f64> {
    let m = p - first;
    let mut out = vec![0.0; m * m];
    for i in first..p {
        for j in i..p {
            let sum = (j..p).fold(0.0, |sum, k| {
                let left = if k == i { 1.0 } else { ud[i * p + k] };
                let right = if k == j { 1.0 } else { ud[j * p + k] };
                sum + left * ud[k * p + k] * right
            });
            out[(i - first) * m + j - first] = sum;
            out[(j - first) * m + i - first] = sum;
        }
    }
    out
}
