//! Complex numbers on lanes, and linear systems of them.

use super::dim::Dim;
use crate::real::{LaneKernel, Mask, Real};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A complex number of two `T`: eight complex numbers on lanes.
#[derive(Debug, Clone, Copy)]
pub struct Cx<T> {
    /// Real part.
    pub re: T,
    /// Imaginary part.
    pub im: T,
}

impl<T: Real> Cx<T> {
    /// `re + i im`.
    #[inline(always)]
    pub fn new(re: T, im: T) -> Self {
        Cx { re, im }
    }
    /// Zero in every lane.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Cx { re: T::zero(), im: T::zero() }
    }
    /// A real number.
    #[inline(always)]
    pub fn real(re: T) -> Self {
        Cx { re, im: T::zero() }
    }
    /// `self * a + b`.
    ///
    /// ```text
    /// re = (b.re + re a.re) - im a.im,   im = (b.im + re a.im) + im a.re
    /// ```
    #[inline(always)]
    #[must_use]
    pub fn mul_add(self, a: Self, b: Self) -> Self {
        Cx {
            re: self.im.neg_mul_add(a.im, self.re.mul_add(a.re, b.re)),
            im: self.im.mul_add(a.re, self.re.mul_add(a.im, b.im)),
        }
    }
    /// `b - self * a`, with the roundings of [`Cx::mul_add`].
    #[inline(always)]
    #[must_use]
    pub fn neg_mul_add(self, a: Self, b: Self) -> Self {
        Cx {
            re: self.im.mul_add(a.im, self.re.neg_mul_add(a.re, b.re)),
            im: self.im.neg_mul_add(a.re, self.re.neg_mul_add(a.im, b.im)),
        }
    }
    /// The conjugate.
    #[inline(always)]
    #[must_use]
    pub fn conj(self) -> Self {
        Cx { re: self.re, im: -self.im }
    }
    /// `self * s`, `s` real.
    #[inline(always)]
    #[must_use]
    pub fn scale(self, s: T) -> Self {
        Cx { re: self.re * s, im: self.im * s }
    }
    /// `|re| + |im|`, within a factor `sqrt(2)` of the modulus.
    #[inline(always)]
    pub fn abs1(self) -> T {
        self.re.abs() + self.im.abs()
    }
    /// `re^2 + im^2`; overflows beyond 1e154.
    #[inline(always)]
    pub fn norm_sqr(self) -> T {
        self.im.mul_add(self.im, self.re * self.re)
    }
    /// `1 / self` without undue overflow: scaled by a power of two near the
    /// modulus first. Zero gives NaN.
    #[inline(always)]
    #[must_use]
    pub fn recip(self) -> Self {
        let limit = T::splat(1000.0);
        let exponent = self.re.abs().max(self.im.abs()).split().1;
        let s = T::pow2i(-exponent.max(-limit).min(limit));
        let near = self.scale(s);
        near.conj().scale(s / near.norm_sqr())
    }
    /// `if mask { a } else { b }`, lane by lane.
    #[inline(always)]
    #[must_use]
    pub fn select(mask: T::Mask, a: Self, b: Self) -> Self {
        Cx { re: T::select(mask, a.re, b.re), im: T::select(mask, a.im, b.im) }
    }
}

impl<T: Real> Add for Cx<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Cx { re: self.re + o.re, im: self.im + o.im }
    }
}

impl<T: Real> Sub for Cx<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Cx { re: self.re - o.re, im: self.im - o.im }
    }
}

impl<T: Real> Neg for Cx<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Cx { re: -self.re, im: -self.im }
    }
}

impl<T: Real> Mul for Cx<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Cx {
            re: self.im.neg_mul_add(o.im, self.re * o.re),
            im: self.im.mul_add(o.re, self.re * o.im),
        }
    }
}

/// The product with [`Cx::recip`].
#[expect(clippy::suspicious_arithmetic_impl, reason = "division by way of the reciprocal")]
impl<T: Real> Div for Cx<T> {
    type Output = Self;
    #[inline(always)]
    fn div(self, d: Self) -> Self {
        self * d.recip()
    }
}

/// `X <- A^-1 X` over the complex numbers, destroying `A`; `A` n x n, `X` n x r,
/// row-major.
///
/// Gaussian elimination with partial pivoting on `|re| + |im|`, the pivot chosen
/// lane by lane. Returns the lanes whose pivots were all normal and finite; in
/// the others a bad pivot is replaced by one, harmless but of no use. Panics
/// unless `a.len() == n * n` and `x.len() == n * r`.
///
/// # Examples
/// ```
/// use mmae::small::{Const, Cx, cx_solve};
/// let i = Cx::new(0.0, 1.0);
/// let (mut a, mut x) = ([i], [Cx::real(2.0)]);
/// assert!(cx_solve(Const::<1>, Const::<1>, &mut a, &mut x));
/// assert_eq!((x[0].re, x[0].im), (0.0, -2.0)); // 2 / i
/// ```
#[inline(always)]
#[track_caller]
#[must_use = "lanes that are false hold no solution"]
pub fn cx_solve<T: Real, N: Dim, C: Dim>(n: N, r: C, a: &mut [Cx<T>], x: &mut [Cx<T>]) -> T::Mask {
    let (n, r) = (n.get(), r.get());
    assert!(
        a.len() == n * n && x.len() == n * r,
        "cx_solve: slices do not fit {n}x{n} and {n}x{r}"
    );
    T::outline(Solve { n, r, a, x, sign: T::one() })
}

