//! The extension module `pymmae._core`: numbers in, numbers out. Names, labels and
//! documentation are in the Python files beside it.

mod adaptive;
mod arrays;
mod eip;
mod errors;
mod estimate;
mod grid;
mod guard;
mod observer;
mod pack;
mod record;
mod scenario;
mod solvers;
mod sweep;
mod table;
mod trials;

use pyo3::prelude::*;

/// The engine behind `pymmae`.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::adaptive::{adaptive_records, adaptive_trials};
    #[pymodule_export]
    use super::eip::{eip, place};
    #[pymodule_export]
    use super::estimate::{estimate, estimate_many};
    #[pymodule_export]
    use super::guard::{panic, wait};
    #[pymodule_export]
    use super::scenario::Scenario;
    #[pymodule_export]
    use super::solvers::{care, lyapunov, riccati_ode, sylvester, where_from};
    #[pymodule_export]
    use super::sweep::{blocks, complete, merge, shard};
    #[pymodule_export]
    use super::trials::trials;

    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("VERSION", env!("CARGO_PKG_VERSION"))?;
        module.add("CPU_TIER", mmae::real::Tier::best().name())
    }
}
