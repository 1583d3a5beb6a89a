//! What an observer says.

use faer::Mat;

/// What a window of measurements says: excitation, residuals, movement.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Its end, in seconds; NaN before the first is complete.
    pub t: f64,
    /// Condition of the excitation: largest over smallest eigenvalue of
    /// `sum phi' phi`, scaled to a unit diagonal. 1 is best; infinite where some
    /// combination of the parameters was not excited at all.
    pub condition: f64,
    /// Root mean square of the residuals `e_j / sqrt(R_j)` with the `theta_hat` before
    /// each sample.
    pub residual: f64,
    /// Largest change of a parameter over the window, relative to its size at the end
    /// or at the very start, whichever is larger.
    pub drift: f64,
}

impl Default for Window {
    fn default() -> Self {
        Self { t: f64::NAN, condition: f64::NAN, residual: f64::NAN, drift: f64::NAN }
    }
}

/// Estimates of an item with what is known of their quality.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// `theta_hat`.
    pub theta: Vec<f64>,
    /// Its standard deviations; NaN before the noise is known.
    pub std: Vec<f64>,
    /// Its correlation, p by p.
    pub correlation: Mat<f64>,
    /// Parameters that stand on a bound.
    pub at_bound: Vec<bool>,
    /// `x_hat`.
    pub x_hat: Vec<f64>,
    /// Standard deviations of `x_hat` as far as they come from `theta_hat`.
    pub x_std: Vec<f64>,
    /// The last complete window.
    pub window: Window,
    /// False for an item that cannot be used, or that ran away.
    pub sound: bool,
}

impl Estimate {
    /// True once `theta_hat` has moved by no more than `tolerance` (relative) over a
    /// whole window and stands on no bound.
    pub fn is_settled(&self, tolerance: f64) -> bool {
        self.sound && self.window.drift <= tolerance && !self.at_bound.contains(&true)
    }
}
