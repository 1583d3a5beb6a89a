//! From whole arrays to lane blocks and back.

use faer::MatRef;

use crate::error::{Error, Result};
use crate::par::{RunControl, map_parts};
use crate::real::Real;
use crate::simd::{Kernel, LANES, Tier, dispatch};
use crate::solve::lanes::outlined;
use crate::solve::problem::{Field, check_item};
use crate::solve::report::{ItemReport, Solutions};

/// Work that a chunk should hold, in floating-point operations: about a
/// millisecond.
const CHUNK_FLOPS: usize = 10_000_000;

/// How one kind of equation is solved on a range of items.
pub(super) trait Equation: Sync {
    /// Solves the items `first..first + bad.len()` but those marked `bad`, into
    /// `x` (one matrix an item); returns one report an item. What it does for a
    /// bad item is of no account.
    fn solve(&self, first: usize, bad: &[bool], x: &mut [f64]) -> Vec<ItemReport>;
}

/// Items a chunk, a multiple of the lanes, from the cost of one item alone.
fn chunk_len(flops_an_item: usize) -> usize {
    (CHUNK_FLOPS / flops_an_item.max(1)).clamp(1, 4096).next_multiple_of(LANES)
}

/// Checks all items and solves the good ones.
///
/// # Errors
/// `Limit` if the solutions do not fit in memory, `Cancelled`.
pub(super) fn run(
    equation: &impl Equation,
    fields: &[Field<'_>],
    [rows, cols]: [usize; 2],
    len: usize,
    flops_an_item: usize,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    let size = rows * cols;
    let mut x = nan_filled(size, len)?;
    let chunk = chunk_len(flops_an_item);
    let parts: Vec<_> = x.chunks_mut(chunk * size).collect();
    let reports = map_parts(
        control,
        parts,
        |part| part.len() / size,
        |index, part| {
            let first = index * chunk;
            let count = part.len() / size;
            let checks: Vec<Result<()>> =
                (first..first + count).map(|k| check_item(fields, k, len)).collect();
            let bad: Vec<bool> = checks.iter().map(Result::is_err).collect();
            let mut reports = if bad.iter().all(|&b| b) {
                vec![ItemReport::pending(); count]
            } else {
                equation.solve(first, &bad, part)
            };
            for (check, report) in checks.into_iter().zip(&mut reports) {
                if let Err(error) = check {
                    *report = ItemReport::refused(error);
                }
            }
            for (report, x) in reports.iter_mut().zip(part.chunks_exact_mut(size)) {
                finish(report, x, cols);
            }
            reports
        },
    )?;
    Ok(Solutions { rows, cols, x, items: reports.into_iter().flatten().collect() })
}

/// `len` matrices of NaN.
fn nan_filled(size: usize, len: usize) -> Result<Vec<f64>> {
    let too_large = || Error::Limit {
        what: "the batch of solutions".into(),
        bytes: size as u128 * len as u128 * 8,
        limit: isize::MAX as u128,
        remedy: "solve the batch in parts",
    };
    let count = size.checked_mul(len).ok_or_else(too_large)?;
    let mut x = Vec::new();
    x.try_reserve_exact(count).map_err(|_| too_large())?;
    x.resize(count, f64::NAN);
    Ok(x)
}

/// A solution out of range becomes an error; a failed item's `X` becomes NaN.
fn finish(report: &mut ItemReport, x: &mut [f64], cols: usize) {
    if report.status.is_ok()
        && let Some(at) = x.iter().position(|v| !v.is_finite())
    {
        report.status = Err(Error::Range {
            what: format!("X[{}][{}]", at / cols, at % cols),
            value: x[at],
            remedy: "the solution overflows; scale the weights or the states".into(),
        });
    }
    if report.status.is_err() {
        x.fill(f64::NAN);
    }
}

/// Makes a matrix for lanes that hold no item.
pub(super) type Substitute = fn(usize, usize) -> f64;

outlined! {
    /// Copies entries of `field` for the items `at` (one a lane) to lanes,
    /// symmetric ones as the mean across the diagonal. Lanes of a bad item
    /// receive `substitute(row, col)`.
    pub(super) fn gather(field: &'a Field<'a>, at: &'a [Option<usize>], substitute: Substitute, out: &'a mut [T]) {
        let (rows, cols) = field.shape();
        let mut stand_in = Vec::new();
        if at.iter().any(Option::is_none) {
            stand_in.extend((0..rows * cols).map(|e| substitute(e / cols, e % cols)));
        }
        let mut items = [&stand_in[..]; LANES];
        for (item, &at) in items.iter_mut().zip(at) {
            if let Some(k) = at {
                *item = field.item(k);
            }
        }
        let mut lanes = [0.0; LANES];
        for (e, x) in out.iter_mut().enumerate() {
            for lane in 0..T::LANES {
                lanes[lane] = items[lane][e];
            }
            *x = T::load(&lanes);
        }
        if field.symmetric() {
            for i in 0..rows {
                for j in 0..i {
                    let (x, y) = (out[i * cols + j], out[j * cols + i]);
                    // Halves first: the sum may overflow. Equal entries are kept.
                    let half = T::splat(0.5);
                    let mean = T::select(x.eq(y), x, half * x + half * y);
                    out[i * cols + j] = mean;
                    out[j * cols + i] = mean;
                }
            }
        }
    }
}

outlined! {
    /// Copies the matrices of the first lanes to consecutive items of `out`.
    pub(super) fn scatter(x: &'a [T], out: &'a mut [f64]) {
        let size = x.len();
        let lanes = out.len() / size;
        let mut buffer = [0.0; LANES];
        for (e, v) in x.iter().enumerate() {
            v.store(&mut buffer);
            for lane in 0..lanes {
                out[lane * size + e] = buffer[lane];
            }
        }
    }
}

/// Runs a chunk on the fastest tier, or in tests on the given one.
pub(super) fn launch(
    tier: Option<Tier>,
    chunk: impl Kernel<Out = Vec<ItemReport>>,
) -> Vec<ItemReport> {
    match tier {
        #[cfg(test)]
        Some(tier) => crate::simd::dispatch_on(tier, chunk).unwrap_or_default(),
        _ => dispatch(chunk),
    }
}

/// Zero as a substitute.
pub(super) fn zero(_: usize, _: usize) -> f64 {
    0.0
}

/// The identity as a substitute.
pub(super) fn unit(i: usize, j: usize) -> f64 {
    f64::from(u8::from(i == j))
}

/// Minus the identity: a stable coefficient.
pub(super) fn minus_unit(i: usize, j: usize) -> f64 {
    -unit(i, j)
}

/// Half the identity: a coefficient stable in discrete time.
pub(super) fn half_unit(i: usize, j: usize) -> f64 {
    0.5 * unit(i, j)
}

/// Items of the lanes of the group that starts at `start`: padding lanes repeat
/// the last item, bad items are `None`.
#[inline(always)]
pub(super) fn lanes_of(first: usize, start: usize, bad: &[bool]) -> [Option<usize>; LANES] {
    std::array::from_fn(|lane| {
        let local = (start + lane).min(bad.len() - 1);
        (!bad[local]).then_some(first + local)
    })
}

/// Fails with `Shape` unless `x` is `want[0]` by `want[1]`.
pub(super) fn check_shape(what: &str, x: MatRef<'_, f64>, want: [usize; 2]) -> Result<()> {
    let got = [x.nrows(), x.ncols()];
    if got == want { Ok(()) } else { Err(Error::Shape { what: what.into(), want, got }) }
}

/// The entries of `x`, row by row.
pub(super) fn rows_of(x: MatRef<'_, f64>) -> Vec<f64> {
    (0..x.nrows()).flat_map(|i| (0..x.ncols()).map(move |j| x[(i, j)])).collect()
}
