//! Exact steps of the Riccati differential equation: the public functions.

use faer::MatRef;

use crate::error::{Error, Result};
use crate::par::RunControl;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, Tier, dispatch_twice};
use crate::solve::batch::{self, Equation, gather, minus_unit, scatter, unit, zero};
use crate::solve::lanes::{Flow, transpose_data};
use crate::solve::problem::{Field, RiccatiOde};
use crate::solve::report::{ItemReport, Method, Solution, Solutions};

/// Doublings beyond which a step is made again in twice the precision: each
/// doubles the rounding of the ones before.
const MAX_DOUBLINGS: u32 = 12;
/// Orders beyond which it is not.
const MAX_TWICE: usize = 64;

/// The checked problem.
struct Batch<'a> {
    n: usize,
    m: usize,
    fields: Vec<Field<'a>>,
    tier: Option<Tier>,
}

/// One item in twice the precision.
struct Single<'a> {
    batch: &'a Batch<'a>,
    item: usize,
    x: &'a mut [f64],
}

impl Kernel for Single<'_> {
    type Out = ItemReport;
    #[inline(always)]
    fn run<T: Real>(self) -> ItemReport {
        let Single { batch, item, x } = self;
        let mut flow = batch.block::<T>();
        let at = batch::alone::<T>(item);
        // What is in the lanes has passed the check already.
        let _ = batch.load(&at, &mut flow);
        flow.solve();
        scatter(&flow.p, x);
        let mut report = Vec::with_capacity(1);
        batch.read(&flow, &at[..1], Method::Fallback, &mut report);
        report.pop().unwrap_or_else(ItemReport::pending)
    }
}

impl Equation for Batch<'_> {
    type Block<T: Real> = Flow<T>;

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
    fn block<T: Real>(&self) -> Flow<T> {
        Flow::new(self.n, self.m)
    }

    #[inline(always)]
    fn load<T: Real>(&self, at: &[Option<usize>], flow: &mut Flow<T>) -> T::Mask {
        let d = &mut flow.data;
        let mut good = gather(&self.fields[0], at, minus_unit, &mut d.a);
        good = good & gather(&self.fields[1], at, zero, &mut d.b);
        good = good & gather(&self.fields[2], at, unit, &mut d.q);
        good = good & gather(&self.fields[3], at, unit, &mut d.r);
        transpose_data(d);
        good = good & gather(&self.fields[4], at, unit, &mut flow.p);
        let mut h = [T::zero()];
        good = good & gather(&self.fields[5], at, zero, &mut h);
        flow.h = h[0];
        good
    }

    #[inline(always)]
    fn solve<T: Real>(&self, flow: &mut Flow<T>) {
        flow.solve();
    }

    #[inline(always)]
    fn solutions<'b, T: Real>(&self, flow: &'b Flow<T>) -> &'b [T] {
        &flow.p
    }

    #[inline(always)]
    fn read<T: Real>(
        &self,
        flow: &Flow<T>,
        at: &[Option<usize>],
        method: Method,
        reports: &mut Vec<ItemReport>,
    ) {
        for (lane, at) in at.iter().enumerate() {
            let h = at.map_or(f64::NAN, |k| self.fields[5].item(k)[0]);
            let status = if !(h > 0.0 && h.is_finite()) {
                Err(Error::InvalidDt { dt: h })
            } else if flow.indefinite.lane(lane) {
                Err(Error::NotPositiveDefinite { what: "R".into() })
            } else if flow.escaped.lane(lane) {
                Err(Error::FiniteEscape { what: "Riccati differential equation".into(), h })
            } else if flow.done.lane(lane) {
                Ok(())
            } else {
                Err(Error::Range {
                    what: "h".into(),
                    value: h,
                    remedy: "the covariance overflows within the step; shorten it".into(),
                })
            };
            let reliable = status.is_ok();
            let iterations = flow.steps.lane(lane) as u32;
            reports.push(ItemReport {
                status,
                iterations,
                reliable,
                method,
                ..ItemReport::pending()
            });
        }
    }

    fn is_unfinished(&self, report: &ItemReport) -> bool {
        report.iterations > MAX_DOUBLINGS && self.n <= MAX_TWICE
    }

    /// In twice the precision.
    #[inline(never)]
    fn try_again(&self, item: usize, report: &mut ItemReport, x: &mut [f64]) {
        *report = dispatch_twice(Single { batch: self, item, x });
    }
}

pub(super) fn run(
    problem: &RiccatiOde<'_>,
    tier: Option<Tier>,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    let fields = problem.fields()?;
    let (n, m) = (problem.n, problem.m);
    let batch = Batch { n, m, fields, tier };
    let cubed = n.saturating_pow(3).saturating_add(n.saturating_mul(n).saturating_mul(m));
    batch::run(&batch, problem.len, cubed.saturating_mul(400), control)
}

