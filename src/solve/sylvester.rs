//! Sylvester equations: the public functions.

use faer::MatRef;

use crate::error::Result;
use crate::par::RunControl;
use crate::solve::batch;
use crate::solve::checks::Checks;
use crate::solve::lanes::Kind;
use crate::solve::linear::run;
use crate::solve::problem::Sylvester;
use crate::solve::report::{Solution, Solutions};

fn run_sylvester(
    kind: Kind,
    p: &Sylvester<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run(kind, p.fields()?, [p.n, p.m, p.len], (checks, None), control)
}

fn one_sylvester(
    kind: Kind,
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
    c: MatRef<'_, f64>,
) -> Result<Solution> {
    let (n, m) = (a.nrows(), b.nrows());
    batch::check_shape("A", a, [n, n])?;
    batch::check_shape("B", b, [m, m])?;
    batch::check_shape("C", c, [n, m])?;
    let (a, b, c) = (batch::rows_of(a), batch::rows_of(b), batch::rows_of(c));
    let problem = Sylvester { n, m, len: 1, A: &a, B: &b, C: &c };
    run_sylvester(kind, &problem, Checks::All, &RunControl::default().threads(1))?.into_one()
}

/// Solutions of a batch of continuous-time Sylvester equations.
///
/// ```text
/// A X + X B + C = 0
/// ```
///
/// The margin in the report is that of the less stable coefficient. Otherwise as
/// [`lyapunov_continuous`](crate::solve::lyapunov_continuous); not solvable where an eigenvalue of `A` and one of
/// `B` add up to zero. Shapes and layout in [`Sylvester`].
///
/// # Errors
/// As [`lyapunov_continuous`](crate::solve::lyapunov_continuous).
///
/// # Examples
/// ```
/// use mmae::solve::{Sylvester, sylvester_continuous};
/// let all = sylvester_continuous(&Sylvester {
///     n: 1, m: 2, len: 1, A: &[-1.0], B: &[-2.0, 0.0, 0.0, -3.0], C: &[6.0, 8.0],
/// })?;
/// assert_eq!(all.item(0)?, [2.0, 2.0]);
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn sylvester_continuous(problem: &Sylvester<'_>) -> Result<Solutions> {
    run_sylvester(Kind::Continuous, problem, Checks::All, &RunControl::default())
}

/// As [`sylvester_continuous`], with a choice of [`Checks`], threads, progress and
/// cancelling.
///
/// # Errors
/// As [`sylvester_continuous`], and `Cancelled`.
pub fn sylvester_continuous_with(
    problem: &Sylvester<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run_sylvester(Kind::Continuous, problem, checks, control)
}

/// Solution of one continuous-time Sylvester equation, see
/// [`sylvester_continuous`].
///
/// ```text
/// A X + X B + C = 0,    A n by n, B m by m, C and X n by m
/// ```
///
/// # Errors
/// As [`sylvester_continuous`]; those of the item too.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::sylvester_continuous_one};
/// let (a, b) = (mat![[-1.0, 2.0], [0.0, -3.0]], mat![[-2.0]]);
/// let c = mat![[1.0], [5.0]];
/// let x = sylvester_continuous_one(a.as_ref(), b.as_ref(), c.as_ref())?.X;
/// assert!((&a * &x + &x * &b + &c).norm_l2() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub fn sylvester_continuous_one(
    A: MatRef<'_, f64>,
    B: MatRef<'_, f64>,
    C: MatRef<'_, f64>,
) -> Result<Solution> {
    one_sylvester(Kind::Continuous, A, B, C)
}

/// Solutions of a batch of discrete-time Sylvester equations.
///
/// ```text
/// A X B - X + C = 0
/// ```
///
/// Otherwise as [`sylvester_continuous`]; not solvable where an eigenvalue of `A`
/// is the reciprocal of one of `B`.
///
/// # Errors
/// As [`sylvester_continuous`].
///
/// # Examples
/// ```
/// use mmae::solve::{Sylvester, sylvester_discrete};
/// let all = sylvester_discrete(&Sylvester {
///     n: 1, m: 1, len: 1, A: &[0.5], B: &[-0.5], C: &[5.0],
/// })?;
/// assert_eq!(all.item(0)?, [4.0]);
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn sylvester_discrete(problem: &Sylvester<'_>) -> Result<Solutions> {
    run_sylvester(Kind::Discrete, problem, Checks::All, &RunControl::default())
}

/// As [`sylvester_discrete`], with a choice of [`Checks`], threads, progress and
/// cancelling.
///
/// # Errors
/// As [`sylvester_discrete`], and `Cancelled`.
pub fn sylvester_discrete_with(
    problem: &Sylvester<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run_sylvester(Kind::Discrete, problem, checks, control)
}

/// Solution of one discrete-time Sylvester equation, see [`sylvester_discrete`].
///
/// ```text
/// A X B - X + C = 0,    A n by n, B m by m, C and X n by m
/// ```
///
/// # Errors
/// As [`sylvester_discrete`]; those of the item too.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::sylvester_discrete_one};
/// let (a, b) = (mat![[0.5, 2.0], [0.0, -0.3]], mat![[-0.2]]);
/// let c = mat![[1.0], [5.0]];
/// let x = sylvester_discrete_one(a.as_ref(), b.as_ref(), c.as_ref())?.X;
/// assert!((&a * &x * &b - &x + &c).norm_l2() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub fn sylvester_discrete_one(
    A: MatRef<'_, f64>,
    B: MatRef<'_, f64>,
    C: MatRef<'_, f64>,
) -> Result<Solution> {
    one_sylvester(Kind::Discrete, A, B, C)
}
