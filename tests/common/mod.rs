//! A textbook oracle: slow, obvious, and independent of the crate's kernels.
//!
//! Matrices are `Vec<Vec<f64>>`, linear equations are solved by Gaussian
//! elimination with full pivoting, Lyapunov equations as Kronecker products.
//! `tests/oracle.rs` proves every function on closed forms and on numbers of
//! `tests/data` that come from elsewhere; everything else is compared with it.
#![allow(dead_code, unreachable_pub, unused_imports, reason = "every test binary uses a part")]

pub mod check;
pub mod data;
pub mod equations;
pub mod matrix;
pub mod upsilon;

pub use check::{assert_bits, assert_close, rel};
pub use matrix::M;
