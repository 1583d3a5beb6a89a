//! Example 4.1 of Liu and Peng.

use std::sync::Arc;

use mmae::adaptive::{FnRegressor, Prior, Structure, Tuning, Unknown};
use mmae::mat;

pub(crate) const TRUTH: [f64; 4] = [3.0, -3.0, 4.5, -4.0];

/// Parameters da1 (measured), da2 (estimated), b and c.
pub(crate) fn structure() -> Structure {
    let given = FnRegressor::new(2, |_, u, y, gamma, _| {
        gamma.copy_from_slice(&[0.0, u[0], 0.0, y[0].sin()]);
    });
    Structure {
        states: vec!["x1".into(), "x2".into()],
        outputs: vec!["y".into()],
        inputs: 1,
        unknown: vec![
            Unknown::entry("da1", 1, 0),
            Unknown::entry("da2", 1, 1),
            Unknown::given("b"),
            Unknown::given("c"),
        ],
        regressor: Arc::new(given),
    }
}

pub(crate) fn tuning(p0: f64) -> Tuning {
    let (a, c, k) = (mat![[0.0, 1.0], [-7.0, -2.0]], mat![[1.0, 0.0]], mat![[5.0], [-5.0]]);
    let start = vec![0.0, 0.0, 1.5, -1.0];
    Tuning {
        lambda: 0.15,
        x_hat: vec![0.0, 2.0],
        ..Tuning::new(a, c, k, start, Prior::uniform(p0, 4))
    }
}

pub(crate) fn input(t: f64) -> f64 {
    1.1 * (0.3 * t).sin() + 1.2 * t.sin() + (1.5 * t).sin()
}

/// Inputs and outputs of the plant at `k h`, by Runge-Kutta with steps of at most 5 ms.
pub(crate) fn record(h: f64, steps: usize, u: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
    let flow = |t: f64, [a, b]: [f64; 2]| [b, -4.0 * a - 5.0 * b + 4.5 * u(t) - 4.0 * a.sin()];
    let parts = (h / 5e-3).ceil().max(1.0);
    let part = h / parts;
    let mut x = [0.0; 2];
    let (mut us, mut ys) = (vec![u(0.0)], vec![0.0]);
    for k in 1..steps {
        for i in 0..parts as usize {
            let t = (k - 1) as f64 * h + i as f64 * part;
            x = runge_kutta(&flow, t, part, x);
        }
        us.push(u(k as f64 * h));
        ys.push(x[0]);
    }
    (us, ys)
}

/// A step of the classical method.
pub(crate) fn runge_kutta<const N: usize>(
    flow: &impl Fn(f64, [f64; N]) -> [f64; N],
    t: f64,
    h: f64,
    x: [f64; N],
) -> [f64; N] {
    let at = |k: [f64; N], share: f64| std::array::from_fn(|i| x[i] + share * h * k[i]);
    let a = flow(t, x);
    let b = flow(t + 0.5 * h, at(a, 0.5));
    let c = flow(t + 0.5 * h, at(b, 0.5));
    let d = flow(t + h, at(c, 1.0));
    std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
}

/// The time from which on all parameters stay within `share` of the truth.
pub(crate) fn settled(theta: &[f64], truth: &[f64], dt: f64, share: f64) -> f64 {
    let inside = |row: &[f64]| row.iter().zip(truth).all(|(v, w)| (v - w).abs() <= share * w.abs());
    let rows = theta.chunks_exact(truth.len());
    let last_out = rows.enumerate().filter(|(_, row)| !inside(row)).map(|(k, _)| k + 1).next_back();
    last_out.unwrap_or(0) as f64 * dt
}
