//! Exponential and logarithm on lanes, within one unit in the last place.

use super::Real;

/// `log2(e)`.
const LOG2_E: f64 = std::f64::consts::LOG2_E;
/// `ln 2`, rounded; an exponent times it, subtracted with one rounding from a
/// number that close to it, is exact.
const LN_2: f64 = std::f64::consts::LN_2;
/// The rest of `ln 2`.
const LN_2_LOW: f64 = 2.319_046_813_846_299_6e-17;

/// `(e^r - 1 - r - r^2/2) / r^3` for `|r| <= ln(2)/2`, near-minimax, 3e-19.
const EXP: [f64; 10] = [
    0.166_666_666_666_666_69,
    0.041_666_666_666_666_664,
    0.008_333_333_333_330_065,
    0.001_388_888_888_888_655_4,
    0.000_198_412_698_630_405_45,
    2.480_158_731_713_516_4e-5,
    2.755_726_848_030_983_7e-6,
    2.755_728_298_405_574e-7,
    2.510_037_583_265_122e-8,
    2.091_122_972_982_282_6e-9,
];

/// `(2 atanh(s) - 2 s) / s^3` in powers of `s^2`, for `|s| <= 3 - 2 sqrt(2)`,
/// near-minimax, 2e-18.
const ATANH: [f64; 7] = [
    0.666_666_666_666_667,
    0.399_999_999_998_995_05,
    0.285_714_286_259_754_87,
    0.222_222_111_347_950_36,
    0.181_828_891_252_647_98,
    0.153_317_216_004_537_65,
    0.146_164_496_863_075_75,
];

/// `-2 ln(1 + f) / f` in powers of `f` for `sqrt(1/2) <= 1 + f <= sqrt(2)`, near-minimax,
/// 5e-17 relative.
const MINUS_TWO_LN: [[f64; 4]; 5] = [
    [-2.0, 0.999_999_999_999_999_2, -0.666_666_666_666_512, 0.500_000_000_000_287_5],
    [
        -0.400_000_000_042_333_7,
        0.333_333_333_326_626_6,
        -0.285_714_281_241_176_9,
        0.249_999_996_135_544_9,
    ],
    [
        -0.222_222_458_122_938_25,
        0.200_000_391_308_656_04,
        -0.181_811_314_002_415_87,
        0.166_650_282_359_410_18,
    ],
    [
        -0.153_958_032_474_778_16,
        0.143_216_106_721_864_2,
        -0.132_413_031_134_222_1,
        0.120_743_146_366_300_11,
    ],
    [
        -0.119_477_478_290_685_83,
        0.135_972_361_572_459_34,
        -0.126_703_349_210_751_77,
        0.056_600_801_131_443_99,
    ],
];

/// `c[0] + c[1] x + c[2] x^2 + ..` by Horner's rule.
#[inline(always)]
pub(super) fn poly<T: Real, const N: usize>(c: &[f64; N], x: T) -> T {
    let mut sum = T::splat(c[N - 1]);
    for i in (0..N - 1).rev() {
        sum = sum.mul_add(x, T::splat(c[i]));
    }
    sum
}

/// `e^x`, within one unit in the last place (subnormal results included).
///
/// ```text
/// k = round(x / ln 2),  r = x - k ln 2,  e^x = 2^k (1 + r + r^2/2 + r^3 p(r))
/// ```
/// Overflows to infinity above 709.78, underflows to zero below -745.13; NaN
/// stays NaN.
///
/// # Examples
/// ```
/// use mmae::real::exp;
/// assert_eq!(exp(0.0), 1.0);
/// assert!((exp(1.0) - std::f64::consts::E).abs() <= 4.5e-16);
/// assert_eq!(exp(f64::NEG_INFINITY), 0.0);
/// ```
#[inline(always)]
pub fn exp<T: Real>(x: T) -> T {
    let clamped = x.max(T::splat(-746.0)).min(T::splat(710.0));
    let k = (clamped * T::splat(LOG2_E)).round_ties_even();
    let r = k.neg_mul_add(T::splat(LN_2), clamped);
    let r = k.neg_mul_add(T::splat(LN_2_LOW), r);
    let square = r * r;
    // 1 + r is rounded; what it lost joins the small terms.
    let sum = T::one() + r;
    let lost = r - (sum - T::one());
    let near_one = sum + poly(&EXP, r).mul_add(r, T::splat(0.5)).mul_add(square, lost);
    // In two factors, each a normal number: the second product is the only
    // rounding of a subnormal result, and overflows by itself.
    let half = (k * T::splat(0.5)).round_ties_even();
    let result = near_one * T::pow2i(half) * T::pow2i(k - half);
    T::select(x.eq(x), result, x)
}

