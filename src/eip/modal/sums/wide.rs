//! Models side by side: lanes, and where registers are many, two of them.

use crate::real::Real;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Numbers of some models.
pub(super) trait Models:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The same number for every model.
    fn splat(x: f64) -> Self;
    /// `self * a + b`, rounded once.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// `b - self * a`, rounded once.
    fn neg_mul_add(self, a: Self, b: Self) -> Self;

    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
    #[inline(always)]
    fn one() -> Self {
        Self::splat(1.0)
    }
}

/// `V` lanes: a number of the plant that is loaded serves all of them, and one works while
/// another waits for its products.
#[derive(Clone, Copy)]
pub(super) struct Wide<T, const V: usize>(pub(super) [T; V]);

/// `out[v] = body` for every lane. (No closure: it would be compiled without the
/// instructions of the lanes.)
macro_rules! each {
    ($self:ident, $v:ident, $body:expr) => {{
        let mut out = $self;
        for $v in 0..V {
            out.0[$v] = $body;
        }
        out
    }};
}

impl<T: Real, const V: usize> Models for Wide<T, V> {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Wide([T::splat(x); V])
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        each!(self, v, self.0[v].mul_add(a.0[v], b.0[v]))
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        each!(self, v, self.0[v].neg_mul_add(a.0[v], b.0[v]))
    }
}

impl<T: Real, const V: usize> Add for Wide<T, V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        each!(self, v, self.0[v] + o.0[v])
    }
}
impl<T: Real, const V: usize> Sub for Wide<T, V> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        each!(self, v, self.0[v] - o.0[v])
    }
}
impl<T: Real, const V: usize> Mul for Wide<T, V> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        each!(self, v, self.0[v] * o.0[v])
    }
}
impl<T: Real, const V: usize> Div for Wide<T, V> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        each!(self, v, self.0[v] / o.0[v])
    }
}
impl<T: Real, const V: usize> Neg for Wide<T, V> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        each!(self, v, -self.0[v])
    }
}
