//! Triangular systems with many right-hand sides, register-tiled.

use super::dim::{Const, Dim, Dyn, unrolls};
use super::tile::{Grid, GridMut, accumulate, chain, grid, grid_mut};
use crate::real::{LaneKernel, Real};

/// Orders up to which a solve is unrolled at the call.
const UNROLL: usize = 3;

/// Which triangle, and which way it is solved.
mod kind {
    /// `L X = B`, ones on the diagonal.
    pub(super) const LOWER_UNIT: u8 = 0;
    /// `L X = B`.
    pub(super) const LOWER: u8 = 1;
    /// `U X = B`.
    pub(super) const UPPER: u8 = 2;
    /// `L' X = B`.
    pub(super) const LOWER_T: u8 = 3;
}

/// `X <- op(T)^-1 X`, `T` n x n, `X` n x r.
///
/// ```text
/// LOWER:           x_i = (x_i - sum_{p = 0 .. i-1} t_ip x_p) / t_ii    i rising
/// UPPER, LOWER_T:  x_i = (x_i - sum_{p = n-1 .. i+1} t_ip x_p) / t_ii  i falling
/// ```
/// Sums run in the order written, whatever the tile. The division is a product
/// with the reciprocal.
struct Triangular<'a, T, N, C, const KIND: u8> {
    n: N,
    r: C,
    t: &'a [T],
    x: &'a mut [T],
}

impl<T: Real, N: Dim, C: Dim, const KIND: u8> Triangular<'_, T, N, C, KIND> {
    #[inline(always)]
    #[track_caller]
    fn go(self) {
        let (n, r) = (self.n.get(), self.r.get());
        assert!(
            self.t.len() == n * n && self.x.len() == n * r,
            "triangular solve: slices do not fit {n}x{n} and {n}x{r}"
        );
        if unrolls::<N, C, N>(UNROLL) {
            self.all();
        } else {
            let Triangular { t, x, .. } = self;
            T::outline(Triangular::<T, Dyn, Dyn, KIND> { n: Dyn(n), r: Dyn(r), t, x });
        }
    }

    /// The same with a size that the compiler sees.
    #[inline(always)]
    fn fixed<const S: usize>(self) {
        // Of no effect but to let bounds checks go.
        let t = &self.t[..S * S];
        Triangular::<T, _, _, KIND> { n: Const::<S>, r: self.r, t, x: self.x }.all();
    }

    #[inline(always)]
    fn all(self) {
        let Triangular { n, r, t, x } = self;
        let (size, width) = (n.get(), r.get());
        let t = grid(t, [size, size]);
        let t = if KIND == kind::LOWER_T { t.t() } else { t };
        let mut tiles = Tiles::<_, N, C, KIND> { n, r, t, x: grid_mut(x, [size, width]) };
        match T::TILE {
            4 => tiles.rows::<4, 4>(),
            2 => tiles.rows::<2, 2>(),
            _ => tiles.rows::<1, 1>(),
        }
    }
}

/// A [`Triangular`] system, `t` as it is solved with.
struct Tiles<'a, T, N, C, const KIND: u8> {
    n: N,
    r: C,
    t: Grid<'a, T>,
    x: GridMut<'a, T>,
}

