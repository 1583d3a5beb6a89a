//! Sums of probabilities kept as logarithms.

use crate::real::{Mask, Real, exp, ln};

/// `ln(1 + x)` for `x > -1`, within a few units in the last place.
///
/// ```text
/// u = fl(1 + x):   ln(1 + x) = ln(u) x / (u - 1)
/// ```
/// # Source
/// Kahan (1982), cited by Goldberg (1991), ACM Computing Surveys 23, theorem 4.
#[inline(always)]
pub(super) fn ln_1p<T: Real>(x: T) -> T {
    let u = T::one() + x;
    let rest = u - T::one();
    let tiny = rest.eq(T::zero());
    let safe = T::select(tiny, T::one(), rest);
    T::select(tiny, x, ln(u) * (x / safe))
}

/// The largest of `l`; `-inf` if all are NaN.
#[inline(always)]
pub(super) fn largest<T: Real>(l: &[T]) -> T {
    let mut top = T::splat(f64::NEG_INFINITY);
    for &x in l {
        // a NaN never replaces a number
        top = x.max(top);
    }
    top
}

/// Numbers of one record whose exponentials are taken together.
pub(crate) const TOGETHER: usize = 64;

/// `ln sum e^{l_i}`; `-inf` where every term is.
#[inline(always)]
pub(super) fn log_sum_exp<T: Real>(l: &[T]) -> T {
    let top = largest(l);
    let shift = T::select(top.is_finite(), top, T::zero());
    let mut sum = T::zero();
    if const { T::LANES > 1 } {
        for &x in l {
            sum = sum + exp(x - shift);
        }
    } else {
        // one record: its models in lanes
        for part in l.chunks(TOGETHER) {
            let mut terms = [T::zero(); TOGETHER];
            let terms = &mut terms[..part.len()];
            for (term, &x) in terms.iter_mut().zip(part) {
                *term = x - shift;
            }
            T::exp_each(terms);
            for &mut term in terms {
                sum = sum + term;
            }
        }
    }
    T::select(top.is_finite(), shift + ln(sum), top)
}

/// Makes `sum e^{l_i} = 1`; lanes without a finite term are left alone and
/// returned as false.
#[inline(always)]
pub(super) fn normalise<T: Real>(l: &mut [T]) -> T::Mask {
    let total = log_sum_exp(l);
    let good = total.is_finite();
    let shift = T::select(good, total, T::zero());
    for x in l.iter_mut() {
        *x = *x - shift;
    }
    good
}

/// Raises weights to at least `e^log_floor`, zeros excepted, and normalises.
#[inline(always)]
pub(super) fn raise<T: Real>(l: &mut [T], log_floor: f64) {
    let floor = T::splat(log_floor);
    let mut touched = T::Mask::splat(false);
    for x in l.iter_mut() {
        let low = x.lt(floor) & x.gt(T::splat(f64::NEG_INFINITY));
        touched = touched | low;
        *x = T::select(low, floor, *x);
    }
    if touched.any() {
        // lanes without a low weight must keep their bits
        let total = log_sum_exp(l);
        let shift = T::select(touched, total, T::zero());
        for x in l.iter_mut() {
            *x = *x - shift;
        }
    }
}
