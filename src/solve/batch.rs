//! From whole arrays to lane blocks and back.

use faer::MatRef;

use crate::error::{Error, Result};
use crate::par::{RunControl, map_parts};
use crate::real::{Mask, Real};
use crate::simd::{Kernel, LANES, Tier, dispatch};
use crate::solve::lanes::outlined;
use crate::solve::problem::{Field, check_item};
use crate::solve::report::{ItemReport, Method, Solutions};

/// Work that a chunk should hold, in floating-point operations: about a
/// millisecond.
const CHUNK_FLOPS: usize = 60_000_000;

/// One kind of equation, as the frame below works through a batch of it.
///
/// What is generic over `T` runs in lanes: mark it `#[inline(always)]`.
pub(super) trait Equation: Sync {
    /// The equations of one lane block and their solutions.
    type Block<T: Real>;
    /// The arguments.
    fn fields(&self) -> &[Field<'_>];
    /// Rows and columns of `X`.
    fn shape(&self) -> [usize; 2];
    /// The tier to run on; `None` for the fastest.
    fn tier(&self) -> Option<Tier>;
    /// Room for one lane block.
    fn block<T: Real>(&self) -> Self::Block<T>;
    /// Copies the items `at` to lanes, a harmless equation where there is none;
    /// returns the lanes that pass the check of [`gather`].
    fn load<T: Real>(&self, at: &[Option<usize>], block: &mut Self::Block<T>) -> T::Mask;
    /// Solves the block.
    fn solve<T: Real>(&self, block: &mut Self::Block<T>);
    /// The solutions.
    fn solutions<'b, T: Real>(&self, block: &'b Self::Block<T>) -> &'b [T];
    /// The reports of the first items of `at`, which are in lanes.
    fn read<T: Real>(
        &self,
        block: &Self::Block<T>,
        at: &[Option<usize>],
        method: Method,
        reports: &mut Vec<ItemReport>,
    );
    /// True if an item with this report is to be tried again, alone.
    fn is_unfinished(&self, report: &ItemReport) -> bool {
        report.status.is_err()
    }
    /// Tries an item again, or finds out why it has no solution.
    fn try_again(&self, item: usize, report: &mut ItemReport, x: &mut [f64]);
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
    len: usize,
    flops_an_item: usize,
    control: &RunControl<'_>,
) -> Result<Solutions> {
    let [rows, cols] = equation.shape();
    let size = rows * cols;
    let mut x = nan_filled(size, len)?;
    let chunk = chunk_len(flops_an_item);
    let parts: Vec<_> = x.chunks_mut(chunk * size).collect();
    let reports = map_parts(
        control,
        parts,
        |part| part.len() / size,
        |index, x| launch(equation.tier(), Chunk { equation, first: index * chunk, len, x }),
    )?;
    let mut reports = reports.into_iter();
    let mut items = reports.next().unwrap_or_default();
    items.extend(reports.flatten());
    Ok(Solutions { rows, cols, x, items })
}

/// A range of the `len` items of a batch, from `first` on.
struct Chunk<'a, E> {
    equation: &'a E,
    first: usize,
    len: usize,
    x: &'a mut [f64],
}

impl<E: Equation> Kernel for Chunk<'_, E> {
    type Out = Vec<ItemReport>;
    #[inline(always)]
    fn run<T: Real>(self) -> Vec<ItemReport> {
        let Chunk { equation, first, len, x } = self;
        let [rows, cols] = equation.shape();
        let size = rows * cols;
        let count = x.len() / size;
        let mut block = equation.block::<T>();
        let mut reports = Vec::with_capacity(count);
        for start in (0..count).step_by(T::LANES) {
            let lanes = T::LANES.min(count - start);
            let x = &mut x[start * size..][..lanes * size];
            // Padding lanes repeat the last item.
            let mut at: [Option<usize>; LANES] =
                std::array::from_fn(|lane| Some(first + start + lane.min(lanes - 1)));
            let mut refused = Vec::new();
            let good = equation.load(&at, &mut block);
            if !good.all() {
                let odd = std::array::from_fn(|lane| lane < T::LANES && !good.lane(lane));
                refused = refuse(equation.fields(), &mut at, odd, len);
                if !refused.is_empty() {
                    let _ = equation.load(&at, &mut block);
                }
            }
            if at[..lanes].iter().all(Option::is_none) {
                reports.extend((0..lanes).map(|_| ItemReport::pending()));
            } else {
                equation.solve(&mut block);
                let solutions = equation.solutions(&block);
                scatter(solutions, x);
                equation.read(&block, &at[..lanes], Method::Doubling, &mut reports);
            }
            let done = &mut reports[start..];
            for (lane, error) in refused {
                if lane < lanes {
                    done[lane] = ItemReport::refused(error);
                }
            }
            for (lane, (report, x)) in done.iter_mut().zip(x.chunks_exact_mut(size)).enumerate() {
                if let Some(item) = at[lane]
                    && equation.is_unfinished(report)
                {
                    equation.try_again(item, report, x);
                }
                finish(report, x, cols);
            }
        }
        reports
    }
}

