//! Lyapunov and Sylvester equations: the public functions.

use faer::{Mat, MatRef};

use crate::error::{Eigenvalue, Error, Result};
use crate::par::RunControl;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, Tier, dispatch_twice};
use crate::solve::backend::eigenvalues;
use crate::solve::batch::{
    self, Equation, Substitute, gather, half_unit, lanes_of, launch, minus_unit, scatter, zero,
};
use crate::solve::checks::Checks;
use crate::solve::kronecker;
use crate::solve::lanes::{Kind, Linear};
use crate::solve::problem::{Field, Lyapunov, Sylvester};
use crate::solve::report::{ItemReport, Method, Solution, Solutions, judged};

/// The checked problem: `A C` of a Lyapunov equation, `A B C` of a Sylvester
/// equation.
struct Batch<'a> {
    kind: Kind,
    n: usize,
    m: usize,
    fields: Vec<Field<'a>>,
    bounds: bool,
    tier: Option<Tier>,
}

/// A range of items in lanes.
struct Chunk<'a> {
    batch: &'a Batch<'a>,
    first: usize,
    bad: &'a [bool],
    x: &'a mut [f64],
}

impl Kernel for Chunk<'_> {
    type Out = Vec<ItemReport>;
    #[inline(always)]
    fn run<T: Real>(self) -> Vec<ItemReport> {
        let Chunk { batch, first, bad, x } = self;
        let mut block = batch.block::<T>();
        let mut reports = Vec::with_capacity(bad.len());
        for start in (0..bad.len()).step_by(T::LANES) {
            batch.load(&lanes_of(first, start, bad), &mut block);
            block.solve();
            let (lanes, size) = (T::LANES.min(bad.len() - start), block.x.len());
            scatter(&block.x, &mut x[start * size..][..lanes * size]);
            for lane in 0..lanes {
                reports.push(batch.read(&block, lane, Method::Doubling));
            }
        }
        // Coefficients that are not stable, or nearly so, or far from normal.
        for (local, report) in reports.iter_mut().enumerate() {
            let size = block.x.len();
            for route in Route::ALL {
                if report.status.is_ok() || bad[local] {
                    break;
                }
                let x = &mut x[local * size..][..size];
                let again = dispatch_twice(Single { batch, item: first + local, route, x });
                let iterations = report.iterations + again.iterations;
                *report = ItemReport { iterations, ..again };
                let shaky = report.condition.is_none_or(|c| c > SHAKY);
                if report.status.is_ok() && shaky && batch.is_singular(first + local) {
                    report.status = Err(batch.no_unique_solution(report.correction));
                    break;
                }
            }
        }
        reports
    }
}

/// A condition beyond which the eigenvalues are looked at: rounding may hide that
/// two of them add up to zero.
const SHAKY: f64 = 1e11;
/// Relative distance below which two eigenvalues count as adding up to zero.
const MEET: f64 = 1e-11;

/// How an item is tried again.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Route {
    /// LU of the whole system, corrected.
    System,
    /// Smith sums in twice the precision.
    Sum,
    /// LU of the whole system in twice the precision.
    SystemTwice,
}

impl Route {
    const ALL: [Route; 3] = [Route::System, Route::Sum, Route::SystemTwice];
}

/// One item in twice the precision.
struct Single<'a> {
    batch: &'a Batch<'a>,
    item: usize,
    route: Route,
    x: &'a mut [f64],
}

impl Kernel for Single<'_> {
    type Out = ItemReport;
    #[inline(always)]
    fn run<T: Real>(self) -> ItemReport {
        let Single { batch, item, route, x } = self;
        let (kind, symmetric, size) = (batch.kind, batch.is_symmetric(), [batch.n, batch.m]);
        let mut block = batch.block::<T>();
        batch.load(&vec![Some(item); T::LANES], &mut block);
        match route {
            Route::System => block.solve_with(|a, b| {
                let lane = |x: &[T]| x.iter().map(|v| v.lane(0)).collect::<Vec<f64>>();
                kronecker::inverse(kind, symmetric, size, &lane(a), &lane(b))
            }),
            Route::Sum if batch.n.max(batch.m) <= MAX_TWICE => block.solve(),
            Route::Sum => {}
            Route::SystemTwice => {
                block.solve_with(|a, b| kronecker::inverse_full(kind, symmetric, size, a, b));
            }
        }
        scatter(&block.x, x);
        batch.read(&block, 0, Method::Fallback)
    }
}

/// Orders beyond which an item is not solved in twice the precision: it would
/// take many seconds.
const MAX_TWICE: usize = 128;

