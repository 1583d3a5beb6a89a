//! Small algebra and elementary functions: eight problems in lanes, one problem
//! at a time on `f64`, and one at a time with faer or the standard library.
//!
//! `cargo bench --bench kernels` runs criterion and ends with a table: the best
//! of interleaved rounds, nanoseconds per problem, ratios, and the share of the
//! fused multiply-add peak measured in the same rounds. `-- --test` runs every
//! case once. Every result is checked before it is timed. `-- --table` prints the
//! table alone.
#![allow(missing_docs, clippy::print_stdout, reason = "a program that reports on stdout")]

use criterion::{BenchmarkId, Criterion, Throughput};
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor as llt;
use faer::linalg::lu::partial_pivoting::{factor as lu, solve as lu_solve};
use faer::linalg::matmul::matmul;
use faer::perm::PermRef;
use faer::prelude::default;
use faer::{Accum, MatMut, MatRef, Par};
use mmae::real::{LaneKernel, Real, Tier, exp, ln, sin_cos};
use mmae::simd::{Block, Kernel, LANES, Panel, dispatch};
use mmae::small::{self, Dyn};
use std::cell::RefCell;
use std::hint::black_box;
use std::time::{Duration, Instant};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Op {
    Mul,
    SymUpdate,
    Solve,
    Cholesky,
}

impl Op {
    const ALL: [Op; 4] = [Op::Mul, Op::SymUpdate, Op::Solve, Op::Cholesky];

    fn name(self) -> &'static str {
        match self {
            Op::Mul => "C = A B",
            Op::SymUpdate => "C = Q + A P A'",
            Op::Solve => "A X = B",
            Op::Cholesky => "P = L L'",
        }
    }

    /// Multiply-adds of one problem of order `n`.
    fn work(self, n: usize) -> f64 {
        let cube = (n * n * n) as f64;
        match self {
            Op::Mul => cube,
            Op::SymUpdate => 1.5 * cube,
            Op::Solve => cube / 3.0 + cube,
            Op::Cholesky => cube / 6.0,
        }
    }
}

/// One operation on consecutive matrices of order `n`, row by row.
struct Each<'a, T> {
    op: Op,
    n: usize,
    a: &'a [T],
    p: &'a [T],
    c: &'a mut [T],
    work: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Each<'_, T> {
    type Out = ();
    #[inline(always)]
    fn run(self) {
        let (n, size) = (Dyn(self.n), self.n * self.n);
        let (work, perm) = self.work.split_at_mut(size);
        let items = self.a.chunks_exact(size).zip(self.p.chunks_exact(size));
        for ((a, p), c) in items.zip(self.c.chunks_exact_mut(size)) {
            match self.op {
                Op::Mul => small::mul(n, n, n, a, p, c),
                Op::SymUpdate => small::sym_update(n, n, a, p, p, c, work),
                Op::Solve => {
                    work.copy_from_slice(a);
                    c.copy_from_slice(p);
                    let _ = small::solve(n, n, work, c, perm);
                }
                Op::Cholesky => {
                    c.copy_from_slice(p);
                    let _ = small::cholesky(n, c);
                }
            }
        }
    }
}

struct OnLanes<'a> {
    op: Op,
    n: usize,
    a: &'a [Block],
    p: &'a [Block],
    c: &'a mut [Block],
    work: &'a mut [Block],
}

impl Kernel for OnLanes<'_> {
    type Out = ();
    #[inline(always)]
    fn run<T: Real>(self) {
        let OnLanes { op, n, a, p, c, work } = self;
        let (a, p) = (T::view(a), T::view(p));
        if let (Some(a), Some(p), Some(c), Some(work)) = (a, p, T::view_mut(c), T::view_mut(work)) {
            Each { op, n, a, p, c, work }.run();
        }
    }
}

/// The same problems for the three contestants. `A` is regular, `P` positive
/// definite.
struct Problems {
    op: Op,
    n: usize,
    items: usize,
    lanes: [Panel; 3],
    lane_work: Panel,
    scalar: [Vec<f64>; 3],
    scalar_work: Vec<f64>,
    /// Column by column, as faer prefers.
    faer: [Vec<f64>; 3],
    faer_work: Vec<f64>,
    perm: [Vec<usize>; 2],
    memory: MemBuffer,
}

