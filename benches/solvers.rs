//! Batched solvers: problems per second in a full batch, with and without error
//! bounds, and one at a time.
//!
//! `cargo bench --bench solvers` measures, `-- --test` runs every case once. Each
//! case is solved and checked before it is timed: every item solved, its closed
//! loop verified stable, its residual (formed here, in plain arithmetic) small.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use mmae::par::RunControl;
use mmae::solve::{
    Checks, Lyapunov, Riccati, Solutions, Sylvester, care_with, dare_with,
    lyapunov_continuous_with, lyapunov_discrete_with, sylvester_continuous_with,
};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Equations of one kind and size.
struct Case {
    kind: &'static str,
    n: usize,
    len: usize,
    a: Vec<f64>,
    b: Vec<f64>,
    q: Vec<f64>,
    r: Vec<f64>,
}

impl Case {
    fn new(kind: &'static str, n: usize, len: usize) -> Self {
        let mut rng = StdRng::seed_from_u64(n as u64);
        let mut uniform = |count: usize, scale: f64| -> Vec<f64> {
            (0..count).map(|_| scale * rng.random_range(-1.0..1.0)).collect()
        };
        let riccati = matches!(kind, "care" | "dare");
        let m = if riccati { n / 2 } else { n };
        let mut a = uniform(len * n * n, if riccati { 0.6 } else { 0.7 / (n as f64).sqrt() });
        let mut b = uniform(len * n * m, if riccati { 1.0 } else { 0.7 / (n as f64).sqrt() });
        let eye = |n: usize, e: usize| f64::from(u8::from((e % (n * n)).is_multiple_of(n + 1)));
        if matches!(kind, "clyap" | "csylv") {
            a.iter_mut().enumerate().for_each(|(e, x)| *x -= 1.5 * eye(n, e));
            b.iter_mut().enumerate().for_each(|(e, x)| *x -= 1.5 * eye(n, e));
        }
        let v = uniform(len * n * n, 0.05);
        let q = (0..len * n * n)
            .map(|e| {
                let (k, i, j) = (e / (n * n), e / n % n, e % n);
                eye(n, e) + v[e] + v[(k * n + j) * n + i]
            })
            .collect();
        let r = (0..m * m).map(|e| eye(m, e)).collect();
        Case { kind, n, len, a, b, q, r }
    }

    /// Solves the first `len` items.
    fn solve(&self, len: usize, checks: Checks, control: &RunControl<'_>) -> Solutions {
        let (n, m) = (self.n, self.b.len() / self.len / self.n);
        let (a, b) = (&self.a[..len * n * n], &self.b[..len * n * m]);
        let q = &self.q[..len * n * n];
        let riccati = Riccati { n, m, len, A: a, B: b, Q: q, R: &self.r, S: None };
        let lyapunov = Lyapunov { n, len, A: a, Q: q };
        let sylvester = Sylvester { n, m, len, A: a, B: b, C: q };
        match self.kind {
            "care" => care_with(&riccati, checks, control),
            "dare" => dare_with(&riccati, checks, control),
            "clyap" => lyapunov_continuous_with(&lyapunov, checks, control),
            "dlyap" => lyapunov_discrete_with(&lyapunov, checks, control),
            _ => sylvester_continuous_with(&sylvester, checks, control),
        }
        .expect("the arrays have the right lengths")
    }

    /// Panics unless every item is solved, stable and exact.
    fn check(&self) {
        let solutions = self.solve(self.len, Checks::All, &RunControl::default());
        for (k, item) in solutions.items.iter().enumerate() {
            assert!(item.status.is_ok() && item.margin > 0.0, "{} item {k}: {item:?}", self.kind);
            let x = solutions.item(k).expect("solved");
            let worst = self.residual(k, x).iter().fold(0.0_f64, |w, r| w.max(r.abs()));
            let size = x.iter().fold(1.0_f64, |w, x| w.max(x.abs()));
            assert!(worst < 1e-11 * size * size, "{} item {k}: residual {worst:e}", self.kind);
        }
    }

