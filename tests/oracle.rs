//! The oracle of `tests/common`, proved on closed forms and on numbers from elsewhere.

mod common;

use common::check::{assert_close_matrix, rel_matrix};
use common::data::{self, equations, matrix};
use common::equations::*;
use common::matrix::*;
use common::{assert_bits, assert_close};

fn sample(n: usize, m: usize) -> M {
    let entry = |i: usize, j: usize| ((7 * i + 3 * j + 1) % 11) as f64 / 5.0 - 1.0;
    (0..n).map(|i| (0..m).map(|j| entry(i, j)).collect()).collect()
}

#[test]
fn elimination_solves_and_knows_determinants() {
    let a = vec![vec![0.0, 2.0], vec![3.0, 4.0]];
    assert_close("ln 6", log_det(&a), 6f64.ln(), 1e-15);
    assert_close_matrix("A A^-1", &mul(&a, &inverse(&a)), &eye(2), 1e-15);
    assert!(eliminate(&vec![vec![1.0, 2.0], vec![2.0, 4.0]], &eye(2)).is_none());
    // Hilbert matrix: the inverse has integer entries, its determinant is 1/6048000.
    let h: M = (0..4).map(|i| (0..4).map(|j| 1.0 / (i + j + 1) as f64).collect()).collect();
    assert_close("Hilbert inverse", inverse(&h)[3][3], 2800.0, 1e-11);
    assert_close("Hilbert det", log_det(&h), -(6_048_000f64.ln()), 1e-12);
}

#[test]
fn bits_are_compared_as_bits() {
    assert_bits("same", &[0.0, f64::NAN], &[0.0, f64::NAN]);
    let differ = std::panic::catch_unwind(|| assert_bits("zeros", &[0.0], &[-0.0]));
    assert!(differ.is_err());
}

#[test]
fn exponentials_of_known_matrices() {
    let (s, c) = 20f64.sin_cos();
    let rotation = expm(&vec![vec![0.0, 20.0], vec![-20.0, 0.0]]);
    assert_close_matrix("rotation", &rotation, &vec![vec![c, s], vec![-s, c]], 1e-13);
    let shift = expm(&vec![vec![0.0, 3.0, 0.0], vec![0.0, 0.0, 3.0], vec![0.0; 3]]);
    let exact = vec![vec![1.0, 3.0, 4.5], vec![0.0, 1.0, 3.0], vec![0.0, 0.0, 1.0]];
    assert_close_matrix("nilpotent", &shift, &exact, 1e-14);
    let decay = expm(&diag(&[-30.0, 1.0]));
    assert_close("e^-30", decay[0][0], (-30f64).exp(), 1e-12);
    assert_close_matrix("zero", &expm(&zeros(2, 2)), &eye(2), 0.0);
}

#[test]
fn sampling_a_double_integrator() {
    let (a, dt) = (vec![vec![0.0, 1.0], vec![0.0, 0.0]], 0.3);
    let (ad, bd) = hold(&a, &vec![vec![0.0], vec![1.0]], dt);
    assert_close_matrix("A_d", &ad, &vec![vec![1.0, dt], vec![0.0, 1.0]], 1e-15);
    assert_close_matrix("B_d", &bd, &vec![vec![dt * dt / 2.0], vec![dt]], 1e-15);
    let (d2, d3) = (dt * dt / 2.0, dt.powi(3) / 3.0);
    let qd = van_loan(&a, &diag(&[0.0, 1.0]), dt);
    assert_close_matrix("Q_d", &qd, &vec![vec![d3, d2], vec![d2, dt]], 1e-15);
}

