//! Eight `f64` in a pair of 256-bit registers.

use super::{Block, LANES, dispatch};
use crate::real::{
    AFTER_ROOT_HALF, LaneKernel, Mask, RAISED, Real, TWO_52, TWO_52_BIASED, TWO_52_RAISED, Tier,
    sealed::Sealed,
};
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
    fn load_columns(rows: &[&[f64]; 8], at: usize) -> [Self; 8] {
        // Four 4 by 4 transpositions.
        let mut r = [Pair256::splat(0.0); 8];
        for l in 0..8 {
            r[l] = Self::load(&rows[l][at..]);
        }
        let [a, b] =
            [columns([r[0].0, r[1].0, r[2].0, r[3].0]), columns([r[4].0, r[5].0, r[6].0, r[7].0])];
        let [c, d] =
            [columns([r[0].1, r[1].1, r[2].1, r[3].1]), columns([r[4].1, r[5].1, r[6].1, r[7].1])];
        let mut out = r;
        for e in 0..4 {
            out[e] = Pair256(a[e], b[e]);
            out[e + 4] = Pair256(c[e], d[e]);
        }
        out
    }
    #[inline(always)]
    fn uniform(state: &mut [[u64; LANES]; 4], _: usize) -> Self {
        // The compiler takes rotations out of the registers, word by word.
        Pair256(uniforms::<0>(state), uniforms::<4>(state))
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
    fn split_near_one(self) -> (Self, Self) {
        let raised = both!(Pair256, above_root_half, self);
        let k = both!(Pair256, high_field, raised) - Self::splat(TWO_52_RAISED);
        (both!(Pair256, near_one, raised), k)
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

/// As an integer the number less the one after `sqrt(1/2)`, and [`RAISED`] in the exponent
/// field: of the significand near one and the exponent that are wanted, the distance of the
/// former and the latter.
#[inline]
#[target_feature(enable = "avx2")]
fn above_root_half(x: __m256d) -> __m256d {
    let by = _mm256_set1_epi64x((RAISED << 52) - AFTER_ROOT_HALF);
    _mm256_castsi256_pd(_mm256_add_epi64(_mm256_castpd_si256(x), by))
}

/// The significand near one of [`above_root_half`].
#[inline]
#[target_feature(enable = "avx2")]
fn near_one(raised: __m256d) -> __m256d {
    let low = _mm256_and_si256(_mm256_castpd_si256(raised), _mm256_set1_epi64x((1 << 52) - 1));
    _mm256_castsi256_pd(_mm256_add_epi64(low, _mm256_set1_epi64x(AFTER_ROOT_HALF)))
}

/// `2^52` plus the upper 12 bits as an integer.
#[inline]
#[target_feature(enable = "avx2")]
fn high_field(x: __m256d) -> __m256d {
    let field = _mm256_srli_epi64::<52>(_mm256_castpd_si256(x));
    _mm256_or_pd(_mm256_castsi256_pd(field), _mm256_set1_pd(TWO_52))
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

/// Columns of a 4 by 4 matrix of which the rows are given.
#[inline(always)]
fn columns(rows: [__m256d; 4]) -> [__m256d; 4] {
    let [r0, r1, r2, r3] = rows;
    cpu!({
        let (low, high) = (_mm256_unpacklo_pd(r0, r1), _mm256_unpackhi_pd(r0, r1));
        let (low2, high2) = (_mm256_unpacklo_pd(r2, r3), _mm256_unpackhi_pd(r2, r3));
        [
            _mm256_permute2f128_pd::<0x20>(low, low2),
            _mm256_permute2f128_pd::<0x20>(high, high2),
            _mm256_permute2f128_pd::<0x31>(low, low2),
            _mm256_permute2f128_pd::<0x31>(high, high2),
        ]
    })
}

/// [`Real::uniform`] of the four streams from `FIRST` on.
#[inline(always)]
fn uniforms<const FIRST: usize>(state: &mut [[u64; LANES]; 4]) -> __m256d {
    const { assert!(FIRST + 4 <= LANES) };
    // SAFETY: the reads and the writes are of four words each, from `FIRST` on, of arrays of
    // eight, which the assertion above keeps inside, and take any alignment; for the
    // intrinsics see `cpu`.
    unsafe {
        let mut words = [_mm256_setzero_si256(); 4];
        for w in 0..4 {
            words[w] = _mm256_loadu_si256(state[w].as_ptr().add(FIRST).cast());
        }
        let [mut a, mut b, mut c, mut d] = words;
        let sum = _mm256_add_epi64(a, d);
        let turned = _mm256_or_si256(_mm256_slli_epi64::<23>(sum), _mm256_srli_epi64::<41>(sum));
        let word = _mm256_add_epi64(turned, a);
        let shifted = _mm256_slli_epi64::<17>(b);
        c = _mm256_xor_si256(c, a);
        d = _mm256_xor_si256(d, b);
        b = _mm256_xor_si256(b, c);
        a = _mm256_xor_si256(a, d);
        c = _mm256_xor_si256(c, shifted);
        d = _mm256_or_si256(_mm256_slli_epi64::<45>(d), _mm256_srli_epi64::<19>(d));
        for (w, value) in [a, b, c, d].into_iter().enumerate() {
            _mm256_storeu_si256(state[w].as_mut_ptr().add(FIRST).cast(), value);
        }
        let one = _mm256_castpd_si256(_mm256_set1_pd(1.0));
        let above_one = _mm256_castsi256_pd(_mm256_or_si256(_mm256_srli_epi64::<12>(word), one));
        _mm256_sub_pd(above_one, _mm256_set1_pd(1.0 - 0.5 * f64::EPSILON))
    }
}
