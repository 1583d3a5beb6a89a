//! Powers by squaring: what Smith sums are made of, and a proof of stability.

use super::ops::{norm, outlined, transpose};
use super::smith::{lyapunov_dual, stein_dual};
use crate::real::{Mask, Real, exp, ln};
use crate::small::{
    Dyn, add_assign, cholesky, identity, inverse, lu_factor, mul, scale, sub_assign, sym_mul_add_tn,
};

/// Squarings after which a lane is given up: a radius of `1 - 1e-15` would need
/// 56.
pub(crate) const MAX_SQUARINGS: usize = 60;
/// A power of this norm or less (`2^-54`) is zero to the sums that use it, even
/// when the other factor of the term is of order one.
#[inline(always)]
fn floor<T: Real>() -> f64 {
    0.25 * T::EPSILON
}
/// The same when the power appears on both sides.
#[inline(always)]
fn floor_root<T: Real>() -> f64 {
    floor::<T>().sqrt()
}
/// The same for a sum of which the size is wanted.
const FEW: f64 = 1.0 / 64.0;

/// To how many digits a sum is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Digits {
    /// All that the numbers have.
    All,
    /// Half of them: a correction.
    Half,
    /// Three: a size.
    Few,
}

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
    /// Lanes whose computed powers became small, which proves nothing where they
    /// grew a lot before.
    decayed: T::Mask,
    /// Margin that a Lyapunov function proved, where one was needed.
    certified: T,
    /// Norm of the last power looked at in each lane, with its rounding errors.
    bound: T,
    /// The exponent of that power.
    exponent: T,
    /// Squarings that each lane made.
    squarings: T,
    /// Powers are only ever used on both sides at once.
    both_sides: bool,
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
            decayed: T::Mask::splat(false),
            certified: T::zero(),
            bound: T::zero(),
            exponent: T::one(),
            squarings: T::zero(),
            both_sides: false,
        }
    }

    /// As [`Powers::new`] for sums that have every power on both sides: they end
    /// one squaring sooner.
    #[inline(always)]
    pub(crate) fn for_both_sides(n: usize) -> Self {
        Powers { both_sides: true, ..Powers::new(n) }
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

    /// Lanes in which `F^(2^k) X F^(2^k)'` can still be seen beside `X`, where
    /// that is wanted to `digits`.
    #[inline(always)]
    pub(crate) fn seen_twice(&self, k: usize, digits: Digits) -> T::Mask {
        self.norms[k].gt(T::splat(match digits {
            Digits::All => floor_root::<T>(),
            Digits::Half => floor_root::<T>().sqrt(),
            Digits::Few => FEW,
        }))
    }

    /// What the Smith sum of a matrix can be at most, over the norm of that matrix.
    ///
    /// ```text
    /// |sum_j F^j Q F^j'| <= |Q| prod_k (1 + |F^(2^k)|^2)
    /// ```
    #[inline(always)]
    pub(super) fn sum_at_most(&self) -> T {
        let mut most = T::one();
        for &norm in &self.norms {
            most = (norm * norm).mul_add(most, most);
        }
        most
    }

    /// Squarings made.
    #[inline(always)]
    pub(crate) fn squarings(&self) -> T {
        self.squarings
    }

    /// Squares `f` (n by n) until it is small in every lane, and shows it stable
    /// where it is.
    #[inline(always)]
    pub(crate) fn set(&mut self, f: &[T]) {
        square(self, f);
        if self.needs_certificate() {
            let (proved, margin) = certify_discrete(self, f);
            self.accept(proved, margin);
        }
    }

    /// True if the powers decayed in a lane where that alone proves nothing.
    #[inline(always)]
    fn needs_certificate(&self) -> bool {
        (self.decayed & !self.stable).any()
    }

    /// Takes over what a Lyapunov function proved.
    #[inline(always)]
    fn accept(&mut self, proved: T::Mask, margin: T) {
        let new = self.decayed & !self.stable & proved;
        self.certified = T::select(new, margin, self.certified);
        self.stable = self.stable | new;
    }

    /// `rho - 1` for the proved bound `rho` on the spectral radius of `F`:
    /// negative where stable.
    ///
    /// ```text
    /// rho = |F^N|^(1/N) = e^l,   e^l - 1 = l + l^2/2 + l^3/6 + ...  for small l
    /// ```
    #[inline(always)]
    fn radius_less_one(&self) -> T {
        // A power that is exactly zero has no logarithm.
        let tiny = T::splat(f64::MIN_POSITIVE);
        let bound = T::select(self.bound.lt(tiny), tiny, self.bound);
        let l = ln(bound) / self.exponent;
        let mut series = T::one();
        for k in (2..=8).rev() {
            series = (l * series).mul_add(T::splat(1.0 / f64::from(k)), T::one());
        }
        let near = l.abs().lt(T::splat(0.05));
        T::select(near, l * series, exp(l) - T::one())
    }

    /// Verified margin in discrete time: every eigenvalue has modulus at most
    /// `1 - margin`. Not positive, or NaN, where stability was not shown.
    #[inline(always)]
    pub(crate) fn margin(&self) -> T {
        self.or_certified(-self.radius_less_one())
    }

    /// The margin of a Lyapunov function where one was needed, `margin` elsewhere.
    #[inline(always)]
    fn or_certified(&self, margin: T) -> T {
        T::select(self.certified.gt(T::zero()), self.certified, margin)
    }
}

