//! Products of small matrices, register-tiled.
//!
//! Every entry of a product is one chain of fused multiply-adds in the order of
//! the inner index, so its bits do not depend on the tile, on `Const` or `Dyn`,
//! or on whether half of a symmetric result is mirrored.

use super::dim::{Const, Dim, Dyn, unrolls};
use super::tile::{Grid, GridMut, accumulate, chain, grid, grid_mut};
use crate::real::{LaneKernel, Real};

/// Sizes up to which a product is unrolled where it is called.
const UNROLL: usize = 3;

/// What happens to the old entries of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Onto {
    /// `C = A B`.
    Set,
    /// `C = C + A B`.
    Add,
    /// `C = C - A B`.
    Sub,
}

/// `C <- op(A) op(B)`: `C` m x n; `A` m x k, or k x m when `TA`; `B` k x n, or
/// n x k when `TB`. When `HALF` the result is symmetric: only the tiles that hold
/// entries `j >= i` are computed, the rest is mirrored.
struct Product<'a, T, M, K, N, const TA: bool, const TB: bool, const HALF: bool> {
    m: M,
    k: K,
    n: N,
    a: &'a [T],
    b: &'a [T],
    c: &'a mut [T],
    onto: Onto,
}

impl<'a, T, M, K, N, const TA: bool, const TB: bool, const HALF: bool>
    Product<'a, T, M, K, N, TA, TB, HALF>
where
    T: Real,
    M: Dim,
    K: Dim,
    N: Dim,
{
    /// Runs in place if fixed and tiny, else through a copy compiled once.
    #[inline(always)]
    #[track_caller]
    fn go(self) {
        let (m, k, n) = (self.m.get(), self.k.get(), self.n.get());
        assert!(
            self.a.len() == m * k && self.b.len() == k * n && self.c.len() == m * n,
            "product: slices do not fit {m}x{k} times {k}x{n}"
        );
        if unrolls::<M, K, N>(UNROLL) {
            self.tiles();
        } else {
            let Product { a, b, c, onto, .. } = self;
            let (m, k, n) = (Dyn(m), Dyn(k), Dyn(n));
            T::outline(Product::<T, Dyn, Dyn, Dyn, TA, TB, HALF> { m, k, n, a, b, c, onto });
        }
    }

    /// The same product with sizes that the compiler sees.
    #[inline(always)]
    fn square<const S: usize>(self) {
        let Product { a, b, c, onto, .. } = self;
        let s = Const::<S>;
        // Of no effect but to let bounds checks go.
        let (a, b, c) = (&a[..S * S], &b[..S * S], &mut c[..S * S]);
        Product::<T, _, _, _, TA, TB, HALF> { m: s, k: s, n: s, a, b, c, onto }.tiles();
    }

    /// All tiles.
    #[inline(always)]
    fn tiles(self) {
        let Product { m, k, n, a, b, c, onto } = self;
        let (rows, inner, cols) = (m.get(), k.get(), n.get());
        let a = if TA { grid(a, [inner, rows]).t() } else { grid(a, [rows, inner]) };
        let b = if TB { grid(b, [cols, inner]).t() } else { grid(b, [inner, cols]) };
        let c = grid_mut(c, [rows, cols]);
        let mut tiles = Tiles::<_, M, K, N, HALF> { m, k, n, a, b, c, onto };
        match T::TILE {
            4 => tiles.rows::<4, 4>(),
            2 => tiles.rows::<2, 2>(),
            _ => tiles.rows::<1, 1>(),
        }
    }
}

/// A [`Product`] with `A` and `B` as they are multiplied.
struct Tiles<'a, T, M, K, N, const HALF: bool> {
    m: M,
    k: K,
    n: N,
    a: Grid<'a, T>,
    b: Grid<'a, T>,
    c: GridMut<'a, T>,
    onto: Onto,
}

impl<T: Real, M: Dim, K: Dim, N: Dim, const HALF: bool> Tiles<'_, T, M, K, N, HALF> {
    /// All rows, `R` at a time.
    #[inline(always)]
    fn rows<const R: usize, const C: usize>(&mut self) {
        let m = self.m.get();
        let full = m / R * R;
        for block in 0..m / R {
            let i = block * R;
            self.columns::<R, C>(i);
        }
        match m - full {
            3 => self.columns::<3, C>(full),
            2 => self.columns::<2, C>(full),
            1 => self.columns::<1, C>(full),
            _ => {}
        }
    }

    /// All columns of rows `i..i + R`, `C` at a time, or of a symmetric result those from
    /// the diagonal on.
    #[inline(always)]
    fn columns<const R: usize, const C: usize>(&mut self, i: usize) {
        let first = if HALF { i } else { 0 };
        let count = self.n.get() - first;
        for block in 0..count / C {
            let j = first + block * C;
            self.tile::<R, C>(i, j);
        }
        let j = first + count / C * C;
        match count % C {
            3 => self.tile::<R, 3>(i, j),
            2 => self.tile::<R, 2>(i, j),
            1 => self.tile::<R, 1>(i, j),
            _ => {}
        }
    }

    /// Entries `i..i + R`, `j..j + C` of the result:
    ///
    /// ```text
    /// for p in 0..k: sum[r][s] += A[i + r][p] B[p][j + s]
    /// ```
    #[inline(always)]
    fn tile<const R: usize, const C: usize>(&mut self, i: usize, j: usize) {
        let mut sum = [[T::zero(); C]; R];
        if self.onto != Onto::Set {
            sum = self.c.view().load(i, j);
        }
        // C - A B = -(-C + A B): one loop serves both signs.
        if self.onto == Onto::Sub {
            negate(&mut sum);
        }
        let inner = (0, self.k.get());
        accumulate::<_, R, C, { chain::ADD }>(self.a, self.b, (i, j), inner, &mut sum);
        if self.onto == Onto::Sub {
            negate(&mut sum);
        }
        // A tile on the diagonal of a symmetric result starts with a square.
        let square = if HALF && i == j { R.min(C) } else { 0 };
        for r in 0..square {
            for s in 0..r {
                sum[r][s] = sum[s][r];
            }
        }
        self.c.store(&sum, (i, j));
        if HALF {
            for s in square..C {
                let mut column = [[T::zero(); R]];
                for r in 0..R {
                    column[0][r] = sum[r][s];
                }
                self.c.store(&column, (j + s, i));
            }
        }
    }
}