impl Problems {
    fn new(op: Op, n: usize) -> Self {
        // A working set of some 24 KiB, or one block.
        let items = LANES * (128 / (n * n)).max(1);
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 * 2.0_f64.powi(-52) - 1.0
        };
        let (mut a, mut p) = (vec![0.0; items * n * n], vec![0.0; items * n * n]);
        for (a, p) in a.chunks_exact_mut(n * n).zip(p.chunks_exact_mut(n * n)) {
            a.fill_with(&mut next);
            small::mul_nt(Dyn(n), Dyn(n), Dyn(n), a, a, p);
            for i in 0..n {
                p[i * n + i] += 0.5;
                a[i * n + i] += 2.0;
            }
        }
        let panel = |x: &[f64]| Panel::from_fn(n, n, items, |k, i, j| x[(k * n + i) * n + j]);
        let columns = |x: &[f64]| -> Vec<f64> {
            let entry = |e: usize| x[e / (n * n) * n * n + e % n * n + e / n % n];
            (0..items * n * n).map(entry).collect()
        };
        let zero = vec![0.0; items * n * n];
        let (one, params) = (Par::Seq, default());
        let scratch = lu::lu_in_place_scratch::<usize, f64>(n, n, one, params)
            .or(lu_solve::solve_in_place_scratch::<usize, f64>(n, n, one))
            .or(llt::cholesky_in_place_scratch::<f64>(n, one, default()))
            .or(StackReq::new::<f64>(1));
        Problems {
            op,
            n,
            items,
            lanes: [panel(&a), panel(&p), panel(&zero)],
            lane_work: Panel::new(n * n + n, 1, LANES),
            faer: [columns(&a), columns(&p), zero.clone()],
            faer_work: vec![0.0; n * n],
            scalar: [a, p, zero],
            scalar_work: vec![0.0; n * n + n],
            perm: [vec![0; n], vec![0; n]],
            memory: MemBuffer::new(scratch),
        }
    }

    fn on_lanes(&mut self) {
        let [a, p, c] = &mut self.lanes;
        let (a, p, c) = (black_box(a.as_blocks()), p.as_blocks(), c.as_blocks_mut());
        let work = self.lane_work.as_blocks_mut();
        dispatch(OnLanes { op: self.op, n: self.n, a, p, c, work });
    }

    fn on_scalars(&mut self) {
        let [a, p, c] = &mut self.scalar;
        let (a, p, work) = (black_box(&**a), &**p, &mut *self.scalar_work);
        <f64 as Real>::outline(Each { op: self.op, n: self.n, a, p, c, work });
    }

    fn on_faer(&mut self) {
        let (n, size) = (self.n, self.n * self.n);
        let [a, p, c] = &mut self.faer;
        let stack = MemStack::new(&mut self.memory);
        let items = black_box(&**a).chunks_exact(size).zip(p.chunks_exact(size));
        for ((a, p), c) in items.zip(c.chunks_exact_mut(size)) {
            let work = &mut self.faer_work;
            let view = |x| MatRef::<f64>::from_column_major_slice(x, n, n);
            match self.op {
                Op::Mul => {
                    let c = MatMut::from_column_major_slice_mut(c, n, n);
                    matmul(c, Accum::Replace, view(a), view(p), 1.0, Par::Seq);
                }
                Op::SymUpdate => {
                    let w = MatMut::from_column_major_slice_mut(work, n, n);
                    matmul(w, Accum::Replace, view(a), view(p), 1.0, Par::Seq);
                    c.copy_from_slice(p);
                    let c = MatMut::from_column_major_slice_mut(c, n, n);
                    matmul(c, Accum::Add, view(work), view(a).transpose(), 1.0, Par::Seq);
                }
                Op::Solve => {
                    work.copy_from_slice(a);
                    c.copy_from_slice(p);
                    let [perm, inverse] = &mut self.perm;
                    let factors = MatMut::from_column_major_slice_mut(work, n, n);
                    lu::lu_in_place(factors, perm, inverse, Par::Seq, stack, default());
                    let perm = PermRef::new_checked(perm, inverse, n);
                    let c = MatMut::from_column_major_slice_mut(c, n, n);
                    lu_solve::solve_in_place(view(work), view(work), perm, c, Par::Seq, stack);
                }
                Op::Cholesky => {
                    c.copy_from_slice(p);
                    let c = MatMut::from_column_major_slice_mut(c, n, n);
                    let done = llt::cholesky_in_place(c, default(), Par::Seq, stack, default());
                    assert!(done.is_ok());
                }
            }
        }
    }

    /// Runs all three once and compares what they computed.
    fn check(&mut self) {
        self.on_lanes();
        self.on_scalars();
        self.on_faer();
        let (n, size) = (self.n, self.n * self.n);
        assert_eq!(self.lanes[2].to_row_major(), self.scalar[2], "lanes and oracle, by bits");
        for (e, &x) in self.scalar[2].iter().enumerate() {
            let (item, i, j) = (e / size, e % size / n, e % n);
            // The strict upper triangle of a Cholesky factor is not written.
            if self.op != Op::Cholesky || j <= i {
                let y = self.faer[2][item * size + j * n + i];
                assert!((x - y).abs() <= 1e-9 * (1.0 + x.abs()), "{:?} {n}: {x} {y}", self.op);
            }
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum Function {
    Exp,
    Ln,
    SinCos,
}

/// A function of many numbers.
struct Map<'a, T> {
    f: Function,
    x: &'a [T],
    y: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Map<'_, T> {
    type Out = ();
    #[inline(always)]
    fn run(self) {
        for (&x, y) in self.x.iter().zip(self.y) {
            *y = match self.f {
                Function::Exp => exp(x),
                Function::Ln => ln(x),
                Function::SinCos => {
                    let (s, c) = sin_cos(x);
                    s + c
                }
            };
        }
    }
}

struct MapOnLanes<'a>(Function, &'a [Block], &'a mut [Block]);

impl Kernel for MapOnLanes<'_> {
    type Out = ();
    #[inline(always)]
    fn run<T: Real>(self) {
        let MapOnLanes(f, x, y) = self;
        if let (Some(x), Some(y)) = (T::view(x), T::view_mut(y)) {
            // One loop a function, as a user would write it.
            match f {
                Function::Exp => Map { f: Function::Exp, x, y }.run(),
                Function::Ln => Map { f: Function::Ln, x, y }.run(),
                Function::SinCos => Map { f: Function::SinCos, x, y }.run(),
            }
        }
    }
}

