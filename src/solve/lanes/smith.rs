//! Lyapunov and Sylvester equations as squared Smith sums over given powers.

use super::ops::outlined;
use super::powers::{Cayley, Digits, Powers};
use crate::real::{Mask, Real};
use crate::small::{
    Dyn, mul, mul_add, mul_add_nt, mul_nt, scale, sym_mul_add_nt, sym_mul_add_tn, sym_mul_nt,
    sym_mul_tn,
};

/// `F X F' - X + Q = 0`, in place: `x` holds `Q` (symmetric), then `X`.
///
/// ```text
/// X <- X + F_k X F_k',   F_k = F^(2^k)      (Smith 1968, squared)
/// ```
/// Of use in lanes where `p.stable`; `work` holds at least `2 n^2` numbers, the
/// sum is made to `digits`.
#[inline(always)]
pub(crate) fn stein_to<T: Real>(p: &Powers<T>, x: &mut [T], work: &mut [T], digits: Digits) {
    stein_from(p, 0, x, work, digits);
}

outlined! {
    /// [`stein_to`] from the term `first` on.
    fn stein_from(p: &'a Powers<T>, first: usize, x: &'a mut [T], work: &'a mut [T], digits: Digits) {
        let n = Dyn(p.n);
        let (product, next) = work[..2 * p.n * p.n].split_at_mut(p.n * p.n);
        for k in first..p.count() {
            let seen = p.seen_twice(k, digits);
            if !seen.any() {
                break;
            }
            let f = p.power(k);
            mul(n, n, n, f, x, product);
            if seen.all() {
                sym_mul_add_nt(n, n, product, f, x);
                continue;
            }
            next.copy_from_slice(x);
            sym_mul_add_nt(n, n, product, f, next);
            keep(seen, next, x);
        }
    }
}

outlined! {
    /// [`stein_to`] for `Q = s I`, whose first term takes one product less.
    pub(crate) fn stein_of_identity(p: &'a Powers<T>, s: T, x: &'a mut [T], work: &'a mut [T], digits: Digits) {
        let n = Dyn(p.n);
        x.fill(T::zero());
        for i in 0..p.n {
            x[i * p.n + i] = s;
        }
        if p.count() == 0 {
            return;
        }
        // s (I + F F')
        let (seen, f) = (p.seen_twice(0, digits), p.power(0));
        let square = &mut work[..p.n * p.n];
        sym_mul_nt(n, n, f, f, square);
        for (x, &y) in x.iter_mut().zip(square.iter()) {
            *x = T::select(seen, s.mul_add(y, *x), *x);
        }
        stein_from(p, 1, x, work, digits);
    }
}

outlined! {
    /// [`lyapunov_to`] for `Q = s I`.
    pub(crate) fn lyapunov_of_identity(a: &'a Cayley<T>, s: T, x: &'a mut [T], work: &'a mut [T], digits: Digits) {
        let n = Dyn(a.powers.n);
        sym_mul_nt(n, n, &a.inverse, &a.inverse, x);
        scale(x, s * (a.gamma + a.gamma));
        stein_from(&a.powers, 0, x, work, digits);
    }
}

outlined! {
    /// `F' X F - X + Q = 0`, in place of `Q`; otherwise as [`stein_to`].
    pub(crate) fn stein_dual_to(p: &'a Powers<T>, x: &'a mut [T], work: &'a mut [T], digits: Digits) {
        let n = Dyn(p.n);
        let (product, next) = work[..2 * p.n * p.n].split_at_mut(p.n * p.n);
        for k in 0..p.count() {
            let seen = p.seen_twice(k, digits);
            if !seen.any() {
                break;
            }
            let f = p.power(k);
            mul(n, n, n, x, f, product);
            if seen.all() {
                sym_mul_add_tn(n, n, f, product, x);
                continue;
            }
            next.copy_from_slice(x);
            sym_mul_add_tn(n, n, f, product, next);
            keep(seen, next, x);
        }
    }
}

outlined! {
    /// `F X H - X + C = 0`, in place of `C` (n by m), `F` and `H` stable.
    ///
    /// ```text
    /// X <- X + F_k X H_k
    /// ```
    /// `work` holds at least `n m` numbers.
    pub(crate) fn stein_pair(f: &'a Powers<T>, h: &'a Powers<T>, x: &'a mut [T], work: &'a mut [T]) {
        let (n, m) = (Dyn(f.n), Dyn(h.n));
        let work = &mut work[..f.n * h.n];
        for k in 0..f.count().min(h.count()) {
            // Powers end in zeros: nothing is added in a lane that is done.
            mul(n, n, m, f.power(k), x, work);
            mul_add(n, m, m, work, h.power(k), x);
        }
    }
}