/// Looks at the items of the `odd` lanes one by one; those that fail the check
/// are taken out of `at` and returned with their lane.
#[cold]
fn refuse(
    fields: &[Field<'_>],
    at: &mut [Option<usize>; LANES],
    odd: [bool; LANES],
    len: usize,
) -> Vec<(usize, Error)> {
    let mut refused = Vec::new();
    for lane in 0..LANES {
        if odd[lane]
            && let Some(item) = at[lane]
            && let Err(error) = check_item(fields, item, len)
        {
            at[lane] = None;
            refused.push((lane, error));
        }
    }
    refused
}

/// One item in every lane, for numbers that hold twice the precision.
pub(super) fn alone<T: Real>(item: usize) -> Vec<Option<usize>> {
    vec![Some(item); T::LANES]
}

/// The numbers of all lanes.
#[inline(always)]
pub(super) fn lanes_of<T: Real>(x: T) -> [f64; LANES] {
    let mut out = [0.0; LANES];
    x.store(&mut out);
    out
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
    /// symmetric ones as the mean across the diagonal. Lanes without an item
    /// receive `substitute(row, col)`. Returns the lanes whose entries are all
    /// finite and, where they should be, equal across the diagonal: the others
    /// may pass a closer look at the item.
    pub(super) fn gather(field: &'a Field<'a>, at: &'a [Option<usize>], substitute: Substitute, out: &'a mut [T]) -> T::Mask {
        let (rows, cols) = field.shape();
        let mut good = T::Mask::splat(true);
        if field.is_shared() && at.iter().all(Option::is_some) {
            for (x, &v) in out.iter_mut().zip(field.item(0)) {
                *x = T::splat(v);
                good = good & x.is_finite();
            }
        } else {
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
            let (blocks, rest) = out.as_chunks_mut::<LANES>();
            for (b, block) in blocks.iter_mut().enumerate() {
                *block = T::load_columns(&items, LANES * b);
                for x in block {
                    good = good & x.is_finite();
                }
            }
            let first = rows * cols - rest.len();
            for (e, x) in rest.iter_mut().enumerate() {
                *x = T::from_fn(|lane| items[lane][first + e]);
                good = good & x.is_finite();
            }
        }
        if field.symmetric() {
            let mut equal = T::Mask::splat(true);
            for i in 0..rows {
                for j in 0..i {
                    equal = equal & out[i * cols + j].eq(out[j * cols + i]);
                }
            }
            good = good & equal;
            if !equal.all() {
                mean_across(rows, out);
            }
        }
        good
    }
}

/// Each pair of entries across the diagonal becomes its mean; equal ones are
/// kept.
#[inline(always)]
fn mean_across<T: Real>(n: usize, out: &mut [T]) {
    for i in 0..n {
        for j in 0..i {
            let (x, y) = (out[i * n + j], out[j * n + i]);
            // Halves first: the sum may overflow.
            let half = T::splat(0.5);
            let mean = T::select(x.eq(y), x, half * x + half * y);
            out[i * n + j] = mean;
            out[j * n + i] = mean;
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
fn launch(tier: Option<Tier>, chunk: impl Kernel<Out = Vec<ItemReport>>) -> Vec<ItemReport> {
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

/// Fails with `Shape` unless `x` is `want[0]` by `want[1]`.
pub(super) fn check_shape(what: &str, x: MatRef<'_, f64>, want: [usize; 2]) -> Result<()> {
    let got = [x.nrows(), x.ncols()];
    if got == want { Ok(()) } else { Err(Error::Shape { what: what.into(), want, got }) }
}

/// The entries of `x`, row by row.
pub(super) fn rows_of(x: MatRef<'_, f64>) -> Vec<f64> {
    (0..x.nrows()).flat_map(|i| (0..x.ncols()).map(move |j| x[(i, j)])).collect()
}
