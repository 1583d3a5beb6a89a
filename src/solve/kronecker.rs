//! Linear matrix equations as one system of the entries of `X`: for coefficients
//! that are not stable, one item at a time.

use faer::Mat;

use crate::solve::backend::Factors;
use crate::solve::lanes::{Inverse, Kind};

/// Unknowns beyond which the system is not formed: it would take more than half
/// a gigabyte.
const MAX_UNKNOWNS: usize = 8192;

/// Solves `A X + X B + C = 0` or `A X B - X + C = 0` for any `C`, by LU of the
/// whole system; `None` if it is too large or singular.
///
/// A Lyapunov equation (`symmetric`, `B = A'`) keeps the entries `i >= j` alone.
pub(super) fn inverse(
    kind: Kind,
    symmetric: bool,
    [n, m]: [usize; 2],
    a: &[f64],
    b: &[f64],
) -> Option<Inverse> {
    let unknowns = if symmetric { n * (n + 1) / 2 } else { n.checked_mul(m)? };
    if unknowns > MAX_UNKNOWNS {
        return None;
    }
    let place = move |i: usize, j: usize| match symmetric {
        true if i >= j => i * (i + 1) / 2 + j,
        true => j * (j + 1) / 2 + i,
        false => i * m + j,
    };
    let mut system = Mat::<f64>::zeros(unknowns, unknowns);
    for i in 0..n {
        let width = if symmetric { i + 1 } else { m };
        for j in 0..width {
            let row = place(i, j);
            match kind {
                Kind::Continuous => {
                    for k in 0..n {
                        system[(row, place(k, j))] += a[i * n + k];
                    }
                    for l in 0..m {
                        system[(row, place(i, l))] += b[l * m + j];
                    }
                }
                Kind::Discrete => {
                    for k in 0..n {
                        for l in 0..m {
                            system[(row, place(k, l))] += a[i * n + k] * b[l * m + j];
                        }
                    }
                    system[(row, row)] -= 1.0;
                }
            }
        }
    }
    let factors = Factors::new(system)?;
    Some(Box::new(move |x: &mut [f64]| {
        let mut column = Mat::<f64>::zeros(unknowns, 1);
        for i in 0..n {
            for j in 0..m {
                column[(place(i, j), 0)] = -x[i * m + j];
            }
        }
        factors.solve(&mut column);
        for i in 0..n {
            for j in 0..m {
                x[i * m + j] = column[(place(i, j), 0)];
            }
        }
    }))
}
