//! Lane types, run-time dispatch, and storage shaped for them.
//!
//! A block is [`LANES`] `f64`, one cache line on every CPU: the layout of data
//! and the results never depend on the machine. A [`Kernel`] is compiled once
//! per tier, and [`dispatch`] picks the fastest tier the CPU has, once per call.
//!
//! The lane types are private. Code outside meets them only as `T: Real` inside
//! a kernel that `dispatch` runs, so a lane value is itself the proof that the
//! CPU feature behind it was detected; `unsafe` stays in this module.
#![expect(unsafe_code, reason = "vector intrinsics and casts between blocks and lanes")]

mod array;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dispatch;
mod each;
mod grid;
mod prefetch;
mod storage;

pub use crate::real::Tier;
pub use dispatch::{Kernel, dispatch, dispatch_on};
pub(crate) use dispatch::{dispatch_twice, outline_scalar, outline_twice};
pub(crate) use each::exp_each;
pub(crate) use grid::{Grid, GridMut, Walk};
pub(crate) use prefetch::prefetch;
pub use storage::{Block, LANES, Panel, groups, load_group, store_group};
