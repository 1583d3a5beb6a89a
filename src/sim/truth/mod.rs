//! The plant that is really there, in its loop, simulated for eight trials at
//! once.
//!
//! ```text
//! continuous, k = 1, 2, .., at t = (k-1) dt
//!     y   = C x + v                                  cov(v) = R / dt
//!     u   = C_K x_K + D_K y + u_ext                  what the observers are told
//!     x_K <- A_K x_K + B_K y
//!     x   <- A x + B0 u(k-d) + B1 u(k-d-1) + w       d samples of delay, and a part
//!
//! discrete, from x(k-1) to x(k)
//!     u   = f + u_ext,   f = 0 before the first measurement
//!     x   <- A x + B u(k-d) + G w,   y = C x + v
//!     f   = C_K x_K + D_K y,   x_K <- A_K x_K + B_K y
//! ```
//!
//! Continuous plants, controllers and filters are sampled exactly for signals
//! that are held over an interval. `u_ext` is the sum of the known signals and of
//! the output `C_r x_r` of the input filter, `x_r <- A_r x_r + w_r`, `x_r = 0` at
//! the start. Commands before the start are zero. Known disturbances are held over
//! a step like inputs.
//!
//! In step `k`, from 1, a known signal has the value that is held from `(k-1) dt`
//! on. White noise in it has the variance of its intensity over `dt` as an input
//! (in discrete time of its intensity); as a disturbance and as measurement noise
//! it takes the place of the channel's own `Q` and `R`.

mod course;
mod source;
mod walk;

use faer::Mat;

use super::signal::Signals;
use crate::model::{Controller, Plant, Shaping};

pub(super) use source::{Source, Timing, spread, start};
pub(super) use walk::{AHEAD, Walk, add_product};

/// The plant of a simulation, one or several after each other, and its loop.
///
/// ```text
/// x <- A x + B u + G w,   y = C x + v,   cov(w) = Q,  cov(v) = R
/// u = K y + u_ext
/// ```
/// A continuous plant is sampled exactly; its measurement noise is held between
/// two measurements, `cov(v) = R / dt`, and so are `y` for the controller and
/// `u`. A discrete plant moves to `x(k)` with the command that follows from
/// `y(k-1)`; before the first measurement the controller gives nothing.
///
/// ```
/// use mmae::model::{Controller, Family, systems};
/// use mmae::sim::Truth;
/// use mmae::{Mat, mat};
/// let family = systems::pendulum();
/// let plant = family.plant(&family.theta_with(&[("L", 1.4)])?)?;
/// let gain = Controller {
///     A: Mat::zeros(0, 0),
///     B: Mat::zeros(0, 2),
///     C: Mat::zeros(1, 0),
///     D: mat![[1.0, 45.0]],
/// };
/// let truth = Truth { controller: Some(gain), delay: 0.002, ..Truth::new(plant) };
/// assert_eq!(truth.x0, [0.0; 4]);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Truth {
    /// Plants of one size with the number of the first step that each makes; the
    /// first plant is there from the start, whatever its number. A disturbance
    /// filter is part of them ([`Plant::with_disturbance`]).
    pub phases: Vec<(u64, Plant)>,
    /// State at the start.
    pub x0: Vec<f64>,
    /// Covariance of the state at the start, n by n; `None` if it is known.
    pub P0: Option<Mat<f64>>,
    /// Feedback from `y` to `u`, in the time of the plant; it starts at rest.
    pub controller: Option<Controller>,
    /// Filter whose output is added to `u`, in the time of the plant, another
    /// course in every trial. It starts at rest.
    pub input: Option<Shaping>,
    /// Seconds from the command to the plant, the same for all inputs; whole
    /// samples of a discrete plant. The observers see the command at once.
    pub delay: f64,
    /// Known functions of time: inputs, disturbances and measurement noise.
    pub signals: Signals,
}

impl Truth {
    /// One plant that starts at rest at `x = 0`, without a loop.
    pub fn new(plant: Plant) -> Self {
        Self {
            x0: vec![0.0; plant.nx()],
            phases: vec![(0, plant)],
            P0: None,
            controller: None,
            input: None,
            delay: 0.0,
            signals: Signals::default(),
        }
    }
}
