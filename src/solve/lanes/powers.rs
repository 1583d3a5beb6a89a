//! Powers by squaring: what Smith sums are made of, and a proof of stability.

use crate::real::{Mask, Real};
use crate::small::{Dyn, inverse, lu_factor, mul, norm_frobenius, scale};

/// Squarings after which a lane is given up: a radius of `1 - 1e-15` would need
/// 56.
pub(crate) const MAX_SQUARINGS: usize = 60;
/// A power of this norm or less is zero to the sums that use it, even when the
/// other factor of the term is of order one.
const FLOOR: f64 = 1.0 / (1_u64 << 54) as f64;
/// The same when the power appears on both sides.
const FLOOR_ROOT: f64 = 1.0 / (1_u64 << 27) as f64;
/// A stable matrix that transiently grows to this is not worked with.
const CEILING: f64 = 1e100;

/// `F, F^2, F^4, ...` of one lane block, n by n, until every lane is small.
///
/// A lane whose power has become small (or has failed) continues with zeros, so
/// that it adds exactly nothing while its neighbours go on: its results have the
/// same bits in any company.
#[derive(Debug, Clone)]
pub(crate) struct Powers<T: Real> {
    /// Order.
    pub(crate) n: usize,
    /// The powers, one after the other.
    f: Vec<T>,
    /// Their Frobenius norms.
    norms: Vec<T>,
    /// Lanes in which `F` was shown to be stable.
    pub(crate) stable: T::Mask,
    /// Norm of the last power looked at in each lane, with its rounding errors.
    bound: T,
    /// The exponent of that power.
    exponent: T,
    /// Squarings that each lane made.
    squarings: T,
}

impl<T: Real> Powers<T> {
    /// Room for powers of order `n`; call [`Powers::set`] before use.
    #[inline(always)]
    pub(crate) fn new(n: usize) -> Self {
        Powers {
            n,
            f: Vec::new(),
            norms: Vec::new(),
            stable: T::Mask::splat(false),
            bound: T::zero(),
            exponent: T::one(),
            squarings: T::zero(),
        }
    }

    /// Number of powers kept.
    #[inline(always)]
    pub(crate) fn count(&self) -> usize {
        self.norms.len()
    }

    /// `F^(2^k)`; `k < count`.
    #[inline(always)]
    pub(crate) fn power(&self, k: usize) -> &[T] {
        let size = self.n * self.n;
        &self.f[k * size..][..size]
    }

    /// Lanes in which `F^(2^k) X F^(2^k)'` can still be seen beside `X`.
    #[inline(always)]
    pub(crate) fn seen_twice(&self, k: usize) -> T::Mask {
        self.norms[k].gt(T::splat(FLOOR_ROOT))
    }

    /// Squarings made in lane `lane`.
    pub(crate) fn squarings(&self, lane: usize) -> u32 {
        self.squarings.lane(lane) as u32
    }

    /// Squares `f` (n by n) until it is small in every lane.
    ///
    /// ```text
    /// rho(F) <= |F^N|^(1/N),    |fl(P P) - P P| <= n u |P|^2
    /// ```
    /// The bound of a power carries the rounding errors of all squarings before
    /// it, so that `stable` is a proof (for the `f` given).
    #[inline(always)]
    pub(crate) fn set(&mut self, f: &[T]) {
        let n = self.n;
        let (zero, one) = (T::zero(), T::one());
        let rounding = T::splat((n + 2) as f64 * f64::EPSILON);
        self.f.clear();
        self.norms.clear();
        self.f.extend_from_slice(f);
        self.exponent = one;
        self.squarings = zero;
        self.stable = T::Mask::splat(false);
        let mut active = T::Mask::splat(true);
        let mut error = zero;
        for _ in 0..=MAX_SQUARINGS {
            let at = self.f.len() - n * n;
            let norm = norm_frobenius(&self.f[at..]);
            self.bound = T::select(active, norm + error, self.bound);
            let small = active & self.bound.le(T::splat(FLOOR));
            self.stable = self.stable | small;
            active = active & !small & norm.le(T::splat(CEILING));
            for x in &mut self.f[at..] {
                *x = T::select(active, *x, zero);
            }
            if !active.any() {
                self.f.truncate(at);
                return;
            }
            self.norms.push(T::select(active, norm, zero));
            if self.norms.len() > MAX_SQUARINGS {
                return;
            }
            // (P + D)^2 = fl(P P) + P D + D P + D D + rounding
            error = (norm + norm + error).mul_add(error, rounding * norm * norm);
            self.f.resize(at + 2 * n * n, zero);
            let (head, next) = self.f.split_at_mut(at + n * n);
            let last = &head[at..];
            mul(Dyn(n), Dyn(n), Dyn(n), last, last, next);
            self.exponent = T::select(active, self.exponent + self.exponent, self.exponent);
            self.squarings = T::select(active, self.squarings + one, self.squarings);
        }
    }

    /// Bound on the spectral radius of `F` in lane `lane`, as its logarithm
    /// (negative where stable, NaN or positive otherwise).
    pub(crate) fn log_radius(&self, lane: usize) -> f64 {
        let bound = self.bound.lane(lane);
        // Not `max`, which would drop a NaN.
        let bound = if bound < f64::MIN_POSITIVE { f64::MIN_POSITIVE } else { bound };
        libm::log(bound) / self.exponent.lane(lane)
    }

