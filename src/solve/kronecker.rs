//! Linear matrix equations as one system of the entries of `X`: for coefficients
//! that are not stable or far from normal, one item at a time.

use faer::Mat;

use crate::real::{Mask, Real};
use crate::small::{Dyn, lu_factor, lu_solve};
use crate::solve::backend::Factors;
use crate::solve::lanes::{Inverse, Kind};

/// Unknowns beyond which the system is not formed: it would take more than half
/// a gigabyte.
const MAX_UNKNOWNS: usize = 8192;
/// The same in twice the precision, where a second is spent at this size.
const MAX_UNKNOWNS_TWICE: usize = 512;

/// Which entry of `X` is which unknown.
#[derive(Clone, Copy)]
struct Places {
    symmetric: bool,
    n: usize,
    m: usize,
}

impl Places {
    /// A Lyapunov equation (`symmetric`) keeps the entries `i >= j` alone.
    fn count(self) -> usize {
        let all = self.n.saturating_mul(self.m);
        if self.symmetric { self.n.saturating_mul(self.n + 1) / 2 } else { all }
    }

    fn of(self, i: usize, j: usize) -> usize {
        match self.symmetric {
            true if i >= j => i * (i + 1) / 2 + j,
            true => j * (j + 1) / 2 + i,
            false => i * self.m + j,
        }
    }

    /// The coefficients of the equations, row by row.
    fn system<T: Real>(self, kind: Kind, a: &[T], b: &[T]) -> Vec<T> {
        let Places { n, m, .. } = self;
        let unknowns = self.count();
        let mut system = vec![T::zero(); unknowns * unknowns];
        for i in 0..n {
            let width = if self.symmetric { i + 1 } else { m };
            for j in 0..width {
                let row = &mut system[self.of(i, j) * unknowns..][..unknowns];
                let mut add = |at: usize, x: T| row[at] = row[at] + x;
                match kind {
                    Kind::Continuous => {
                        for k in 0..n {
                            add(self.of(k, j), a[i * n + k]);
                        }
                        for l in 0..m {
                            add(self.of(i, l), b[l * m + j]);
                        }
                    }
                    Kind::Discrete => {
                        for k in 0..n {
                            for l in 0..m {
                                add(self.of(k, l), a[i * n + k] * b[l * m + j]);
                            }
                        }
                        add(self.of(i, j), -T::one());
                    }
                }
            }
        }
        system
    }
}

/// Solves `A X + X B + C = 0` or `A X B - X + C = 0` for any `C`, by LU of the
/// whole system; `None` if it is too large or singular.
pub(super) fn inverse<T: Real>(
    kind: Kind,
    symmetric: bool,
    [n, m]: [usize; 2],
    a: &[f64],
    b: &[f64],
) -> Option<Inverse<T>> {
    let places = Places { symmetric, n, m };
    let unknowns = places.count();
    if unknowns > MAX_UNKNOWNS {
        return None;
    }
    let system = places.system(kind, a, b);
    let factors = Factors::new(Mat::from_fn(unknowns, unknowns, |i, j| system[i * unknowns + j]))?;
    Some(Inverse::Plain(Box::new(move |x: &mut [f64]| {
        let mut column = Mat::<f64>::zeros(unknowns, 1);
        for i in 0..n {
            for j in 0..m {
                column[(places.of(i, j), 0)] = -x[i * m + j];
            }
        }
        factors.solve(&mut column);
        for i in 0..n {
            for j in 0..m {
                x[i * m + j] = column[(places.of(i, j), 0)];
            }
        }
    })))
}

/// As [`inverse`] in the precision of `T`.
pub(super) fn inverse_full<T: Real>(
    kind: Kind,
    symmetric: bool,
    [n, m]: [usize; 2],
    a: &[T],
    b: &[T],
) -> Option<Inverse<T>> {
    let places = Places { symmetric, n, m };
    let unknowns = places.count();
    if unknowns > MAX_UNKNOWNS_TWICE {
        return None;
    }
    let mut factors = places.system(kind, a, b);
    let mut perm = vec![T::zero(); unknowns];
    let regular = lu_factor(Dyn(unknowns), &mut factors, &mut perm).ok;
    if !regular.all() {
        return None;
    }
    Some(Inverse::Full(Box::new(move |x: &mut [T]| {
        let mut column = vec![T::zero(); unknowns];
        for i in 0..n {
            for j in 0..m {
                column[places.of(i, j)] = -x[i * m + j];
            }
        }
        lu_solve(Dyn(unknowns), Dyn(1), &factors, &perm, &mut column);
        for i in 0..n {
            for j in 0..m {
                x[i * m + j] = column[places.of(i, j)];
            }
        }
    })))
}