outlined! {
    /// `F X H' - X + C = 0`; otherwise as [`stein_pair`].
    pub(crate) fn stein_pair_nt(f: &'a Powers<T>, h: &'a Powers<T>, x: &'a mut [T], work: &'a mut [T]) {
        let (n, m) = (Dyn(f.n), Dyn(h.n));
        let work = &mut work[..f.n * h.n];
        for k in 0..f.count().min(h.count()) {
            mul(n, n, m, f.power(k), x, work);
            mul_add_nt(n, m, m, work, h.power(k), x);
        }
    }
}

/// [`stein_to`] to all digits.
#[inline(always)]
pub(crate) fn stein<T: Real>(p: &Powers<T>, x: &mut [T], work: &mut [T]) {
    stein_to(p, x, work, Digits::All);
}

/// [`stein_dual_to`] to all digits.
#[inline(always)]
pub(crate) fn stein_dual<T: Real>(p: &Powers<T>, x: &mut [T], work: &mut [T]) {
    stein_dual_to(p, x, work, Digits::All);
}

/// [`lyapunov_to`] to all digits.
#[inline(always)]
pub(crate) fn lyapunov<T: Real>(a: &Cayley<T>, x: &mut [T], work: &mut [T]) {
    lyapunov_to(a, x, work, Digits::All);
}

/// [`lyapunov_dual_to`] to all digits.
#[inline(always)]
pub(crate) fn lyapunov_dual<T: Real>(a: &Cayley<T>, x: &mut [T], work: &mut [T]) {
    lyapunov_dual_to(a, x, work, Digits::All);
}

/// `x = next` where `seen`.
#[inline(always)]
fn keep<T: Real>(seen: T::Mask, next: &[T], x: &mut [T]) {
    for (x, &y) in x.iter_mut().zip(next) {
        *x = T::select(seen, y, *x);
    }
}

outlined! {
    /// `A X + X A' + Q = 0`, in place of `Q` (symmetric).
    ///
    /// ```text
    /// F X F' - X + 2 gamma M Q M' = 0,   M = (gamma I - A)^-1
    /// ```
    /// Of use in lanes where `a.powers.stable`. `work` holds at least `2 n^2` numbers.
    pub(crate) fn lyapunov_to(a: &'a Cayley<T>, x: &'a mut [T], work: &'a mut [T], digits: Digits) {
        let n = Dyn(a.powers.n);
        let half = &mut work[..a.inverse.len()];
        mul(n, n, n, &a.inverse, x, half);
        sym_mul_nt(n, n, half, &a.inverse, x);
        scale(x, a.gamma + a.gamma);
        stein_to(&a.powers, x, work, digits);
    }
}

outlined! {
    /// `A' X + X A + Q = 0`, in place of `Q`; otherwise as [`lyapunov_to`].
    pub(crate) fn lyapunov_dual_to(a: &'a Cayley<T>, x: &'a mut [T], work: &'a mut [T], digits: Digits) {
        let n = Dyn(a.powers.n);
        let half = &mut work[..a.inverse.len()];
        mul(n, n, n, x, &a.inverse, half);
        sym_mul_tn(n, n, &a.inverse, half, x);
        scale(x, a.gamma + a.gamma);
        stein_dual_to(&a.powers, x, work, digits);
    }
}

outlined! {
    /// `A X + X B + C = 0`, in place of `C` (n by m); `a` and `b` share `gamma`.
    /// `work` holds at least `n m` numbers.
    pub(crate) fn sylvester(a: &'a Cayley<T>, b: &'a Cayley<T>, x: &'a mut [T], work: &'a mut [T]) {
        let (n, m) = (Dyn(a.powers.n), Dyn(b.powers.n));
        let work = &mut work[..a.powers.n * b.powers.n];
        mul(n, n, m, &a.inverse, x, work);
        mul(n, m, m, work, &b.inverse, x);
        scale(x, a.gamma + a.gamma);
        stein_pair(&a.powers, &b.powers, x, work);
    }
}

outlined! {
    /// `A X + X B' + C = 0`, in place of `C`; otherwise as [`sylvester`].
    pub(crate) fn sylvester_nt(a: &'a Cayley<T>, b: &'a Cayley<T>, x: &'a mut [T], work: &'a mut [T]) {
        let (n, m) = (Dyn(a.powers.n), Dyn(b.powers.n));
        let work = &mut work[..a.powers.n * b.powers.n];
        mul(n, n, m, &a.inverse, x, work);
        mul_nt(n, m, m, work, &b.inverse, x);
        scale(x, a.gamma + a.gamma);
        stein_pair_nt(&a.powers, &b.powers, x, work);
    }
}