impl<T: Real, N: Dim, C: Dim, const KIND: u8> Tiles<'_, T, N, C, KIND> {
    const FALLING: bool = KIND == kind::UPPER || KIND == kind::LOWER_T;

    /// All rows, `R` at a time, in the order that the triangle asks for.
    #[inline(always)]
    fn rows<const R: usize, const W: usize>(&mut self) {
        let n = self.n.get();
        let full = n / R * R;
        if !Self::FALLING {
            for block in 0..n / R {
                let i = block * R;
                self.columns::<R, W>(i);
            }
        }
        match n - full {
            3 => self.columns::<3, W>(full),
            2 => self.columns::<2, W>(full),
            1 => self.columns::<1, W>(full),
            _ => {}
        }
        if Self::FALLING {
            for block in (0..n / R).rev() {
                let i = block * R;
                self.columns::<R, W>(i);
            }
        }
    }

    /// All columns of rows `i..i + R`, `W` at a time.
    #[inline(always)]
    fn columns<const R: usize, const W: usize>(&mut self, i: usize) {
        let block = self.t.load::<R, R>(i, i);
        let mut inverse = [T::zero(); R];
        if KIND != kind::LOWER_UNIT {
            for s in 0..R {
                inverse[s] = block[s][s].recip();
            }
        }
        let r = self.r.get();
        let full = r / W * W;
        for k in 0..r / W {
            let j = k * W;
            self.tile::<R, W>(i, j, &block, &inverse);
        }
        match r - full {
            3 => self.tile::<R, 3>(i, full, &block, &inverse),
            2 => self.tile::<R, 2>(i, full, &block, &inverse),
            1 => self.tile::<R, 1>(i, full, &block, &inverse),
            _ => {}
        }
    }

    /// Rows `i..i + R`, columns `j..j + W` of the solution; `block` is that of the triangle
    /// on the diagonal, `inverse` what its diagonal is multiplied by.
    #[inline(always)]
    fn tile<const R: usize, const W: usize>(
        &mut self,
        i: usize,
        j: usize,
        block: &[[T; R]; R],
        inverse: &[T; R],
    ) {
        let x = self.x.view();
        let mut sum = x.load::<R, W>(i, j);
        if Self::FALLING {
            let after = (i + R, self.n.get());
            accumulate::<_, R, W, { chain::SUB_DOWN }>(self.t, x, (i, j), after, &mut sum);
        } else {
            accumulate::<_, R, W, { chain::SUB }>(self.t, x, (i, j), (0, i), &mut sum);
        }
        for step in 0..R {
            let row = if Self::FALLING { R - 1 - step } else { step };
            for back in 0..step {
                let p = if Self::FALLING { R - 1 - back } else { back };
                for s in 0..W {
                    sum[row][s] = block[row][p].neg_mul_add(sum[p][s], sum[row][s]);
                }
            }
            if KIND != kind::LOWER_UNIT {
                for s in 0..W {
                    sum[row][s] = sum[row][s] * inverse[row];
                }
            }
        }
        self.x.store(&sum, (i, j));
    }
}

impl<T: Real, N: Dim, C: Dim, const KIND: u8> LaneKernel<T> for Triangular<'_, T, N, C, KIND> {
    type Out = ();
    #[inline(always)]
    fn run(self) {
        if T::UNROLLS {
            match self.n.get() {
                2 => return self.fixed::<2>(),
                3 => return self.fixed::<3>(),
                4 => return self.fixed::<4>(),
                5 => return self.fixed::<5>(),
                6 => return self.fixed::<6>(),
                8 => return self.fixed::<8>(),
                _ => {}
            }
        }
        self.all();
    }
}

/// The public functions.
macro_rules! solves {
    ($($name:ident $kind:ident $doc:literal;)*) => {$(
        #[doc = $doc]
        ///
        /// The other triangle has no effect. A zero on the diagonal gives
        /// infinities or NaN. Panics unless `t.len() == n * n` and
        /// `x.len() == n * r`.
        #[inline(always)]
        #[track_caller]
        pub fn $name<T: Real, N: Dim, C: Dim>(n: N, r: C, t: &[T], x: &mut [T]) {
            Triangular::<T, N, C, { kind::$kind }> { n, r, t, x }.go();
        }
    )*};
}

solves! {
    solve_lower_unit LOWER_UNIT "`X <- L^-1 X`, `L` n x n lower triangular with ones on the diagonal, `X` n x r.";
    solve_lower LOWER "`X <- L^-1 X`, `L` n x n lower triangular, `X` n x r.";
    solve_upper UPPER "`X <- U^-1 X`, `U` n x n upper triangular, `X` n x r.";
    solve_lower_t LOWER_T "`X <- L'^-1 X`, `L` n x n lower triangular, `X` n x r.";
}
