//! The number type of every kernel: one `f64`, or eight of them in a lane.
//!
//! A kernel is written once, generic over [`Real`]. Run on `f64` it is the
//! oracle: plain scalar arithmetic that can be read and stepped through. Run on
//! a lane type (made by [`crate::simd::dispatch`] and nameable nowhere else) it
//! is the product: the same operations on eight independent problems.
//!
//! Every operation here is correctly rounded or acts on bits, and fused
//! multiply-add has one spelling, [`Real::mul_add`]. So each lane of every tier
//! returns exactly the bits of the oracle (payloads and signs of NaN excepted),
//! and a lane never looks at its neighbours.
//!
//! A third implementation, private to the crate, holds one number in twice the
//! precision: the solvers run their kernels on it for the few problems whose
//! condition exceeds plain `f64`. It is one number, never a lane.
//!
//! Comparisons give a mask instead of a `bool`; a branch becomes
//! [`Real::select`], and only [`Mask::any`] and [`Mask::all`] may steer control
//! flow, where both ways give the same bits.

mod math;
mod scalar;
mod tier;
mod trig;
mod twice;

pub(crate) use math::minus_two_ln;
pub use math::{exp, ln};
pub(crate) use scalar::{AFTER_ROOT_HALF, RAISED, TWO_52, TWO_52_BIASED, TWO_52_RAISED};
pub use tier::Tier;
pub use trig::sin_cos;
pub(crate) use trig::sin_cos_octant;
pub(crate) use twice::Twice;

use std::fmt::Debug;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// Keeps [`Real`] to the types of this crate: storage is cast to lanes on the
/// strength of their layout.
pub(crate) mod sealed {
    /// Implemented by `f64` and the lane types.
    pub trait Sealed {}
    impl Sealed for f64 {}
}

/// A truth value per lane; `bool` for the scalar oracle.
pub trait Mask:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + Not<Output = Self>
{
    /// The same truth value in every lane.
    fn splat(value: bool) -> Self;
    /// True when at least one lane is true.
    fn any(self) -> bool;
    /// True when every lane is true.
    fn all(self) -> bool;
    /// The truth value of lane `i`, `i < Real::LANES`.
    fn lane(self, i: usize) -> bool;
}

/// A unit of work for one lane type, to be compiled out of line by
/// [`Real::outline`].
///
/// Mark `run` `#[inline(always)]`: it must melt into the feature-enabled
/// function around it.
pub trait LaneKernel<T: Real> {
    /// What the kernel returns.
    type Out;
    /// Does the work.
    fn run(self) -> Self::Out;
}

