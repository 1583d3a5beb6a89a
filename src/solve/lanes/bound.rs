//! Bounds on the error of a corrected solution.

use super::ops::outlined;
use crate::real::{Mask, Real};

/// Rounding of the returned entries, and of whatever they are compared with.
const ROUNDING: f64 = 1.25 * f64::EPSILON;
/// What a correction leaves, over what the ratio of two corrections predicts.
const SAFETY: f64 = 4.0;
/// Unit roundoff of sums in twice the working precision.
const TWICE: f64 = f64::EPSILON * f64::EPSILON;

/// A correction beside which the rounding of the returned entries shows: larger
/// ones are looked at again.
const CLEAR: f64 = f64::EPSILON / 32.0;
/// What a sum of powers leaves of a residual, over its condition and rounding.
const SUMS: f64 = 16.0;
/// What such a sum leaves that is ended early, see [`super::powers::Digits`].
const ENDED: f64 = 1.0 / (1_u64 << 26) as f64;

/// A bound on the error of a first solution below which it is not corrected.
const ENOUGH: f64 = 1e-13;
/// Orders up to which every item is corrected all the same: it costs next to
/// nothing, and solutions in closed form come out as one would write them.
const TINY: usize = 2;

/// What is known of a solution from its residual in plain arithmetic.
///
/// ```text
/// |X - X*| / |X| <= 1.25 eps + (2 |R| + eps t) / s * kappa
/// ```
/// `R` the residual as computed, `s` the sum of the norms of its terms, `kappa` the
/// condition (relative to `s`), `t` the terms with the norms of products replaced by
/// products of norms: what rounding of the residual can hide.
#[derive(Clone, Copy)]
pub(super) struct FirstLook<T> {
    /// `|R| / s`.
    pub(super) residual: T,
    /// `s`.
    pub(super) size: T,
    /// `t / s`.
    pub(super) terms: T,
}

impl<T: Real> FirstLook<T> {
    /// The bound.
    #[inline(always)]
    pub(super) fn bound(self, condition: T) -> T {
        let share = self.residual + self.residual + T::splat(T::EPSILON) * self.terms;
        share.mul_add(condition, T::splat(ROUNDING))
    }
}

/// True if solutions of order `n` in numbers `T` are looked at before they are
/// corrected.
#[inline(always)]
pub(super) fn looks_first<T: Real>(n: usize) -> bool {
    T::EPSILON == f64::EPSILON && n > TINY
}

/// Lanes with a bound that needs no correction.
#[inline(always)]
pub(super) fn is_enough<T: Real>(bound: T) -> T::Mask {
    bound.le(T::splat(ENOUGH))
}

/// Sizes of the last corrections of a solution, relative to it.
#[derive(Clone, Copy)]
pub(super) struct Amplification<T> {
    /// The last, in the units that show it largest.
    pub(super) last: T,
    /// What it left over what it took away.
    pub(super) rate: T,
    /// What a residual relative to its terms is amplified by.
    pub(super) condition: T,
}

impl<T: Real> Amplification<T> {
    /// Bound on the relative error that the last correction leaves.
    ///
    /// ```text
    /// |X - X*| / |X| <= 1.25 eps + 4 r c + 8 n eps^2 kappa
    /// ```
    /// `c` the last correction, `r` what it left over what it took away.
    /// Residuals are summed in twice the working precision, so their rounding
    /// counts only for conditions beyond 1e15.
    #[inline(always)]
    pub(super) fn bound(self, n: usize) -> T {
        let noise = self.condition * T::splat(8.0 * n as f64 * TWICE);
        let left = T::splat(SAFETY) * self.rate * self.last;
        T::splat(ROUNDING) + (left + noise)
    }

    /// Lanes in which another correction would change nothing that can be seen.
    #[inline(always)]
    pub(super) fn is_clear(self) -> T::Mask {
        (T::splat(SAFETY) * self.rate * self.last).le(T::splat(CLEAR))
    }
}