#[test]
fn sylvester_equations_of_diagonal_matrices_and_residuals() {
    let (la, lb) = ([-1.0, -2.5, -0.3], [-0.7, -4.0]);
    let q = sample(3, 2);
    for time in [Time::Continuous, Time::Discrete] {
        let f = if time == Time::Discrete { 0.2 } else { 1.0 };
        let x = sylvester(&scale(f, &diag(&la)), &scale(f, &diag(&lb)), &q, time);
        for i in 0..3 {
            for j in 0..2 {
                let (l, m) = (f * la[i], f * lb[j]);
                let want = match time {
                    Time::Continuous => -q[i][j] / (l + m),
                    Time::Discrete => q[i][j] / (1.0 - l * m),
                };
                assert_close("diagonal", x[i][j], want, 1e-14);
            }
        }
        let a = sub(&scale(0.2 * f, &sample(4, 4)), &scale(0.5, &eye(4)));
        let (b, q) = (scale(0.1 * f, &sample(3, 3)), sample(4, 3));
        let x = sylvester(&a, &b, &q, time);
        let residual = frob(&sylvester_residual(&a, &b, &q, &x, time));
        assert!(residual < 1e-13 * frob(&x), "residual {residual:e}");
    }
}

#[test]
fn lyapunov_equations_of_the_collections() {
    let mut solved = 0;
    for e in equations("lyap.json") {
        let time = if e.eq == "clyap" { Time::Continuous } else { Time::Discrete };
        if let (Some(x), "easy" | "moderate") = (&e.x, e.difficulty.as_str()) {
            let error = rel_matrix(&lyapunov(&e.a, &e.q, time), x);
            assert!(error <= e.tol, "{}: {error:e} > {:e}", e.id, e.tol);
            solved += 1;
        }
    }
    assert_eq!(solved, 14);
}

#[test]
fn riccati_equations_in_closed_form() {
    // Double integrator, y = position: P in fourth roots of q and r.
    let (q, r) = (3.0f64, 0.2f64);
    let a = vec![vec![0.0, 1.0], vec![0.0, 0.0]];
    let (p, h) = kalman_bucy(&a, &vec![vec![1.0, 0.0]], &diag(&[0.0, q]), &diag(&[r]));
    let p11 = 2f64.sqrt() * q.powf(0.25) * r.powf(0.75);
    let p22 = 2f64.sqrt() * q.powf(0.75) * r.powf(0.25);
    let want = vec![vec![p11, (q * r).sqrt()], vec![(q * r).sqrt(), p22]];
    assert_close_matrix("P", &p, &want, 1e-14);
    assert_close("H", h[1][0], (q / r).sqrt(), 1e-14);
    // Random walk in noise: P^2 - q P - q r = 0.
    let (p, h, s) = kalman(&eye(1), &eye(1), &diag(&[q]), &diag(&[r]));
    let want = (q + (q * q + 4.0 * q * r).sqrt()) / 2.0;
    assert_close("P", p[0][0], want, 1e-14);
    assert_close("H S = P", h[0][0] * s[0][0], want, 1e-14);
    // Cross term, scalar: X from the quadratic equation.
    let x = care(&eye(1), &eye(1), &diag(&[2.0]), &eye(1), &diag(&[0.5]));
    assert_close("X", x[0][0], 0.5 + 2f64.sqrt(), 1e-14);
}

#[test]
fn riccati_equations_of_the_collections() {
    let mut solved = 0;
    for name in ["carex.json", "darex.json"] {
        for e in equations(name) {
            let n = e.a.len();
            let benign = ["easy", "moderate"].contains(&e.difficulty.as_str());
            if n > 11 || !benign || e.tol > 1e-9 {
                continue;
            }
            let (b, r) = (e.b.unwrap(), e.r.unwrap());
            let s = e.s.unwrap_or_else(|| zeros(n, r.len()));
            let solve = if e.eq == "care" { care } else { dare };
            let error = rel_matrix(&solve(&e.a, &b, &e.q, &r, &s), &e.x.unwrap());
            let tol = 10.0 * e.tol.max(1e-12);
            assert!(error <= tol, "{}: {error:e} > {tol:e}", e.id);
            solved += 1;
        }
    }
    assert!(solved >= 25, "only {solved}");
    for c in data::load("oscillator.json")["care"]["items"].as_array().unwrap() {
        let g = [5.0, 0.0, 0.0].map(|v| vec![v]).to_vec();
        let q = scale(100.0, &mul(&g, &t(&g)));
        let (p, _) = kalman_bucy(&matrix(&c["A"]), &vec![vec![0.0, 1.0, 0.0]], &q, &diag(&[0.1]));
        assert_close_matrix("oscillator", &p, &matrix(&c["P"]), 1e-11);
    }
}
