//! Lyapunov, Sylvester and Riccati equations, the matrix exponential, sampling.

use super::matrix::*;

/// Continuous or discrete time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Time {
    /// Differential equations; stable means the open left half plane.
    Continuous,
    /// Difference equations; stable means the open unit disc.
    Discrete,
}

/// `A X + X B' + Q = 0` (continuous), `A X B' - X + Q = 0` (discrete), as one
/// linear system of the entries of `X`, with one step of refinement.
pub fn sylvester(a: &M, b: &M, q: &M, time: Time) -> M {
    let (n, m) = shape(q);
    let mut kron = zeros(n * m, n * m);
    for i in 0..n {
        for j in 0..m {
            let row = &mut kron[i * m + j];
            match time {
                Time::Continuous => {
                    (0..n).for_each(|k| row[k * m + j] += a[i][k]);
                    (0..m).for_each(|l| row[i * m + l] += b[j][l]);
                }
                Time::Discrete => {
                    for k in 0..n {
                        (0..m).for_each(|l| row[k * m + l] += a[i][k] * b[j][l]);
                    }
                    row[i * m + j] -= 1.0;
                }
            }
        }
    }
    let once = |rhs: &M| -> M {
        let column: M = rhs.iter().flatten().map(|v| vec![-v]).collect();
        let x = solve(&kron, &column);
        (0..n).map(|i| (0..m).map(|j| x[i * m + j][0]).collect()).collect()
    };
    let x = once(q);
    add(&x, &once(&sylvester_residual(a, b, q, &x, time)))
}

/// The left-hand side of the Sylvester equation at `x`.
pub fn sylvester_residual(a: &M, b: &M, q: &M, x: &M, time: Time) -> M {
    match time {
        Time::Continuous => add(&add(&mul(a, x), &mul(x, &t(b))), q),
        Time::Discrete => add(&sub(&prod(&[a, x, &t(b)]), x), q),
    }
}

/// Stationary covariance: `A X + X A' + Q = 0`, or `A X A' - X + Q = 0`.
pub fn lyapunov(a: &M, q: &M, time: Time) -> M {
    symmetric(&sylvester(a, a, q, time))
}

/// Stabilizing `X` of `A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0`.
///
/// The matrix sign function of the Hamiltonian gives a stabilizing start,
/// Newton's method (Kleinman 1968) the digits.
pub fn care(a: &M, b: &M, q: &M, r: &M, s: &M) -> M {
    let n = a.len();
    let ri = inverse(r);
    let a0 = sub(a, &prod(&[b, &ri, &t(s)]));
    let q0 = sub(q, &prod(&[s, &ri, &t(s)]));
    let g = prod(&[b, &ri, &t(b)]);
    // X is counted in units of `c`, which makes both off-diagonal blocks the same size.
    let ratio = (frob(&q0) / frob(&g)).sqrt();
    let c = if ratio.is_normal() { ratio } else { 1.0 };
    let (g_c, q_c) = (scale(-c, &g), scale(-1.0 / c, &q0));
    let mut w = blocks(&[&[&a0, &g_c], &[&q_c, &scale(-1.0, &t(&a0))]]);
    for _ in 0..100 {
        let (inv, log_det) = eliminate(&w, &eye(2 * n)).expect("an eigenvalue on the axis");
        let d = (-log_det / (2 * n) as f64).exp();
        let next = scale(0.5, &add(&scale(d, &w), &scale(1.0 / d, &inv)));
        let change = frob(&sub(&next, &w));
        w = next;
        if change <= 1e-12 * frob(&w) {
            break;
        }
    }
    // (sign + I) [I; X] = 0, in the sense of least squares.
    let w = add(&w, &eye(2 * n));
    let (left, right) = (part(&w, 0, 2 * n, 0, n), part(&w, 0, 2 * n, n, 2 * n));
    let x = solve(&mul(&t(&right), &right), &mul(&t(&right), &left));
    newton(scale(-c, &symmetric(&x)), |x| {
        let k = mul(&ri, &add(&mul(&t(b), x), &t(s)));
        (sub(a, &mul(b, &k)), cost(q, r, s, &k), Time::Continuous)
    })
}

