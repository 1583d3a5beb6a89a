//! Lyapunov equations: the public functions.

use faer::MatRef;

use crate::error::Result;
use crate::par::RunControl;
use crate::solve::batch;
use crate::solve::checks::Checks;
use crate::solve::lanes::Kind;
use crate::solve::linear::run;
use crate::solve::problem::Lyapunov;
use crate::solve::report::{Solution, Solutions};

fn run_lyapunov(
    kind: Kind,
    p: &Lyapunov<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run(kind, p.fields()?, [p.n, p.n, p.len], (checks, None), control)
}

fn one_lyapunov(kind: Kind, a: MatRef<'_, f64>, q: MatRef<'_, f64>) -> Result<Solution> {
    let n = a.nrows();
    batch::check_shape("A", a, [n, n])?;
    batch::check_shape("Q", q, [n, n])?;
    let (a, q) = (batch::rows_of(a), batch::rows_of(q));
    let problem = Lyapunov { n, len: 1, A: &a, Q: &q };
    run_lyapunov(kind, &problem, Checks::All, &RunControl::default().threads(1))?.into_one()
}

/// Solutions of a batch of continuous-time Lyapunov equations.
///
/// ```text
/// A X + X A' + Q = 0
/// ```
///
/// `X` is the stationary covariance of `dx/dt = A x + w`, `w` white of intensity
/// `Q`, where `A` is stable: look at the margin of the report. For an `A` that is
/// not stable the equation is solved all the same (its margin is NaN), unless two
/// eigenvalues add up to zero. Shapes and layout in [`Lyapunov`]. Item `k` has
/// the same bits alone and in any batch, on any CPU and with any number of
/// threads.
///
/// # Source
/// Smith (1968), SIAM J. Appl. Math. 16, 198-201, squared, after a Cayley
/// transform; corrected with the residual in twice the working precision.
///
/// # Errors
/// `Shape` for arrays of a wrong length, `Empty` for no item or order zero. What
/// is wrong with an item is in its report: `NonFinite`, `NotSymmetric`,
/// `NoUniqueSolution`.
///
/// # Examples
/// ```
/// use mmae::solve::{Lyapunov, lyapunov_continuous};
/// // One A, two right-hand sides
/// let all = lyapunov_continuous(&Lyapunov {
///     n: 2, len: 2,
///     A: &[0.0, 1.0, -4.0, -0.4],
///     Q: &[0.0, 0.0, 0.0, 1.6,   1.0, 0.0, 0.0, 0.0],
/// })?;
/// let x = all.item(0)?;   // [w / (2 d w0^2), 0; 0, w / (2 d)] of an oscillator
/// assert!((x[0] - 0.5).abs() < 1e-15 && x[1].abs() < 1e-15 && (x[3] - 2.0).abs() < 1e-15);
/// let margin = all.items[0].margin;   // a proved bound: both modes decay at 0.2
/// assert!(margin > 0.0 && margin <= 0.2 * (1.0 + 1e-12));
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn lyapunov_continuous(problem: &Lyapunov<'_>) -> Result<Solutions> {
    run_lyapunov(Kind::Continuous, problem, Checks::All, &RunControl::default())
}

/// As [`lyapunov_continuous`], with a choice of [`Checks`], threads, progress and
/// cancelling.
///
/// # Errors
/// As [`lyapunov_continuous`], and `Cancelled`.
pub fn lyapunov_continuous_with(
    problem: &Lyapunov<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run_lyapunov(Kind::Continuous, problem, checks, control)
}

/// Solution of one continuous-time Lyapunov equation, see
/// [`lyapunov_continuous`].
///
/// ```text
/// A X + X A' + Q = 0,    A, Q, X n by n, Q symmetric
/// ```
///
/// # Errors
/// As [`lyapunov_continuous`]; those of the item too.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::lyapunov_continuous_one};
/// let a = mat![[-1.0, 5.0], [0.0, -3.0]];
/// let q = mat![[2.0, 1.0], [1.0, 4.0]];
/// let x = lyapunov_continuous_one(a.as_ref(), q.as_ref())?.X;
/// assert!((&a * &x + &x * a.transpose() + &q).norm_l2() < 1e-14);
/// # Ok::<(), mmae::Error>(())
/// ```
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub fn lyapunov_continuous_one(A: MatRef<'_, f64>, Q: MatRef<'_, f64>) -> Result<Solution> {
    one_lyapunov(Kind::Continuous, A, Q)
}

/// Solutions of a batch of discrete-time Lyapunov (Stein) equations.
///
/// ```text
/// A X A' - X + Q = 0
/// ```
///
/// Otherwise as [`lyapunov_continuous`]; not solvable where two eigenvalues are
/// reciprocal.
///
/// # Errors
/// As [`lyapunov_continuous`].
///
/// # Examples
/// ```
/// use mmae::solve::{Lyapunov, lyapunov_discrete};
/// // x+ = a x + w: X = q / (1 - a^2)
/// let all = lyapunov_discrete(&Lyapunov { n: 1, len: 2, A: &[0.5, 0.9], Q: &[1.0] })?;
/// assert!((all.item(0)?[0] - 4.0 / 3.0).abs() < 1e-15);
/// assert!((all.item(1)?[0] * (1.0 - 0.81) - 1.0).abs() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn lyapunov_discrete(problem: &Lyapunov<'_>) -> Result<Solutions> {
    run_lyapunov(Kind::Discrete, problem, Checks::All, &RunControl::default())
}

/// As [`lyapunov_discrete`], with a choice of [`Checks`], threads, progress and
/// cancelling.
///
/// # Errors
/// As [`lyapunov_discrete`], and `Cancelled`.
pub fn lyapunov_discrete_with(
    problem: &Lyapunov<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run_lyapunov(Kind::Discrete, problem, checks, control)
}

/// Solution of one discrete-time Lyapunov equation, see [`lyapunov_discrete`].
///
/// ```text
/// A X A' - X + Q = 0,    A, Q, X n by n, Q symmetric
/// ```
///
/// # Errors
/// As [`lyapunov_discrete`]; those of the item too.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::lyapunov_discrete_one};
/// let a = mat![[0.5, 1.0], [0.0, -0.8]];
/// let q = mat![[1.0, 0.0], [0.0, 1.0]];
/// let x = lyapunov_discrete_one(a.as_ref(), q.as_ref())?.X;
/// assert!((&a * &x * a.transpose() - &x + &q).norm_l2() < 1e-14);
/// # Ok::<(), mmae::Error>(())
/// ```
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub fn lyapunov_discrete_one(A: MatRef<'_, f64>, Q: MatRef<'_, f64>) -> Result<Solution> {
    one_lyapunov(Kind::Discrete, A, Q)
}
