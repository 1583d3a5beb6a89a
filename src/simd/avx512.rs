//! Eight `f64` in one 512-bit register.

use super::{Block, LANES, dispatch};
use crate::real::{
    AFTER_ROOT_HALF, LaneKernel, Mask, RAISED, Real, TWO_52, TWO_52_BIASED, TWO_52_RAISED, Tier,
    sealed::Sealed,
};
use std::arch::x86_64::*;
use std::fmt;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// Eight numbers. A value exists only where AVX-512 F, DQ and VL were detected:
/// the type is private to `simd`, whose dispatch hands it out after the check.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(super) struct Lane512(__m512d);

/// Eight truth values, bit `i` for lane `i`.
#[derive(Clone, Copy)]
pub(super) struct Mask512(__mmask8);

/// An intrinsic of this tier.
macro_rules! cpu {
    ($call:expr) => {
        // SAFETY: these intrinsics need only the CPU features of the tier, and
        // a `Lane512` (or its mask) exists only where they were detected.
        unsafe { $call }
    };
}

impl fmt::Debug for Lane512 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries((0..LANES).map(|i| self.lane(i))).finish()
    }
}

impl fmt::Debug for Mask512 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries((0..LANES).map(|i| self.lane(i))).finish()
    }
}

impl BitAnd for Mask512 {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, o: Self) -> Self {
        Mask512(self.0 & o.0)
    }
}
impl BitOr for Mask512 {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, o: Self) -> Self {
        Mask512(self.0 | o.0)
    }
}
impl Not for Mask512 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Mask512(!self.0)
    }
}
impl Mask for Mask512 {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        Mask512(if value { 0xff } else { 0 })
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0 != 0
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.0 == 0xff
    }
    #[inline(always)]
    fn lane(self, i: usize) -> bool {
        debug_assert!(i < LANES);
        (self.0 >> i) & 1 != 0
    }
}

impl Add for Lane512 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Lane512(cpu!(_mm512_add_pd(self.0, o.0)))
    }
}
impl Sub for Lane512 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Lane512(cpu!(_mm512_sub_pd(self.0, o.0)))
    }
}
impl Mul for Lane512 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Lane512(cpu!(_mm512_mul_pd(self.0, o.0)))
    }
}
impl Div for Lane512 {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        Lane512(cpu!(_mm512_div_pd(self.0, o.0)))
    }
}
impl Neg for Lane512 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Lane512(cpu!(_mm512_xor_pd(self.0, _mm512_set1_pd(-0.0))))
    }
}

impl Sealed for Lane512 {}

