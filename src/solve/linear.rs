//! Lyapunov and Sylvester equations through the batch frame.

use faer::Mat;

use crate::error::{Eigenvalue, Error, Result};
use crate::par::RunControl;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, Tier, dispatch_twice};
use crate::solve::backend::eigenvalues;
use crate::solve::batch::{
    self, Equation, Substitute, gather, half_unit, lanes_of, minus_unit, scatter, zero,
};
use crate::solve::checks::Checks;
use crate::solve::kronecker;
use crate::solve::lanes::{Kind, Linear};
use crate::solve::problem::Field;
use crate::solve::report::{ItemReport, Method, Solutions, judged};

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
        let at = batch::alone::<T>(item);
        // What is in the lanes has passed the check already.
        let _ = batch.load(&at, &mut block);
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
        let mut report = Vec::with_capacity(1);
        batch.read(&block, &at[..1], Method::Fallback, &mut report);
        report.pop().unwrap_or_else(ItemReport::pending)
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
}

impl Equation for Batch<'_> {
    type Block<T: Real> = Linear<T>;

    fn fields(&self) -> &[Field<'_>] {
        &self.fields
    }

    fn shape(&self) -> [usize; 2] {
        [self.n, self.m]
    }

    fn tier(&self) -> Option<Tier> {
        self.tier
    }

    #[inline(always)]
    fn block<T: Real>(&self) -> Linear<T> {
        let mut block = Linear::new(self.kind, self.is_symmetric(), self.n, self.m);
        block.bounds = self.bounds;
        block
    }

    #[inline(always)]
    fn load<T: Real>(&self, at: &[Option<usize>], block: &mut Linear<T>) -> T::Mask {
        let stable: Substitute = match self.kind {
            Kind::Continuous => minus_unit,
            Kind::Discrete => half_unit,
        };
        let mut good = gather(&self.fields[0], at, stable, &mut block.a);
        if !self.is_symmetric() {
            good = good & gather(&self.fields[1], at, stable, &mut block.b);
        }
        let last = self.fields.len() - 1;
        good & gather(&self.fields[last], at, zero, &mut block.c)
    }

    #[inline(always)]
    fn solve<T: Real>(&self, block: &mut Linear<T>) {
        block.solve();
    }

    #[inline(always)]
    fn solutions<'b, T: Real>(&self, block: &'b Linear<T>) -> &'b [T] {
        &block.x
    }

    #[inline(always)]
    fn read<T: Real>(
        &self,
        block: &Linear<T>,
        at: &[Option<usize>],
        method: Method,
        reports: &mut Vec<ItemReport>,
    ) {
        let (steps, margin) = (lanes_of(block.steps), lanes_of(block.margin));
        let (residual, correction) = (lanes_of(block.residual), lanes_of(block.correction));
        let (bound, condition) = (lanes_of(block.error_bound), lanes_of(block.condition));
        for lane in 0..at.len() {
            let correction = correction[lane];
            let done = block.done.lane(lane);
            let status = if done { Ok(()) } else { Err(self.no_unique_solution(correction)) };
            let (error_bound, condition, sound) = judged(bound[lane], condition[lane]);
            reports.push(ItemReport {
                status,
                residual: residual[lane],
                correction,
                margin: margin[lane],
                iterations: steps[lane] as u32,
                error_bound,
                condition,
                reliable: sound && done,
                method,
            });
        }
    }

    /// For coefficients that are not stable, or nearly so, or far from normal.
    #[inline(never)]
    fn try_again(&self, item: usize, report: &mut ItemReport, x: &mut [f64]) {
        for route in Route::ALL {
            let again = dispatch_twice(Single { batch: self, item, route, x: &mut *x });
            let iterations = report.iterations + again.iterations;
            *report = ItemReport { iterations, ..again };
            if report.status.is_ok() {
                let shaky = report.condition.is_none_or(|c| c > SHAKY);
                if shaky && self.is_singular(item) {
                    report.status = Err(self.no_unique_solution(report.correction));
                }
                return;
            }
        }
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
    let batch = Batch { kind, n, m, fields, bounds, tier };
    let larger = n.max(m);
    let flops = larger.saturating_pow(3).saturating_mul(100);
    batch::run(&batch, len, flops, control)
}
