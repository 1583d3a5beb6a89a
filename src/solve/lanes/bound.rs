//! Bounds on the error of a corrected solution.

use super::balance::apply;
use super::ops::norm;
use crate::real::{Mask, Real};

/// Rounding of the returned entries, and of whatever they are compared with.
const ROUNDING: f64 = 1.25 * f64::EPSILON;
/// What a correction leaves, over what the ratio of two corrections predicts.
const SAFETY: f64 = 4.0;
/// Unit roundoff of sums in twice the working precision.
const TWICE: f64 = f64::EPSILON * f64::EPSILON;

/// Sizes of the last two corrections of a solution, relative to it.
#[derive(Clone, Copy)]
pub(super) struct Amplification<T> {
    /// The last but one, in balanced units.
    pub(super) correction: T,
    /// The last in balanced units, for its ratio to the one before.
    pub(super) rate: T,
    /// The last, in the units that show it largest.
    pub(super) again: T,
    /// What a residual relative to its terms is amplified by.
    pub(super) condition: T,
}

impl<T: Real> Amplification<T> {
    /// Bound on the relative error that the last correction leaves.
    ///
    /// ```text
    /// |X - X*| / |X| <= 1.25 eps + 4 r c2 + 8 n eps^2 kappa,    r = min(1, c2 / c1)
    /// ```
    /// `c1`, `c2` the last two corrections: what a correction leaves of an error
    /// is about the ratio of the two. Residuals are summed in twice the working
    /// precision, so their rounding counts only for conditions beyond 1e15.
    #[inline(always)]
    pub(super) fn bound(self, n: usize) -> T {
        let one = T::one();
        let rate = self.rate / self.correction;
        let rate = T::select(rate.lt(one), rate, one);
        let noise = self.condition * T::splat(8.0 * n as f64 * TWICE);
        let left = T::splat(SAFETY) * rate * self.again;
        T::splat(ROUNDING) + (left + noise)
    }
}

/// `|D^-1 part D^-1| / |D^-1 whole D^-1|` for `D = diag(2^k)`, both n by n and
/// overwritten; zero where that is beyond the range of numbers.
#[inline(always)]
pub(super) fn in_units<T: Real>(k: &[T], part: &mut [T], whole: &mut [T]) -> T {
    let n = k.len();
    let mut least = k[0];
    for &e in k {
        least = least.min(e);
    }
    let mut relative = k.to_vec();
    for e in &mut relative {
        *e = *e - least;
    }
    ratio([&relative, &relative], [-1.0, -1.0], part, whole, [n, n])
}

/// As [`in_units`] for `2^(left) part 2^(right)` with the given sides.
#[inline(always)]
pub(super) fn ratio<T: Real>(
    [left, right]: [&[T]; 2],
    [l, r]: [f64; 2],
    part: &mut [T],
    whole: &mut [T],
    size: [usize; 2],
) -> T {
    for x in [&mut *part, &mut *whole] {
        apply(left, [l, 0.0], x, size);
        apply(right, [0.0, r], x, size);
    }
    let share = norm(part) / norm(whole);
    T::select(share.is_finite() & share.ge(T::zero()), share, T::zero())
}
