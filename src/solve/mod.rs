//! Riccati, Lyapunov and Sylvester equations, one at a time and in batches.

pub mod backend;
mod batch;
mod fallback;
pub(crate) mod lanes;
mod problem;
mod report;
mod riccati;

pub use problem::{Care, Dare, Lyapunov, Riccati, Sylvester};
pub use report::{ItemReport, Method, Solution, Solutions};
pub use riccati::{care, care_on, care_one, care_with, dare, dare_on, dare_one, dare_with};
