//! Algebraic Riccati equations: the public functions.

use faer::MatRef;

use crate::error::{Error, Result};
use crate::par::RunControl;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, Tier, dispatch_twice};
use crate::solve::batch::{self, Equation, gather, lanes_of, minus_unit, scatter, unit, zero};
use crate::solve::checks::Checks;
use crate::solve::explain::explain;
use crate::solve::fallback::sign_start;
use crate::solve::lanes::{Block, Coefficients, Kind};
use crate::solve::problem::{Field, Riccati};
use crate::solve::report::{ItemReport, Method, Solution, Solutions, judged};

/// The checked problem.
struct Batch<'a> {
    kind: Kind,
    n: usize,
    m: usize,
    fields: Vec<Field<'a>>,
    bounds: bool,
    tier: Option<Tier>,
}

/// Orders beyond which an item is not doubled in twice the precision: it would
/// take many seconds.
const MAX_TWICE: usize = 128;

/// How an item is tried again.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Route {
    /// From the matrix sign function.
    Sign,
    /// The same, scaled for a weak `Q`.
    Tilted,
    /// By doubling in twice the precision.
    Doubling,
}

impl Route {
    const ALL: [Route; 3] = [Route::Sign, Route::Tilted, Route::Doubling];
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
        let mut block = batch.block::<T>();
        let at = batch::alone::<T>(item);
        // What is in the lanes has passed the check already.
        let _ = batch.load(&at, &mut block);
        if route == Route::Doubling {
            block.solve(batch.kind);
        } else {
            let start = |c: Coefficients<'_, T>| sign_start_in_lanes(batch.kind, batch.n, c);
            block.solve_from(batch.kind, route == Route::Tilted, start);
        }
        scatter(&block.x, x);
        let mut report = Vec::with_capacity(1);
        batch.read(&block, &at[..1], Method::Fallback, &mut report);
        report.pop().unwrap_or_else(ItemReport::pending)
    }
}

/// [`sign_start`] for a block whose lanes all hold one equation.
fn sign_start_in_lanes<T: Real>(
    kind: Kind,
    n: usize,
    c: Coefficients<'_, T>,
) -> Option<(Vec<T>, T)> {
    let lane = |x: &[T]| x.iter().map(|v| v.lane(0)).collect::<Vec<f64>>();
    let (a, g, q) = (lane(c.a), lane(c.g), lane(c.q));
    let (x, steps) = sign_start(kind, n, Coefficients { a: &a, g: &g, q: &q })?;
    Some((x.into_iter().map(T::splat).collect(), T::splat(f64::from(steps))))
}

impl Equation for Batch<'_> {
    type Block<T: Real> = Block<T>;

    fn fields(&self) -> &[Field<'_>] {
        &self.fields
    }

    fn shape(&self) -> [usize; 2] {
        [self.n, self.n]
    }

    fn tier(&self) -> Option<Tier> {
        self.tier
    }

    #[inline(always)]
    fn block<T: Real>(&self) -> Block<T> {
        let mut block = Block::new(self.n, self.m);
        block.set_bounds(self.bounds);
        block.data.has_cross = self.fields.len() > 4;
        block
    }

    #[inline(always)]
    fn load<T: Real>(&self, at: &[Option<usize>], block: &mut Block<T>) -> T::Mask {
        let d = &mut block.data;
        let mut good = gather(&self.fields[0], at, minus_unit, &mut d.a);
        good = good & gather(&self.fields[1], at, zero, &mut d.b);
        good = good & gather(&self.fields[2], at, unit, &mut d.q);
        good = good & gather(&self.fields[3], at, unit, &mut d.r);
        if let Some(s) = self.fields.get(4) {
            good = good & gather(s, at, zero, &mut d.s);
        }
        good
    }

    #[inline(always)]
    fn solve<T: Real>(&self, block: &mut Block<T>) {
        block.solve(self.kind);
    }

    #[inline(always)]
    fn solutions<'b, T: Real>(&self, block: &'b Block<T>) -> &'b [T] {
        &block.x
    }

    /// The status is an error if the lane failed, of which [`Batch::try_again`]
    /// finds the reason.
    #[inline(always)]
    fn read<T: Real>(
        &self,
        block: &Block<T>,
        at: &[Option<usize>],
        method: Method,
        reports: &mut Vec<ItemReport>,
    ) {
        let (steps, margin) = (lanes_of(block.steps), lanes_of(block.margin));
        let (residual, correction) = (lanes_of(block.residual), lanes_of(block.correction));
        let (bound, condition) = (lanes_of(block.error_bound), lanes_of(block.condition));
        for lane in 0..at.len() {
            let iterations = steps[lane] as u32;
            let residual = residual[lane];
            let status = if block.done.lane(lane) {
                Ok(())
            } else if block.indefinite.lane(lane) {
                Err(Error::NotPositiveDefinite { what: "R".into() })
            } else {
                Err(Error::NoStabilizingSolution { what: String::new(), residual, iterations })
            };
            let (error_bound, condition, sound) = judged(bound[lane], condition[lane]);
            reports.push(ItemReport {
                reliable: sound && status.is_ok() && !block.odd_weight.lane(lane),
                status,
                residual,
                correction: correction[lane],
                margin: margin[lane],
                iterations,
                error_bound,
                condition,
                method,
            });
        }
    }

    /// Alone, in twice the precision.
    #[inline(never)]
    fn try_again(&self, item: usize, report: &mut ItemReport, x: &mut [f64]) {
        let indefinite = matches!(report.status, Err(Error::NotPositiveDefinite { .. }));
        for route in Route::ALL {
            if route == Route::Doubling && self.n > MAX_TWICE {
                break;
            }
            let mut second = dispatch_twice(Single { batch: self, item, route, x: &mut *x });
            second.iterations += report.iterations;
            let best = report.residual.min(second.residual);
            *report = second;
            if report.status.is_ok() {
                return;
            }
            report.residual = best;
            if indefinite && self.kind == Kind::Continuous && route == Route::Tilted {
                break;
            }
        }
        let reached = (report.residual, report.iterations);
        report.status = Err(if indefinite && self.kind == Kind::Continuous {
            Error::NotPositiveDefinite { what: "R".into() }
        } else {
            explain(self.kind, [self.n, self.m], &self.fields, item, reached)
        });
        report.method = Method::None;
    }
}

