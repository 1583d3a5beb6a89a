//! The guide: how the crate is built, what it computes, how to use it.

#[doc = include_str!("architecture.md")]
pub mod architecture {}

#[doc = include_str!("command.md")]
pub mod command {}

#[doc = include_str!("eip.md")]
pub mod eip {}

#[doc = include_str!("notation.md")]
pub mod notation {}

#[doc = include_str!("results.md")]
pub mod results {}

#[doc = include_str!("scenario.md")]
pub mod scenario {}
