//! A bank of observers on one measurement stream, models in lanes.
//!
//! ```text
//! discrete     x <- A x + B u                 P <- A P A' + G Q G'
//!              r = y - C x                    S = C P C' + R,  K = P C' S^-1
//!              x <- x + K r                   P <- (I - K C) P (I - K C)' + K R K'
//!
//! continuous   x <- e^{F h} x + int_0^h e^{F s} ds (L y + B u),   F = A - L C
//! ```
//!
//! Matrices, states and covariances of all models are stored as structures of
//! arrays, eight models to a block. The covariances do not depend on the data:
//! [`Gains`] is the recursion that makes the coefficients of a step, [`Bank`]
//! applies them to the states. A step allocates nothing, but for the Riccati
//! equation of continuous observers until it has come to rest and when outputs go
//! missing or come back.

mod advance;
mod change;
mod continuous;
mod covariance;
mod filter;
mod gains;
mod matrices;
mod members;
mod schedule;
mod states;
mod stream;
mod tile;
mod wide;

pub(crate) use filter::by_size;
pub use gains::{Coefficients, GainMode, Gains, Settings};
pub(crate) use matrices::whitener;
pub use members::{Initial, Members, StartTime};
pub(crate) use schedule::Schedule;
pub(crate) use states::{Repeat, add_product, correct, innovate, propagate, whiten};
pub(crate) use stream::norm_factor;
pub use stream::{Bank, Step};
pub(crate) use tile::Tile;