/// `-sum`.
#[inline(always)]
fn negate<T: Real, const R: usize, const C: usize>(sum: &mut [[T; C]; R]) {
    for r in 0..R {
        for s in 0..C {
            sum[r][s] = -sum[r][s];
        }
    }
}

impl<T: Real, M: Dim, K: Dim, N: Dim, const TA: bool, const TB: bool, const HALF: bool>
    LaneKernel<T> for Product<'_, T, M, K, N, TA, TB, HALF>
{
    type Out = ();
    #[inline(always)]
    fn run(self) {
        if T::UNROLLS {
            match (self.m.get(), self.k.get(), self.n.get()) {
                (2, 2, 2) => return self.square::<2>(),
                (3, 3, 3) => return self.square::<3>(),
                (4, 4, 4) => return self.square::<4>(),
                (5, 5, 5) => return self.square::<5>(),
                (6, 6, 6) => return self.square::<6>(),
                (8, 8, 8) => return self.square::<8>(),
                _ => {}
            }
        }
        self.tiles();
    }
}

/// The functions for one placement of the transpose.
macro_rules! products {
    ($ta:literal, $tb:literal, $($name:ident $onto:ident $doc:literal;)*) => {$(
        #[doc = $doc]
        ///
        /// Panics unless the slices have the sizes in the equation.
        #[inline(always)]
        #[track_caller]
        pub fn $name<T: Real, M: Dim, K: Dim, N: Dim>(
            m: M, k: K, n: N, a: &[T], b: &[T], c: &mut [T],
        ) {
            Product::<T, M, K, N, $ta, $tb, false> { m, k, n, a, b, c, onto: Onto::$onto }.go();
        }
    )*};
}

/// The functions whose result is known to be symmetric.
macro_rules! symmetric {
    ($ta:literal, $tb:literal, $($name:ident $onto:ident $doc:literal;)*) => {$(
        #[doc = $doc]
        ///
        /// The product must be symmetric in exact arithmetic: only the entries
        /// `j >= i` are computed (and read), the others are their mirror image.
        /// Panics unless the slices have the sizes in the equation.
        #[inline(always)]
        #[track_caller]
        pub fn $name<T: Real, M: Dim, K: Dim>(m: M, k: K, a: &[T], b: &[T], c: &mut [T]) {
            Product::<T, M, K, M, $ta, $tb, true> {
                m, k, n: m, a, b, c, onto: Onto::$onto,
            }
            .go();
        }
    )*};
}

products! { false, false,
    mul Set "`C = A B`, `A` m x k, `B` k x n.";
    mul_add Add "`C += A B`, `A` m x k, `B` k x n.";
    mul_sub Sub "`C -= A B`, `A` m x k, `B` k x n.";
}
products! { false, true,
    mul_nt Set "`C = A B'`, `A` m x k, `B` n x k.";
    mul_add_nt Add "`C += A B'`, `A` m x k, `B` n x k.";
    mul_sub_nt Sub "`C -= A B'`, `A` m x k, `B` n x k.";
}
products! { true, false,
    mul_tn Set "`C = A' B`, `A` k x m, `B` k x n.";
    mul_add_tn Add "`C += A' B`, `A` k x m, `B` k x n.";
    mul_sub_tn Sub "`C -= A' B`, `A` k x m, `B` k x n.";
}
symmetric! { false, false,
    sym_mul Set "`C = A B`, `A` m x k, `B` k x m, `C` symmetric m x m.";
    sym_mul_add Add "`C += A B`, `A` m x k, `B` k x m, `C` symmetric m x m.";
    sym_mul_sub Sub "`C -= A B`, `A` m x k, `B` k x m, `C` symmetric m x m.";
}
symmetric! { false, true,
    sym_mul_nt Set "`C = A B'`, `A` and `B` m x k, `C` symmetric m x m.";
    sym_mul_add_nt Add "`C += A B'`, `A` and `B` m x k, `C` symmetric m x m.";
    sym_mul_sub_nt Sub "`C -= A B'`, `A` and `B` m x k, `C` symmetric m x m.";
}
symmetric! { true, false,
    sym_mul_tn Set "`C = A' B`, `A` and `B` k x m, `C` symmetric m x m.";
    sym_mul_add_tn Add "`C += A' B`, `A` and `B` k x m, `C` symmetric m x m.";
    sym_mul_sub_tn Sub "`C -= A' B`, `A` and `B` k x m, `C` symmetric m x m.";
}

/// Congruence update of a symmetric matrix, exactly symmetric:
///
/// ```text
/// C = Q + A P A'        A m x k, P k x k, Q and C m x m
/// ```
/// `P` and `Q` are read as symmetric; `work` holds `m * k` numbers, of any value.
/// Panics unless the slices have these sizes.
#[inline(always)]
#[track_caller]
pub fn sym_update<T: Real, M: Dim, K: Dim>(
    m: M,
    k: K,
    a: &[T],
    p: &[T],
    q: &[T],
    c: &mut [T],
    work: &mut [T],
) {
    c.copy_from_slice(q);
    mul(m, k, k, a, p, work);
    sym_mul_add_nt(m, k, work, a, c);
}