outlined! {
    /// Squares `f` (n by n) until it is small in every lane.
    ///
    /// ```text
    /// rho(F) <= |F^N|^(1/N),    |fl(P P) - P P| <= n u |P|^2
    /// ```
    /// The bound of a power carries the rounding errors of all squarings before
    /// it, so that `stable` is a proof (for the `f` given). Where `f` is far from
    /// normal the errors can swamp the bound though the powers decay.
    fn square(p: &'a mut Powers<T>, f: &'a [T]) {
        let n = p.n;
        let (zero, one) = (T::zero(), T::one());
        let rounding = T::splat((n + 2) as f64 * T::EPSILON);
        let least = T::splat(if p.both_sides { floor_root::<T>() } else { floor::<T>() });
        let none = T::Mask::splat(false);
        p.norms.clear();
        if p.f.len() < n * n {
            p.f.resize(n * n, zero);
        }
        p.f[..n * n].copy_from_slice(f);
        (p.exponent, p.squarings, p.certified) = (one, zero, zero);
        (p.stable, p.decayed) = (none, none);
        let mut active = T::Mask::splat(true);
        let mut error = zero;
        for k in 0..=MAX_SQUARINGS {
            let at = k * n * n;
            let norm = norm(&p.f[at..][..n * n]);
            let small = active & norm.le(least);
            p.bound = T::select(active, norm + error, p.bound);
            p.decayed = p.decayed | small;
            // A bound far above the power itself is no proof of its size.
            p.stable = p.stable | (small & error.le(T::splat(floor_root::<T>())));
            active = active & !small & norm.le(T::splat(CEILING));
            if !active.any() {
                return;
            }
            if !active.all() {
                for x in &mut p.f[at..][..n * n] {
                    *x = T::select(active, *x, zero);
                }
            }
            p.norms.push(T::select(active, norm, zero));
            if p.norms.len() > MAX_SQUARINGS {
                return;
            }
            // (P + D)^2 = fl(P P) + P D + D P + D D + rounding
            error = (norm + norm + error).mul_add(error, rounding * norm * norm);
            if p.f.len() < at + 2 * n * n {
                p.f.resize(at + 2 * n * n, zero);
            }
            let (head, next) = p.f[..at + 2 * n * n].split_at_mut(at + n * n);
            let last = &head[at..];
            mul(Dyn(n), Dyn(n), Dyn(n), last, last, next);
            p.exponent = T::select(active, p.exponent + p.exponent, p.exponent);
            p.squarings = T::select(active, p.squarings + one, p.squarings);
        }
    }
}

outlined! {
    /// Shows `f` stable by a Lyapunov function, and a margin.
    ///
    /// ```text
    /// Y - F'YF = M,  Y > 0,  M > 0   =>   rho(F)^2 <= 1 - lambda_min(M) / lambda_max(Y)
    /// ```
    /// `Y` is made for `M = I`; what counts is the `M` it really has.
    fn certify_discrete(p: &'a Powers<T>, f: &'a [T]) -> (T::Mask, T) {
        let n = Dyn(p.n);
        let mut y = vec![T::zero(); p.n * p.n];
        identity(n, &mut y);
        let mut work = vec![T::zero(); 2 * p.n * p.n];
        stein_dual(p, &mut y, &mut work);
        let (product, defect) = work.split_at_mut(p.n * p.n);
        // F'YF - Y + I
        identity(n, defect);
        sub_assign(defect, &y);
        mul(n, n, n, &y, f, product);
        sym_mul_add_tn(n, n, f, product, defect);
        let left = T::one() - norm(defect);
        let share = left / norm(&y);
        // 1 - sqrt(1 - s) = s / (1 + sqrt(1 - s))
        let margin = share / (T::one() + (T::one() - share).max(T::zero()).sqrt());
        let positive = cholesky(n, &mut y);
        (positive & left.gt(T::splat(0.5)), margin)
    }
}

impl<T: Real> Powers<T> {
    /// The powers of `one` in every lane: the scalar has the bits of the lanes.
    #[inline(always)]
    pub(crate) fn splat_from(&mut self, one: &Powers<f64>) {
        self.n = one.n;
        splat(&one.f[..one.count() * one.n * one.n], &mut self.f);
        splat(&one.norms, &mut self.norms);
        self.stable = T::Mask::splat(one.stable);
        self.decayed = T::Mask::splat(one.decayed);
        self.certified = T::splat(one.certified);
        self.bound = T::splat(one.bound);
        self.exponent = T::splat(one.exponent);
        self.squarings = T::splat(one.squarings);
        self.both_sides = one.both_sides;
    }
}

