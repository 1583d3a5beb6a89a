//! What a residual can do to the solution of a linear equation.

use super::super::bound::{shares, shares_at_most};
use super::super::data::Kind;
use super::super::ops::norm;
use super::super::powers::Digits;
use super::super::smith::{lyapunov_of_identity, stein_of_identity};
use super::{Inverse, Linear};
use crate::real::Real;

/// A bound on [`condition`] of a Lyapunov equation from the norms of the powers alone:
/// some times as large for a matrix that is near normal, much larger where several modes
/// are slow.
///
/// ```text
/// discrete     |Y| <= s sqrt(n) prod_k (1 + |F^(2^k)|^2)
/// continuous   |Y| <= s 2 gamma |M|^2 prod_k (1 + |F^(2^k)|^2),   M = (gamma I - A)^-1
/// ```
#[inline(always)]
pub(super) fn condition_at_most<T: Real>(l: &Linear<T>, size: T, scale: T) -> (T, T) {
    let c = &l.left_cayley;
    let first = match l.kind {
        Kind::Continuous => {
            let inverse = norm(&c.inverse);
            (c.gamma + c.gamma) * (inverse * inverse)
        }
        Kind::Discrete => T::splat((l.n as f64).sqrt()),
    };
    let most = size * first * c.powers.sum_at_most();
    (most / scale, shares_at_most(&l.left, &l.right, [1.0, -1.0], most, &l.x))
}

/// What a residual as large as `size` could do to `X`, relative to its size
/// `scale`, in balanced units and in those of the user.
#[inline(always)]
pub(super) fn condition<T: Real>(
    l: &mut Linear<T>,
    size: T,
    scale: T,
    inverse: Option<&Inverse<T>>,
) -> (T, T) {
    let (n, m) = (l.n, l.m);
    let zero = scale.eq(T::zero());
    let (mut here, mut there) = (T::zero(), T::zero());
    if l.symmetric && inverse.is_none() {
        let (x, work, cayley) = (&mut l.dx, &mut l.work, &l.left_cayley);
        match l.kind {
            Kind::Continuous => lyapunov_of_identity(cayley, size, x, work, Digits::Few),
            Kind::Discrete => stein_of_identity(&cayley.powers, size, x, work, Digits::Few),
        }
        here = T::select(zero, T::zero(), norm(&l.dx) / scale);
        return (here, T::select(zero, T::zero(), share_there(l)));
    }
    let entry = size * T::splat(1.0 / ((n * m) as f64).sqrt());
    for probe in 0..PROBES {
        for i in 0..n {
            for j in 0..m {
                l.dx[i * m + j] = entry * T::splat(sign(probe, i) * sign(probe, j));
            }
        }
        l.invert(inverse, Digits::Few);
        here = here.max(T::select(zero, T::zero(), norm(&l.dx) / scale));
        there = there.max(T::select(zero, T::zero(), share_there(l)));
    }
    (here, there)
}

/// `|dX| / |X|` in the units of the user.
#[inline(always)]
pub(super) fn share_there<T: Real>(l: &Linear<T>) -> T {
    shares(&l.left, &l.right, [T::zero(); 2], [1.0, -1.0], &l.dx, &l.x)
}

/// Right-hand sides tried for the condition where the worst is not known.
const PROBES: usize = 3;

/// Signs of the right-hand side `probe`, by row and column.
#[inline(always)]
fn sign(probe: usize, at: usize) -> f64 {
    if (at >> probe.saturating_sub(1)) & usize::from(probe > 0) == 1 { -1.0 } else { 1.0 }
}
