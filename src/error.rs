//! What can go wrong, one variant a cause; every message ends with the remedy.

use std::fmt;

/// Result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A point of the complex plane, as messages print it: `-0.43 + 0.59i`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eigenvalue {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

impl fmt::Display for Eigenvalue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.im == 0.0 {
            write!(f, "{:.6}", self.re)
        } else {
            let sign = if self.im < 0.0 { '-' } else { '+' };
            write!(f, "{:.6} {sign} {:.6}i", self.re, self.im.abs())
        }
    }
}

/// Bad input or an unsolvable problem.
///
/// Sizes are `[rows, columns]`; `what` names the argument with the letter that
/// the documentation of the failing function uses.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Something that needs at least one element has none.
    #[error("{what} is empty: give at least one")]
    Empty {
        /// The empty argument.
        what: String,
    },
    /// A matrix has the wrong size.
    #[error("{what} is {}x{}, wanted {}x{}: check the order of rows and columns", got[0], got[1], want[0], want[1])]
    Shape {
        /// The argument.
        what: String,
        /// Wanted rows and columns.
        want: [usize; 2],
        /// Given rows and columns.
        got: [usize; 2],
    },
    /// An entry is NaN or infinite.
    #[error("{what}[{row}][{col}] is not a finite number: check how it was computed")]
    NonFinite {
        /// The argument.
        what: String,
        /// Row of the first offending entry.
        row: usize,
        /// Its column.
        col: usize,
    },
    /// A matrix that must be symmetric is not.
    #[error(
        "{what} is not symmetric (relative difference {relative:.3e}): pass ({what} + {what}')/2 if that is what you mean"
    )]
    NotSymmetric {
        /// The argument.
        what: String,
        /// Largest difference across the diagonal over the largest entry.
        relative: f64,
    },
    /// A covariance or intensity has a negative eigenvalue.
    #[error(
        "{what} is not positive semidefinite (smallest eigenvalue {min_eig:.3e}): a covariance cannot be negative in any direction"
    )]
    NotPsd {
        /// The argument.
        what: String,
        /// The smallest eigenvalue.
        min_eig: f64,
    },
    /// A matrix that must be invertible and positive is not.
    #[error(
        "{what} is not positive definite: every measured channel needs noise; raise its diagonal"
    )]
    NotPositiveDefinite {
        /// The argument.
        what: String,
    },
    /// A mode that the output does not see and that does not decay.
    #[error(
        "mode {eigenvalue} ({states}) is not detectable from the output: measure it, or drop it from the model"
    )]
    Undetectable {
        /// The eigenvalue of `A`.
        eigenvalue: Eigenvalue,
        /// States that dominate the mode, by name.
        states: String,
    },
    /// A mode that the output does not see, whether it decays or not.
    #[error(
        "mode {eigenvalue} ({states}) is not observable from the output: measure it, or drop it from the plant"
    )]
    NotObservable {
        /// The eigenvalue of `A`.
        eigenvalue: Eigenvalue,
        /// States that dominate the mode, by name.
        states: String,
    },
    /// An observer gain whose error does not decay.
    #[error(
        "A - K C has the mode {eigenvalue}, which does not decay: {}",
        sign_of_gain(*opposite)
    )]
    ObserverUnstable {
        /// The eigenvalue of `A - K C` of largest real part.
        eigenvalue: Eigenvalue,
        /// True if `A + K C` is stable.
        opposite: bool,
    },
    /// Parameters that no output can tell apart.
    #[error(
        "only {rank} of {parameters} combinations of the parameters can be identified from the output: {directions}: fix as many parameters as there are directions, or write the plant in an observer canonical form"
    )]
    NotIdentifiable {
        /// Combinations that can be identified.
        rank: usize,
        /// Parameters asked for.
        parameters: usize,
        /// What leaves the output unchanged, in words.
        directions: String,
    },
    /// A mode that the noise does not reach and that does not decay.
    #[error(
        "mode {eigenvalue} ({states}) is not stabilizable through the noise input: give it a disturbance, or drop it from the model"
    )]
    Unstabilizable {
        /// The eigenvalue of `A`.
        eigenvalue: Eigenvalue,
        /// States that dominate the mode, by name.
        states: String,
    },
    /// A Riccati equation without a stabilizing solution that could be verified.
    #[error(
        "{what}: no stabilizing solution was found ({}): check detectability, stabilizability and the scale of the weights",
        reached(*residual, *iterations)
    )]
    NoStabilizingSolution {
        /// The equation.
        what: String,
        /// Relative residual reached; NaN if no attempt came to a residual.
        residual: f64,
        /// Iterations spent.
        iterations: u32,
    },
    /// A Riccati equation with a mode that does not decay and that the input does
    /// not reach.
    #[error(
        "{what}: mode {eigenvalue} ({states}) is not stabilizable through B (in filter form: not detectable through C): act on it, or drop it from the model"
    )]
    NotStabilizable {
        /// The equation.
        what: String,
        /// The eigenvalue of `A`.
        eigenvalue: Eigenvalue,
        /// States that dominate the mode.
        states: String,
    },
    /// A Riccati equation with a mode on the boundary of stability that the
    /// weight does not see.
    #[error(
        "{what}: mode {eigenvalue} ({states}) on the boundary of stability is not detectable through Q (in filter form: not reached by the noise): weigh it, or drop it from the model"
    )]
    NotDetectable {
        /// The equation.
        what: String,
        /// The eigenvalue of `A`.
        eigenvalue: Eigenvalue,
        /// States that dominate the mode.
        states: String,
    },
    /// The solution of a Riccati differential equation that becomes infinite.
    #[error(
        "{what}: the solution leaves the finite within the step {h:.3e}: shorten the step, or make the weights positive semidefinite"
    )]
    FiniteEscape {
        /// The equation.
        what: String,
        /// The step, in seconds.
        h: f64,
    },
    /// A matrix that must be inverted is singular.
    #[error("{what} is singular to working precision: check for redundant states or equations")]
    Singular {
        /// The matrix.
        what: String,
    },
    /// A Lyapunov or Sylvester equation whose coefficient is not stable.
    #[error(
        "{what}: the coefficient is not stable, so the stationary covariance does not exist: stabilise the system first"
    )]
    NotStable {
        /// The equation.
        what: String,
    },
    /// A linear matrix equation without a unique solution.
    #[error(
        "{what}: no unique solution{}: two eigenvalues add up to zero, or are reciprocal in discrete time; change a coefficient",
        last_correction(*correction)
    )]
    NoUniqueSolution {
        /// The equation.
        what: String,
        /// What a correction of the best attempt still changed, relative to it;
        /// NaN if there was none.
        correction: f64,
    },
    /// A plant whose loop is unstable has no stationary output error.
    #[error(
        "plant {index} ({parameters}) is unstable in its loop (mode {mode}): narrow the grid, or change the controller"
    )]
    UnstablePlant {
        /// Index on the grid.
        index: usize,
        /// Parameter values, printed.
        parameters: String,
        /// The eigenvalue of largest real part (modulus in discrete time).
        mode: Eigenvalue,
    },
    /// A model of the bank that cannot be used.
    #[error("model {index} ({parameters}): {source}")]
    Model {
        /// Index in the bank, from 0.
        index: usize,
        /// Parameter values, printed.
        parameters: String,
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// Nothing is left to work with: every model, or every plant, failed.
    #[error("none of the {count} {what} can be used; the first: {source}")]
    AllFailed {
        /// `models` or `plants`.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// Why the first cannot be used.
        source: Box<Error>,
    },
    /// A family that cannot be evaluated at some parameter value.
    #[error("plant at {parameters}: {source}")]
    Plant {
        /// Parameter values, printed.
        parameters: String,
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// A parameter name that the family does not have.
    #[error("no parameter is called '{name}': the family has {known}")]
    UnknownParameter {
        /// The name asked for.
        name: String,
        /// The names there are, comma-separated.
        known: String,
    },
    /// A sampling interval that is not a positive number.
    #[error("sampling interval {dt} must be positive and finite")]
    InvalidDt {
        /// The interval, in seconds.
        dt: f64,
    },
    /// A value outside its range.
    #[error("{what} = {value} is out of range: {remedy}")]
    Range {
        /// The argument.
        what: String,
        /// Its value.
        value: f64,
        /// What is allowed.
        remedy: String,
    },
    /// Two settings that exclude each other, or one that is missing.
    #[error("{problem}: {remedy}")]
    Conflict {
        /// What does not fit together.
        problem: String,
        /// What to change.
        remedy: String,
    },
    /// A run that would not fit in memory; nothing was allocated.
    #[error("{what} needs {bytes} bytes, over the limit of {limit}: {remedy}")]
    Limit {
        /// What is too large.
        what: String,
        /// Bytes needed (saturating).
        bytes: u128,
        /// The limit in force.
        limit: u128,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The quadrature did not reach its tolerance.
    #[error(
        "{what}: the frequency integral did not converge (error estimate {error:.3e} after {evaluations} evaluations): loosen the tolerance, or check for poles on the axis"
    )]
    Quadrature {
        /// Which plant and model.
        what: String,
        /// The error estimate reached.
        error: f64,
        /// Integrand evaluations spent.
        evaluations: usize,
    },
    /// The caller asked to stop.
    #[error("cancelled: nothing was written")]
    Cancelled,
}