impl Real for Lane512 {
    type Mask = Mask512;
    const TIER: Tier = Tier::Avx512;
    const LANES: usize = LANES;
    // 16 sums, four entries of one factor and one of the other: 21 of 32.
    const TILE: usize = 4;
    const UNROLLS: bool = true;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Lane512(cpu!(_mm512_set1_pd(x)))
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
        let src = &src[..LANES];
        // SAFETY: eight readable numbers; the load takes any alignment.
        Lane512(unsafe { _mm512_loadu_pd(src.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, dst: &mut [f64]) {
        let dst = &mut dst[..LANES];
        // SAFETY: eight writable numbers; the store takes any alignment.
        unsafe { _mm512_storeu_pd(dst.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn load_columns(rows: &[&[f64]; 8], at: usize) -> [Self; 8] {
        // An 8 by 8 transposition: pairs of rows, then pairs of pairs, then all.
        let (r0, r1) = (Self::load(&rows[0][at..]).0, Self::load(&rows[1][at..]).0);
        let (r2, r3) = (Self::load(&rows[2][at..]).0, Self::load(&rows[3][at..]).0);
        let (r4, r5) = (Self::load(&rows[4][at..]).0, Self::load(&rows[5][at..]).0);
        let (r6, r7) = (Self::load(&rows[6][at..]).0, Self::load(&rows[7][at..]).0);
        cpu!({
            let [x0, x2, x4, x6] = columns([
                _mm512_unpacklo_pd(r0, r1),
                _mm512_unpacklo_pd(r2, r3),
                _mm512_unpacklo_pd(r4, r5),
                _mm512_unpacklo_pd(r6, r7),
            ]);
            let [x1, x3, x5, x7] = columns([
                _mm512_unpackhi_pd(r0, r1),
                _mm512_unpackhi_pd(r2, r3),
                _mm512_unpackhi_pd(r4, r5),
                _mm512_unpackhi_pd(r6, r7),
            ]);
            [x0, x1, x2, x3, x4, x5, x6, x7]
        })
    }
    #[inline(always)]
    fn uniform(state: &mut [[u64; LANES]; 4], _: usize) -> Self {
        // In registers: the compiler takes the rotations word by word. SAFETY: the reads and
        // the writes are of eight words each, of arrays of eight, and take any alignment;
        // for the intrinsics see `cpu`.
        let above_one = unsafe {
            let mut words = [_mm512_setzero_si512(); 4];
            for w in 0..4 {
                words[w] = _mm512_loadu_si512(state[w].as_ptr().cast());
            }
            let [mut a, mut b, mut c, mut d] = words;
            let turned = _mm512_rol_epi64::<23>(_mm512_add_epi64(a, d));
            let word = _mm512_add_epi64(turned, a);
            let shifted = _mm512_slli_epi64::<17>(b);
            c = _mm512_xor_si512(c, a);
            d = _mm512_xor_si512(d, b);
            b = _mm512_xor_si512(b, c);
            a = _mm512_xor_si512(a, d);
            c = _mm512_xor_si512(c, shifted);
            d = _mm512_rol_epi64::<45>(d);
            for (w, value) in [a, b, c, d].into_iter().enumerate() {
                _mm512_storeu_si512(state[w].as_mut_ptr().cast(), value);
            }
            let one = _mm512_castpd_si512(_mm512_set1_pd(1.0));
            _mm512_castsi512_pd(_mm512_or_si512(_mm512_srli_epi64::<12>(word), one))
        };
        Lane512(above_one) - Self::splat(1.0 - 0.5 * f64::EPSILON)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Lane512(cpu!(_mm512_fmadd_pd(self.0, a.0, b.0)))
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        Lane512(cpu!(_mm512_fnmadd_pd(self.0, a.0, b.0)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Lane512(cpu!(_mm512_sqrt_pd(self.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Lane512(cpu!(_mm512_andnot_pd(_mm512_set1_pd(-0.0), self.0)))
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Lane512(cpu!({
            let bit = _mm512_set1_pd(-0.0);
            _mm512_or_pd(_mm512_andnot_pd(bit, self.0), _mm512_and_pd(bit, sign.0))
        }))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Lane512(cpu!(_mm512_max_pd(self.0, other.0)))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Lane512(cpu!(_mm512_min_pd(self.0, other.0)))
    }
    #[inline(always)]
    fn round_ties_even(self) -> Self {
        Lane512(cpu!(_mm512_roundscale_pd::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(
            self.0
        )))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask512 {
        Mask512(cpu!(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask512 {
        Mask512(cpu!(_mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Mask512 {
        Mask512(cpu!(_mm512_cmp_pd_mask::<_CMP_EQ_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn select(mask: Mask512, a: Self, b: Self) -> Self {
        Lane512(cpu!(_mm512_mask_blend_pd(mask.0, b.0, a.0)))
    }
    #[inline(always)]
    fn pow2i(n: Self) -> Self {
        let biased = n + Self::splat(TWO_52_BIASED);
        Lane512(cpu!(_mm512_castsi512_pd(_mm512_slli_epi64::<52>(_mm512_castpd_si512(biased.0)))))
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let (significand, biased) = cpu!({
            let bits = _mm512_castpd_si512(self.0);
            let fraction = _mm512_and_si512(bits, _mm512_set1_epi64((1 << 52) - 1));
            let one = _mm512_castpd_si512(_mm512_set1_pd(1.0));
            let exponent = _mm512_srli_epi64::<53>(_mm512_slli_epi64::<1>(bits));
            let two_52 = _mm512_castpd_si512(_mm512_set1_pd(TWO_52));
            (
                _mm512_castsi512_pd(_mm512_or_si512(fraction, one)),
                _mm512_castsi512_pd(_mm512_or_si512(exponent, two_52)),
            )
        });
        (Lane512(significand), Lane512(biased) - Self::splat(TWO_52_BIASED))
    }
    #[inline(always)]
    fn split_near_one(self) -> (Self, Self) {
        // as in two halves, see there
        let (near_one, high) = cpu!({
            let by = _mm512_set1_epi64((RAISED << 52) - AFTER_ROOT_HALF);
            let raised = _mm512_add_epi64(_mm512_castpd_si512(self.0), by);
            let low = _mm512_and_si512(raised, _mm512_set1_epi64((1 << 52) - 1));
            let two_52 = _mm512_castpd_si512(_mm512_set1_pd(TWO_52));
            let field = _mm512_or_si512(_mm512_srli_epi64::<52>(raised), two_52);
            let near_one = _mm512_add_epi64(low, _mm512_set1_epi64(AFTER_ROOT_HALF));
            (_mm512_castsi512_pd(near_one), _mm512_castsi512_pd(field))
        });
        (Lane512(near_one), Lane512(high) - Self::splat(TWO_52_RAISED))
    }
    #[inline(always)]
    fn outline<K: LaneKernel<Self>>(k: K) -> K::Out {
        // SAFETY: the features of the tier were detected, or no `Lane512` type
        // could have been handed to the caller.
        unsafe { dispatch::outline_avx512(k) }
    }
    #[inline(always)]
    fn view(blocks: &[Block]) -> Option<&[Self]> {
        // SAFETY: `Block` and `Lane512` are both 64 bytes aligned to 64, and
        // any bits are valid in either.
        Some(unsafe { std::slice::from_raw_parts(blocks.as_ptr().cast(), blocks.len()) })
    }
    #[inline(always)]
    fn view_mut(blocks: &mut [Block]) -> Option<&mut [Self]> {
        // SAFETY: as in `view`; the borrow is exclusive.
        Some(unsafe { std::slice::from_raw_parts_mut(blocks.as_mut_ptr().cast(), blocks.len()) })
    }
}

/// Quarter `k` of each register, side by side, for `k` from 0 to 3.
#[inline]
#[target_feature(enable = "avx512f")]
fn columns([a, b, c, d]: [__m512d; 4]) -> [Lane512; 4] {
    let (even_ab, odd_ab) =
        (_mm512_shuffle_f64x2::<0x88>(a, b), _mm512_shuffle_f64x2::<0xdd>(a, b));
    let (even_cd, odd_cd) =
        (_mm512_shuffle_f64x2::<0x88>(c, d), _mm512_shuffle_f64x2::<0xdd>(c, d));
    [
        Lane512(_mm512_shuffle_f64x2::<0x88>(even_ab, even_cd)),
        Lane512(_mm512_shuffle_f64x2::<0x88>(odd_ab, odd_cd)),
        Lane512(_mm512_shuffle_f64x2::<0xdd>(even_ab, even_cd)),
        Lane512(_mm512_shuffle_f64x2::<0xdd>(odd_ab, odd_cd)),
    ]
}
