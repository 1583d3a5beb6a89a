//! Eight `f64` in a pair of 256-bit registers.

use super::{Block, LANES, dispatch};
use crate::real::{LaneKernel, Mask, Real, TWO_52, TWO_52_BIASED, Tier, sealed::Sealed};
use std::arch::x86_64::*;
use std::fmt;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// Eight numbers, the first four in the first register. A value exists only
/// where AVX2 and FMA were detected: the type is private to `simd`, whose
/// dispatch hands it out after the check.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Pair256(__m256d, __m256d);

/// Eight truth values: all bits of a number set, or none.
#[derive(Clone, Copy)]
pub(super) struct MaskPair(__m256d, __m256d);

/// An intrinsic of this tier.
macro_rules! cpu {
    ($call:expr) => {
        // SAFETY: these intrinsics need only the CPU features of the tier, and
        // a `Pair256` (or its mask) exists only where they were detected.
        unsafe { $call }
    };
}

/// One intrinsic on both halves.
macro_rules! both {
    ($out:ident, $f:path, $a:expr) => {
        $out(cpu!($f($a.0)), cpu!($f($a.1)))
    };
    ($out:ident, $f:path, $a:expr, $b:expr) => {
        $out(cpu!($f($a.0, $b.0)), cpu!($f($a.1, $b.1)))
    };
    ($out:ident, $f:path, $a:expr, $b:expr, $c:expr) => {
        $out(cpu!($f($a.0, $b.0, $c.0)), cpu!($f($a.1, $b.1, $c.1)))
    };
}

impl fmt::Debug for Pair256 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries((0..LANES).map(|i| self.lane(i))).finish()
    }
}

impl fmt::Debug for MaskPair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries((0..LANES).map(|i| self.lane(i))).finish()
    }
}

impl MaskPair {
    /// Bit `i` for lane `i`.
    #[inline(always)]
    fn bits(self) -> i32 {
        cpu!(_mm256_movemask_pd(self.0) | _mm256_movemask_pd(self.1) << 4)
    }
}

impl BitAnd for MaskPair {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, o: Self) -> Self {
        both!(MaskPair, _mm256_and_pd, self, o)
    }
}
impl BitOr for MaskPair {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, o: Self) -> Self {
        both!(MaskPair, _mm256_or_pd, self, o)
    }
}
impl Not for MaskPair {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        both!(MaskPair, _mm256_xor_pd, self, Self::splat(true))
    }
}
impl Mask for MaskPair {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        let half = cpu!(_mm256_castsi256_pd(_mm256_set1_epi64x(-i64::from(value))));
        MaskPair(half, half)
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.bits() == 0xff
    }
    #[inline(always)]
    fn lane(self, i: usize) -> bool {
        debug_assert!(i < LANES);
        (self.bits() >> i) & 1 != 0
    }
}

impl Add for Pair256 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        both!(Pair256, _mm256_add_pd, self, o)
    }
}
impl Sub for Pair256 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        both!(Pair256, _mm256_sub_pd, self, o)
    }
}
impl Mul for Pair256 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        both!(Pair256, _mm256_mul_pd, self, o)
    }
}
impl Div for Pair256 {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        both!(Pair256, _mm256_div_pd, self, o)
    }
}
impl Neg for Pair256 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        both!(Pair256, _mm256_xor_pd, self, Self::splat(-0.0))
    }
}

impl Sealed for Pair256 {}

