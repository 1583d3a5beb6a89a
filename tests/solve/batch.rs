//! Item `k` of a batch has the bits it has alone, whatever its neighbours.

use super::common::assert_bits;
use mmae::par::RunControl;
use mmae::solve::{
    Checks, Lyapunov, Riccati, Solutions, Sylvester, care_with, dare_with,
    lyapunov_continuous_with, lyapunov_discrete_with, sylvester_continuous_with,
    sylvester_discrete_with,
};
use mmae::{Error, Result};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

pub(crate) fn random(seed: u64, count: usize) -> Vec<f64> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// `len` matrices `M M' + shift I` of order `n`.
pub(crate) fn covariances(seed: u64, n: usize, len: usize, shift: f64) -> Vec<f64> {
    let roots = random(seed, n * n * len);
    let mut out = Vec::new();
    for root in roots.chunks_exact(n * n) {
        for i in 0..n {
            for j in 0..n {
                let (a, b) = (i.max(j), i.min(j));
                let sum: f64 = (0..n).map(|k| root[a * n + k] * root[b * n + k]).sum();
                out.push(sum + if i == j { shift } else { 0.0 });
            }
        }
    }
    out
}

/// One problem of each kind: solves items `from..to` of a fixed family.
struct Family {
    n: usize,
    m: usize,
    a: Vec<f64>,
    b: Vec<f64>,
    q: Vec<f64>,
    r: Vec<f64>,
    c: Vec<f64>,
    square: Vec<f64>,
}

impl Family {
    fn new(n: usize, m: usize, len: usize) -> Self {
        let mut a = random(1, len * n * n);
        for a in a.chunks_exact_mut(n * n) {
            // Stable in both senses, for the linear equations.
            a.iter_mut().for_each(|x| *x *= 0.4 / n as f64);
            (0..n).for_each(|i| a[i * n + i] -= 0.5);
        }
        let mut square = random(5, len * m * m);
        for b in square.chunks_exact_mut(m * m) {
            b.iter_mut().for_each(|x| *x *= 0.4 / m as f64);
            (0..m).for_each(|i| b[i * m + i] -= 0.5);
        }
        let (q, r) = (covariances(3, n, len, 0.1), covariances(4, m, len, 0.1));
        let (b, c) = (random(2, len * n * m), random(6, len * n * m));
        Family { n, m, a, b, q, r, c, square }
    }

    fn solve(&self, kind: usize, from: usize, to: usize, threads: usize) -> Result<Solutions> {
        self.solve_for(Checks::All, kind, from, to, threads)
    }

    fn solve_for(
        &self,
        checks: Checks,
        kind: usize,
        from: usize,
        to: usize,
        threads: usize,
    ) -> Result<Solutions> {
        let (n, m, len) = (self.n, self.m, to - from);
        let control = RunControl::default().threads(threads);
        let part = |x: &[f64], size: usize| x[from * size..to * size].to_vec();
        let (a, b, q) = (part(&self.a, n * n), part(&self.b, n * m), part(&self.q, n * n));
        let (r, c) = (part(&self.r, m * m), part(&self.c, n * m));
        let square = part(&self.square, m * m);
        let riccati = Riccati { n, m, len, A: &a, B: &b, Q: &q, R: &r, S: None };
        let lyapunov = Lyapunov { n, len, A: &a, Q: &q };
        let sylvester = Sylvester { n, m, len, A: &a, B: &square, C: &c };
        match kind {
            0 => care_with(&riccati, checks, &control),
            1 => dare_with(&riccati, checks, &control),
            2 => lyapunov_continuous_with(&lyapunov, checks, &control),
            3 => lyapunov_discrete_with(&lyapunov, checks, &control),
            4 => sylvester_continuous_with(&sylvester, checks, &control),
            _ => sylvester_discrete_with(&sylvester, checks, &control),
        }
    }
}

const KINDS: usize = 6;

#[test]
fn every_length_gives_the_bits_of_single_problems() {
    for (n, m) in [(1, 1), (3, 2), (4, 1), (6, 3)] {
        let family = Family::new(n, m, 17);
        for kind in 0..KINDS {
            let alone: Vec<Solutions> =
                (0..17).map(|k| family.solve(kind, k, k + 1, 1).unwrap()).collect();
            for len in 1..=17 {
                let all = family.solve(kind, 0, len, 1).unwrap();
                for k in 0..len {
                    let what = format!("kind {kind} n={n} item {k} of {len}");
                    assert_eq!(all.items[k].status, Ok(()), "{what}");
                    assert_bits(&what, all.item(k).unwrap(), &alone[k].x);
                    assert_eq!(all.items[k], alone[k].items[0], "{what}");
                }
            }
        }
    }
}