pub(super) fn run(
    kind: Kind,
    problem: &Riccati<'_>,
    checks: Checks,
    tier: Option<Tier>,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    let bounds = checks == Checks::All;
    let fields = problem.fields()?;
    let (n, m) = (problem.n, problem.m);
    let batch = Batch { kind, n, m, fields, bounds, tier };
    let cubed = n.saturating_pow(3).saturating_add(n.saturating_mul(n).saturating_mul(m));
    batch::run(&batch, problem.len, cubed.saturating_mul(250), control)
}

/// One problem from faer matrices.
#[expect(non_snake_case, reason = "capital letters are matrices")]
fn run_one(
    kind: Kind,
    A: MatRef<'_, f64>,
    B: MatRef<'_, f64>,
    Q: MatRef<'_, f64>,
    R: MatRef<'_, f64>,
    S: Option<MatRef<'_, f64>>,
) -> Result<Solution> {
    let (n, m) = (A.nrows(), B.ncols());
    for (what, x, want) in [("A", A, [n, n]), ("B", B, [n, m]), ("Q", Q, [n, n]), ("R", R, [m, m])]
    {
        batch::check_shape(what, x, want)?;
    }
    if let Some(s) = S {
        batch::check_shape("S", s, [n, m])?;
    }
    let rows = batch::rows_of;
    let (a, b, q, r, s) = (rows(A), rows(B), rows(Q), rows(R), S.map(rows));
    let problem = Riccati { n, m, len: 1, A: &a, B: &b, Q: &q, R: &r, S: s.as_deref() };
    let control = RunControl::default().threads(1);
    run(kind, &problem, Checks::All, None, &control)?.into_one()
}

/// Stabilizing solutions of a batch of continuous-time algebraic Riccati
/// equations.
///
/// ```text
/// A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0,   A - B R^-1 (B'X + S') stable
/// ```
///
/// Shapes and layout in [`Riccati`]. Item `k` has the same bits alone and in any
/// batch, on any CPU and with any number of threads.
///
/// # Source
/// Structure-preserving doubling: Chu, Fan, Lin (2005), Linear Algebra Appl.
/// 396, 55-80. Correction: Kleinman (1968), IEEE Trans. Automat. Control 13,
/// 114-115, with the residual in twice the working precision.
///
/// # Errors
/// `Shape` for arrays of a wrong length, `Empty` for no item or order zero. What
/// is wrong with an item is in its report: `NonFinite`, `NotSymmetric`,
/// `NotPositiveDefinite` (`R`), `NoStabilizingSolution`.
///
/// # Examples
/// ```
/// use mmae::solve::{Care, care};
/// // x' = a x + u for a = 0, 1: X = a + sqrt(a^2 + 1)
/// let all = care(&Care {
///     n: 1, m: 1, len: 2, A: &[0.0, 1.0], B: &[1.0], Q: &[1.0], R: &[1.0], S: None,
/// })?;
/// assert!((all.item(0)?[0] - 1.0).abs() < 1e-15);
/// assert!((all.item(1)?[0] - (1.0 + 2.0_f64.sqrt())).abs() < 1e-15);
/// assert!(all.items.iter().all(|item| item.margin > 0.0));
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn care(problem: &Riccati<'_>) -> Result<Solutions> {
    run(Kind::Continuous, problem, Checks::All, None, &RunControl::default())
}

