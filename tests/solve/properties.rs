//! Properties over random problems.

use super::batch::{covariances, random};
use mmae::Mat;
use mmae::solve::backend::{eigenvalues, symmetric_eigenvalues};
use mmae::solve::{
    Riccati, care, dare, lyapunov_continuous_one, lyapunov_discrete_one, sylvester_continuous_one,
    sylvester_discrete_one,
};
use proptest::prelude::*;

fn mat(n: usize, m: usize, x: &[f64]) -> Mat<f64> {
    Mat::from_fn(n, m, |i, j| x[i * m + j])
}

fn flat(x: &Mat<f64>) -> Vec<f64> {
    (0..x.nrows() * x.ncols()).map(|e| x[(e / x.ncols(), e % x.ncols())]).collect()
}

fn inverse(x: &Mat<f64>) -> Mat<f64> {
    use faer::linalg::solvers::DenseSolveCore;
    x.partial_piv_lu().inverse()
}

fn distance(x: &Mat<f64>, y: &Mat<f64>) -> f64 {
    (x - y).norm_l2() / y.norm_l2()
}

struct Problem {
    n: usize,
    m: usize,
    a: Mat<f64>,
    b: Mat<f64>,
    q: Mat<f64>,
    r: Mat<f64>,
}

impl Problem {
    fn new(n: usize, m: usize, seed: u64) -> Self {
        let part = |k: u64, count: usize| random(7 * seed + k, count);
        let a = mat(n, n, &part(0, n * n)) * 2.0;
        let b = mat(n, m, &part(1, n * m));
        let q = mat(n, n, &covariances(7 * seed + 2, n, 1, 0.05));
        let r = mat(m, m, &covariances(7 * seed + 3, m, 1, 0.05));
        Problem { n, m, a, b, q, r }
    }

    fn solve(&self, continuous: bool) -> (Mat<f64>, f64) {
        let (a, b, q, r) = (flat(&self.a), flat(&self.b), flat(&self.q), flat(&self.r));
        let p = Riccati { n: self.n, m: self.m, len: 1, A: &a, B: &b, Q: &q, R: &r, S: None };
        let s = if continuous { care(&p) } else { dare(&p) }.unwrap();
        (s.matrix(0).unwrap(), s.items[0].margin)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) })]

    #[test]
    fn closed_loop_is_stable_by_the_margin_and_x_is_psd(
        n in 1_usize..8, m in 1_usize..4, seed in 0_u64..1_000_000, continuous: bool,
    ) {
        let p = Problem::new(n, m, seed);
        let (x, margin) = p.solve(continuous);
        prop_assert_eq!(&x, &x.transpose().to_owned());
        let smallest = symmetric_eigenvalues(x.as_ref()).unwrap()[0];
        prop_assert!(smallest > -1e-12 * x.norm_l2());
        let xb = &x * &p.b;
        let k = if continuous {
            inverse(&p.r) * xb.transpose()
        } else {
            inverse(&(&p.r + p.b.transpose() * &xb)) * xb.transpose() * &p.a
        };
        let closed = &p.a - &p.b * k;
        for e in eigenvalues(closed.as_ref()).unwrap() {
            let distance = if continuous { -e.re } else { 1.0 - e.re.hypot(e.im) };
            prop_assert!(distance >= margin * (1.0 - 1e-6) - 1e-9 && margin > 0.0);
        }
    }

    #[test]
    fn similarity_and_units_do_not_matter(
        n in 1_usize..7, m in 1_usize..3, seed in 0_u64..1_000_000, continuous: bool,
        log_cost in -140_i32..140, log_time in -8_i32..8,
    ) {
        let p = Problem::new(n, m, seed);
        let (x, _) = p.solve(continuous);
        // x = T z, T an orthogonal-ish mix of very different units
        let mut t = mat(n, n, &random(seed + 5, n * n)) * 0.2;
        for i in 0..n {
            t[(i, i)] += 1.0;
        }
        let units = Mat::from_fn(n, n, |i, j| {
            if i == j { 10.0_f64.powi(4 * (i as i32 % 3) - 4) } else { 0.0 }
        });
        let t = t * units;
        let inverse_t = inverse(&t);
        let cost = 10.0_f64.powi(log_cost);
        let time = if continuous { 10.0_f64.powi(log_time) } else { 1.0 };
        let symmetric = |q: Mat<f64>| {
            Mat::from_fn(q.nrows(), q.ncols(), |i, j| 0.5 * q[(i, j)] + 0.5 * q[(j, i)])
        };
        let other = Problem {
            n, m,
            a: &inverse_t * &p.a * &t * time,
            b: &inverse_t * &p.b * time,
            q: symmetric(t.transpose() * &p.q * &t) * (cost * time),
            r: &p.r * (cost * time),
        };
        let (y, _) = other.solve(continuous);
        let back = inverse_t.transpose() * (y * (1.0 / cost)) * &inverse_t;
        prop_assert!(distance(&back, &x) < 1e-8, "{}", distance(&back, &x));
    }

    #[test]
    fn linear_equations_hold(n in 1_usize..9, m in 1_usize..6, seed in 0_u64..1_000_000) {
        let a = mat(n, n, &random(seed, n * n));
        let b = mat(m, m, &random(seed + 1, m * m));
        let c = mat(n, m, &random(seed + 2, n * m));
        let q = mat(n, n, &covariances(seed + 3, n, 1, 0.0));
        let limit = |x: &Mat<f64>| 1e-13 * (1.0 + x.norm_l2());
        // Not always stable, seldom singular.
        if let Ok(s) = lyapunov_continuous_one(a.as_ref(), q.as_ref()) {
            let x = &s.X;
            prop_assert!((&a * x + x * a.transpose() + &q).norm_l2() < limit(x) * n as f64);
            let stable = eigenvalues(a.as_ref()).unwrap().iter().all(|e| e.re < 0.0);
            prop_assert_eq!(s.report.margin > 0.0, stable);
        }
        if let Ok(s) = lyapunov_discrete_one(a.as_ref(), q.as_ref()) {
            let x = &s.X;
            prop_assert!((&a * x * a.transpose() - x + &q).norm_l2() < limit(x) * n as f64);
        }
        if let Ok(s) = sylvester_continuous_one(a.as_ref(), b.as_ref(), c.as_ref()) {
            let x = &s.X;
            prop_assert!((&a * x + x * &b + &c).norm_l2() < limit(x) * n as f64);
        }
        if let Ok(s) = sylvester_discrete_one(a.as_ref(), b.as_ref(), c.as_ref()) {
            let x = &s.X;
            prop_assert!((&a * x * &b - x + &c).norm_l2() < limit(x) * n as f64);
        }
    }
}