impl Batch<'_> {
    fn is_symmetric(&self) -> bool {
        self.fields.len() == 2
    }

    fn what(&self) -> &'static str {
        match (self.kind, self.is_symmetric()) {
            (Kind::Continuous, true) => "A X + X A' + Q = 0",
            (Kind::Continuous, false) => "A X + X B + C = 0",
            (Kind::Discrete, true) => "A X A' - X + Q = 0",
            (Kind::Discrete, false) => "A X B - X + C = 0",
        }
    }

    #[inline(always)]
    fn block<T: Real>(&self) -> Linear<T> {
        let mut block = Linear::new(self.kind, self.is_symmetric(), self.n, self.m);
        block.bounds = self.bounds;
        block
    }

    /// Copies the items `at` to lanes; bad items become a harmless equation.
    #[inline(always)]
    fn load<T: Real>(&self, at: &[Option<usize>], block: &mut Linear<T>) {
        let stable: Substitute = match self.kind {
            Kind::Continuous => minus_unit,
            Kind::Discrete => half_unit,
        };
        gather(&self.fields[0], at, stable, &mut block.a);
        if !self.is_symmetric() {
            gather(&self.fields[1], at, stable, &mut block.b);
        }
        let last = self.fields.len() - 1;
        gather(&self.fields[last], at, zero, &mut block.c);
    }

    /// True if eigenvalues of the coefficients of item `k` add up to zero, or are
    /// reciprocal in discrete time, to rounding.
    fn is_singular(&self, k: usize) -> bool {
        let of = |field: usize, n: usize| {
            let x = self.fields[field].item(k);
            eigenvalues(Mat::from_fn(n, n, |i, j| x[i * n + j]).as_ref())
        };
        let left = of(0, self.n);
        let right = if self.is_symmetric() { left.clone() } else { of(1, self.m) };
        let (Ok(left), Ok(right)) = (left, right) else { return true };
        let size = |x: &[Eigenvalue]| x.iter().map(|v| v.re.hypot(v.im)).fold(0.0, f64::max);
        let scale = size(&left) + size(&right);
        left.iter().any(|a| {
            right.iter().any(|b| match self.kind {
                Kind::Continuous => (a.re + b.re).hypot(a.im + b.im) <= MEET * scale,
                Kind::Discrete => {
                    let (re, im) = (a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
                    (re - 1.0).hypot(im) <= MEET
                }
            })
        })
    }

    fn no_unique_solution(&self, correction: f64) -> Error {
        Error::NoUniqueSolution { what: self.what().into(), correction }
    }

    /// The report of one lane.
    #[inline(always)]
    fn read<T: Real>(&self, block: &Linear<T>, lane: usize, method: Method) -> ItemReport {
        let correction = block.correction.lane(lane);
        let status =
            if block.done.lane(lane) { Ok(()) } else { Err(self.no_unique_solution(correction)) };
        let (error_bound, condition, sound) =
            judged(block.error_bound.lane(lane), block.condition.lane(lane));
        ItemReport {
            status,
            residual: block.residual.lane(lane),
            correction,
            margin: block.margin.lane(lane),
            iterations: block.steps.lane(lane) as u32,
            error_bound,
            condition,
            reliable: sound && block.done.lane(lane),
            method,
        }
    }
}

impl Equation for Batch<'_> {
    fn solve(&self, first: usize, bad: &[bool], x: &mut [f64]) -> Vec<ItemReport> {
        launch(self.tier, Chunk { batch: self, first, bad, x })
    }
}

/// Solves the items of `fields`.
pub(super) fn run(
    kind: Kind,
    fields: Vec<Field<'_>>,
    [n, m, len]: [usize; 3],
    (checks, tier): (Checks, Option<Tier>),
    control: &RunControl<'_>,
) -> Result<Solutions> {
    let bounds = checks == Checks::All;
    let batch = Batch { kind, n, m, fields: fields.clone(), bounds, tier };
    let larger = n.max(m);
    let flops = larger.saturating_pow(3).saturating_mul(100);
    batch::run(&batch, &fields, [n, m], len, flops, control)
}

fn run_lyapunov(
    kind: Kind,
    p: &Lyapunov<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run(kind, p.fields()?, [p.n, p.n, p.len], (checks, None), control)
}

fn run_sylvester(
    kind: Kind,
    p: &Sylvester<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run(kind, p.fields()?, [p.n, p.m, p.len], (checks, None), control)
}

fn one_lyapunov(kind: Kind, a: MatRef<'_, f64>, q: MatRef<'_, f64>) -> Result<Solution> {
    let n = a.nrows();
    batch::check_shape("A", a, [n, n])?;
    batch::check_shape("Q", q, [n, n])?;
    let (a, q) = (batch::rows_of(a), batch::rows_of(q));
    let problem = Lyapunov { n, len: 1, A: &a, Q: &q };
    run_lyapunov(kind, &problem, Checks::All, &RunControl::default().threads(1))?.into_one()
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

/// Solutions of a batch of continuous-time Sylvester equations.
///
/// ```text
/// A X + X B + C = 0
/// ```
///
/// The margin in the report is that of the less stable coefficient. Otherwise as
/// [`lyapunov_continuous`]; not solvable where an eigenvalue of `A` and one of
/// `B` add up to zero. Shapes and layout in [`Sylvester`].
///
/// # Errors
/// As [`lyapunov_continuous`].
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
