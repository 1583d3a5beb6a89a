//! Matrix exponential by scaling and squaring, one matrix a lane.

use super::basic::{identity, norm_1, scale, select_assign};
use super::dim::{Dim, Dyn};
use super::lu::solve;
use super::product::mul;
use crate::real::{LaneKernel, Mask, Real};

/// Coefficients of the [13/13] Pade approximant (Higham 2005), times `PADE[0]`.
const PADE: [f64; 14] = [
    64_764_752_532_480_000.0,
    32_382_376_266_240_000.0,
    7_771_770_303_897_600.0,
    1_187_353_796_428_800.0,
    129_060_195_264_000.0,
    10_559_470_521_600.0,
    670_442_572_800.0,
    33_522_128_640.0,
    1_323_241_920.0,
    40_840_800.0,
    960_960.0,
    16_380.0,
    182.0,
    1.0,
];
/// Largest norm at which the approximant is accurate to the last bit.
const THETA: f64 = 5.371_920_351_148_152;
/// Coefficient of `A^27`, the first term in which the approximant's backward
/// error differs from zero.
const FIRST_ERROR: f64 = 1.0 / 113_250_775_606_021_113_483_283_660_800_000_000.0;
/// Degree of that term.
const FIRST_DEGREE: usize = 27;

/// Numbers of scratch that [`expm`] needs for order `n`.
#[must_use]
pub const fn expm_work(n: usize) -> usize {
    6 * n * n + 2 * n
}

/// `E = exp(A)` in every lane; both n x n, row-major.
///
/// Scaling and squaring with the [13/13] Pade approximant (Al-Mohy and Higham
/// 2009): the scaling follows the norms of powers, so a matrix with one large
/// nilpotent part, as in van Loan's integrals, is not scaled to death. Each lane
/// takes its own scaling.
///
/// Returns the lanes whose result is finite; a lane whose input is not holds the
/// identity. `work` holds [`expm_work`]`(n)` numbers of any value. Panics unless
/// the slices have these sizes.
///
/// # Examples
/// ```
/// use mmae::small::{Const, expm, expm_work};
/// let mut e = [0.0; 4];
/// let ok = expm(Const::<2>, &[0.0, 1.0, -1.0, 0.0], &mut e, &mut [0.0; expm_work(2)]);
/// assert!(ok && (e[0] - 1_f64.cos()).abs() < 1e-15 && (e[1] - 1_f64.sin()).abs() < 1e-15);
/// ```
#[inline(always)]
#[track_caller]
#[must_use = "lanes that are false hold no exponential"]
pub fn expm<T: Real, N: Dim>(n: N, a: &[T], e: &mut [T], work: &mut [T]) -> T::Mask {
    let n = n.get();
    assert!(
        a.len() == n * n && e.len() == n * n && work.len() == expm_work(n),
        "expm: slices do not fit {n}x{n}"
    );
    T::outline(Exponential { n, a, e, work })
}

struct Exponential<'a, T> {
    n: usize,
    a: &'a [T],
    e: &'a mut [T],
    work: &'a mut [T],
}

/// The number of halvings that bring a norm of `power`-th powers under
/// `THETA^power`: `ceil(log2(norm / THETA^power) / power)`.
#[inline(always)]
fn halvings<T: Real>(norm: T, power: i32) -> T {
    let (_, exponent) = (norm * T::splat(THETA.powi(-power))).split();
    // Ceiling of a multiple of 1/power.
    let up = T::splat(0.5 - 0.5 / f64::from(power));
    ((exponent + T::one()) * T::splat(1.0 / f64::from(power)) + up).round_ties_even()
}

/// `v_j <- sum_i |a_ij| v_i`, repeated: the norm of a power of `|A|`.
#[inline(always)]
fn power_norm<T: Real>(n: usize, power: usize, a: &[T], v: &mut [T], next: &mut [T]) -> T {
    v.fill(T::one());
    for _ in 0..power {
        next.fill(T::zero());
        for (row, &x) in a.chunks_exact(n).zip(&*v) {
            for (sum, entry) in next.iter_mut().zip(row) {
                *sum = entry.abs().mul_add(x, *sum);
            }
        }
        v.copy_from_slice(next);
    }
    v.iter().fold(T::zero(), |m, &x| x.max(m))
}

/// `W = c6 A6 + c4 A4 + c2 A2 + c0 I + W0`, `W0` what `W` held if `keep`.
#[inline(always)]
fn combine<T: Real>(n: usize, keep: bool, c: [f64; 4], powers: [&[T]; 3], w: &mut [T]) {
    let [c6, c4, c2, c0] = c.map(T::splat);
    let [a6, a4, a2] = powers;
    for e in 0..n * n {
        let start = if keep { w[e] } else { T::zero() };
        w[e] = c6.mul_add(a6[e], c4.mul_add(a4[e], c2.mul_add(a2[e], start)));
    }
    for i in 0..n {
        w[i * n + i] = w[i * n + i] + c0;
    }
}

