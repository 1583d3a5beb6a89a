//! Solvers across lanes: one problem a lane, generic over [`crate::real::Real`].
//!
//! Everything here runs inside a [`crate::simd::Kernel`] (or on plain `f64`).
//! Matrices are row-major slices of `T`; nothing is looked at across lanes, so
//! every lane has the bits of the same problem solved alone.
//!
//! For equations that share coefficients, transform each coefficient once and
//! solve as often as needed:
//!
//! ```text
//! let gamma = gamma_of(n, a, work, perm);          // or one constant for a whole family
//! let mut ca = Cayley::new(n);  ca.set(a, gamma);   // inverse and powers; ca.powers.stable, ca.margin()
//! lyapunov(&ca, x, work);                           // A X + X A' + Q = 0, x: Q -> X, work 2 n^2
//! lyapunov_dual(&ca, x, work);                      // A' X + X A + Q = 0
//! sylvester(&ca, &cb, x, work);                     // A X + X B + C = 0, x: C -> X, work n m
//! sylvester_nt(&ca, &cb, x, work);                  // A X + X B' + C = 0
//! ```
//!
//! In discrete time `Powers::new(n)`, `p.set(f)` take the place of `Cayley`, and
//! `stein`, `stein_dual`, `stein_pair`, `stein_pair_nt` that of the solvers. In
//! a Sylvester equation both coefficients must be stable, and with one `gamma`.

mod balance;
mod bound;
mod data;
mod double;
mod doubling;
mod flow;
mod linear;
mod newton;
mod ops;
mod powers;
mod residual;
mod riccati;
mod smith;

pub(crate) use balance::balance;
pub(crate) use data::{Data, Kind};
pub(crate) use doubling::Coefficients;
pub(crate) use flow::{Flow, transpose_data};
pub(crate) use linear::{Inverse, Linear};
pub(crate) use ops::outlined;
pub(crate) use powers::{Cayley, Powers, gamma_of, splat};
pub(crate) use riccati::Block;
pub(crate) use smith::{
    lyapunov, lyapunov_dual, stein, stein_dual, stein_pair, stein_pair_nt, sylvester, sylvester_nt,
};

#[cfg(test)]
mod tests;