/// 1024 numbers for one function.
struct Numbers {
    f: Function,
    x: Panel,
    y: Panel,
    scalar: [Vec<f64>; 2],
    std: Vec<f64>,
}

impl Numbers {
    const LEN: usize = 1024;

    fn new(f: Function) -> Self {
        let x: Vec<f64> = (1..=Self::LEN).map(|i| i as f64 * 0.0173).collect();
        Numbers {
            f,
            x: Panel::from_fn(1, 1, Self::LEN, |k, _, _| x[k]),
            y: Panel::new(1, 1, Self::LEN),
            scalar: [x, vec![0.0; Self::LEN]],
            std: vec![0.0; Self::LEN],
        }
    }

    fn on_lanes(&mut self) {
        dispatch(MapOnLanes(self.f, black_box(self.x.as_blocks()), self.y.as_blocks_mut()));
    }

    fn on_scalars(&mut self) {
        let [x, y] = &mut self.scalar;
        <f64 as Real>::outline(Map { f: self.f, x: black_box(x), y });
    }

    fn on_std(&mut self) {
        for (&x, y) in black_box(&self.scalar[0]).iter().zip(&mut self.std) {
            *y = match self.f {
                Function::Exp => x.exp(),
                Function::Ln => x.ln(),
                Function::SinCos => {
                    let (s, c) = x.sin_cos();
                    s + c
                }
            };
        }
    }

    fn check(&mut self) {
        self.on_lanes();
        self.on_scalars();
        self.on_std();
        assert_eq!(self.y.to_row_major(), self.scalar[1], "lanes and oracle, by bits");
        for (x, y) in self.scalar[1].iter().zip(&self.std) {
            assert!((x - y).abs() <= 4e-16 * (1.0 + y.abs()), "{:?}: {x} {y}", self.f);
        }
    }
}

/// Independent chains of fused multiply-adds: what the unit can do.
struct Peak(usize);

impl Peak {
    /// Enough chains to hide the latency, few enough for the registers.
    #[inline(always)]
    fn chains<T: Real, const C: usize>(rounds: usize) -> f64 {
        let mut x = [T::zero(); C];
        for (i, x) in x.iter_mut().enumerate() {
            *x = T::from_fn(|l| black_box((LANES * i + l) as f64));
        }
        let (a, b) = (black_box(T::splat(0.999)), black_box(T::splat(0.001)));
        for _ in 0..rounds {
            for x in &mut x {
                *x = x.mul_add(a, b);
            }
        }
        x.iter().map(|x| (0..T::LANES).map(|l| x.lane(l)).sum::<f64>()).sum()
    }
}

impl Kernel for Peak {
    /// The sum, which keeps the work alive, and the multiply-adds done.
    type Out = (f64, f64);
    #[inline(always)]
    fn run<T: Real>(self) -> (f64, f64) {
        let each = (self.0 * LANES) as f64;
        if T::TIER == Tier::Avx512 {
            (Self::chains::<T, 12>(self.0), 12.0 * each)
        } else {
            (Self::chains::<T, 6>(self.0), 6.0 * each)
        }
    }
}