/// Natural logarithm, within one unit in the last place.
///
/// ```text
/// x = 2^k (1 + f),  sqrt(1/2) <= 1 + f < sqrt(2),  s = f / (2 + f)
/// ln x = k ln 2 + f - (f^2/2 - s (f^2/2 + s^2 p(s^2)))
/// ```
/// (the form of fdlibm's `e_log.c`, one division). `ln 0 = -inf`,
/// `ln inf = inf`, NaN for negative numbers and NaN.
///
/// # Examples
/// ```
/// use mmae::real::{exp, ln};
/// assert_eq!(ln(1.0), 0.0);
/// assert!((ln(exp(3.0_f64)) - 3.0).abs() <= 1e-15);
/// assert!(ln(-1.0).is_nan() && ln(0.0) == f64::NEG_INFINITY);
/// ```
#[inline(always)]
pub fn ln<T: Real>(x: T) -> T {
    let subnormal = x.lt(T::splat(f64::MIN_POSITIVE));
    let two_54 = 18_014_398_509_481_984.0;
    let (m, e) = T::select(subnormal, x * T::splat(two_54), x).split();
    let e = T::select(subnormal, e - T::splat(54.0), e);
    let result = ln_of_parts(m, e);
    // Zero, infinity, NaN and negative numbers.
    let infinite = x.eq(T::splat(f64::INFINITY));
    let result = T::select(infinite, x, result);
    let result = T::select(x.eq(T::zero()), T::splat(f64::NEG_INFINITY), result);
    T::select(x.ge(T::zero()), result, T::splat(f64::NAN))
}

/// `-2 ln u` of a positive normal number, within three units in the last place: without a
/// division, which a square root after it would wait for.
///
/// ```text
/// u = 2^k (1 + f),  sqrt(1/2) <= 1 + f < sqrt(2),   -2 ln u = -2 k ln 2 + f p(f)
/// ```
#[inline(always)]
pub(crate) fn minus_two_ln<T: Real>(u: T) -> T {
    let (m, k) = u.split_near_one();
    let f = m - T::one();
    // by Estrin's rule: a chain of twenty would fill the processor's queue
    let powers = [f, f * f];
    let z2 = powers[1] * powers[1];
    let z4 = z2 * z2;
    let [a, b, c, d, e] = &MINUS_TWO_LN;
    let low = cubic(b, powers).mul_add(z2, cubic(a, powers));
    let high = cubic(d, powers).mul_add(z2, cubic(c, powers));
    let p = cubic(e, powers).mul_add(z4, high).mul_add(z4, low);
    f.mul_add(p, k * T::splat(-2.0 * LN_2))
}

/// `c_0 + c_1 x + c_2 x^2 + c_3 x^3` with `x` and `x^2` given.
#[inline(always)]
fn cubic<T: Real>(c: &[f64; 4], [x, square]: [T; 2]) -> T {
    let low = T::splat(c[1]).mul_add(x, T::splat(c[0]));
    let high = T::splat(c[3]).mul_add(x, T::splat(c[2]));
    high.mul_add(square, low)
}

/// `ln(2^e m)`, `1 <= m < 2`.
#[inline(always)]
fn ln_of_parts<T: Real>(m: T, e: T) -> T {
    // 1 + f in (sqrt(1/2), sqrt(2)].
    let high = m.gt(T::splat(std::f64::consts::SQRT_2));
    let m = T::select(high, m * T::splat(0.5), m);
    let k = T::select(high, e + T::one(), e);
    let f = m - T::one();
    let s = f / (T::splat(2.0) + f);
    let z = s * s;
    let half_square = f * f * T::splat(0.5);
    let correction = s * poly(&ATANH, z).mul_add(z, half_square);
    let correction = k.mul_add(T::splat(LN_2_LOW), correction);
    k.mul_add(T::splat(LN_2), f - (half_square - correction))
}

#[cfg(test)]
mod tests {
    use super::minus_two_ln;

    #[test]
    fn the_logarithm_of_uniform_numbers() {
        let mut most: f64 = 0.0;
        for k in 0..400_000_u64 {
            // all over (0, 1), its ends, and the seams of the reduction
            let word = k.wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let u = match k % 4 {
                0 => ((word >> 12) as f64 + 0.5) * 2f64.powi(-52),
                1 => ((word >> 50) as f64 + 0.5) * 2f64.powi(-52),
                2 => 1.0 - ((word >> 50) as f64 + 0.5) * 2f64.powi(-52),
                _ => 0.5_f64.powi((k % 45) as i32) * (0.5_f64.sqrt() + (k as f64 - 2e5) * 2e-13),
            };
            let (got, want) = (minus_two_ln(u), -2.0 * libm::log(u));
            most = most.max((got - want).abs() / want.abs());
        }
        assert!(most <= 3.0 * f64::EPSILON, "{most:e}");
    }
}