/// Stabilizing `X` of `A'XA - X - (A'XB + S)(R + B'XB)^-1 (B'XA + S') + Q = 0`.
///
/// The Riccati recursion runs until it hardly moves, then Newton's method (Hewer 1971).
pub fn dare(a: &M, b: &M, q: &M, r: &M, s: &M) -> M {
    let gain = |x: &M| {
        let xb = mul(x, b);
        let head = add(r, &mul(&t(b), &xb));
        solve(&head, &add(&mul(&t(&xb), a), &t(s)))
    };
    let mut x = add(q, &scale(frob(q).max(1.0), &eye(a.len())));
    for _ in 0..200_000 {
        let k = gain(&x);
        let ac = sub(a, &mul(b, &k));
        let next = symmetric(&add(&prod(&[&t(&ac), &x, &ac]), &cost(q, r, s, &k)));
        let change = frob(&sub(&next, &x));
        x = next;
        if change <= 1e-10 * frob(&x) {
            break;
        }
    }
    newton(x, |x| {
        let k = gain(x);
        (sub(a, &mul(b, &k)), cost(q, r, s, &k), Time::Discrete)
    })
}

/// `[I; -K]' [[Q, S], [S', R]] [I; -K]`, the cost of the feedback `u = -K x`.
fn cost(q: &M, r: &M, s: &M, k: &M) -> M {
    let sk = mul(s, k);
    add(&sub(q, &add(&sk, &t(&sk))), &prod(&[&t(k), r, k]))
}

/// Newton's method: the Lyapunov equation of the current feedback, until steps stop shrinking.
fn newton(mut x: M, closed: impl Fn(&M) -> (M, M, Time)) -> M {
    let mut last = f64::INFINITY;
    for _ in 0..30 {
        let (ac, q, time) = closed(&x);
        let next = lyapunov(&t(&ac), &q, time);
        let step = frob(&sub(&next, &x));
        x = next;
        if step <= 1e-15 * frob(&x) || (step >= last && step <= 1e-8 * frob(&x)) {
            break;
        }
        last = step;
    }
    x
}

/// Steady Kalman-Bucy filter: `A P + P A' - P C' R^-1 C P + Q = 0`; returns `P` and `H = P C' R^-1`.
pub fn kalman_bucy(a: &M, c: &M, q: &M, r: &M) -> (M, M) {
    let p = care(&t(a), &t(c), q, r, &zeros(a.len(), c.len()));
    let h = prod(&[&p, &t(c), &inverse(r)]);
    (p, h)
}

/// Steady one-step predictor: prior `P`, gain `H = A P C' S^-1`, `S = C P C' + R`.
pub fn kalman(a: &M, c: &M, q: &M, r: &M) -> (M, M, M) {
    let p = dare(&t(a), &t(c), q, r, &zeros(a.len(), c.len()));
    let s = symmetric(&add(&prod(&[c, &p, &t(c)]), r));
    let h = prod(&[a, &p, &t(c), &inverse(&s)]);
    (p, h, s)
}

/// `e^A` by Taylor's series of `A / 2^k`, squared `k` times.
pub fn expm(a: &M) -> M {
    let k = (frob(a).max(1e-300).log2().ceil() as i32 + 2).max(0);
    let small = scale(0.5f64.powi(k), a);
    let (mut sum, mut term) = (eye(a.len()), eye(a.len()));
    for j in 1..25 {
        term = scale(1.0 / f64::from(j), &mul(&term, &small));
        sum = add(&sum, &term);
    }
    for _ in 0..k {
        sum = mul(&sum, &sum);
    }
    sum
}

/// Zero-order hold: `e^{A dt}` and `int_0^dt e^{A s} ds B`.
pub fn hold(a: &M, b: &M, dt: f64) -> (M, M) {
    let ((n, m), all) = (shape(b), a.len() + shape(b).1);
    let e = expm(&scale(dt, &blocks(&[&[a, b], &[&zeros(m, n), &zeros(m, m)]])));
    (part(&e, 0, n, 0, n), part(&e, 0, n, n, all))
}

/// Sampled noise (van Loan 1978): `int_0^dt e^{A s} Q e^{A's} ds`.
pub fn van_loan(a: &M, q: &M, dt: f64) -> M {
    let n = a.len();
    let e = expm(&scale(dt, &blocks(&[&[&scale(-1.0, a), q], &[&zeros(n, n), &t(a)]])));
    let ad = t(&part(&e, n, 2 * n, n, 2 * n));
    symmetric(&mul(&ad, &part(&e, 0, n, n, 2 * n)))
}
