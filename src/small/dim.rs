//! Sizes known to the compiler, and sizes known at run time, in one source.

/// A matrix dimension: [`Const`] or [`Dyn`].
///
/// Functions of this module take dimensions as values of this trait. With
/// [`Const`] the compiler sees the numbers and unrolls; with [`Dyn`] it compiles
/// loops. Both give the same bits.
pub trait Dim: Copy + std::fmt::Debug + Send + Sync + 'static {
    /// The size, if the type fixes it.
    const FIXED: Option<usize>;
    /// The size.
    fn get(self) -> usize;
}

/// A size fixed at compile time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Const<const N: usize>;

/// A size chosen at run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dyn(pub usize);

impl<const N: usize> Dim for Const<N> {
    const FIXED: Option<usize> = Some(N);
    #[inline(always)]
    fn get(self) -> usize {
        N
    }
}

impl Dim for Dyn {
    const FIXED: Option<usize> = None;
    #[inline(always)]
    fn get(self) -> usize {
        self.0
    }
}

/// True if every size is fixed and none exceeds `limit`: then the code is small
/// enough to be unrolled where it is used.
#[inline(always)]
pub(super) const fn unrolls<A: Dim, B: Dim, C: Dim>(limit: usize) -> bool {
    match (A::FIXED, B::FIXED, C::FIXED) {
        (Some(a), Some(b), Some(c)) => a <= limit && b <= limit && c <= limit,
        _ => false,
    }
}
