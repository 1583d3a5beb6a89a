//! Algebra of small matrices, generic over [`Real`](crate::real::Real): one
//! matrix, or eight in lanes.
//!
//! Matrices are row-major slices; sizes are passed as [`Dim`] values, fixed
//! ([`Const`]) or not ([`Dyn`]). Nothing is allocated: results, and scratch
//! where it is needed, are arguments, and scratch may hold anything. Slices of
//! the wrong size are a caller's mistake and panic; a matrix that cannot be
//! factored is data and comes back as a mask, lane by lane.

mod basic;
mod cholesky;
mod complex;
mod dim;
mod expm;
mod lu;
mod product;
mod tile;
mod triangular;

pub use basic::{
    add_assign, dot, identity, norm_1, norm_frobenius, norm_max, scale, select_assign, sub_assign,
    symmetrize, trace, transpose,
};
pub use cholesky::{cholesky, cholesky_solve};
pub use complex::{Cx, cx_solve};
pub use dim::{Const, Dim, Dyn};
pub use expm::{expm, expm_work};
pub use lu::{LuInfo, inverse, lu_factor, lu_solve, solve};
pub use product::{
    mul, mul_add, mul_add_nt, mul_add_tn, mul_nt, mul_sub, mul_sub_nt, mul_sub_tn, mul_tn, sym_mul,
    sym_mul_add, sym_mul_add_nt, sym_mul_add_tn, sym_mul_nt, sym_mul_sub, sym_mul_sub_nt,
    sym_mul_sub_tn, sym_mul_tn, sym_update,
};
pub use triangular::{solve_lower, solve_lower_t, solve_lower_unit, solve_upper};
