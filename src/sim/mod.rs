//! Simulation: the plant that is really there, noise, and many trials of a bank.
//!
//! ```text
//! x(k) = A x(k-1) + B u(k) + G w(k),   y(k) = C x(k) + v(k)      the truth, per trial
//! u(k+1) = K y(k) + u_ext(k+1)                                   its loop, see Truth
//! predict, innovate, weigh, fuse                                 the bank, per trial
//! mean p, fraction identified, sqrt(mean |x - x_hat|^2), ..      over all trials
//! ```
//!
//! Trials stand in lanes, eight at a time, and all models of a bank share the
//! measurements of each trial. Covariances and gains do not depend on the data:
//! their recursion runs once, until it repeats itself by bits. Where states are
//! mixed (interacting models, re-seeding) and for Dunn's differential equation
//! each trial goes through [`Mmae`](crate::engine::Mmae) by itself. With
//! [`Measurement::Continuous`] plant and continuous observers are integrated as
//! one system. [`AdaptiveTrials`] run an adaptive observer on a plant that is given by
//! its differential equation ([`Field`]).
//!
//! Random numbers are keyed by seed and trial ([`Streams`]), and sums are taken
//! in chunks of a fixed size in the order of the trials: results have the same
//! bits for any number of threads, and a trial is the same alone as among
//! others.

mod adaptive;
mod alone;
mod consistency;
mod field;
mod joint;
mod lanes;
mod moment;
mod monte_carlo;
mod quantile;
mod random;
mod recentring;
mod recorder;
mod signal;
mod tally;
mod truth;

pub use adaptive::{
    AdaptiveCourse, AdaptiveCourses, AdaptiveMoment, AdaptiveSummary, AdaptiveTrials,
};
pub use consistency::chi_square_band;
pub use field::{Field, FieldFn, Path};
pub use moment::{Moment, Summary};
pub use monte_carlo::{Measurement, MonteCarlo};
pub use quantile::LEVELS;
pub use random::{SplitMix64, Streams};
pub use recentring::{RecentringTrial, RecentringTrials, ValuesAt};
pub use signal::{Signal, Signals, Term, Wave};
pub use tally::Trajectory;
pub use truth::Truth;