/// Seconds that `f` takes, from enough repeats to last 50 microseconds.
fn once(mut f: impl FnMut()) -> f64 {
    let mut repeats = 1_u32;
    loop {
        let start = Instant::now();
        for _ in 0..repeats {
            f();
        }
        let time = start.elapsed();
        if time > Duration::from_micros(50) {
            return time.as_secs_f64() / f64::from(repeats);
        }
        repeats *= 4;
    }
}

/// Best of rounds that take turns, in seconds per problem, and the peak in
/// multiply-adds per second.
fn contest(items: usize, mut run: [&mut dyn FnMut(); 3]) -> ([f64; 3], f64) {
    let (mut best, mut peak) = ([f64::INFINITY; 3], 0.0_f64);
    for _ in 0..40 {
        for (best, f) in best.iter_mut().zip(&mut run) {
            *best = best.min(once(f) / items as f64);
        }
        let mut done = 0.0;
        let time = once(|| done = black_box(dispatch(Peak(400))).1);
        peak = peak.max(done / time);
    }
    (best, peak)
}

fn table() {
    println!("\nbest of 40 rounds in turn, tier {}, ns per problem\n", Tier::best());
    println!("| operation | n | lanes | f64 | faer | f64/lanes | faer/lanes | share of peak |");
    println!("|---|---|---|---|---|---|---|---|");
    for op in Op::ALL {
        for n in [2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64] {
            let case = RefCell::new(Problems::new(op, n));
            case.borrow_mut().check();
            let items = case.borrow().items;
            let ([lanes, scalar, faer], peak) = contest(
                items,
                [
                    &mut || case.borrow_mut().on_lanes(),
                    &mut || case.borrow_mut().on_scalars(),
                    &mut || case.borrow_mut().on_faer(),
                ],
            );
            println!(
                "| {} | {n} | {:.1} | {:.1} | {:.1} | {:.1} | {:.2} | {:.0} % |",
                op.name(),
                lanes * 1e9,
                scalar * 1e9,
                faer * 1e9,
                scalar / lanes,
                faer / lanes,
                100.0 * op.work(n) / lanes / peak,
            );
        }
    }
    println!("\n| function | lanes | f64 | std | f64/lanes | std/lanes | 1e9/s |");
    println!("|---|---|---|---|---|---|---|");
    for f in [Function::Exp, Function::Ln, Function::SinCos] {
        let case = RefCell::new(Numbers::new(f));
        case.borrow_mut().check();
        let ([lanes, scalar, std], _) = contest(
            Numbers::LEN,
            [
                &mut || case.borrow_mut().on_lanes(),
                &mut || case.borrow_mut().on_scalars(),
                &mut || case.borrow_mut().on_std(),
            ],
        );
        println!(
            "| {f:?} | {:.2} | {:.1} | {:.1} | {:.1} | {:.1} | {:.2} |",
            lanes * 1e9,
            scalar * 1e9,
            std * 1e9,
            scalar / lanes,
            std / lanes,
            1e-9 / lanes,
        );
    }
}

fn criterion(c: &mut Criterion) {
    for op in Op::ALL {
        let mut group = c.benchmark_group(op.name());
        for n in [2, 4, 8, 12, 16] {
            let mut case = Problems::new(op, n);
            case.check();
            group.throughput(Throughput::Elements(case.items as u64));
            group.bench_function(BenchmarkId::new("lanes", n), |b| b.iter(|| case.on_lanes()));
            group.bench_function(BenchmarkId::new("f64", n), |b| b.iter(|| case.on_scalars()));
            group.bench_function(BenchmarkId::new("faer", n), |b| b.iter(|| case.on_faer()));
        }
        group.finish();
    }
    let mut group = c.benchmark_group("functions");
    group.throughput(Throughput::Elements(Numbers::LEN as u64));
    for f in [Function::Exp, Function::Ln, Function::SinCos] {
        let mut case = Numbers::new(f);
        case.check();
        let id = |who| BenchmarkId::new(format!("{f:?}"), who);
        group.bench_function(id("lanes"), |b| b.iter(|| case.on_lanes()));
        group.bench_function(id("f64"), |b| b.iter(|| case.on_scalars()));
        group.bench_function(id("std"), |b| b.iter(|| case.on_std()));
    }
    group.finish();
}

fn main() {
    let asked = |flag: &str| std::env::args().any(|argument| argument == flag);
    if asked("--table") {
        return table();
    }
    let settings = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    let mut c = settings.configure_from_args();
    criterion(&mut c);
    c.final_summary();
    if asked("--bench") && !asked("--test") {
        table();
    }
}
