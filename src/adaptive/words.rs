//! Directions that the output does not show, in words.
//!
//! A change of coordinates `x -> (I + eps M) x` with `C M = 0` leaves the output alone.
//! It changes the right-hand side `F(x) = A x + Gamma theta + f` by
//!
//! ```text
//! M F(x) - F'(x) M x = sum_i d theta_i g_i(x, u)        for all x, u
//! ```
//! if the family holds the plant in its new coordinates. `M` is found by least squares
//! over points; a direction that has one is told as the change of coordinates.

use faer::Mat;

use super::identify::{Probe, scatter};
use super::layout::Kind;
use crate::solve::backend;

/// Relative misfit up to which a direction is a change of coordinates.
const MISFIT: f64 = 1e-5;
/// Share of the largest coefficient below which one is left out.
const SMALL: f64 = 1e-4;
/// Letters of coefficients.
const LETTERS: [&str; 8] = ["alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta"];

/// One sentence a cause.
pub(super) fn explain(probe: &Probe<'_>, directions: &[Vec<f64>]) -> Vec<String> {
    let n = probe.structure.states.len();
    let mut moved = vec![false; n * n];
    let mut others = Vec::new();
    for direction in directions {
        match coordinates(probe, direction) {
            Some(m) => {
                let largest = m.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
                for (flag, v) in moved.iter_mut().zip(&m) {
                    *flag |= v.abs() > SMALL * largest;
                }
            }
            None => others.push(combination(probe, direction)),
        }
    }
    let mut sentences = Vec::new();
    let mut letters = LETTERS.iter();
    let states = &probe.structure.states;
    let mut changes = Vec::new();
    for i in (0..n).filter(|i| moved[i * n..][..n].contains(&true)) {
        // the state itself stands first
        let order = std::iter::once(i).chain((0..n).filter(|j| *j != i));
        let mut terms = Vec::new();
        for j in order {
            match (moved[i * n + j], i == j) {
                (true, _) => {
                    let letter = letters.next().copied().unwrap_or("omega");
                    terms.push(format!("{letter} {}", states[j]));
                }
                (false, true) => terms.push(states[j].clone()),
                (false, false) => {}
            }
        }
        changes.push(format!("{} -> {}", states[i], terms.join(" + ")));
    }
    if !changes.is_empty() {
        sentences.push(format!("{} leaves y unchanged", changes.join(", ")));
    }
    sentences.extend(others);
    sentences
}

/// "d b + 0.5 d c leaves y unchanged", "c does not reach y".
fn combination(probe: &Probe<'_>, direction: &[f64]) -> String {
    let largest =
        direction.iter().fold(0.0_f64, |most, v| if v.abs() > most.abs() { *v } else { most });
    let terms: Vec<(f64, &str)> = (direction.iter().zip(&probe.structure.unknown))
        .filter(|(v, _)| v.abs() > SMALL * largest.abs())
        .map(|(v, unknown)| (v / largest, unknown.name.as_str()))
        .collect();
    if let [(_, name)] = terms[..] {
        return format!("{name} does not reach y");
    }
    let mut text = String::from("changing");
    for (k, (share, name)) in terms.iter().enumerate() {
        let sign = match (k, *share < 0.0) {
            (0, false) => "",
            (0, true) => "-",
            (_, false) => "+ ",
            (_, true) => "- ",
        };
        let size = share.abs();
        let size = if (size - 1.0).abs() < SMALL { String::new() } else { format!("{size:.4} ") };
        text.push_str(&format!(" {sign}{size}{name}"));
    }
    format!("{text} together leaves y unchanged")
}

