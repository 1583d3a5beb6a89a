//! Eight `f64` in an array: every CPU runs it, vector units as the target has
//! them (on AArch64 the compiler uses NEON and its fused multiply-add).

use super::{Block, LANES};
use crate::real::{LaneKernel, Mask, Real, Tier, sealed::Sealed};
use std::array::from_fn;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// Eight numbers.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Array8([f64; LANES]);

/// Eight truth values.
#[derive(Clone, Copy, Debug)]
pub(super) struct MaskArray([bool; LANES]);

// Without a fused instruction each lane of `mul_add` is a call into the
// mathematics library, which no inlining makes fast: there every operation is a
// function of its own, or kernels would grow tenfold and take as long to build.
macro_rules! operation {
    ($($item:item)*) => {$(
        #[cfg_attr(any(target_arch = "aarch64", target_feature = "fma"), inline(always))]
        #[cfg_attr(not(any(target_arch = "aarch64", target_feature = "fma")), inline(never))]
        $item
    )*};
}

impl Array8 {
    operation! {
        fn map(&self, f: impl Fn(f64) -> f64) -> Self {
            Array8(from_fn(|i| f(self.0[i])))
        }
        fn zip(&self, o: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
            Array8(from_fn(|i| f(self.0[i], o.0[i])))
        }
        fn fused(&self, a: &Self, b: &Self) -> Self {
            Array8(from_fn(|i| self.0[i].mul_add(a.0[i], b.0[i])))
        }
        fn compare(&self, o: &Self, f: impl Fn(f64, f64) -> bool) -> MaskArray {
            MaskArray(from_fn(|i| f(self.0[i], o.0[i])))
        }
        fn choose(mask: &MaskArray, a: &Self, b: &Self) -> Self {
            Array8(from_fn(|i| if mask.0[i] { a.0[i] } else { b.0[i] }))
        }
    }
}

impl BitAnd for MaskArray {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, o: Self) -> Self {
        MaskArray(from_fn(|i| self.0[i] & o.0[i]))
    }
}
impl BitOr for MaskArray {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, o: Self) -> Self {
        MaskArray(from_fn(|i| self.0[i] | o.0[i]))
    }
}
impl Not for MaskArray {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        MaskArray(from_fn(|i| !self.0[i]))
    }
}
impl Mask for MaskArray {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        MaskArray([value; LANES])
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0.iter().any(|&m| m)
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.0.iter().all(|&m| m)
    }
    #[inline(always)]
    fn lane(self, i: usize) -> bool {
        self.0[i]
    }
}

impl Add for Array8 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.zip(&o, |a, b| a + b)
    }
}
impl Sub for Array8 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.zip(&o, |a, b| a - b)
    }
}
impl Mul for Array8 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.zip(&o, |a, b| a * b)
    }
}
impl Div for Array8 {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        self.zip(&o, |a, b| a / b)
    }
}
impl Neg for Array8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl Sealed for Array8 {}

impl Real for Array8 {
    type Mask = MaskArray;
    const TIER: Tier = Tier::Baseline;
    const LANES: usize = LANES;
    // One sum of eight numbers is all that 16 registers of 128 bits hold; the 32
    // of AArch64 hold four.
    const TILE: usize = if cfg!(target_arch = "aarch64") { 2 } else { 1 };
    const UNROLLS: bool = cfg!(target_arch = "aarch64");

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Array8([x; LANES])
    }
    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self {
        Array8(from_fn(f))
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f64 {
        self.0[i]
    }
    #[inline(always)]
    fn load(src: &[f64]) -> Self {
        let src = &src[..LANES];
        Array8(from_fn(|i| src[i]))
    }
    #[inline(always)]
    fn store(self, dst: &mut [f64]) {
        dst[..LANES].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self.fused(&a, &b)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        (-self).mul_add(a, b)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f64::abs)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        self.zip(&sign, f64::copysign)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(&other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(&other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn round_ties_even(self) -> Self {
        self.map(f64::round_ties_even)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> MaskArray {
        self.compare(&other, |a, b| a < b)
    }
    #[inline(always)]
    fn le(self, other: Self) -> MaskArray {
        self.compare(&other, |a, b| a <= b)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> MaskArray {
        self.compare(&other, |a, b| a == b)
    }
    #[inline(always)]
    fn select(mask: MaskArray, a: Self, b: Self) -> Self {
        Self::choose(&mask, &a, &b)
    }
    #[inline(always)]
    fn pow2i(n: Self) -> Self {
        n.map(<f64 as Real>::pow2i)
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        (self.map(|x| Real::split(x).0), self.map(|x| Real::split(x).1))
    }
    #[inline(never)]
    fn outline<K: LaneKernel<Self>>(k: K) -> K::Out {
        k.run()
    }
    #[inline(always)]
    fn view(blocks: &[Block]) -> Option<&[Self]> {
        // SAFETY: `Block` and `Array8` are both eight numbers aligned to 64.
        Some(unsafe { std::slice::from_raw_parts(blocks.as_ptr().cast(), blocks.len()) })
    }
    #[inline(always)]
    fn view_mut(blocks: &mut [Block]) -> Option<&mut [Self]> {
        // SAFETY: as in `view`; the borrow is exclusive.
        Some(unsafe { std::slice::from_raw_parts_mut(blocks.as_mut_ptr().cast(), blocks.len()) })
    }
}