/// Arithmetic that means the same, to the bit, on `f64` and on every lane type.
///
/// # Examples
/// ```
/// use mmae::real::Real;
/// /// Horner's rule, each step rounded once.
/// fn horner<T: Real>(c: &[f64], x: T) -> T {
///     c.iter().rev().fold(T::splat(0.0), |s, &c| s.mul_add(x, T::splat(c)))
/// }
/// assert_eq!(horner(&[1.0, 2.0, 3.0], 2.0), 17.0);
/// ```
pub trait Real:
    sealed::Sealed
    + Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// What comparisons return.
    type Mask: Mask;

    /// The instruction set behind the type.
    const TIER: Tier;
    /// Numbers held: 1 or [`crate::simd::LANES`].
    const LANES: usize;
    /// Rows and columns of the register tile of a matrix product: 4, 2 or 1.
    const TILE: usize;
    /// Distance from one to the next number: `2^-52`.
    const EPSILON: f64 = f64::EPSILON;
    /// True if kernels for common small sizes are worth compiling: not for the
    /// oracle, nor where a fused multiply-add is a call.
    const UNROLLS: bool;

    /// The same number in every lane.
    fn splat(x: f64) -> Self;
    /// The number `f(i)` in lane `i`, called in order of `i`.
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self;
    /// The number in lane `i`; panics unless `i < LANES`.
    fn lane(self, i: usize) -> f64;
    /// The first `LANES` numbers of `src`; panics if it is shorter.
    fn load(src: &[f64]) -> Self;
    /// Writes `LANES` numbers to the front of `dst`; panics if it is shorter.
    fn store(self, dst: &mut [f64]);

    /// Eight numbers of each of eight rows, from `at` on: number `e` of row `l` in
    /// lane `l` of the result `e`. Panics if a row that a lane reads is too short.
    #[inline(always)]
    fn load_columns(rows: &[&[f64]; 8], at: usize) -> [Self; 8] {
        let mut out = [Self::zero(); 8];
        for (e, x) in out.iter_mut().enumerate() {
            *x = Self::from_fn(|l| rows[l][at + e]);
        }
        out
    }

    /// The next number of `LANES` streams of xoshiro256++, from stream `first` of eight
    /// on: an odd multiple of `2^-53` in (0, 1). `state` holds the four words of each.
    ///
    /// # Source
    /// Blackman, Vigna (2021), ACM Transactions on Mathematical Software 47, 36.
    #[inline(always)]
    fn uniform(state: &mut [[u64; 8]; 4], first: usize) -> Self {
        let [a, b, c, d] = state;
        let mut out = [0.0; 8];
        for l in first..first + Self::LANES {
            let word = a[l].wrapping_add(d[l]).rotate_left(23).wrapping_add(a[l]);
            let shifted = b[l] << 17;
            c[l] ^= a[l];
            d[l] ^= b[l];
            b[l] ^= c[l];
            a[l] ^= d[l];
            c[l] ^= shifted;
            d[l] = d[l].rotate_left(45);
            // 1 + k 2^-52 from bits, then an exact difference
            let above_one = f64::from_bits((word >> 12) | 0x3ff0_0000_0000_0000);
            out[l] = above_one - (1.0 - 0.5 * f64::EPSILON);
        }
        Self::load(&out[first..])
    }

    /// `self * a + b`, rounded once.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// `b - self * a`, rounded once.
    fn neg_mul_add(self, a: Self, b: Self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Magnitude: clears the sign bit.
    fn abs(self) -> Self;
    /// Magnitude of `self` with the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// `if self > other { self } else { other }`: a NaN on either side gives
    /// `other`, and so do zeros of either sign.
    fn max(self, other: Self) -> Self;
    /// `if self < other { self } else { other }`, see [`Real::max`].
    fn min(self, other: Self) -> Self;
    /// The nearest integer, ties to even, the sign of zero kept.
    fn round_ties_even(self) -> Self;

    /// `self < other`; false when either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`; false when either is NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `self == other`; false when either is NaN, true for zeros of either sign.
    fn eq(self, other: Self) -> Self::Mask;
    /// `if mask { a } else { b }`, lane by lane, whatever `a` and `b` hold.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;

    /// `2^n` for integer `n` in `-1022..=1023`, built from bits; any other `n`
    /// gives an unspecified number, the same one in every tier.
    ///
    /// ```text
    /// bits(2^n) = (n + 1023) << 52
    /// ```
    fn pow2i(n: Self) -> Self;
    /// The fields of the number: significand in `[1, 2)` and exponent `e`.
    ///
    /// ```text
    /// |x| = significand * 2^e        for normal x
    /// ```
    /// The sign is dropped. Zeros and subnormals have `e = -1023`, infinities
    /// and NaN `e = 1024`; their significand is then `1 + fraction bits`.
    fn split(self) -> (Self, Self);
    /// The fields of a positive normal number, the significand as near to one as can be.
    ///
    /// ```text
    /// x = significand * 2^e,   sqrt(1/2) < significand <= sqrt(2)   (both rounded)
    /// ```
    #[inline(always)]
    fn split_near_one(self) -> (Self, Self) {
        let (m, e) = self.split();
        let high = m.gt(Self::splat(std::f64::consts::SQRT_2));
        let m = Self::select(high, m * Self::splat(0.5), m);
        (m, Self::select(high, e + Self::one(), e))
    }

    /// `e^x` of each number, in place: one number at a time has its lanes here, too.
    #[inline(always)]
    fn exp_each(numbers: &mut [Self]) {
        for x in numbers {
            *x = exp(*x);
        }
    }

    /// Runs `k` in a function of its own, compiled once per tier with the
    /// tier's instruction set, where inlining at every call site would cost
    /// more build time and code than the call.
    fn outline<K: LaneKernel<Self>>(k: K) -> K::Out;

    /// Blocks of storage seen as lanes, or `None` for the scalar oracle, which
    /// copies one item at a time ([`crate::simd::load_group`]).
    fn view(blocks: &[crate::simd::Block]) -> Option<&[Self]>;
    /// As [`Real::view`], to write.
    fn view_mut(blocks: &mut [crate::simd::Block]) -> Option<&mut [Self]>;

    /// `self > other`; false when either is NaN.
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// `self >= other`; false when either is NaN.
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// `1 / self`, correctly rounded.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::splat(1.0) / self
    }
    /// `self * a - b`, rounded once.
    #[inline(always)]
    fn mul_sub(self, a: Self, b: Self) -> Self {
        self.mul_add(a, -b)
    }
    /// False for infinities and NaN.
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.abs().lt(Self::splat(f64::INFINITY))
    }
    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
    /// One in every lane.
    #[inline(always)]
    fn one() -> Self {
        Self::splat(1.0)
    }
    /// `f` of every lane, one at a time: for rare fallbacks.
    #[inline(always)]
    fn map_lanes(self, f: impl Fn(f64) -> f64) -> Self {
        Self::from_fn(|i| f(self.lane(i)))
    }
}
