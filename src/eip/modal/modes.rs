//! Eigenvalues and eigenvectors of a model, scaled and judged.

use faer::{Mat, MatRef};

use super::spectrum::CONDITION;
use crate::error::Result;
use crate::solve::backend;

/// Eigenvalues with scaled eigenvectors, the real ones first: `left[j]` is row `j` of `V^-1`.
pub(super) struct Modes {
    pub(super) values: Vec<(f64, f64)>,
    pub(super) right: Vec<Vec<(f64, f64)>>,
    pub(super) left: Vec<Vec<(f64, f64)>>,
}

impl Modes {
    /// Diagonalises `a`; `None` where the eigenvectors are ill-conditioned.
    pub(super) fn new(a: MatRef<'_, f64>) -> Result<Option<Self>> {
        let n = a.nrows();
        let eigen = backend::eigen(a)?;
        let mut modes = Self { values: Vec::new(), right: Vec::new(), left: Vec::new() };
        let mut order: Vec<usize> = Vec::with_capacity(n);
        let mut j = 0;
        while j < n {
            order.push(j);
            j += if eigen.values[j].im != 0.0 { 2 } else { 1 };
        }
        order.sort_by_key(|&j| eigen.values[j].im != 0.0);
        for j in order {
            let value = eigen.values[j];
            let pair = value.im != 0.0;
            let column = |m: &Mat<f64>| -> Vec<(f64, f64)> {
                (0..n).map(|i| (m[(i, j)], if pair { m[(i, j + 1)] } else { 0.0 })).collect()
            };
            let (x, y) = (column(&eigen.right), column(&eigen.left));
            // y^H x
            let (mut re, mut im) = (0.0, 0.0);
            let (mut size_x, mut size_y) = (0.0, 0.0);
            for (&(xr, xi), &(yr, yi)) in x.iter().zip(&y) {
                re += yr * xr + yi * xi;
                im += yr * xi - yi * xr;
                size_x += xr * xr + xi * xi;
                size_y += yr * yr + yi * yi;
            }
            let modulus = re * re + im * im;
            let well_conditioned = modulus * CONDITION * CONDITION > size_x * size_y;
            if !well_conditioned {
                return Ok(None); // also for NaN
            }
            let left = y
                .iter()
                .map(|&(yr, yi)| ((yr * re - yi * im) / modulus, (-yi * re - yr * im) / modulus))
                .collect();
            modes.values.push((value.re, value.im));
            modes.right.push(x);
            modes.left.push(left);
        }
        Ok(Some(modes))
    }

    /// How many are real.
    pub(super) fn reals(&self) -> usize {
        self.values.iter().take_while(|value| value.1 == 0.0).count()
    }
}

/// `sum_i row_i m_i,col`, a complex row times a real matrix.
pub(super) fn row_times(row: &[(f64, f64)], m: MatRef<'_, f64>, col: usize) -> (f64, f64) {
    row.iter()
        .enumerate()
        .fold((0.0, 0.0), |(re, im), (i, &(r, s))| (re + r * m[(i, col)], im + s * m[(i, col)]))
}