impl<T: Real> Cayley<T> {
    /// The transform `one` in every lane.
    #[inline(always)]
    pub(crate) fn splat_from(&mut self, one: &Cayley<f64>) {
        self.gamma = T::splat(one.gamma);
        splat(&one.inverse, &mut self.inverse);
        self.powers.splat_from(&one.powers);
    }
}

/// Numbers in every lane, in the place of what was there.
#[inline(always)]
pub(crate) fn splat<T: Real>(x: &[f64], lanes: &mut Vec<T>) {
    lanes.resize(x.len(), T::zero());
    for (lane, &v) in lanes.iter_mut().zip(x) {
        *lane = T::splat(v);
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

    /// As [`Cayley::new`] for equations that have the powers on both sides.
    #[inline(always)]
    pub(crate) fn for_both_sides(n: usize) -> Self {
        Cayley { powers: Powers::for_both_sides(n), ..Cayley::new(n) }
    }

    /// Transforms `a` (n by n) with `gamma` and squares; see
    /// [`gamma_of`] for a choice.
    #[inline(always)]
    pub(crate) fn set(&mut self, a: &[T], gamma: T) {
        self.gamma = gamma;
        transform(self, a);
        square(&mut self.powers, &self.work);
        // A singular lane has F = -I: not small, so not stable.
        if self.powers.needs_certificate() {
            let (proved, margin) = certify_continuous(self, a);
            self.powers.accept(proved, margin);
        }
    }

    /// Verified margin in continuous time: every eigenvalue of `A` has real part
    /// at most `-margin`.
    ///
    /// ```text
    /// |f| <= rho   =>   Re(gamma (f - 1)/(f + 1)) <= -gamma (1 - rho)/(1 + rho)
    /// ```
    #[inline(always)]
    pub(crate) fn margin(&self) -> T {
        let less = self.powers.radius_less_one();
        let margin = -self.gamma * less / (less + T::splat(2.0));
        self.powers.or_certified(margin)
    }
}

outlined! {
    /// `inverse` and `F` (in `work`) of `a`.
    fn transform(c: &'a mut Cayley<T>, a: &'a [T]) {
        let n = c.powers.n;
        for (w, &x) in c.work.iter_mut().zip(a) {
            *w = -x;
        }
        for i in 0..n {
            c.work[i * n + i] = c.gamma - a[i * n + i];
        }
        let regular = inverse(Dyn(n), &mut c.work, &mut c.inverse, &mut c.perm).ok;
        for x in &mut c.inverse {
            *x = T::select(regular, *x, T::zero());
        }
        c.work.copy_from_slice(&c.inverse);
        scale(&mut c.work, c.gamma + c.gamma);
        for i in 0..n {
            c.work[i * n + i] = c.work[i * n + i] - T::one();
        }
    }
}

outlined! {
    /// Shows `a` stable by a Lyapunov function, and a margin.
    ///
    /// ```text
    /// A'Y + YA = -M,  Y > 0,  M > 0   =>   Re(lambda) <= -lambda_min(M) / (2 lambda_max(Y))
    /// ```
    /// `Y` is made for `M = I`; what counts is the `M` it really has.
    fn certify_continuous(c: &'a Cayley<T>, a: &'a [T]) -> (T::Mask, T) {
        let size = c.powers.n;
        let n = Dyn(size);
        let mut y = vec![T::zero(); size * size];
        identity(n, &mut y);
        let mut work = vec![T::zero(); 2 * size * size];
        lyapunov_dual(c, &mut y, &mut work);
        let (product, defect) = work.split_at_mut(size * size);
        // A'Y + YA + I
        mul(n, n, n, &y, a, product);
        transpose(size, size, product, defect);
        add_assign(defect, product);
        for i in 0..size {
            defect[i * size + i] = defect[i * size + i] + T::one();
        }
        let left = T::one() - norm(defect);
        let margin = left / (T::splat(2.0) * norm(&y));
        let positive = cholesky(n, &mut y);
        (positive & left.gt(T::splat(0.5)), margin)
    }
}

outlined! {
    /// A Cayley parameter for `a` (n by n): about the geometric mean of the moduli
    /// of its eigenvalues, which balances the slowest against the fastest.
    ///
    /// ```text
    /// gamma = 1.17 * 2^round(log2|det A| / n),  kept within [2^-16, 1] of |A|
    /// ```
    /// `work` holds `n * n` numbers, `perm` `n`. The factor keeps `gamma` off the
    /// round numbers that eigenvalues of made-up problems like to be.
    pub(crate) fn gamma_of(n: usize, a: &'a [T], work: &'a mut [T], perm: &'a mut [T]) -> T {
        let (_, size) = (norm(a) / T::splat((n as f64).sqrt())).split();
        work.copy_from_slice(a);
        let regular = lu_factor(Dyn(n), work, perm).ok;
        let mean = mean_log2_of_pivots(n, work);
        gamma_near(T::select(regular, mean, size), size)
    }
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
