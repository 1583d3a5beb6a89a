//! Observers: a design model in, gain, `P` and `S` out.
//!
//! ```text
//! continuous   xhat' = A xhat + B u + L (y - C xhat),            L = P C' R^-1
//! discrete     xhat+ = A xhat + B u + L (y - C xhat),            L = A K
//!              xhat(k|k) = xhat + K (y - C xhat),                K = P C' S^-1
//! ```
//!
//! The design model may differ from the plant that is observed: leave out the
//! state of the shaping filter, or change `Q` and `R`, before designing.

mod design;
mod model_set;

pub use design::{Observer, design, design_with};
pub use model_set::ModelSet;

/// Which observer a bank runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObserverKind {
    /// Steady-state Kalman-Bucy filter (continuous time).
    KalmanBucy,
    /// Krener's min-max observer: the same equations, `Q` and `R` as weights.
    Krener,
    /// Steady-state discrete Kalman filter.
    Kalman,
}

impl ObserverKind {
    /// True for observers in continuous time.
    pub fn is_continuous(self) -> bool {
        self != ObserverKind::Kalman
    }

    /// The name as a sentence has it.
    pub fn name(self) -> &'static str {
        match self {
            ObserverKind::KalmanBucy => "Kalman-Bucy filter",
            ObserverKind::Krener => "Krener observer",
            ObserverKind::Kalman => "Kalman filter",
        }
    }
}
