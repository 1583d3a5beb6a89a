//! One number in twice the precision, as [`Real`]: an unevaluated sum of two
//! `f64`, some 106 bits with the range of one.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{LaneKernel, Real, Tier, sealed};
use crate::simd::{self, Block};

/// `hi + lo`, `|lo| <= ulp(hi)/2`; `lo` is zero where `hi` is not finite.
///
/// ```text
/// relative error of + - * / sqrt:  some 2^-104
/// ```
/// Dekker (1971), Numer. Math. 18, 224-242; sums and products as in Joldes,
/// Muller, Popescu (2017), ACM Trans. Math. Softw. 44, 15res.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Twice {
    hi: f64,
    lo: f64,
}

/// `hi + lo` of any two numbers, `|a| >= |b|` or `a` zero.
#[inline(always)]
fn quick(a: f64, b: f64) -> Twice {
    let hi = a + b;
    // Infinity and NaN have nothing below them.
    Twice { hi, lo: if hi.is_finite() { b - (hi - a) } else { 0.0 } }
}

/// `s + e = a + b` exactly.
#[inline(always)]
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let z = s - a;
    (s, (a - (s - z)) + (b - z))
}

impl Twice {
    #[inline(always)]
    fn of(hi: f64) -> Self {
        Twice { hi, lo: 0.0 }
    }
    #[inline(always)]
    fn flip(self, negative: bool) -> Self {
        if negative { -self } else { self }
    }
}

impl sealed::Sealed for Twice {}

impl Neg for Twice {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Twice { hi: -self.hi, lo: -self.lo }
    }
}

impl Add for Twice {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        let (s, e) = two_sum(self.hi, b.hi);
        if !s.is_finite() {
            return Twice::of(s);
        }
        let (t, f) = two_sum(self.lo, b.lo);
        let v = quick(s, e + t);
        quick(v.hi, f + v.lo)
    }
}

impl Sub for Twice {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self + -b
    }
}

impl Mul for Twice {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        let p = self.hi * b.hi;
        if !p.is_finite() {
            return Twice::of(p);
        }
        let e = f64::mul_add(self.hi, b.hi, -p);
        let cross = f64::mul_add(self.hi, b.lo, f64::mul_add(self.lo, b.hi, self.lo * b.lo));
        quick(p, e + cross)
    }
}

impl Div for Twice {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        let q = self.hi / b.hi;
        let rest = self - b * Twice::of(q);
        let correction = rest.hi / b.hi;
        if !correction.is_finite() {
            return Twice::of(q);
        }
        let again = rest - b * Twice::of(correction);
        quick(q, correction) + Twice::of(again.hi / b.hi)
    }
}

impl Real for Twice {
    type Mask = bool;
    const TIER: Tier = Tier::Scalar;
    const LANES: usize = 1;
    const TILE: usize = 1;
    const UNROLLS: bool = false;
    const EPSILON: f64 = f64::EPSILON * f64::EPSILON;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Twice::of(x)
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        Twice::of(f(0))
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f64 {
        debug_assert_eq!(i, 0);
        self.hi
    }
    #[inline(always)]
    fn load(src: &[f64]) -> Self {
        Twice::of(src[0])
    }
    #[inline(always)]
    fn store(self, dst: &mut [f64]) {
        dst[0] = self.hi;
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        b - self * a
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.hi.sqrt();
        if !(root > 0.0 && root.is_finite()) {
            return Twice::of(root);
        }
        // One step of Newton's iteration from the rounded root.
        let rest = self - Twice::of(root) * Twice::of(root);
        quick(root, rest.hi / (2.0 * root))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.flip(self.hi.is_sign_negative())
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        self.flip(self.hi.is_sign_negative() != sign.hi.is_sign_negative())
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if other.lt(self) { self } else { other }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self.lt(other) { self } else { other }
    }
    #[inline(always)]
    fn round_ties_even(self) -> Self {
        let hi = self.hi.round_ties_even();
        // A tie in the high part is decided by the low one.
        let tie = (self.hi - hi).abs() == 0.5;
        if hi == self.hi {
            quick(hi, self.lo.round_ties_even())
        } else if tie && self.lo != 0.0 {
            Twice::of(if self.lo > 0.0 { self.hi.ceil() } else { self.hi.floor() })
        } else {
            Twice::of(hi)
        }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.hi < other.hi || (self.hi == other.hi && self.lo < other.lo)
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self.hi < other.hi || (self.hi == other.hi && self.lo <= other.lo)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self.hi == other.hi && self.lo == other.lo
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn pow2i(n: Self) -> Self {
        Twice::of(f64::pow2i(n.hi))
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let (significand, exponent) = self.hi.split();
        (Twice::of(significand), Twice::of(exponent))
    }
    #[inline(always)]
    fn outline<K: LaneKernel<Self>>(k: K) -> K::Out {
        simd::outline_twice(k)
    }
    #[inline(always)]
    fn view(_: &[Block]) -> Option<&[Self]> {
        None
    }
    #[inline(always)]
    fn view_mut(_: &mut [Block]) -> Option<&mut [Self]> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arithmetic_has_twice_the_digits() {
        let mut x = 0.6180339887;
        for _ in 0..1000 {
            x = (x * 997.0_f64).fract() + 1e-3;
            let a = Twice::of(x) / Twice::of(3.0);
            let back = a * Twice::of(3.0) - Twice::of(x);
            assert!(back.hi.abs() <= 2e-32 * x, "{x} {back:?}");
            let root = a.sqrt();
            let back = (root * root - a).hi.abs();
            assert!(back <= 4e-32 * x, "{x} {back:e}");
            let sum = (a + Twice::of(1e10)) - Twice::of(1e10);
            assert!((sum - a).hi.abs() <= 1e-22);
        }
    }

    #[test]
    fn limits_are_those_of_one_number() {
        let (one, zero) = (Twice::of(1.0), Twice::of(0.0));
        let infinite = one / zero;
        assert!(infinite.hi == f64::INFINITY && infinite.lo == 0.0);
        assert!((zero / zero).hi.is_nan() && !(zero / zero).is_finite());
        assert!(!infinite.is_finite() && (infinite - infinite).hi.is_nan());
        assert!((Twice::of(1e200) * Twice::of(1e200)).hi == f64::INFINITY);
        assert!(zero.sqrt().hi == 0.0 && (-one).sqrt().hi.is_nan());
        let half = Twice::of(2.5) + Twice::of(1e-20);
        assert_eq!(half.round_ties_even().hi, 3.0);
        assert!(half.gt(Twice::of(2.5)) && Twice::of(2.5).lt(half));
    }
}
