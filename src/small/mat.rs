//! Matrices whose sizes are part of their type.

use super::dim::Const;
use super::product::{mul, mul_nt, mul_tn};
use crate::real::Real;

/// An `R` x `C` matrix held by value, rows first, for kernels that keep theirs
/// in registers.
///
/// # Examples
/// ```
/// use mmae::small::Mat;
/// let a = Mat([[1.0, 2.0], [3.0, 4.0]]);
/// let x = Mat([[5.0], [6.0]]);
/// assert_eq!(a.mul(&x), Mat([[17.0], [39.0]]));
/// assert_eq!(a.t_mul(&x), a.transpose().mul(&x));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(transparent)]
pub struct Mat<T, const R: usize, const C: usize>(pub [[T; C]; R]);

impl<T: Real, const R: usize, const C: usize> Mat<T, R, C> {
    /// All zeros.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Mat([[T::zero(); C]; R])
    }

    /// The same matrix of numbers in every lane.
    #[inline(always)]
    #[must_use]
    pub fn splat(m: &[[f64; C]; R]) -> Self {
        let mut out = Self::zero();
        for i in 0..R {
            for j in 0..C {
                out.0[i][j] = T::splat(m[i][j]);
            }
        }
        out
    }

    /// The entries, row by row.
    #[inline(always)]
    #[must_use]
    pub fn as_slice(&self) -> &[T] {
        self.0.as_flattened()
    }

    /// The entries, row by row, to write.
    #[inline(always)]
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        self.0.as_flattened_mut()
    }

    /// `A'`.
    #[inline(always)]
    #[must_use]
    pub fn transpose(&self) -> Mat<T, C, R> {
        let mut out = Mat::zero();
        for i in 0..R {
            for j in 0..C {
                out.0[j][i] = self.0[i][j];
            }
        }
        out
    }

    /// `A B`.
    #[inline(always)]
    #[must_use]
    pub fn mul<const N: usize>(&self, b: &Mat<T, C, N>) -> Mat<T, R, N> {
        let mut out = Mat::zero();
        let (r, c, n) = (Const::<R>, Const::<C>, Const::<N>);
        mul(r, c, n, self.as_slice(), b.as_slice(), out.as_mut_slice());
        out
    }

    /// `A B'`.
    #[inline(always)]
    #[must_use]
    pub fn mul_t<const N: usize>(&self, b: &Mat<T, N, C>) -> Mat<T, R, N> {
        let mut out = Mat::zero();
        let (r, c, n) = (Const::<R>, Const::<C>, Const::<N>);
        mul_nt(r, c, n, self.as_slice(), b.as_slice(), out.as_mut_slice());
        out
    }

    /// `A' B`.
    #[inline(always)]
    #[must_use]
    pub fn t_mul<const N: usize>(&self, b: &Mat<T, R, N>) -> Mat<T, C, N> {
        let mut out = Mat::zero();
        let (r, c, n) = (Const::<R>, Const::<C>, Const::<N>);
        mul_tn(c, r, n, self.as_slice(), b.as_slice(), out.as_mut_slice());
        out
    }
}
