//! Observers: a design model in, gain, `P` and `S` out.

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