    /// Verified margin in discrete time: every eigenvalue has modulus at most
    /// `1 - margin`.
    pub(crate) fn margin(&self, lane: usize) -> f64 {
        -libm::expm1(self.log_radius(lane))
    }
}

/// The Cayley transform of a stable matrix and its powers.
///
/// ```text
/// F = (gamma I + A)(gamma I - A)^-1 = 2 gamma (gamma I - A)^-1 - I
/// ```
/// `F` has its eigenvalues in the unit disc exactly when those of `A` are in the
/// left half-plane, and the continuous equations in `A` become discrete ones in
/// `F` (Smith 1968).
#[derive(Debug, Clone)]
pub(crate) struct Cayley<T: Real> {
    /// The parameter, positive; two matrices of one Sylvester equation must
    /// share it.
    pub(crate) gamma: T,
    /// `(gamma I - A)^-1`.
    pub(crate) inverse: Vec<T>,
    /// Powers of `F`; `stable` speaks of `A`.
    pub(crate) powers: Powers<T>,
    work: Vec<T>,
    perm: Vec<T>,
}

impl<T: Real> Cayley<T> {
    /// Room for order `n`; call [`Cayley::set`] before use.
    #[inline(always)]
    pub(crate) fn new(n: usize) -> Self {
        Cayley {
            gamma: T::one(),
            inverse: vec![T::zero(); n * n],
            powers: Powers::new(n),
            work: vec![T::zero(); n * n],
            perm: vec![T::zero(); n],
        }
    }

    /// Transforms `a` (n by n) with `gamma` and squares; see
    /// [`gamma_of`] for a choice.
    #[inline(always)]
    pub(crate) fn set(&mut self, a: &[T], gamma: T) {
        let n = self.powers.n;
        let zero = T::zero();
        for (w, &x) in self.work.iter_mut().zip(a) {
            *w = -x;
        }
        for i in 0..n {
            self.work[i * n + i] = gamma - a[i * n + i];
        }
        self.gamma = gamma;
        let regular = inverse(Dyn(n), &mut self.work, &mut self.inverse, &mut self.perm).ok;
        for x in &mut self.inverse {
            *x = T::select(regular, *x, zero);
        }
        let f = &mut self.work;
        f.copy_from_slice(&self.inverse);
        scale(f, gamma + gamma);
        for i in 0..n {
            f[i * n + i] = f[i * n + i] - T::one();
        }
        self.powers.set(f);
        // A singular lane has F = -I: not small, so already not stable.
    }

    /// Verified margin in continuous time: every eigenvalue of `A` has real part
    /// at most `-margin`.
    ///
    /// ```text
    /// |f| <= rho   =>   Re(gamma (f - 1)/(f + 1)) <= -gamma (1 - rho)/(1 + rho)
    /// ```
    pub(crate) fn margin(&self, lane: usize) -> f64 {
        let half = -0.5 * self.powers.log_radius(lane);
        self.gamma.lane(lane) * libm::tanh(half)
    }
}

/// A Cayley parameter for `a` (n by n): about the geometric mean of the moduli
/// of its eigenvalues, which balances the slowest against the fastest.
///
/// ```text
/// gamma = 1.17 * 2^round(log2|det A| / n),  kept within [2^-16, 1] of |A|
/// ```
/// `work` holds `n * n` numbers, `perm` `n`. The factor keeps `gamma` off the round numbers
/// that eigenvalues of made-up problems like to be.
#[inline(always)]
pub(crate) fn gamma_of<T: Real>(n: usize, a: &[T], work: &mut [T], perm: &mut [T]) -> T {
    let (_, size) = (norm_frobenius(a) / T::splat((n as f64).sqrt())).split();
    work.copy_from_slice(a);
    let regular = lu_factor(Dyn(n), work, perm).ok;
    let mean = mean_log2_of_pivots(n, work);
    gamma_near(T::select(regular, mean, size), size)
}

/// `1.17 * 2^round(mean)`, the exponent kept within `[size - 16, size]`.
#[inline(always)]
pub(crate) fn gamma_near<T: Real>(mean: T, size: T) -> T {
    let mean = mean.round_ties_even();
    let exponent = mean.min(size).max(size - T::splat(16.0));
    let exponent = exponent.min(T::splat(1000.0)).max(T::splat(-1000.0));
    T::splat(1.17) * T::pow2i(exponent)
}

/// `log2|det| / n` of an LU factor of order `n`, to a tenth.
#[inline(always)]
pub(crate) fn mean_log2_of_pivots<T: Real>(n: usize, lu: &[T]) -> T {
    let (mut significand, mut exponent) = (T::one(), T::zero());
    for i in 0..n {
        let (s, e) = lu[i * n + i].split();
        let (s, carry) = (significand * s).split();
        significand = s;
        exponent = exponent + e + carry;
    }
    // log2(s) ~ s - 1 on [1, 2)
    (exponent + (significand - T::one())) / T::splat(n as f64)
}
