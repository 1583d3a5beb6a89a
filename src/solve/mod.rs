//! Riccati, Lyapunov and Sylvester equations, one at a time and in batches.

pub mod backend;
#[allow(dead_code, reason = "the linear equations come next")]
mod batch;
mod fallback;
#[allow(dead_code, unused_imports, reason = "the linear equations that use the rest come next")]
pub(crate) mod lanes;
mod modes;
#[allow(dead_code, reason = "the linear equations come next")]
mod problem;
mod report;
mod riccati;

pub use modes::{Mode, Region, least_stable_mode, unseen_mode};
pub use problem::{Care, Dare, Lyapunov, Riccati, Sylvester};
pub use report::{ItemReport, Method, Solution, Solutions};
pub use riccati::{care, care_on, care_one, care_with, dare, dare_on, dare_one, dare_with};