/// Columns that span the states the output does not see, by elimination.
fn unseen(c: &Mat<f64>) -> Vec<Vec<f64>> {
    let (q, n) = (c.nrows(), c.ncols());
    let mut rows: Vec<Vec<f64>> = (0..q).map(|i| (0..n).map(|j| c[(i, j)]).collect()).collect();
    let mut pivots: Vec<(usize, usize)> = Vec::new();
    for i in 0..q {
        let best = (0..n).max_by(|&a, &b| rows[i][a].abs().total_cmp(&rows[i][b].abs()));
        let Some(j) = best.filter(|&j| rows[i][j].abs() > 1e-12) else { continue };
        let pivot: Vec<f64> = rows[i].iter().map(|v| v / rows[i][j]).collect();
        for (k, row) in rows.iter_mut().enumerate() {
            let factor = row[j];
            if k != i {
                row.iter_mut().zip(&pivot).for_each(|(r, p)| *r -= factor * p);
            }
        }
        rows[i] = pivot;
        pivots.push((i, j));
    }
    let free = (0..n).filter(|j| !pivots.iter().any(|(_, p)| p == j));
    let vector = |f: usize| {
        let mut v = vec![0.0; n];
        v[f] = 1.0;
        for &(row, j) in &pivots {
            v[j] = -rows[row][f];
        }
        v
    };
    free.map(vector).collect()
}

/// The change of coordinates behind a direction, row by row.
fn coordinates(probe: &Probe<'_>, direction: &[f64]) -> Option<Vec<f64>> {
    let [n, m, _, _] = probe.structure.sizes();
    let hidden = unseen(&probe.tuning.C);
    let unknowns = hidden.len() * n;
    if unknowns == 0 {
        return None;
    }
    // F'(x) along what the output does not see: y stays, and what hangs on it
    let mut slope = probe.tuning.A.clone();
    for (kind, theta) in probe.kinds.iter().zip(probe.theta) {
        if let Kind::Estimated { row, col } | Kind::Measured { row, col, .. } = *kind {
            slope[(row, col)] += theta;
        }
    }
    let points = 3 * n + 4;
    let (mut gross, mut whole) = (0.0_f64, 0.0_f64);
    let mut left = Mat::zeros(points * n, unknowns);
    let mut right = Mat::zeros(points * n, 1);
    for s in 0..points {
        let draw = |k: usize| scatter(s * (n + m) + k) + 0.5 * scatter(977 + 3 * s + 11 * k);
        let x: Vec<f64> = (0..n).map(draw).collect();
        let u: Vec<f64> = (n..n + m).map(draw).collect();
        let (g, known) = probe.regressors(0.37 * s as f64, &u, &x);
        let f = probe.derivative(&x, &g, &known);
        for i in 0..n {
            for (a, v) in hidden.iter().enumerate() {
                let along: f64 = (0..n).map(|j| slope[(i, j)] * v[j]).sum();
                for b in 0..n {
                    left[(s * n + i, a * n + b)] = v[i] * f[b] - along * x[b];
                }
            }
            let terms = || direction.iter().enumerate().map(|(k, d)| d * g[k * n + i]);
            right[(s * n + i, 0)] = terms().sum::<f64>();
            gross = terms().fold(gross, |most, v| most.max(v.abs()));
            whole = whole.max(terms().sum::<f64>().abs());
        }
    }
    // columns that cancel each other need no change of coordinates
    if whole <= 1e-9 * gross {
        return None;
    }
    let solution = backend::least_squares(left.clone(), right.clone());
    let mut misfit = 0.0_f64;
    for e in 0..points * n {
        let fit: f64 = (0..unknowns).map(|k| left[(e, k)] * solution[(k, 0)]).sum();
        misfit = misfit.max((fit - right[(e, 0)]).abs());
    }
    // false for NaN as well
    let fits = misfit <= MISFIT * whole;
    if !fits {
        return None;
    }
    let entry = |i: usize, j: usize| {
        hidden.iter().enumerate().map(|(a, v)| v[i] * solution[(a * n + j, 0)]).sum()
    };
    Some((0..n * n).map(|e| entry(e / n, e % n)).collect())
}