/// How far the search for a Riccati solution came.
fn reached(residual: f64, iterations: u32) -> String {
    if residual.is_finite() {
        format!("relative residual {residual:.3e} after {iterations} iterations")
    } else {
        format!("the iteration broke down after {iterations} steps, before it came to a residual")
    }
}

/// What to do about an observer that is not stable.
fn sign_of_gain(opposite: bool) -> &'static str {
    if opposite {
        "K acts on y - y_hat here, and A + K C is stable: turn the sign of K (Liu and Peng print that of their example 4.1 the other way round)"
    } else {
        "place the eigenvalues of A - K C in the left half-plane"
    }
}

/// What a correction of a linear equation still changed, if there was one.
fn last_correction(correction: f64) -> String {
    if correction.is_finite() {
        format!(" (relative correction {correction:.1e})")
    } else {
        String::new()
    }
}

impl Error {
    /// A short name of the cause for programs, stable across versions:
    /// `not_detectable`, `no_convergence` and so on. Errors of a model or plant
    /// have the code of their cause.
    pub fn code(&self) -> &'static str {
        match self {
            Error::Empty { .. } => "empty",
            Error::Shape { .. } => "shape",
            Error::NonFinite { .. } => "not_finite",
            Error::NotSymmetric { .. } => "not_symmetric",
            Error::NotPsd { .. } => "not_positive_semidefinite",
            Error::NotPositiveDefinite { .. } => "not_positive_definite",
            Error::Undetectable { .. } | Error::NotDetectable { .. } => "not_detectable",
            Error::Unstabilizable { .. } | Error::NotStabilizable { .. } => "not_stabilizable",
            Error::NotObservable { .. } => "not_observable",
            Error::ObserverUnstable { .. } => "observer_unstable",
            Error::NotIdentifiable { .. } => "not_identifiable",
            Error::FiniteEscape { .. } => "finite_escape",
            Error::NoStabilizingSolution { .. } => "no_stabilizing_solution",
            Error::Singular { .. } => "singular",
            Error::NotStable { .. } => "not_stable",
            Error::NoUniqueSolution { .. } => "no_unique_solution",
            Error::UnstablePlant { .. } => "unstable_plant",
            Error::AllFailed { .. } => "all_failed",
            Error::Model { source, .. } | Error::Plant { source, .. } => source.code(),
            Error::UnknownParameter { .. } => "unknown_parameter",
            Error::InvalidDt { .. } => "invalid_dt",
            Error::Range { .. } => "range",
            Error::Conflict { .. } => "conflict",
            Error::Limit { .. } => "limit",
            Error::Quadrature { .. } => "quadrature",
            Error::Cancelled => "cancelled",
        }
    }
}