/// `P` after a step of a batch of Riccati differential equations with constant
/// coefficients, exact but for rounding, whatever the step.
///
/// ```text
/// dP/dt = F P + P F' - P H' R^-1 H P + Q
/// P(h) = H_h + E_h' P (I + G_h P)^-1 E_h
/// ```
///
/// The covariance of a Kalman-Bucy filter: there is no step limit and nothing to
/// integrate. `E`, `G`, `H` of a short step come from the exponential of the
/// Hamiltonian, those of twice the step from two such steps in a row; `P` stays
/// symmetric and positive semidefinite, and tends to the solution of the
/// algebraic equation. Steps that need more than 12 doublings (stiff, or long
/// beside the fastest mode) are made in twice the precision. Shapes and layout in
/// [`RiccatiOde`]. Item `k` has the same bits alone and in any batch, on any CPU
/// and with any number of threads. Of the report only `status`, `iterations`
/// (doublings) and `method` have a meaning.
///
/// # Source
/// Chu, Fan, Lin (2005), Linear Algebra Appl. 396, 55-80 (the doubling); Lainiotis
/// (1976), IEEE Trans. Automat. Control 21, 677-689 (its use for the equation in
/// time).
///
/// # Errors
/// `Shape` for arrays of a wrong length, `Empty` for no item or order zero. What
/// is wrong with an item is in its report: `NonFinite`, `NotSymmetric`,
/// `NotPositiveDefinite` (`R`), `InvalidDt` for a step that is not positive,
/// `FiniteEscape` where an indefinite `Q` or `P` lets the solution become
/// infinite within the step, `Range` where it grows beyond the range of numbers.
///
/// # Examples
/// ```
/// use mmae::solve::{RiccatiOde, riccati_ode};
/// // dp/dt = 1 - p^2, p(0) = 0: p = tanh(t)
/// let all = riccati_ode(&RiccatiOde {
///     n: 1, m: 1, len: 2, F: &[0.0], H: &[1.0], Q: &[1.0], R: &[1.0], P: &[0.0], h: &[0.5, 50.0],
/// })?;
/// assert!((all.item(0)?[0] - 0.5_f64.tanh()).abs() < 1e-15);
/// assert!((all.item(1)?[0] - 1.0).abs() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn riccati_ode(problem: &RiccatiOde<'_>) -> Result<Solutions> {
    run(problem, None, &RunControl::default())
}

/// As [`riccati_ode`], with threads, progress and cancelling.
///
/// # Errors
/// As [`riccati_ode`], and `Cancelled`.
pub fn riccati_ode_with(problem: &RiccatiOde<'_>, control: &RunControl<'_>) -> Result<Solutions> {
    run(problem, None, control)
}

/// `P` after one step of one Riccati differential equation, see [`riccati_ode`].
///
/// ```text
/// dP/dt = F P + P F' - P H' R^-1 H P + Q
/// ```
///
/// `F` n by n, `H` m by n, `Q` n by n, `R` m by m, `P` n by n; `h` in seconds.
///
/// # Errors
/// As [`riccati_ode`]; those of the item too.
///
/// # Examples
/// ```
/// use mmae::{Mat, mat, solve::{care_one, riccati_ode_one}};
/// let (f, h) = (mat![[0.0, 1.0], [0.0, 0.0]], mat![[1.0, 0.0]]);
/// let (q, r) = (mat![[0.0, 0.0], [0.0, 1.0]], mat![[1.0]]);
/// let p = Mat::<f64>::identity(2, 2) * 10.0;
/// let late = riccati_ode_one(f.as_ref(), h.as_ref(), q.as_ref(), r.as_ref(), p.as_ref(), 1e9)?;
/// let (a, b) = (f.transpose(), h.transpose());
/// let steady = care_one(a, b, q.as_ref(), r.as_ref(), None)?;
/// assert!((late.X - steady.X).norm_l2() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub fn riccati_ode_one(
    F: MatRef<'_, f64>,
    H: MatRef<'_, f64>,
    Q: MatRef<'_, f64>,
    R: MatRef<'_, f64>,
    P: MatRef<'_, f64>,
    h: f64,
) -> Result<Solution> {
    let (n, m) = (F.nrows(), H.nrows());
    for (what, x, want) in
        [("F", F, [n, n]), ("H", H, [m, n]), ("Q", Q, [n, n]), ("R", R, [m, m]), ("P", P, [n, n])]
    {
        batch::check_shape(what, x, want)?;
    }
    let [f, c, q, r, p] = [F, H, Q, R, P].map(batch::rows_of);
    let problem = RiccatiOde { n, m, len: 1, F: &f, H: &c, Q: &q, R: &r, P: &p, h: &[h] };
    run(&problem, None, &RunControl::default().threads(1))?.into_one()
}
