//! The guide: how the crate is built, what it computes, how to use it.

#[cfg(feature = "scenario")]
#[doc = include_str!("adaptive.md")]
pub mod adaptive {}

#[doc = include_str!("architecture.md")]
pub mod architecture {}

#[cfg(feature = "cli")]
#[doc = include_str!("command.md")]
pub mod command {}

#[doc = include_str!("eip.md")]
pub mod eip {}

#[doc = include_str!("notation.md")]
pub mod notation {}

#[doc = include_str!("python.md")]
pub mod python {}

#[cfg(feature = "cli")]
#[doc = include_str!("results.md")]
pub mod results {}

#[cfg(feature = "scenario")]
#[doc = include_str!("scenario.md")]
pub mod scenario {}

#[doc = include_str!("solvers.md")]
pub mod solvers {}
