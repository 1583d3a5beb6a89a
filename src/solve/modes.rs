//! Modes that an output does not see or an input does not reach
//! (Popov-Belevitch-Hautus tests).

use faer::{Mat, MatRef};

use crate::error::{Eigenvalue, Error, Result};
use crate::solve::backend;
use crate::solve::lanes::balance;

/// Relative singular value below which a mode counts as unseen.
const UNSEEN: f64 = 1e-10;
/// Relative distance from the boundary of stability that counts as on it: a
/// double eigenvalue there scatters by the root of the rounding.
const BOUNDARY: f64 = 1e-7;

/// Where a mode lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region {
    /// It does not decay: on the boundary of stability or beyond.
    Unstable,
    /// On the boundary of stability, to rounding.
    Boundary,
    /// Anywhere.
    Everywhere,
}

/// A mode of `A`.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Its eigenvalue.
    pub eigenvalue: Eigenvalue,
    /// Shares of the states in its eigenvector, the largest 1, in balanced
    /// units.
    pub shares: Vec<f64>,
}

impl Mode {
    /// The names of the states that dominate the mode, at most three, the
    /// largest first; `x1`, `x2`, ... where there are no names.
    pub fn states(&self, names: Option<&[String]>) -> String {
        let mut order: Vec<usize> = (0..self.shares.len()).collect();
        // Shares that differ by rounding keep the order of the states.
        let percent = |i: usize| (self.shares[i] * 100.0).round();
        order.sort_by(|&i, &j| percent(j).total_cmp(&percent(i)));
        let name = |i: usize| match names.and_then(|names| names.get(i)) {
            Some(name) => name.clone(),
            None => format!("x{}", i + 1),
        };
        let large = order.into_iter().filter(|&i| self.shares[i] > 0.3).take(3);
        large.map(name).collect::<Vec<_>>().join(", ")
    }
}

/// The first mode of `A` in `region` that `C` does not see.
///
/// ```text
/// rank [A - lambda I; C] < n,   Re(lambda) >= 0   (|lambda| >= 1 in discrete time)
/// ```
/// `A` n by n, `C` any number of rows by n. Units do not matter: states are
/// balanced, and every row of `C` is brought to the size of `A`. For modes that
/// an input does not reach pass `A'` and `B'`.
///
/// # Errors
/// `Shape`, `NonFinite`; `Range` if eigenvalues cannot be computed.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::{Region, unseen_mode}};
/// let a = mat![[-1.0, 0.0], [0.0, 2.0]];
/// let mode = unseen_mode(a.as_ref(), mat![[1.0, 0.0]].as_ref(), true, Region::Unstable)?;
/// let mode = mode.expect("the second state grows unseen");
/// assert_eq!(mode.eigenvalue.re, 2.0);
/// assert_eq!(mode.states(None), "x2");
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn unseen_mode(
    a: MatRef<'_, f64>,
    c: MatRef<'_, f64>,
    continuous: bool,
    region: Region,
) -> Result<Option<Mode>> {
    let n = a.nrows();
    let (a, scale) = balanced(a);
    let size = a.norm_l2().max(f64::MIN_POSITIVE);
    let c = Mat::from_fn(c.nrows(), n, |i, j| c[(i, j)] * scale[j]);
    let row_norm: Vec<f64> = (0..c.nrows()).map(|i| c.row(i).norm_l2()).collect();
    let c = Mat::from_fn(c.nrows(), n, |i, j| match row_norm[i] {
        0.0 => 0.0,
        norm => c[(i, j)] / norm * size,
    });
    let eigen = backend::eigen(a.as_ref())?;
    for (k, &value) in eigen.values.iter().enumerate() {
        let modulus = value.re.hypot(value.im);
        // How far beyond the boundary, relative to the size of the modes.
        let beyond = if continuous { value.re / size } else { modulus - 1.0 };
        let wanted = match region {
            Region::Unstable => beyond >= -BOUNDARY,
            Region::Boundary => beyond.abs() <= BOUNDARY,
            Region::Everywhere => true,
        };
        if !wanted || value.im < 0.0 || seen(&a, &c, value, size)? {
            continue;
        }
        return Ok(Some(Mode { eigenvalue: value, shares: shares(&eigen, k) }));
    }
    Ok(None)
}

/// The mode of `A` that decays least: the eigenvalue of largest real part, in
/// discrete time of largest modulus (of a pair the member above the axis).
///
/// # Errors
/// `Empty` without states, `NonFinite`; `Range` if eigenvalues cannot be
/// computed.
///
/// # Examples
/// ```
/// use mmae::{mat, solve::least_stable_mode};
/// let mode = least_stable_mode(mat![[-1.0, 0.0], [0.0, 2.0]].as_ref(), true)?;
/// assert_eq!((mode.eigenvalue.re, mode.states(None).as_str()), (2.0, "x2"));
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn least_stable_mode(a: MatRef<'_, f64>, continuous: bool) -> Result<Mode> {
    let n = a.nrows();
    let (a, _) = balanced(a);
    let eigen = backend::eigen(a.as_ref())?;
    let growth = |v: &Eigenvalue| if continuous { v.re } else { v.re.hypot(v.im) };
    let worst = (0..n)
        .filter(|&k| eigen.values[k].im >= 0.0)
        .max_by(|&i, &j| growth(&eigen.values[i]).total_cmp(&growth(&eigen.values[j])));
    let Some(k) = worst else { return Err(Error::Empty { what: "A".into() }) };
    Ok(Mode { eigenvalue: eigen.values[k], shares: shares(&eigen, k) })
}

