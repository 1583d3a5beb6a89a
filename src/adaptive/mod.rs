//! Adaptive observers: state and parameters of linearly parameterized systems, in
//! batch.
//!
//! ```text
//! plant      x' = A x + sum_i theta_i g_i + f,          y = C x
//!            g_i = E_row y_j or E_row x_hat_col (an unknown entry of A), or a column of Gamma(y, u, t)
//! observer   x_hat' = A x_hat + sum_i theta_hat_i g_i + f + K (y - C x_hat)
//! filters    psi_i' = A_k psi_i + g_i,   psi_0' = A_k psi_0 + K y + f,   A_k = A - K C
//!            psi_i(0) = 0,   psi_0(0) = x_hat(0),   y = C (Psi theta + psi_0)
//! ```
//! The last line is linear in `theta`: least squares with forgetting estimates it.
//!
//! [`Structure`] names what is unknown, [`Tuning`] describes one observer, [`Adaptive`]
//! runs many of them, eight to a block of lanes: trials, plants, gains or forgetting
//! factors; [`run_records`] many along many records. Filters are sampled with linearly
//! interpolated inputs (second order), the least squares run as `P = U D U'` (Bierman).
//! When a batch is built each plant is tested: observable, `A_k` stable, parameters
//! identifiable ([`identifiability`]).
//!
//! ## Source
//! Liu, Peng, A state and parameter identification scheme for linearly parameterized
//! systems, with these corrections. Fact 3.1 holds for frozen `theta_hat` only, so there
//! are three [`Reading`]s of the error; `zhang` (the state follows `theta_hat`) is the
//! consistent one. In example 4.1 the printed `K = [-5, 5]` makes the observer unstable:
//! it is `[5, -5]` for `K (y - y_hat)`. In (17) the term `[-v_x; 0] r` takes the
//! measured `r` and belongs into `psi_0`. Example 4.2 is not identifiable as posed. The
//! bound of fact 3.2 is false for lightly damped `A_k`, and the premise of proposition
//! 3.4 fails most of the time while the estimate converges: neither is computed here.

mod advance;
mod batch;
mod check;
mod course;
mod estimate;
mod group;
mod identify;
mod layout;
mod least_squares;
mod physical;
mod plant;
mod records;
mod regressor;
mod scheme;
mod ud;
mod words;

pub use batch::Adaptive;
pub use course::Courses;
pub(crate) use course::Plan;
pub use estimate::{Estimate, Window};
pub use identify::{Identifiability, identifiability};
pub use least_squares::LeastSquares;
pub use physical::solve_parameters;
pub use plant::{Prior, Reading, Settings, Structure, Tuning};
pub use records::{Records, run_records};
pub use regressor::{Column, FnRegressor, Regressor, Unknown};
