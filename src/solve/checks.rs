//! What is found out about a solution beside the solution.

/// How much is found out about every solution of a batch.
///
/// Whatever is asked for, every item is checked to be finite and symmetric, and
/// (but for linear equations) proved to be the stabilizing solution. Its residual
/// and condition bound its error; beyond 1e-13 it is corrected, with residuals in
/// twice the working precision. `residual`, `correction` and `margin` of the report
/// are always there.
///
/// # Examples
/// ```
/// use mmae::{par::RunControl, solve::{Care, Checks, care_with}};
/// let p = Care { n: 1, m: 1, len: 1, A: &[0.0], B: &[1.0], Q: &[4.0], R: &[1.0], S: None };
/// let all = care_with(&p, Checks::Stability, &RunControl::default())?;
/// assert!((all.item(0)?[0] - 2.0).abs() < 1e-15 && all.items[0].margin > 0.0);
/// assert_eq!(all.items[0].error_bound, None);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Checks {
    /// Everything: also a bound on the error and the condition, and with them
    /// another correction where more than rounding may be left.
    #[default]
    All,
    /// Stability only: `error_bound` and `condition` are `None`, and `reliable`
    /// knows nothing of them. Saves a tenth of the time where an item needs more
    /// than one correction, nothing elsewhere.
    Stability,
}
