//! Algebra of small matrices, generic over [`Real`](crate::real::Real): one
//! matrix, or eight in lanes.
//!
//! Matrices are row-major slices; sizes are passed as [`Dim`] values, fixed
//! ([`Const`]) or not ([`Dyn`]). Nothing is allocated: results, and scratch
//! where it is needed, are arguments, and scratch may hold anything. Slices of
//! the wrong size are a caller's mistake and panic; a matrix that cannot be
//! factored is data and comes back as a mask, lane by lane.
//!
//! # Sizes
//! A function called with `Const` sizes up to 3 is unrolled where it is called.
//! Everything else goes through one copy per instruction set, compiled once
//! ([`Real::outline`](crate::real::Real::outline)), which holds kernels for the
//! common orders and register-tiled loops for all others; so a solver written
//! with [`Dyn`] runs at the speed of fixed sizes, and need not be compiled once
//! an order. `C = A B` for eight matrices in lanes (ns; AVX-512 on an AMD EPYC
//! virtual machine that did other work too, best rounds, peak 112 to 117 GFLOP/s;
//! before commit 66bdaaac2079, since when tiles are checked once and order 8 is
//! fixed inside, too):
//!
//! | order | tiled loops | one call, fixed order inside | unrolled at the call |
//! |---|---|---|---|
//! | 2 | 10 | 7 | 2 |
//! | 3 | 15 | 9 | 6 |
//! | 4 | 25 | 12 | 11 |
//! | 5 | 44 | 23 | 21 |
//! | 6 | 55 | 34 | 34 |
//! | 8 | 90 | as loops | 76 to 87 |
//!
//! # Where faer takes over
//! Against faer, one problem at a time on one thread, lanes win by 26 to 39 times
//! at order 2 and by 2.7 to 8 at order 16; faer's product is level at order 30
//! and ahead from there. `cargo bench --bench kernels -- --table` prints the
//! comparison, BENCHMARKS.md holds a run of it.
//!
//! With AVX2 lanes the lines cross between orders 16 and 24 for products and
//! between 48 and 64 for systems. Orders above some 30, and decompositions that
//! branch on their data (eigenvalues, Schur, singular values), belong to faer.

mod basic;
mod cholesky;
mod complex;
mod dim;
mod expm;
mod lu;
mod mat;
mod product;
mod tile;
mod triangular;

pub use basic::{
    add_assign, dot, identity, norm_1, norm_frobenius, norm_max, scale, select_assign, sub_assign,
    symmetrize, trace, transpose,
};
pub use cholesky::{cholesky, cholesky_solve};
pub use complex::{Cx, cx_det, cx_solve};
pub use dim::{Const, Dim, Dyn};
pub use expm::{expm, expm_work};
pub use lu::{LuInfo, inverse, lu_factor, lu_solve, solve};
pub use mat::Mat;
pub use product::{
    mul, mul_add, mul_add_nt, mul_add_tn, mul_nt, mul_sub, mul_sub_nt, mul_sub_tn, mul_tn, sym_mul,
    sym_mul_add, sym_mul_add_nt, sym_mul_add_tn, sym_mul_nt, sym_mul_sub, sym_mul_sub_nt,
    sym_mul_sub_tn, sym_mul_tn, sym_update,
};
pub(crate) use tile::{grid, grid_mut};
pub use triangular::{solve_lower, solve_lower_t, solve_lower_unit, solve_upper};
