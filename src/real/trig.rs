//! Sine and cosine on lanes, within one unit in the last place.

use super::math::poly;
use super::{Mask, Real};

/// `pi/2` in three parts. `n` times the first, subtracted with one rounding from
/// a number that close to it, is exact.
const HALF_PI: [f64; 3] =
    [std::f64::consts::FRAC_PI_2, 6.123_233_995_736_766e-17, -1.497_384_904_859_169_8e-33];

/// Largest argument reduced in lanes; beyond it `n HALF_PI[1]` outgrows the
/// parts.
const LIMIT: f64 = 1_048_576.0;

/// `(sin r - r) / r^3` in powers of `r^2`, for `|r| <= pi/4`, near-minimax.
const SIN: [f64; 6] = [
    -0.166_666_666_666_666_66,
    0.008_333_333_333_330_948,
    -0.000_198_412_698_367_585_57,
    2.755_731_610_254_353e-6,
    -2.505_113_184_314_626e-8,
    1.591_812_916_105_078e-10,
];

/// `(cos r - 1 + r^2/2) / r^4` in powers of `r^2`, for `|r| <= pi/4`,
/// near-minimax.
const COS: [f64; 6] = [
    0.041_666_666_666_666_664,
    -0.001_388_888_888_888_739_8,
    2.480_158_729_867_656_7e-5,
    -2.755_731_727_172_422e-7,
    2.087_614_626_724_125_4e-9,
    -1.138_263_234_180_770_6e-11,
];

/// Sine and cosine of `x` in radians, within one unit in the last place.
///
/// ```text
/// n = round(2 x / pi),  r + l = x - n pi/2  (Cody and Waite, fused steps)
/// sin(r + l) = r + r^3 p(r^2) + l (1 - r^2/2),  cos(r + l) = 1 - r^2/2 + r^4 q(r^2) - r l
/// ```
/// then exchanged and signed by `n mod 4`. Beyond 2^20 a lane is computed by
/// itself with `libm`, which reduces any argument; infinities and NaN give NaN.
///
/// # Examples
/// ```
/// use mmae::real::sin_cos;
/// let (s, c) = sin_cos(std::f64::consts::FRAC_PI_6);
/// assert!((s - 0.5).abs() <= 1.2e-16 && (s.mul_add(s, c * c) - 1.0).abs() <= 2.3e-16);
/// ```
#[inline(always)]
pub fn sin_cos<T: Real>(x: T) -> (T, T) {
    let n = (x * T::splat(std::f64::consts::FRAC_2_PI)).round_ties_even();
    // t is exact; r + low holds t minus the other parts to twice the precision.
    let t = n.neg_mul_add(T::splat(HALF_PI[0]), x);
    let p = n * T::splat(HALF_PI[1]);
    let p_low = n.mul_sub(T::splat(HALF_PI[1]), p);
    let high = t - p;
    let back = high - t;
    let rounding = (t - (high - back)) - (p + back);
    let low = n.neg_mul_add(T::splat(HALF_PI[2]), rounding - p_low);
    let r = high + low;
    let low = (high - r) + low;

    let (sine, cosine) = near_zero(r, low);

    // Odd quadrants exchange the two; n mod 4 in {2, 3} negates the sine and in
    // {1, 2} the cosine.
    let odd = is_odd(n);
    let s = T::select(odd, cosine, sine);
    let c = T::select(odd, sine, cosine);
    let floor_half = T::select(odd, n - T::one(), n) * T::splat(0.5);
    let upper = is_odd(floor_half);
    let s = T::select(upper, -s, s);
    let c = T::select((odd & !upper) | (!odd & upper), -c, c);

    // Below 2^-27 the sine is its argument: keeps subnormals and the sign of 0.
    let tiny = x.abs().lt(T::splat(7.450_580_596_923_828e-9));
    let s = T::select(tiny, x, s);

    let near = x.abs().le(T::splat(LIMIT));
    if near.all() {
        return (s, c);
    }
    let invalid = T::splat(f64::NAN);
    let far = x.is_finite() & !near;
    let (s, c) = (T::select(near, s, invalid), T::select(near, c, invalid));
    if far.any() {
        let argument = T::select(far, x, T::zero());
        let (far_s, far_c) = (argument.map_lanes(libm::sin), argument.map_lanes(libm::cos));
        return (T::select(far, far_s, s), T::select(far, far_c, c));
    }
    (s, c)
}

/// True for odd integers, `|n| < 2^51`.
#[inline(always)]
fn is_odd<T: Real>(n: T) -> T::Mask {
    let half = n * T::splat(0.5);
    !half.eq(half.round_ties_even())
}

/// Sine and cosine of `r`, `0 <= r <= pi/4`, within one unit in the last place.
#[inline(always)]
pub(crate) fn sin_cos_octant<T: Real>(r: T) -> (T, T) {
    let z = r * r;
    let sine = poly(&SIN, z).mul_add(z * r, r);
    let cosine = poly(&COS, z).mul_add(z, T::splat(-0.5)).mul_add(z, T::one());
    (sine, cosine)
}

/// Sine and cosine of `r + low`, `|r| <= pi/4`.
///
/// ```text
/// sin: r + (r^3 p + l (1 - z/2)),   cos: 1 - z/2, its rounding put back, + z^2 q - r l,   z = r^2
/// ```
#[inline(always)]
fn near_zero<T: Real>(r: T, low: T) -> (T, T) {
    let z = r * r;
    let half = z * T::splat(0.5);
    let cube = poly(&SIN, z) * z * r;
    let top = T::one() - half;
    let lost = (T::one() - top) - half;
    let fourth = poly(&COS, z) * z * z;
    let rest = lost + r.neg_mul_add(low, fourth);
    (r + (low - half * low + cube), top + rest)
}

#[cfg(test)]
mod tests {
    use super::sin_cos_octant;

    #[test]
    fn the_octant_is_good_to_one_unit() {
        let last = 100_000;
        for k in 0..=last {
            let r = f64::from(k) / f64::from(last) * std::f64::consts::FRAC_PI_4;
            let (s, c) = sin_cos_octant::<f64>(r);
            // half a unit of rounding in either
            assert!((s - libm::sin(r)).abs() <= 1.5 * f64::EPSILON * s, "sin {r}: {s}");
            assert!((c - libm::cos(r)).abs() <= f64::EPSILON, "cos {r}: {c}");
        }
    }
}
