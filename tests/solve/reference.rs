//! Published and constructed problems with solutions to 40 digits.

use super::common::data::{self, Equation};
use super::common::matrix::{M, frob, sub};
use mmae::Error;
use mmae::solve::{
    Lyapunov, Riccati, Solutions, care, dare, lyapunov_continuous, lyapunov_discrete,
};

pub(crate) fn flat(x: &M) -> Vec<f64> {
    x.iter().flatten().copied().collect()
}

/// `|x - y| / |y|` without overflow.
pub(crate) fn error(x: &[f64], y: &[f64]) -> f64 {
    let scale = y.iter().fold(0.0_f64, |s, v| s.max(v.abs()));
    let row = |x: &[f64]| vec![x.iter().map(|v| v / scale).collect::<Vec<_>>()];
    frob(&sub(&row(x), &row(y))) / frob(&row(y))
}

pub(crate) fn riccati(c: &Equation) -> Solutions {
    let (b, r) = (c.b.as_ref().unwrap(), c.r.as_ref().unwrap());
    let (n, m) = (c.a.len(), r.len());
    let s = c.s.as_ref().map(flat);
    let (a, b, q, r) = (flat(&c.a), flat(b), flat(&c.q), flat(r));
    let p = Riccati { n, m, len: 1, A: &a, B: &b, Q: &q, R: &r, S: s.as_deref() };
    if c.eq == "care" { care(&p) } else { dare(&p) }.unwrap()
}

#[test]
fn riccati_collections() {
    let mut worse = Vec::new();
    for file in ["carex.json", "darex.json"] {
        for c in data::equations(file) {
            if c.id == "err_nan_A" {
                continue;
            }
            let s = riccati(&c);
            let item = &s.items[0];
            match &item.status {
                Ok(()) => {
                    assert_ne!(c.expect, "error", "{}: solved", c.id);
                    assert!(item.margin > 0.0, "{}: {item:?}", c.id);
                    let flagged = c.expect != "critical" || !item.reliable;
                    assert!(flagged, "{}: {item:?}", c.id);
                    let e = error(&s.x, &flat(c.x.as_ref().unwrap()));
                    let limit = if c.expect == "critical" { 1e-6 } else { c.tol.max(1e-12) };
                    if e.is_nan() || e > limit {
                        worse.push(format!("{}: {e:.1e} > {limit:.1e}", c.id));
                    }
                }
                Err(e) => {
                    if c.expect == "solution" {
                        worse.push(format!("{}: {e}", c.id));
                    }
                }
            }
        }
    }
    assert!(worse.is_empty(), "{worse:#?}");
}

fn lyapunov(c: &Equation) -> Solutions {
    let (a, q) = (flat(&c.a), flat(&c.q));
    let p = Lyapunov { n: c.a.len(), len: 1, A: &a, Q: &q };
    if c.eq == "clyap" { lyapunov_continuous(&p) } else { lyapunov_discrete(&p) }.unwrap()
}

#[test]
fn lyapunov_collections() {
    let mut worse = Vec::new();
    for c in data::equations("lyap.json") {
        let s = lyapunov(&c);
        match (&s.items[0].status, c.expect.as_str()) {
            (Ok(()), "solution") => {
                let e = error(&s.x, &flat(c.x.as_ref().unwrap()));
                let limit = c.tol.max(1e-12);
                if e.is_nan() || e > limit {
                    worse.push(format!("{}: {e:.1e} > {limit:.1e} {:?}", c.id, s.items[0]));
                }
            }
            (Err(Error::NoUniqueSolution { .. }), "error") => {}
            (status, expect) => worse.push(format!("{}: {expect}, got {status:?}", c.id)),
        }
    }
    assert!(worse.is_empty(), "{worse:#?}");
}

/// True errors and bounds of all cases that have a solution.
fn bounds() -> Vec<(String, f64, f64)> {
    let mut out = Vec::new();
    for file in ["carex.json", "darex.json", "lyap.json"] {
        for c in data::equations(file) {
            if c.expect != "solution" {
                continue;
            }
            let s = if file == "lyap.json" { lyapunov(&c) } else { riccati(&c) };
            let true_error = error(&s.x, &flat(c.x.as_ref().unwrap()));
            out.push((c.id, true_error, s.items[0].error_bound.unwrap()));
        }
    }
    out
}

#[test]
fn error_bounds_hold_and_are_tight() {
    let all = bounds();
    let share = |hit: &dyn Fn(f64, f64) -> bool| {
        all.iter().filter(|(_, e, b)| hit(*e, *b)).count() as f64 / all.len() as f64
    };
    let covered = share(&|e, b| b >= e);
    let tight = share(&|e, b| b <= 1e3 * e + 1e-14);
    assert!(covered >= 0.99, "{all:#?}");
    assert!(tight >= 0.95, "{all:#?}");
}
