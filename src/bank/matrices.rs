//! The matrices of all models, eight models to a block.

use faer::{Mat, MatRef};

use crate::error::{Error, Result};
use crate::model::Plant;
use crate::simd::Panel;
use crate::small::{Dyn, cholesky, solve_lower};

/// Sizes that all models share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sizes {
    /// States.
    pub(super) n: usize,
    /// Control inputs.
    pub(super) m: usize,
    /// Outputs.
    pub(super) q: usize,
}

impl Sizes {
    pub(super) fn of(plant: &Plant) -> Self {
        Self { n: plant.nx(), m: plant.nu(), q: plant.ny() }
    }
}

/// `A`, `B`, `C`, `G Q G'` and `R` of every model.
#[derive(Debug, Clone)]
pub(super) struct Matrices {
    pub(super) a: Panel,
    pub(super) b: Panel,
    pub(super) c: Panel,
    pub(super) q: Panel,
    pub(super) r: Panel,
}

impl Matrices {
    /// Of plants of one size.
    pub(super) fn new(plants: &[&Plant]) -> Self {
        let noise: Vec<Mat<f64>> = plants.iter().map(|p| disturbance(p)).collect();
        let noise: Vec<&Mat<f64>> = noise.iter().collect();
        let of = |pick: fn(&Plant) -> &Mat<f64>| -> Vec<&Mat<f64>> {
            plants.iter().map(|p| pick(p)).collect()
        };
        Self {
            a: panel(&of(|p| &p.A)),
            b: panel(&of(|p| &p.B)),
            c: panel(&of(|p| &p.C)),
            q: panel(&noise),
            r: panel(&of(|p| &p.R)),
        }
    }
}

/// Matrices of one size as a panel.
pub(super) fn panel(all: &[&Mat<f64>]) -> Panel {
    let (rows, cols) = all.first().map_or((0, 0), |m| (m.nrows(), m.ncols()));
    Panel::from_fn(rows, cols, all.len(), |k, i, j| all[k][(i, j)])
}

/// `G Q G'`, exactly symmetric.
fn disturbance(plant: &Plant) -> Mat<f64> {
    let (n, w) = (plant.nx(), plant.nw());
    let gq = Mat::from_fn(n, w, |i, j| {
        (0..w).fold(0.0, |sum, k| f64::mul_add(plant.G[(i, k)], plant.Q[(k, j)], sum))
    });
    let entry = |i: usize, j: usize| {
        (0..w).fold(0.0, |sum, k| f64::mul_add(gq[(i, k)], plant.G[(j, k)], sum))
    };
    Mat::from_fn(n, n, |i, j| 0.5 * (entry(i, j) + entry(j, i)))
}

/// `L^-1` and `ln det S` for `S = L L'`.
pub(crate) fn whitener(what: &str, s: MatRef<'_, f64>) -> Result<(Mat<f64>, f64)> {
    let q = s.nrows();
    let mut l: Vec<f64> = (0..q * q).map(|e| s[(e / q, e % q)]).collect();
    let mut inverse = vec![0.0; q * q];
    let Some(ln_det) = whiten(q, &mut l, &mut inverse) else {
        return Err(Error::NotPositiveDefinite { what: what.into() });
    };
    Ok((Mat::from_fn(q, q, |i, j| inverse[i * q + j]), ln_det))
}

/// Puts `L` in the place of `S = L L'`, q by q and row-major, and writes `L^-1`;
/// returns `ln det S`, or `None` if `S` is not positive definite.
pub(super) fn whiten(q: usize, s: &mut [f64], inverse: &mut [f64]) -> Option<f64> {
    if !cholesky(Dyn(q), s) {
        return None;
    }
    for (e, entry) in inverse.iter_mut().enumerate() {
        *entry = if e / q == e % q { 1.0 } else { 0.0 };
    }
    solve_lower(Dyn(q), Dyn(q), s, inverse);
    for (e, entry) in inverse.iter_mut().enumerate() {
        if e % q > e / q {
            *entry = 0.0;
        }
    }
    Some(2.0 * (0..q).map(|i| libm::log(s[i * q + i])).sum::<f64>())
}
