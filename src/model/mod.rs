//! Plants, families of plants, grids of parameters and the systems they form.
//!
//! ```text
//! x' = A x + B u + G w,   y = C x + v,   E[w w'] = Q,  E[v v'] = R
//! ```
//!
//! in continuous time (`Q`, `R` are intensities) or, with `x'` read as
//! `x(k+1)`, in discrete time (`Q`, `R` are covariances).

mod check;
mod close;
mod discretize;
mod family;
mod grid;
mod loop_block;
mod plant;
mod shaping;
pub mod systems;
mod unmodelled;

pub(crate) use check::{check_count, check_signals};
pub use check::{check_covariance, check_finite, check_shape};
pub(crate) use close::{Around, Closing, psd_factor};
pub use discretize::{DelayLine, Sampled, pade_delay, sample, van_loan};
pub(crate) use discretize::{Taps, sample_taps};
pub use family::{Family, FnFamily, Parameter, describe};
pub use grid::{Axis, Grid};
pub use loop_block::{DelayForm, Delayed, LoopBlock, Surroundings, block_states};
pub use plant::{Controller, Names, Plant, Time};
pub use shaping::Shaping;
pub use unmodelled::ActuatorBound;
