//! Problems of one kind and size side by side, as the batched solvers take them.

use super::file::{Case, Kind, Rows};
use crate::error::{Error, Result};
use crate::par::RunControl;
use crate::solve::{
    Checks, Lyapunov, Riccati, Solutions, care_with, dare_with, lyapunov_continuous_with,
    lyapunov_discrete_with,
};

/// The matrices of one problem, row by row; empty where the equation has none.
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(super) struct Flat {
    pub(super) kind: Kind,
    pub(super) n: usize,
    pub(super) m: usize,
    pub(super) A: Vec<f64>,
    pub(super) B: Vec<f64>,
    pub(super) Q: Vec<f64>,
    pub(super) R: Vec<f64>,
    pub(super) S: Option<Vec<f64>>,
}

impl Flat {
    /// Checks the shapes of a case.
    ///
    /// # Errors
    /// `Shape`, `Empty`, `Conflict` for a matrix that is missing or too much.
    pub(super) fn new(case: &Case) -> Result<Self> {
        let kind = case.eq;
        if case.E.is_some() {
            return Err(Error::Conflict {
                problem: "E is given, and these equations have none".into(),
                remedy: "multiply by the inverse of E, or leave it out if it is the identity"
                    .into(),
            });
        }
        let n = case.A.len();
        if n == 0 {
            return Err(Error::Empty { what: "A".into() });
        }
        let mut flat = Flat {
            kind,
            n,
            m: 0,
            A: flatten("A", &case.A, [n, n])?,
            B: Vec::new(),
            Q: flatten("Q", &case.Q, [n, n])?,
            R: Vec::new(),
            S: None,
        };
        if kind.is_riccati() {
            let (Some(b), Some(r)) = (&case.B, &case.R) else {
                return Err(Error::Conflict {
                    problem: format!("{} without B or R", kind.name()),
                    remedy: "give both, or ask for clyap or dlyap".into(),
                });
            };
            let m = r.len();
            flat.m = m;
            flat.B = flatten("B", b, [n, m])?;
            flat.R = flatten("R", r, [m, m])?;
            flat.S = case.S.as_ref().map(|s| flatten("S", s, [n, m])).transpose()?;
        }
        Ok(flat)
    }

    /// What problems of one batch have in common.
    pub(super) fn key(&self) -> (Kind, usize, usize, bool) {
        (self.kind, self.n, self.m, self.S.is_some())
    }
}

fn flatten(what: &str, rows: &Rows, [n, m]: [usize; 2]) -> Result<Vec<f64>> {
    let odd = rows.iter().map(Vec::len).find(|&len| len != m);
    if rows.len() != n || odd.is_some() {
        let got = [rows.len(), odd.or(rows.first().map(Vec::len)).unwrap_or(0)];
        return Err(Error::Shape { what: what.into(), want: [n, m], got });
    }
    Ok(rows.iter().flatten().map(|entry| entry.0).collect())
}

/// Solves problems of one [`Flat::key`].
///
/// # Errors
/// Those of the whole batch; an item has its own in its report.
pub(super) fn solve(problems: &[&Flat], control: &RunControl<'_>) -> Result<Solutions> {
    let Some(first) = problems.first() else {
        return Err(Error::Empty { what: "batch".into() });
    };
    let join = |of: fn(&Flat) -> &[f64]| -> Vec<f64> {
        problems.iter().flat_map(|p| of(p)).copied().collect()
    };
    let (n, m, len) = (first.n, first.m, problems.len());
    let (a, q) = (join(|p| &p.A), join(|p| &p.Q));
    if !first.kind.is_riccati() {
        let problem = Lyapunov { n, len, A: &a, Q: &q };
        return match first.kind {
            Kind::Clyap => lyapunov_continuous_with(&problem, Checks::All, control),
            _ => lyapunov_discrete_with(&problem, Checks::All, control),
        };
    }
    let (b, r) = (join(|p| &p.B), join(|p| &p.R));
    let s = first.S.as_ref().map(|_| join(|p| p.S.as_deref().unwrap_or(&[])));
    let problem = Riccati { n, m, len, A: &a, B: &b, Q: &q, R: &r, S: s.as_deref() };
    match first.kind {
        Kind::Care => care_with(&problem, Checks::All, control),
        _ => dare_with(&problem, Checks::All, control),
    }
}