impl Real for Pair256 {
    type Mask = MaskPair;
    const TIER: Tier = Tier::Avx2;
    const LANES: usize = LANES;
    // Four sums of two registers each, two entries of one factor and one of the
    // other: 14 of 16.
    const TILE: usize = 2;
    const UNROLLS: bool = true;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        let half = cpu!(_mm256_set1_pd(x));
        Pair256(half, half)
    }
    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self {
        Self::load(&std::array::from_fn::<f64, LANES, _>(f))
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f64 {
        let mut all = [0.0; LANES];
        self.store(&mut all);
        all[i]
    }
    #[inline(always)]
    fn load(src: &[f64]) -> Self {
        let (low, high) = src[..LANES].split_at(4);
        // SAFETY: four readable numbers each; the loads take any alignment.
        unsafe { Pair256(_mm256_loadu_pd(low.as_ptr()), _mm256_loadu_pd(high.as_ptr())) }
    }
    #[inline(always)]
    fn store(self, dst: &mut [f64]) {
        let (low, high) = dst[..LANES].split_at_mut(4);
        // SAFETY: four writable numbers each; the stores take any alignment.
        unsafe {
            _mm256_storeu_pd(low.as_mut_ptr(), self.0);
            _mm256_storeu_pd(high.as_mut_ptr(), self.1);
        }
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        both!(Pair256, _mm256_fmadd_pd, self, a, b)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        both!(Pair256, _mm256_fnmadd_pd, self, a, b)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        both!(Pair256, _mm256_sqrt_pd, self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        both!(Pair256, _mm256_andnot_pd, Self::splat(-0.0), self)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        let bit = Self::splat(-0.0);
        let magnitude = self.abs();
        let sign = both!(Pair256, _mm256_and_pd, bit, sign);
        both!(Pair256, _mm256_or_pd, magnitude, sign)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        both!(Pair256, _mm256_max_pd, self, other)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        both!(Pair256, _mm256_min_pd, self, other)
    }
    #[inline(always)]
    fn round_ties_even(self) -> Self {
        both!(Pair256, _mm256_round_pd::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>, self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> MaskPair {
        both!(MaskPair, _mm256_cmp_pd::<_CMP_LT_OQ>, self, other)
    }
    #[inline(always)]
    fn le(self, other: Self) -> MaskPair {
        both!(MaskPair, _mm256_cmp_pd::<_CMP_LE_OQ>, self, other)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> MaskPair {
        both!(MaskPair, _mm256_cmp_pd::<_CMP_EQ_OQ>, self, other)
    }
    #[inline(always)]
    fn select(mask: MaskPair, a: Self, b: Self) -> Self {
        both!(Pair256, _mm256_blendv_pd, b, a, mask)
    }
    #[inline(always)]
    fn pow2i(n: Self) -> Self {
        let biased = n + Self::splat(TWO_52_BIASED);
        both!(Pair256, exponent_from_low_bits, biased)
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let significand = both!(Pair256, significand, self);
        let biased = both!(Pair256, biased_exponent, self);
        (significand, biased - Self::splat(TWO_52_BIASED))
    }
    #[inline(always)]
    fn outline<K: LaneKernel<Self>>(k: K) -> K::Out {
        // SAFETY: the features of the tier were detected, or no `Pair256` type
        // could have been handed to the caller.
        unsafe { dispatch::outline_avx2(k) }
    }
    #[inline(always)]
    fn view(blocks: &[Block]) -> Option<&[Self]> {
        // SAFETY: `Block` and `Pair256` are both 64 bytes aligned to 64, and
        // any bits are valid in either.
        Some(unsafe { std::slice::from_raw_parts(blocks.as_ptr().cast(), blocks.len()) })
    }
    #[inline(always)]
    fn view_mut(blocks: &mut [Block]) -> Option<&mut [Self]> {
        // SAFETY: as in `view`; the borrow is exclusive.
        Some(unsafe { std::slice::from_raw_parts_mut(blocks.as_mut_ptr().cast(), blocks.len()) })
    }
}

/// The low 11 bits moved into the exponent field.
#[inline]
#[target_feature(enable = "avx2")]
fn exponent_from_low_bits(x: __m256d) -> __m256d {
    _mm256_castsi256_pd(_mm256_slli_epi64::<52>(_mm256_castpd_si256(x)))
}

/// The fraction bits under the exponent of one.
#[inline]
#[target_feature(enable = "avx2")]
fn significand(x: __m256d) -> __m256d {
    let fraction = _mm256_castsi256_pd(_mm256_set1_epi64x((1 << 52) - 1));
    _mm256_or_pd(_mm256_and_pd(x, fraction), _mm256_set1_pd(1.0))
}

/// `2^52` plus the exponent field as an integer.
#[inline]
#[target_feature(enable = "avx2")]
fn biased_exponent(x: __m256d) -> __m256d {
    let shifted = _mm256_slli_epi64::<1>(_mm256_castpd_si256(x));
    let field = _mm256_castsi256_pd(_mm256_srli_epi64::<53>(shifted));
    _mm256_or_pd(field, _mm256_set1_pd(TWO_52))
}