#[test]
fn without_bounds_solutions_are_as_good_and_as_stable() {
    let family = Family::new(5, 2, 17);
    for kind in 0..KINDS {
        let with = family.solve(kind, 0, 17, 1).unwrap();
        let without = family.solve_for(Checks::Stability, kind, 0, 17, 1).unwrap();
        for (k, (item, full)) in without.items.iter().zip(&with.items).enumerate() {
            assert!(item.status.is_ok() && item.margin == full.margin, "{item:?} {full:?}");
            assert_eq!((item.error_bound, item.condition), (None, None));
            let bound = full.error_bound.unwrap() + f64::EPSILON;
            let size = with.item(k).unwrap().iter().map(|x| x * x).sum::<f64>().sqrt();
            for (x, y) in without.item(k).unwrap().iter().zip(with.item(k).unwrap()) {
                assert!((x - y).abs() <= bound * size, "kind {kind} item {k}: {x} {y}");
            }
        }
    }
}

#[test]
fn a_bad_item_leaves_its_neighbours_alone() {
    let (n, m, len) = (3, 2, 19);
    let mut family = Family::new(n, m, len);
    let whole: Vec<Solutions> =
        (0..KINDS).map(|kind| family.solve(kind, 0, len, 1).unwrap()).collect();
    // NaN, infinity, asymmetry, an equation that runs to the iteration cap.
    family.a[2 * n * n + 4] = f64::NAN;
    family.a[9 * n * n] = f64::INFINITY;
    family.q[11 * n * n + 1] += 1e-3;
    let zero = 12 * n * n..13 * n * n;
    family.a[zero.clone()].fill(0.0);
    family.q[zero].fill(0.0);
    family.b[12 * n * m..13 * n * m].fill(0.0);
    for (kind, before) in whole.iter().enumerate() {
        let after = family.solve(kind, 0, len, 2).unwrap();
        for k in (0..len).filter(|k| ![2, 9, 11, 12].contains(k)) {
            assert_bits("neighbour", after.item(k).unwrap(), before.item(k).unwrap());
            assert_eq!(after.items[k], before.items[k]);
        }
        for (k, row, col) in [(2, 1, 1), (9, 0, 0)] {
            let what = format!("item {k}: A");
            let expected = Error::NonFinite { what, row, col };
            assert_eq!(after.items[k].status, Err(expected), "kind {kind}");
            assert!(after.x[k * before.rows * before.cols].is_nan());
        }
        if kind < 4 {
            let status = &after.items[11].status;
            assert!(matches!(status, Err(Error::NotSymmetric { .. })), "{status:?}");
        }
    }
    let status = &family.solve(0, 0, len, 1).unwrap().items[12].status;
    assert!(matches!(status, Err(Error::NotStabilizable { .. })), "{status:?}");
}

#[test]
fn threads_do_not_matter() {
    let family = Family::new(4, 2, 403);
    for kind in 0..KINDS {
        let one = family.solve(kind, 0, 403, 1).unwrap();
        for threads in [2, 3, 8] {
            assert_eq!(family.solve(kind, 0, 403, threads).unwrap(), one);
        }
    }
}

#[test]
fn shared_arrays_are_repeated() {
    let family = Family::new(3, 2, 5);
    let p = Riccati {
        n: 3,
        m: 2,
        len: 5,
        A: &family.a,
        B: &family.b[..6],
        Q: &family.q[..9],
        R: &family.r[..4],
        S: None,
    };
    let all = mmae::solve::care(&p).unwrap();
    for k in 0..5 {
        let one = Riccati { len: 1, A: &family.a[k * 9..][..9], ..p };
        assert_bits("item", all.item(k).unwrap(), &mmae::solve::care(&one).unwrap().x);
    }
}

#[test]
fn a_long_solve_can_be_cancelled() {
    let (n, len) = (6, 60_000);
    let mut a = random(7, n * n);
    (0..n).for_each(|i| a[i * n + i] -= 4.0);
    let q = covariances(8, n, len, 0.1);
    let p = Lyapunov { n, len, A: &a, Q: &q };
    for threads in [1, 2] {
        let (flag, seen) = (AtomicBool::new(false), AtomicU64::new(0));
        let stop = |done: u64, total: u64| {
            assert!(done < total);
            seen.store(done, Ordering::Relaxed);
            flag.store(true, Ordering::Relaxed);
        };
        let control = RunControl::default().threads(threads).cancel(&flag).progress(&stop);
        let out = lyapunov_continuous_with(&p, Checks::All, &control);
        assert_eq!(out.err(), Some(Error::Cancelled));
        let seen = seen.into_inner();
        assert!(seen > 0 && seen < len as u64 / 2, "{seen} of {len} were solved all the same");
    }
}
