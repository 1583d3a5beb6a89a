//! Errors that say why, problems on the edge, and what a call must leave alone.

use std::hint::black_box;

use super::batch::{covariances, random};
use super::reference::error;
use mmae::Error;
use mmae::solve::{Riccati, Solutions, care, dare};

fn problem<'a>(a: &'a [f64], b: &'a [f64], q: &'a [f64], r: &'a [f64]) -> Riccati<'a> {
    let (m, n) = (r.len().isqrt(), q.len().isqrt());
    Riccati { n, m, len: 1, A: a, B: b, Q: q, R: r, S: None }
}

fn status(s: &Solutions) -> &Result<(), Error> {
    &s.items[0].status
}

#[test]
fn the_mode_at_fault_is_named() {
    // The second state grows and is not reached.
    let p = problem(&[-1.0, 0.0, 0.0, 2.0], &[1.0, 0.0], &[1.0, 0.0, 0.0, 1.0], &[1.0]);
    for s in [care(&p).unwrap(), dare(&p).unwrap()] {
        let Err(Error::NotStabilizable { eigenvalue, states, .. }) = status(&s) else {
            panic!("{s:?}")
        };
        assert!((eigenvalue.re - 2.0).abs() < 1e-12 && states == "x2");
    }
    // The first state stays where it is and costs nothing.
    let q = [0.0, 0.0, 0.0, 1.0];
    let (eye, b) = ([1.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0]);
    let s = care(&problem(&[0.0, 0.0, 0.0, -1.0], &b, &q, &eye)).unwrap();
    assert!(
        matches!(status(&s), Err(Error::NotDetectable { states, .. }) if states == "x1"),
        "{s:?}"
    );
    let s = dare(&problem(&[1.0, 0.0, 0.0, 0.5], &b, &q, &eye)).unwrap();
    assert!(
        matches!(status(&s), Err(Error::NotDetectable { states, .. }) if states == "x1"),
        "{s:?}"
    );
    // A mode that grows is stabilized though it costs nothing; a stable one may be unreached.
    let s = care(&problem(&[1.0, 0.0, 0.0, -1.0], &[1.0, 0.0], &[0.0; 4], &[1.0])).unwrap();
    assert!((s.item(0).unwrap()[0] - 2.0).abs() < 1e-14 && s.items[0].margin > 0.0, "{s:?}");
}

/// CAREX 2.5: `X = [2 1; 1 1]` for every `eps`, closed-loop eigenvalues at `-eps/2 +- ..`.
#[test]
fn near_the_edge_the_condition_grows_and_the_bound_holds() {
    let mut last = 0.0;
    for k in 0..=6 {
        let e = 10.0_f64.powi(-k);
        let a = [3.0 - e, 1.0, 4.0, 2.0 - e];
        let q = [4.0 * e - 11.0, 2.0 * e - 5.0, 2.0 * e - 5.0, 2.0 * e - 2.0];
        let s = care(&problem(&a, &[1.0, 1.0], &q, &[1.0])).unwrap();
        let item = &s.items[0];
        let (bound, condition) = (item.error_bound.unwrap(), item.condition.unwrap());
        // The data are rounded, so the printed solution is off by the condition.
        let distance = error(s.item(0).unwrap(), &[2.0, 1.0, 1.0, 1.0]);
        assert!(distance <= bound + 4.0 * condition * f64::EPSILON, "eps {e}: {item:?}");
        assert!(condition > last, "eps {e}: {condition:e} after {last:e}");
        last = condition;
    }
    assert!(last > 1e5);
}

#[test]
fn the_scale_of_the_cost_does_not_matter() {
    let a = [0.0, 1.0, 0.0, 0.0];
    for exponent in [-150, -75, -50, -20, 20, 50, 75, 150] {
        let f = 10.0_f64.powi(exponent);
        let s = care(&problem(&a, &[0.0, 1.0], &[f, 0.0, 0.0, 2.0 * f], &[f])).unwrap();
        let x = s.item(0).unwrap();
        assert!(error(x, &[2.0 * f, f, f, 2.0 * f]) < 1e-15, "1e{exponent}: {x:?}");
        // An unstable state and a weight that hardly matters: X = 2 a r / b^2.
        let s = care(&problem(&[3.0, 1.0, 0.0, -1.0], &[1.0, 0.0], &[0.0, 0.0, 0.0, f], &[1.0]));
        let s = s.unwrap();
        if exponent < 0 {
            let item = &s.items[0];
            assert!(item.status.is_ok() && item.margin > 0.0, "1e{exponent}: {item:?}");
        }
    }
}

#[test]
fn the_steady_filter_solves_the_equation() {
    for (n, m) in [(1, 1), (3, 1), (4, 2)] {
        let a: Vec<f64> = random(7, n * n).iter().map(|x| 0.9 * x).collect();
        let c = random(8, m * n);
        let (q, r) = (covariances(9, n, 1, 0.05), covariances(10, m, 1, 0.1));
        let at: Vec<f64> = (0..n * n).map(|e| a[e % n * n + e / n]).collect();
        let ct: Vec<f64> = (0..n * m).map(|e| c[e % m * n + e / m]).collect();
        let s = dare(&problem(&at, &ct, &q, &r)).unwrap();
        let x = s.item(0).unwrap();
        let product = |x: &[f64], y: &[f64], [p, d, k]: [usize; 3]| -> Vec<f64> {
            let entry = |i: usize, j: usize| (0..d).map(|l| x[i * d + l] * y[l * k + j]).sum();
            (0..p * k).map(|e| entry(e / k, e % k)).collect()
        };
        let mut p = q.clone();
        for _ in 0..3000 {
            let pc = product(&p, &ct, [n, n, m]);
            let mut innovation = product(&c, &pc, [m, n, m]);
            innovation.iter_mut().zip(&r).for_each(|(s, r)| *s += r);
            let mut gain: Vec<f64> = (0..m * n).map(|e| pc[e % n * m + e / n]).collect();
            let (rows, cols) = (mmae::small::Dyn(m), mmae::small::Dyn(n));
            mmae::small::solve(rows, cols, &mut innovation, &mut gain, &mut vec![0.0; m]);
            let update = product(&pc, &gain, [n, m, n]);
            let after: Vec<f64> = p.iter().zip(&update).map(|(p, u)| p - u).collect();
            p = product(&product(&a, &after, [n, n, n]), &at, [n, n, n]);
            p.iter_mut().zip(&q).for_each(|(p, q)| *p += q);
            let mean = |e: usize| 0.5 * (p[e] + p[e % n * n + e / n]);
            p = (0..n * n).map(mean).collect();
        }
        assert!(error(&p, x) < 1e-13, "n = {n}: {:e}", error(&p, x));
    }
}

#[test]
fn subnormal_numbers_of_the_caller_survive() {
    let s = care(&problem(&[1.0], &[1.0], &[5e-324], &[1.0])).unwrap();
    assert_eq!(s.items[0].status.is_ok(), s.x[0].is_finite());
    let half = black_box(f64::MIN_POSITIVE) * black_box(0.5);
    assert!(half > 0.0 && half * 2.0 == f64::MIN_POSITIVE);
}