impl<T: Real> LaneKernel<T> for Exponential<'_, T> {
    type Out = T::Mask;
    #[inline(always)]
    fn run(self) -> T::Mask {
        let Exponential { n, a, e, work } = self;
        let dim = Dyn(n);
        // So that exp(0) is exactly the identity: b0 = 1.
        let b = PADE.map(|b| b / PADE[0]);
        if n == 0 {
            return T::Mask::splat(true);
        }
        let (a1, rest) = work.split_at_mut(n * n);
        let (a2, rest) = rest.split_at_mut(n * n);
        let (a4, rest) = rest.split_at_mut(n * n);
        let (a6, rest) = rest.split_at_mut(n * n);
        let (w, rest) = rest.split_at_mut(n * n);
        let (u, rest) = rest.split_at_mut(n * n);
        let (perm, other) = rest.split_at_mut(n);

        // X = A / 2^t of norm near one, so that no power overflows.
        let norm = norm_1(dim, dim, a);
        let finite = norm.is_finite();
        let limit = T::splat(1000.0);
        let t = T::select(finite, norm.split().1.max(-limit).min(limit), T::zero());
        let down = T::pow2i(-t);
        for (x, &y) in a1.iter_mut().zip(a) {
            *x = T::select(finite, y * down, T::zero());
        }
        mul(dim, dim, dim, a1, a1, a2);
        mul(dim, dim, dim, a2, a2, a4);
        mul(dim, dim, dim, a4, a2, a6);

        // Halvings s of A: by its norm at most, by its powers if they are
        // smaller, plus what the rounding of the approximant asks for.
        let by_norm = (t + halvings(norm_1(dim, dim, a1), 1)).max(T::zero());
        let by_powers =
            halvings(norm_1(dim, dim, a4), 4).max(halvings(norm_1(dim, dim, a6), 6)) + t;
        let s = by_powers.max(T::zero()).min(by_norm);
        let f = T::pow2i(t - s);
        let f2 = f * f;
        let f4 = f2 * f2;
        scale(a1, f);
        scale(a2, f2);
        scale(a4, f4);
        scale(a6, f4 * f2);
        let norm = norm_1(dim, dim, a1);
        let error = power_norm(n, FIRST_DEGREE, a1, perm, other) * T::splat(FIRST_ERROR) / norm;
        let degree = FIRST_DEGREE as f64 - 1.0;
        let (_, exponent) = (error * T::splat(2.0_f64.powi(53))).split();
        let extra = (exponent + T::one()) * T::splat(1.0 / degree);
        let extra = (extra + T::splat(0.5 - 0.5 / degree)).round_ties_even().max(T::zero());
        let extra = T::select(error.is_finite() & norm.gt(T::zero()), s + extra, by_norm);
        let total = T::select(error.eq(T::zero()), s, extra).min(by_norm);
        let f = T::pow2i(s - total);
        let f2 = f * f;
        let f4 = f2 * f2;
        scale(a1, f);
        scale(a2, f2);
        scale(a4, f4);
        scale(a6, f4 * f2);
        let s = total;

        // U = A (A6 (b13 A6 + b11 A4 + b9 A2) + b7 A6 + b5 A4 + b3 A2 + b1 I)
        let powers = [&*a6, &*a4, &*a2];
        combine(n, false, [b[13], b[11], b[9], 0.0], powers, e);
        mul(dim, dim, dim, a6, e, w);
        combine(n, true, [b[7], b[5], b[3], b[1]], powers, w);
        mul(dim, dim, dim, a1, w, u);
        // V = A6 (b12 A6 + b10 A4 + b8 A2) + b6 A6 + b4 A4 + b2 A2 + b0 I
        combine(n, false, [b[12], b[10], b[8], 0.0], powers, e);
        mul(dim, dim, dim, a6, e, w);
        combine(n, true, [b[6], b[4], b[2], b[0]], powers, w);
        // E = (V - U)^-1 (V + U)
        for ((e, w), &u) in e.iter_mut().zip(&mut *w).zip(&*u) {
            *e = *w + u;
            *w = *w - u;
        }
        let info = solve(dim, dim, w, e, perm);

        // exp(A) = (exp(A / 2^s))^(2^s), each lane with its own s.
        let mut done = T::zero();
        while done.lt(s).any() {
            mul(dim, dim, dim, e, e, w);
            select_assign(done.lt(s), e, w);
            done = done + T::one();
        }
        identity(dim, w);
        select_assign(!finite, e, w);
        finite & info.ok & norm_1(dim, dim, e).is_finite()
    }
}