/// As [`care`], with a choice of [`Checks`], threads, progress and cancelling.
///
/// # Errors
/// As [`care`], and `Cancelled`.
pub fn care_with(
    problem: &Riccati<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run(Kind::Continuous, problem, checks, None, control)
}

/// Stabilizing solution of one continuous-time algebraic Riccati equation.
///
/// ```text
/// A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0
/// ```
///
/// `A` n by n, `B` n by m, `Q` n by n, `R` m by m, `S` n by m. For a filter pass
/// `A'` for `A` and `C'` for `B`.
///
/// # Errors
/// As [`care`]; those of the item too.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::care_one};
/// let a = mat![[0.0, 1.0], [0.0, 0.0]];
/// let b = mat![[0.0], [1.0]];
/// let (q, r) = (mat![[1.0, 0.0], [0.0, 2.0]], mat![[1.0]]);
/// let s = care_one(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref(), None)?;
/// let x = &s.X;
/// let residual = a.transpose() * x + x * &a - x * &b * b.transpose() * x + &q;
/// assert!(residual.norm_l2() < 1e-14);
/// # Ok::<(), mmae::Error>(())
/// ```
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub fn care_one(
    A: MatRef<'_, f64>,
    B: MatRef<'_, f64>,
    Q: MatRef<'_, f64>,
    R: MatRef<'_, f64>,
    S: Option<MatRef<'_, f64>>,
) -> Result<Solution> {
    run_one(Kind::Continuous, A, B, Q, R, S)
}

/// Stabilizing solutions of a batch of discrete-time algebraic Riccati
/// equations.
///
/// ```text
/// A'XA - X - (A'XB + S)(R + B'XB)^-1(B'XA + S') + Q = 0
/// A - B K has its eigenvalues inside the unit circle,  K = (R + B'XB)^-1(B'XA + S')
/// ```
///
/// Otherwise as [`care`]; `R` may be singular where `R + B'XB` is not.
///
/// # Source
/// Anderson (1978), Int. J. Control 28, 295-306; Chu, Fan, Lin, Wang (2004),
/// Int. J. Control 77, 767-788. Correction: Hewer (1971), IEEE Trans. Automat.
/// Control 16, 382-384.
///
/// # Errors
/// As [`care`].
///
/// # Examples
/// ```
/// use mmae::solve::{Dare, dare};
/// // A random walk seen in noise: X = (q + sqrt(q^2 + 4 q r))/2
/// let all = dare(&Dare {
///     n: 1, m: 1, len: 1, A: &[1.0], B: &[1.0], Q: &[2.0], R: &[1.5], S: None,
/// })?;
/// assert!((all.item(0)?[0] - 3.0).abs() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn dare(problem: &Riccati<'_>) -> Result<Solutions> {
    run(Kind::Discrete, problem, Checks::All, None, &RunControl::default())
}

/// As [`dare`], with a choice of [`Checks`], threads, progress and cancelling.
///
/// # Errors
/// As [`dare`], and `Cancelled`.
pub fn dare_with(
    problem: &Riccati<'_>,
    checks: Checks,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    run(Kind::Discrete, problem, checks, None, control)
}

/// Stabilizing solution of one discrete-time algebraic Riccati equation.
///
/// ```text
/// A'XA - X - (A'XB + S)(R + B'XB)^-1(B'XA + S') + Q = 0
/// ```
///
/// `A` n by n, `B` n by m, `Q` n by n, `R` m by m, `S` n by m. For a filter pass
/// `A'` for `A` and `C'` for `B`: `X` is then the predicted covariance.
///
/// # Errors
/// As [`dare`]; those of the item too.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::dare_one};
/// let (a, b) = (mat![[1.0, 1.0], [0.0, 1.0]], mat![[0.0], [1.0]]);
/// let (q, r) = (mat![[1.0, 0.0], [0.0, 1.0]], mat![[1.0]]);
/// let x = dare_one(a.as_ref(), b.as_ref(), q.as_ref(), r.as_ref(), None)?.X;
/// let (xa, xb) = (&x * &a, &x * &b);
/// let s = r[(0, 0)] + (b.transpose() * &xb)[(0, 0)];
/// let axb = a.transpose() * &xb;
/// let residual = a.transpose() * &xa - &x - &axb * axb.transpose() * (1.0 / s) + &q;
/// assert!(residual.norm_l2() < 1e-14);
/// # Ok::<(), mmae::Error>(())
/// ```
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub fn dare_one(
    A: MatRef<'_, f64>,
    B: MatRef<'_, f64>,
    Q: MatRef<'_, f64>,
    R: MatRef<'_, f64>,
    S: Option<MatRef<'_, f64>>,
) -> Result<Solution> {
    run_one(Kind::Discrete, A, B, Q, R, S)
}
