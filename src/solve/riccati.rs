//! Algebraic Riccati equations: the public functions.

use faer::MatRef;

use crate::error::{Error, Result};
use crate::par::RunControl;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, Tier, dispatch, dispatch_on};
use crate::solve::batch::{self, Equation, gather, lanes_of, minus_unit, unit};
use crate::solve::fallback::sign_start;
use crate::solve::lanes::{Block, Data, Kind};
use crate::solve::problem::{Field, Riccati};
use crate::solve::report::{ItemReport, Method, Solution, Solutions};

/// The checked problem.
struct Batch<'a> {
    kind: Kind,
    n: usize,
    m: usize,
    fields: Vec<Field<'a>>,
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
        let mut block = Block::<T>::new(batch.n, batch.m);
        let mut reports = Vec::with_capacity(bad.len());
        for start in (0..bad.len()).step_by(T::LANES) {
            let at = lanes_of::<T>(first, start, bad);
            batch.load(&at, &mut block.data);
            block.solve(batch.kind);
            for lane in 0..T::LANES.min(bad.len() - start) {
                let size = block.x.len();
                let out = &mut x[(start + lane) * size..][..size];
                reports.push(read(&block, lane, Method::Doubling, out));
            }
        }
        reports
    }
}

/// Copies the solution of one lane to `x`; its status is an error if the lane
/// failed, of which the caller finds the reason.
fn read<T: Real>(block: &Block<T>, lane: usize, method: Method, x: &mut [f64]) -> ItemReport {
    for (o, v) in x.iter_mut().zip(&block.x) {
        *o = v.lane(lane);
    }
    let iterations = block.steps.lane(lane) as u32;
    let residual = block.residual.lane(lane);
    let status = if block.done.lane(lane) {
        Ok(())
    } else if block.indefinite.lane(lane) {
        Err(Error::NotPositiveDefinite { what: "R".into() })
    } else {
        Err(Error::NoStabilizingSolution { what: String::new(), residual, iterations })
    };
    ItemReport {
        status,
        residual,
        correction: block.correction.lane(lane),
        margin: block.margin.lane(lane),
        iterations,
        error_bound: None,
        method,
    }
}

impl Batch<'_> {
    /// Copies the items `at` to lanes; bad items become a harmless equation.
    #[inline(always)]
    fn load<T: Real>(&self, at: &[Option<usize>], d: &mut Data<T>) {
        gather(&self.fields[0], at, minus_unit, &mut d.a);
        gather(&self.fields[1], at, |_, _| 0.0, &mut d.b);
        gather(&self.fields[2], at, unit, &mut d.q);
        gather(&self.fields[3], at, unit, &mut d.r);
        match self.fields.get(4) {
            Some(s) => gather(s, at, |_, _| 0.0, &mut d.s),
            None => d.s.fill(T::zero()),
        }
    }

    /// Tries item `k`, which failed in lanes as `report` says, in another way.
    fn retry(&self, k: usize, x: &mut [f64], report: &mut ItemReport) {
        let indefinite = matches!(report.status, Err(Error::NotPositiveDefinite { .. }));
        if indefinite && self.kind == Kind::Continuous {
            return;
        }
        let mut block = Block::<f64>::new(self.n, self.m);
        self.load(&[Some(k)], &mut block.data);
        block.solve_from(self.kind, |c| {
            sign_start(self.kind, self.n, c).map(|(x, steps)| (x, f64::from(steps)))
        });
        let mut second = read(&block, 0, Method::Fallback, x);
        second.iterations += report.iterations;
        if second.status.is_ok() {
            *report = second;
            return;
        }
        let what = if self.kind == Kind::Continuous { "CARE" } else { "DARE" }.into();
        let (residual, iterations) = (report.residual, second.iterations);
        report.iterations = iterations;
        report.status = Err(Error::NoStabilizingSolution { what, residual, iterations });
    }
}

impl Equation for Batch<'_> {
    fn solve(&self, first: usize, bad: &[bool], x: &mut [f64]) -> Vec<ItemReport> {
        let chunk = Chunk { batch: self, first, bad, x: &mut *x };
        let mut reports = match self.tier {
            // A tier that this CPU lacks is refused before the batch starts.
            Some(tier) => dispatch_on(tier, chunk).unwrap_or_default(),
            None => dispatch(chunk),
        };
        let items = x.chunks_exact_mut(self.n * self.n).zip(&mut reports);
        for (local, (x, report)) in items.enumerate() {
            if report.status.is_err() && !bad[local] {
                self.retry(first + local, x, report);
            }
        }
        reports
    }
}

fn run(
    kind: Kind,
    problem: &Riccati<'_>,
    tier: Option<Tier>,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    let fields = problem.fields()?;
    let (n, m) = (problem.n, problem.m);
    let batch = Batch { kind, n, m, fields: fields.clone(), tier };
    let cubed = n.saturating_pow(3).saturating_add(n.saturating_mul(n).saturating_mul(m));
    batch::run(&batch, &fields, [n, n], problem.len, cubed.saturating_mul(250), control)
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
    run(kind, &problem, None, &control)?.into_one()
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
    run(Kind::Continuous, problem, None, &RunControl::default())
}

/// As [`care`], with threads, progress and cancelling.
///
/// # Errors
/// As [`care`], and `Cancelled`.
pub fn care_with(problem: &Riccati<'_>, control: &RunControl<'_>) -> Result<Solutions> {
    run(Kind::Continuous, problem, None, control)
}

/// As [`care`] on the given instruction set: for tests and measurements.
///
/// # Errors
/// As [`care`], and `Conflict` if this CPU lacks it.
pub fn care_on(tier: Tier, problem: &Riccati<'_>) -> Result<Solutions> {
    run(Kind::Continuous, problem, Some(batch::available(tier)?), &RunControl::default())
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
    run(Kind::Discrete, problem, None, &RunControl::default())
}

/// As [`dare`], with threads, progress and cancelling.
///
/// # Errors
/// As [`dare`], and `Cancelled`.
pub fn dare_with(problem: &Riccati<'_>, control: &RunControl<'_>) -> Result<Solutions> {
    run(Kind::Discrete, problem, None, control)
}

/// As [`dare`] on the given instruction set: for tests and measurements.
///
/// # Errors
/// As [`dare`], and `Conflict` if this CPU lacks it.
pub fn dare_on(tier: Tier, problem: &Riccati<'_>) -> Result<Solutions> {
    run(Kind::Discrete, problem, Some(batch::available(tier)?), &RunControl::default())
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