/// What a correction leaves of an error, from two in a row.
///
/// ```text
/// r = min(1, c2 / c1)
/// ```
#[inline(always)]
pub(super) fn rate_of_two<T: Real>(before: T, last: T) -> T {
    let (one, rate) = (T::one(), last / before);
    T::select(rate.lt(one), rate, one)
}

/// What a correction leaves of an error at most, from the rounding of the sums
/// that made it: they amplify it by no more than the condition. `nonlinear` is
/// what the equation itself leaves.
///
/// ```text
/// r = min(1, (16 n eps + nonlinear) kappa + 2^-26)
/// ```
#[inline(always)]
pub(super) fn rate_of_sums<T: Real>(n: usize, condition: T, nonlinear: T) -> T {
    let one = T::one();
    let share = T::splat(SUMS * n as f64 * T::EPSILON) + nonlinear;
    let rate = share.mul_add(condition, T::splat(ENDED));
    T::select(rate.lt(one), rate, one)
}

/// `|D^-1 part D^-1| / |D^-1 whole D^-1|` for `D = diag(2^k)`, both n by n; zero
/// where that is beyond the range of numbers, or `|part| / |whole|`.
#[inline(always)]
pub(super) fn in_units<T: Real>(k: &[T], part: &[T], whole: &[T]) -> T {
    let mut least = k[0];
    for &e in k {
        least = least.min(e);
    }
    shares(k, k, [least, least], [-1.0, -1.0], part, whole)
}

outlined! {
    /// As [`in_units`] for `2^(l left) part 2^(r right)`, `l` and `r` 1 or -1.
    /// `origin` is taken from the exponents: it cancels.
    pub(super) fn shares(left: &'a [T], right: &'a [T], origin: [T; 2], sides: [f64; 2], part: &'a [T], whole: &'a [T]) -> T {
        let cols = right.len();
        let even = is_even(left) & is_even(right);
        if even.all() {
            return T::zero();
        }
        let (l, r) = (T::splat(sides[0]), T::splat(sides[1]));
        let (mut sum_part, mut sum_whole) = (T::zero(), T::zero());
        for j in 0..cols {
            let column = power_within((right[j] - origin[1]) * r);
            for i in 0..left.len() {
                let row = power_within((left[i] - origin[0]) * l);
                let (u, v) = (part[i * cols + j] * row * column, whole[i * cols + j] * row * column);
                sum_part = u.mul_add(u, sum_part);
                sum_whole = v.mul_add(v, sum_whole);
            }
        }
        let share = (sum_part / sum_whole).sqrt();
        let use_it = !even & share.is_finite() & share.ge(T::zero());
        T::select(use_it, share, T::zero())
    }
}

outlined! {
    /// What [`shares`] can be at most for a part of norm `part`, with origins of zero;
    /// infinite or NaN where that is beyond the range of numbers.
    pub(super) fn shares_at_most(left: &'a [T], right: &'a [T], sides: [f64; 2], part: T, whole: &'a [T]) -> T {
        let cols = right.len();
        let even = is_even(left) & is_even(right);
        if even.all() {
            return T::zero();
        }
        let (l, r) = (T::splat(sides[0]), T::splat(sides[1]));
        let (mut tallest, mut widest, mut sum) = (T::zero(), T::zero(), T::zero());
        for j in 0..cols {
            let column = power_within(right[j] * r);
            widest = widest.max(column);
            for i in 0..left.len() {
                let row = power_within(left[i] * l);
                tallest = tallest.max(row);
                let v = whole[i * cols + j] * row * column;
                sum = v.mul_add(v, sum);
            }
        }
        T::select(even, T::zero(), part * tallest * widest / sum.sqrt())
    }
}

/// Lanes whose exponents are all the same: units that change no ratio.
#[inline(always)]
fn is_even<T: Real>(k: &[T]) -> T::Mask {
    let mut even = T::Mask::splat(true);
    for &e in &k[1..] {
        even = even & e.eq(k[0]);
    }
    even
}

/// `2^e`, `e` brought within the range of normal numbers.
#[inline(always)]
fn power_within<T: Real>(e: T) -> T {
    let reach = T::splat(1000.0);
    T::pow2i(e.min(reach).max(-reach))
}
