//! The engine: one bank of observers, one law of weights.
//!
//! ```text
//! predict    x_i <- A_i x_i + B_i u,          P_i <- A_i P_i A_i' + G_i Q_i G_i'
//! innovate   r_i = y - C_i x_i,               S_i = C_i P_i C_i' + R_i
//! weigh      ln p_i += ln N(r_i; 0, S_i),     or another law
//! fuse       x_hat = sum p_i x_i
//! ```
//!
//! [`Mmae::step`] does it for one measurement, [`Mmae::run`] for a record,
//! [`Mmae::run_arrays`] for many records at once, [`crate::sim::MonteCarlo`] for
//! trials that are simulated:
//!
//! ```
//! use mmae::bank::{Initial, Members, Settings, GainMode};
//! use mmae::engine::{Mmae, Weighting};
//! use mmae::model::{Plant, Time};
//! use mmae::observer::ObserverKind;
//! use mmae::{Mat, mat};
//! // a random walk whose steps have variance 1, 4 or 16, seen through unit noise
//! let walk = |q: f64| Plant {
//!     time: Time::Discrete { dt: 1.0 },
//!     A: mat![[1.0]], B: Mat::zeros(1, 0), G: mat![[1.0]], C: mat![[1.0]],
//!     Q: mat![[q]], R: mat![[1.0]],
//! };
//! let mut members = Members::new(ObserverKind::Kalman, [1.0, 4.0, 16.0].map(walk).to_vec());
//! members.initial = vec![Initial { x_hat: vec![0.0], P: Some(mat![[1.0]]) }];
//! let settings = Settings { gains: GainMode::Recursive, ..Settings::default() };
//! let mut mmae = Mmae::new(&members, &settings, &Weighting::default(), &[1.0, 1.0, 1.0])?;
//! for y in [0.2, -0.1, 0.3, 0.1, -0.2] {
//!     mmae.step(&[], &[y])?;
//! }
//! let estimate = mmae.estimate();
//! assert_eq!(estimate.best, Some(0)); // small steps explain it best
//! assert!((estimate.p.iter().sum::<f64>() - 1.0).abs() < 1e-14);
//! # Ok::<(), mmae::Error>(())
//! ```

mod arrays;
mod estimate;
mod lanes;
mod likelihood;
mod mixing;
mod mmae;
mod recentre;
mod record;
mod weighting;

pub use arrays::{Arrays, Courses};
pub use estimate::Estimate;
pub use mmae::Mmae;
pub use recentre::{Build, Move, Recentre, Recentred};
pub use record::Record;
pub use weighting::{Innovation, Mixing, Weighting};
