//! `f64` as [`Real`]: the oracle.

use super::{LaneKernel, Mask, Real, Tier};
use crate::simd::{self, Block};

/// Bits of the fraction field.
const FRACTION: u64 = (1 << 52) - 1;
/// `2^52`: adding an integer puts it into the low fraction bits.
pub(crate) const TWO_52: f64 = 4_503_599_627_370_496.0;
/// Added to an integer exponent, leaves the biased exponent in the low bits.
pub(crate) const TWO_52_BIASED: f64 = TWO_52 + 1023.0;
/// The bits of the number after `sqrt(1/2)`, the least significand near one.
pub(crate) const AFTER_ROOT_HALF: i64 = 0x3fe6_a09e_667f_3bce;
/// Added to exponents that are taken apart so: none of them is negative.
pub(crate) const RAISED: i64 = 1024;
/// The same in a number that has them in its low bits.
pub(crate) const TWO_52_RAISED: f64 = TWO_52 + 1024.0;

impl Mask for bool {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        value
    }
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn all(self) -> bool {
        self
    }
    #[inline(always)]
    fn lane(self, _: usize) -> bool {
        self
    }
}

impl Real for f64 {
    type Mask = bool;
    const TIER: Tier = Tier::Scalar;
    const LANES: usize = 1;
    const TILE: usize = 2;
    const UNROLLS: bool = false;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        f(0)
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f64 {
        debug_assert_eq!(i, 0);
        self
    }
    #[inline(always)]
    fn load(src: &[f64]) -> Self {
        src[0]
    }
    #[inline(always)]
    fn store(self, dst: &mut [f64]) {
        dst[0] = self;
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        f64::mul_add(self, a, b)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        f64::mul_add(-self, a, b)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        f64::copysign(self, sign)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn round_ties_even(self) -> Self {
        f64::round_ties_even(self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn pow2i(n: Self) -> Self {
        f64::from_bits((n + TWO_52_BIASED).to_bits() << 52)
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let bits = self.to_bits();
        let significand = f64::from_bits((bits & FRACTION) | 1.0_f64.to_bits());
        let biased = f64::from_bits(((bits << 1) >> 53) | TWO_52.to_bits());
        (significand, biased - TWO_52_BIASED)
    }
    #[inline(always)]
    fn exp_each(numbers: &mut [Self]) {
        simd::exp_each(numbers);
    }
    #[inline(always)]
    fn outline<K: LaneKernel<Self>>(k: K) -> K::Out {
        simd::outline_scalar(k)
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