/// Determinant of `A`, n x n, destroying it; NaN in lanes where [`cx_solve`]
/// would fail. Scale `A` so that the product of its pivots stays in range.
/// Panics unless `a.len() == n * n`.
///
/// # Examples
/// ```
/// use mmae::small::{Const, Cx, cx_det};
/// let [zero, one, i] = [Cx::zero(), Cx::real(1.0), Cx::new(0.0, 1.0)];
/// let det = cx_det(Const::<2>, &mut [zero, one, i, zero]);
/// assert_eq!((det.re, det.im), (0.0, -1.0));
/// ```
#[inline(always)]
#[track_caller]
pub fn cx_det<T: Real, N: Dim>(n: N, a: &mut [Cx<T>]) -> Cx<T> {
    let n = n.get();
    assert!(a.len() == n * n, "cx_det: slice does not fit {n}x{n}");
    T::outline(Det(Solve { n, r: 0, a, x: &mut [], sign: T::one() }))
}

struct Solve<'a, T> {
    n: usize,
    r: usize,
    a: &'a mut [Cx<T>],
    x: &'a mut [Cx<T>],
    /// Of the permutation.
    sign: T,
}

/// Elimination for the sake of the pivots.
struct Det<'a, T>(Solve<'a, T>);

impl<T: Real> LaneKernel<T> for Det<'_, T> {
    type Out = Cx<T>;
    #[inline(always)]
    fn run(mut self) -> Cx<T> {
        let ok = self.0.eliminate();
        let mut reciprocal = Cx::real(self.0.sign);
        for k in 0..self.0.n {
            reciprocal = reciprocal * self.0.a[k * self.0.n + k];
        }
        let nan = T::splat(f64::NAN);
        Cx::select(ok, reciprocal.recip(), Cx::new(nan, nan))
    }
}

impl<T: Real> Solve<'_, T> {
    /// Brings each lane's pivot of step `k` to row `k`, in `A` and `X`.
    #[inline(always)]
    fn pivot(&mut self, k: usize) {
        let (n, r) = (self.n, self.r);
        let mut best = self.a[k * n + k].abs1();
        let diagonal = best;
        for i in k + 1..n {
            best = self.a[i * n + k].abs1().max(best);
        }
        let mut searching = !diagonal.ge(best);
        for i in k + 1..n {
            if !searching.any() {
                break;
            }
            let here = searching & self.a[i * n + k].abs1().eq(best);
            searching = searching & !here;
            if here.any() {
                swap_where(here, n, k, i, self.a);
                swap_where(here, r, k, i, self.x);
                self.sign = T::select(here, -self.sign, self.sign);
            }
        }
    }

    /// Replaces pivot `k` by its reciprocal; returns the lanes where it is good.
    #[inline(always)]
    fn invert(&mut self, k: usize) -> T::Mask {
        let pivot = &mut self.a[k * self.n + k];
        let size = pivot.abs1();
        let good = size.ge(T::splat(f64::MIN_POSITIVE)) & size.is_finite();
        *pivot = Cx::select(good, *pivot, Cx::real(T::one())).recip();
        good
    }

    /// Brings `A` to triangular form, with the reciprocals of the pivots on the
    /// diagonal, and `X` along.
    #[inline(always)]
    fn eliminate(&mut self) -> T::Mask {
        let (n, r) = (self.n, self.r);
        let mut ok = T::Mask::splat(true);
        for k in 0..n {
            self.pivot(k);
            ok = ok & self.invert(k);
            let (top, below) = self.a.split_at_mut((k + 1) * n);
            let (x_top, x_below) = self.x.split_at_mut((k + 1) * r);
            let (pivot, x_pivot) = (&top[k * n..], &x_top[k * r..]);
            for i in 0..n - k - 1 {
                let row = &mut below[i * n..][..n];
                let factor = row[k] * pivot[k];
                subtract(factor, &pivot[k + 1..], &mut row[k + 1..]);
                subtract(factor, x_pivot, &mut x_below[i * r..][..r]);
            }
        }
        ok
    }
}

/// Exchanges rows `k` and `i` in the lanes of `here`.
#[inline(always)]
fn swap_where<T: Real>(here: T::Mask, width: usize, k: usize, i: usize, m: &mut [Cx<T>]) {
    let (head, tail) = m.split_at_mut(i * width);
    for (p, q) in head[k * width..][..width].iter_mut().zip(&mut tail[..width]) {
        (*p, *q) = (Cx::select(here, *q, *p), Cx::select(here, *p, *q));
    }
}

/// `row <- row - factor * pivot`.
#[inline(always)]
fn subtract<T: Real>(factor: Cx<T>, pivot: &[Cx<T>], row: &mut [Cx<T>]) {
    for (x, &p) in row.iter_mut().zip(pivot) {
        *x = factor.neg_mul_add(p, *x);
    }
}

impl<T: Real> LaneKernel<T> for Solve<'_, T> {
    type Out = T::Mask;
    #[inline(always)]
    fn run(mut self) -> T::Mask {
        let (n, r) = (self.n, self.r);
        let ok = self.eliminate();
        for k in (0..n).rev() {
            let (x_top, x_below) = self.x.split_at_mut(k * r);
            let solution = &mut x_below[..r];
            for x in &mut *solution {
                *x = *x * self.a[k * n + k];
            }
            for i in 0..k {
                subtract(self.a[i * n + k], solution, &mut x_top[i * r..][..r]);
            }
        }
        ok
    }
}