/// Sizes of the states in eigenvector `k`, of a pair the first, the largest 1.
fn shares(eigen: &backend::Eigen, k: usize) -> Vec<f64> {
    let n = eigen.right.nrows();
    let part = |i: usize| {
        let imaginary = if eigen.values[k].im > 0.0 { eigen.right[(i, k + 1)] } else { 0.0 };
        eigen.right[(i, k)].hypot(imaginary)
    };
    let largest = (0..n).map(part).fold(f64::MIN_POSITIVE, f64::max);
    (0..n).map(|i| part(i) / largest).collect()
}

/// `D^-1 A D` with evened rows and columns, and the diagonal of `D`.
fn balanced(a: MatRef<'_, f64>) -> (Mat<f64>, Vec<f64>) {
    let n = a.nrows();
    let mut magnitudes: Vec<f64> = (0..n * n).map(|e| a[(e / n, e % n)]).collect();
    let mut exponents = vec![0.0; n];
    balance(n, &mut magnitudes, &mut [], &mut [], &mut exponents);
    let scale: Vec<f64> = exponents.iter().map(|&e| libm::exp2(e)).collect();
    (Mat::from_fn(n, n, |i, j| a[(i, j)] / scale[i] * scale[j]), scale)
}

/// True if `[A - lambda I; C]` has full rank: its real form for complex `lambda`.
fn seen(a: &Mat<f64>, c: &Mat<f64>, value: Eigenvalue, size: f64) -> Result<bool> {
    let (n, q) = (a.nrows(), c.nrows());
    let shifted = |i: usize, j: usize| a[(i, j)] - if i == j { value.re } else { 0.0 };
    let pencil = if value.im == 0.0 {
        Mat::from_fn(n + q, n, |i, j| if i < n { shifted(i, j) } else { c[(i - n, j)] })
    } else {
        Mat::from_fn(2 * (n + q), 2 * n, |i, j| {
            let (half, i) = (i / (n + q), i % (n + q));
            let (side, j) = (j / n, j % n);
            match (i < n, half == side) {
                (true, true) => shifted(i, j),
                (false, true) => c[(i - n, j)],
                (true, false) if i == j && half == 0 => value.im,
                (true, false) if i == j => -value.im,
                _ => 0.0,
            }
        })
    };
    let smallest = backend::singular_values(pencil.as_ref())?.last().copied().unwrap_or(0.0);
    Ok(smallest > UNSEEN * size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::mat;

    #[test]
    fn complex_modes_and_units() {
        // An undamped oscillator beside a decaying state; only the latter is seen.
        let u = (1_u64 << 30) as f64;
        let a = mat![[0.0, u, 0.0], [-1.0 / u, 0.0, 0.0], [0.0, 0.0, -1.0]];
        let c = mat![[0.0, 0.0, 1e-12]];
        let mode = unseen_mode(a.as_ref(), c.as_ref(), true, Region::Boundary).unwrap().unwrap();
        assert!(mode.eigenvalue.re.abs() < 1e-12 && (mode.eigenvalue.im - 1.0).abs() < 1e-12);
        assert_eq!(mode.states(Some(&["p".into(), "v".into(), "z".into()])), "p, v");
        let c = mat![[1e-14, 0.0, 0.0]];
        assert_eq!(unseen_mode(a.as_ref(), c.as_ref(), true, Region::Unstable).unwrap(), None);
    }

    #[test]
    fn a_double_eigenvalue_needs_two_outputs() {
        let a = mat![[1.5, 0.0], [0.0, 1.5]];
        let one = unseen_mode(a.as_ref(), mat![[1.0, 1.0]].as_ref(), false, Region::Unstable);
        assert!(one.unwrap().is_some());
        let two = mat![[1.0, 1.0], [1.0, -1.0]];
        assert_eq!(unseen_mode(a.as_ref(), two.as_ref(), false, Region::Unstable).unwrap(), None);
    }

    #[test]
    fn no_output_and_no_unstable_mode() {
        let none = Mat::<f64>::zeros(0, 1);
        let found = |x: f64| {
            unseen_mode(mat![[x]].as_ref(), none.as_ref(), true, Region::Unstable).unwrap()
        };
        assert!(found(0.0).is_some() && found(1.0).is_some() && found(-1.0).is_none());
    }
}