    /// The left-hand side of the equation (`R = I`), entry by entry.
    fn residual(&self, k: usize, x: &[f64]) -> Vec<f64> {
        let n = self.n;
        let m = self.b.len() / self.len / n;
        let a = &self.a[k * n * n..][..n * n];
        let b = &self.b[k * n * m..][..n * m];
        let q = &self.q[k * n * n..][..n * n];
        let product = |x: &[f64], y: &[f64], [r, d, c]: [usize; 3]| -> Vec<f64> {
            let entry = |i: usize, j: usize| (0..d).map(|l| x[i * d + l] * y[l * c + j]).sum();
            (0..r * c).map(|e| entry(e / c, e % c)).collect()
        };
        let transpose = |x: &[f64], [r, c]: [usize; 2]| -> Vec<f64> {
            (0..r * c).map(|e| x[e % r * c + e / r]).collect()
        };
        let square = [n, n, n];
        let (at, bt) = (transpose(a, [n, n]), transpose(b, [n, m]));
        let sum = |terms: &[(&[f64], f64)]| -> Vec<f64> {
            (0..n * n).map(|e| q[e] + terms.iter().map(|(t, s)| s * t[e]).sum::<f64>()).collect()
        };
        match self.kind {
            "care" => {
                let xa = product(x, a, square);
                let xb = product(x, b, [n, n, m]);
                let xbbx = product(&xb, &transpose(&xb, [n, m]), [n, m, n]);
                sum(&[(&xa, 1.0), (&transpose(&xa, [n, n]), 1.0), (&xbbx, -1.0)])
            }
            "dare" => {
                // (R + B'XB) K = B'XA: A'X(A - BK) - X + Q
                let bx = product(&bt, x, [m, n, n]);
                let mut s = product(&bx, b, [m, n, m]);
                (0..m).for_each(|i| s[i * m + i] += 1.0);
                let mut gain = product(&bx, a, [m, n, n]);
                let mut perm = vec![0.0; m];
                let (rows, cols) = (mmae::small::Dyn(m), mmae::small::Dyn(n));
                mmae::small::solve(rows, cols, &mut s, &mut gain, &mut perm);
                let bk = product(b, &gain, [n, m, n]);
                let closed: Vec<f64> = a.iter().zip(&bk).map(|(a, bk)| a - bk).collect();
                let axa = product(&at, &product(x, &closed, square), square);
                sum(&[(&axa, 1.0), (x, -1.0)])
            }
            "clyap" => sum(&[(&product(a, x, square), 1.0), (&product(x, &at, square), 1.0)]),
            "dlyap" => {
                let axa = product(&product(a, x, square), &at, square);
                sum(&[(&axa, 1.0), (x, -1.0)])
            }
            _ => sum(&[(&product(a, x, square), 1.0), (&product(x, b, square), 1.0)]),
        }
    }
}

fn solvers(c: &mut Criterion) {
    let control = RunControl::default().threads(1);
    for kind in ["care", "dare", "clyap", "dlyap", "csylv"] {
        let mut group = c.benchmark_group(kind);
        for n in [4, 8, 12] {
            let case = Case::new(kind, n, 512);
            case.check();
            group.throughput(Throughput::Elements(case.len as u64));
            for (name, checks) in [("batch", Checks::All), ("stability", Checks::Stability)] {
                group.bench_function(BenchmarkId::new(name, n), |b| {
                    b.iter(|| black_box(case.solve(black_box(case.len), checks, &control)));
                });
            }
            group.throughput(Throughput::Elements(1));
            group.bench_function(BenchmarkId::new("one", n), |b| {
                b.iter(|| black_box(case.solve(black_box(1), Checks::All, &control)));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, solvers);
criterion_main!(benches);
