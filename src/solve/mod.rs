//! Riccati, Lyapunov and Sylvester equations, one at a time and in batches.

pub mod backend;
mod batch;
mod checks;
mod explain;
mod fallback;
mod kronecker;
#[allow(dead_code, unused_imports, reason = "a toolbox: not every equation is in use")]
pub(crate) mod lanes;
mod linear;
mod lyapunov;
mod modes;
mod problem;
mod report;
mod riccati;
mod riccati_ode;
mod sylvester;

pub use checks::Checks;
pub use lyapunov::{
    lyapunov_continuous, lyapunov_continuous_one, lyapunov_continuous_with, lyapunov_discrete,
    lyapunov_discrete_one, lyapunov_discrete_with,
};
pub use modes::{Mode, Region, least_stable_mode, unseen_mode};
pub use problem::{Care, Dare, Lyapunov, Riccati, RiccatiOde, Sylvester};
pub use report::{ItemReport, Method, Solution, Solutions};
pub use riccati::{care, care_one, care_with, dare, dare_one, dare_with};
pub use riccati_ode::{riccati_ode, riccati_ode_one, riccati_ode_with};
pub use sylvester::{
    sylvester_continuous, sylvester_continuous_one, sylvester_continuous_with, sylvester_discrete,
    sylvester_discrete_one, sylvester_discrete_with,
};

#[cfg(test)]
mod tests;
