//! Energies of pairs in separable modal form: for many models per plant.
//!
//! With the plant block and the observers diagonalised, `A = V diag(lambda)
//! V^-1` and `F_i = U diag(mu) U^-1`, the coupling of a pair needs no solve: in
//! the error coordinates of the doubling (same `N`, `M`, `D`, `X`, `Z`)
//!
//! ```text
//! 2 tr((Z N + C' W D) S) = -2 sum_jk K_kj T_jk / (lambda_j + mu_k)
//! K = U' (Z N + C' W D) V,   T = V^-1 (X N' + B M') U^-T
//! ```
//!
//! (discrete time: `F' Z N` and `A X N'` in their places, `+2` and `1 - lambda_j
//! mu_k`). Only the rows of `N` that differ between plant and model count: few,
//! where few parameters vary. The rest of `T` separates into a factor of the
//! plant and one of the model. `N` is small where the model is near, so nothing
//! cancels: the separable form in the coordinates `[x_p, x_hat]`, which needs
//! no `N`, loses five digits on the pendulum.
//!
//! Plants or models with ill-conditioned eigenvectors are left to the doubling.
//!
//! Plants in lanes up to their modes, then models in lanes. Limited by multiply-adds and
//! one division for three pairs of eigenvalues.

mod modes;
mod plants;
mod spectrum;
mod sums;
#[cfg(test)]
mod tests;

use faer::Mat;

use self::modes::{Modes, row_times};
use self::plants::{Fill, Places, Sides, TOGETHER, Way};
use self::sums::Sums;
use crate::eip::batch::LoopBatch;
use crate::eip::doubling::Doubling;
use crate::eip::setup::PairModel;
use crate::eip::spare::Spare;
use crate::error::{Eigenvalue, Result};
use crate::simd::{self, Block, LANES};

/// How far off the values of another plant the search for eigenvalues starts, as a share
/// of them: in all directions, so that two real ones can become a pair.
const ASIDE: f64 = 0.02;

/// The models as arrays over models, padded to whole lanes.
pub(crate) struct Modal {
    continuous: bool,
    n_models: usize,
    n: usize,
    ny: usize,
    nu: usize,
    /// Modes kept of each model: one of each pair.
    kept: usize,
    /// Those that are real in every model: the first.
    reals: usize,
    /// Where the eigenvalues of plants are looked for first.
    start: Vec<(f64, f64)>,
    /// `C` of all models, if they have the same.
    shared_c: Option<Mat<f64>>,
    /// Row by row `A` and `B` of all models, where they have the same.
    shared_rows: Vec<Option<(Vec<f64>, Vec<f64>)>>,
    fields: Fields,
    /// Eight models after eight, each with its fields in lanes: the fields of one
    /// lane are read together, and lie together.
    data: Vec<Block>,
    /// Buffers of plants and of sums.
    spare: Spare,
}

/// Places of the fields in [`Modal::data`]: matrices row-major, then the modes,
/// each with `mu`, `(U' Z)_k`, `(U' C' W)_k` (both times 2 for a pair, the
/// first times `mu` in discrete time), `(U^-1)_k`, `(U^-1 J)_k`, complex numbers
/// as two fields.
#[derive(Clone, Copy)]
struct Fields {
    a: usize,
    b: usize,
    c: usize,
    h: usize,
    w: usize,
    z: usize,
    zj: usize,
    jzj: usize,
    mode: usize,
    uz: usize,
    ucw: usize,
    inv: usize,
    inv_j: usize,
    mode_len: usize,
}

impl Fields {
    fn new(n: usize, ny: usize, nu: usize) -> Self {
        let rank = ny + nu;
        let mut next = 0;
        let mut take = |len: usize| {
            let at = next;
            next += len;
            at
        };
        let (a, b, c, h) = (take(n * n), take(n * nu), take(ny * n), take(n * ny));
        let (w, z, zj, jzj) = (take(ny * ny), take(n * n), take(n * rank), take(rank * rank));
        let mode = next;
        let (uz, ucw) = (2, 2 + 2 * n);
        let inv = ucw + 2 * ny;
        let inv_j = inv + 2 * n;
        Self { a, b, c, h, w, z, zj, jzj, mode, uz, ucw, inv, inv_j, mode_len: inv_j + 2 * rank }
    }
}

impl Modal {
    /// Diagonalises the models; `None` if one is ill-conditioned. `near` are the
    /// eigenvalues of some plant of the grid.
    pub(crate) fn new<'m>(
        continuous: bool,
        models: impl Iterator<Item = &'m PairModel>,
        near: &[Eigenvalue],
    ) -> Result<Option<Self>> {
        let models: Vec<&PairModel> = models.collect();
        let Some(first) = models.first() else { return Ok(None) };
        let (n, ny, nu) = (first.F.nrows(), first.C.nrows(), first.B.ncols());
        let mut modes = Vec::with_capacity(models.len());
        for m in &models {
            match Modes::new(m.F.as_ref())? {
                Some(found) => modes.push(found),
                None => return Ok(None),
            }
        }
        let kept = modes.iter().map(|m| m.values.len()).max().unwrap_or(0);
        let reals = modes.iter().map(Modes::reals).min().unwrap_or(0);
        let slots = models.len().next_multiple_of(LANES);
        let fields = Fields::new(n, ny, nu);
        let mut modal = Self {
            continuous,
            n_models: models.len(),
            n,
            ny,
            nu,
            kept,
            reals,
            start: beside(near),
            shared_c: models.iter().all(|m| m.C == first.C).then(|| first.C.clone()),
            shared_rows: (0..n).map(|r| shared_row(&models, r)).collect(),
            fields,
            data: Vec::new(),
            spare: Spare::default(),
        };
        modal.data = vec![Block::default(); modal.total() * slots / LANES];
        for slot in 0..slots {
            // padding repeats the last model
            let i = slot.min(models.len() - 1);
            modal.fill(slot, models[i], &modes[i]);
        }
        Ok(Some(modal))
    }

    /// Number of models.
    pub(crate) fn len(&self) -> usize {
        self.n_models
    }

    /// Fields of one model.
    fn total(&self) -> usize {
        self.fields.mode + self.kept * self.fields.mode_len
    }

    fn fill(&mut self, slot: usize, model: &PairModel, modes: &Modes) {
        let (n, ny, continuous) = (self.n, self.ny, self.continuous);
        let start = slot / LANES * self.total();
        let rank = ny + self.nu;
        let f = self.fields;
        let j = Mat::from_fn(
            n,
            rank,
            |r, c| {
                if c < ny { model.H[(r, c)] } else { model.B[(r, c - ny)] }
            },
        );
        let zj = &model.Z * &j;
        let jzj = j.transpose() * &zj;
        let cw = model.C.transpose() * &model.W;
        let mut set = |field: usize, value: f64| {
            self.data[start + field].0[slot % LANES] = value;
        };
        for (at, m) in [
            (f.a, &model.A),
            (f.b, &model.B),
            (f.c, &model.C),
            (f.h, &model.H),
            (f.w, &model.W),
            (f.z, &model.Z),
            (f.zj, &zj),
            (f.jzj, &jzj),
        ] {
            for row in 0..m.nrows() {
                for col in 0..m.ncols() {
                    set(at + row * m.ncols() + col, m[(row, col)]);
                }
            }
        }
        for k in 0..self.kept {
            let at = f.mode + k * f.mode_len;
            let Some(&(re, im)) = modes.values.get(k) else {
                // all factors zero, a harmless eigenvalue
                set(at, if continuous { -1.0 } else { 0.0 });
                continue;
            };
            set(at, re);
            set(at + 1, im);
            let weight = if im == 0.0 { 1.0 } else { 2.0 };
            let mut put = |at: usize, i: usize, (re, im): (f64, f64)| {
                set(at + 2 * i, re);
                set(at + 2 * i + 1, im);
            };
            for i in 0..n {
                let (mut zr, mut zi) = row_times(&modes.right[k], model.Z.as_ref(), i);
                if !continuous {
                    (zr, zi) = (zr * re - zi * im, zr * im + zi * re);
                }
                put(at + f.uz, i, (zr * weight, zi * weight));
                put(at + f.inv, i, modes.left[k][i]);
            }
            for i in 0..ny {
                let (cr, ci) = row_times(&modes.right[k], cw.as_ref(), i);
                put(at + f.ucw, i, (cr * weight, ci * weight));
            }
            for i in 0..rank {
                put(at + f.inv_j, i, row_times(&modes.left[k], j.as_ref(), i));
            }
        }
    }

    /// Energies of the plants of `batch` with all models into `out`, NaN for a plant that
    /// was not shown to be stable; returns those left to the doubling.
    pub(crate) fn energies(
        &self,
        doubling: &Doubling,
        batch: &LoopBatch,
        out: &mut Vec<f64>,
    ) -> Vec<usize> {
        out.clear();
        out.resize(batch.len() * self.n_models, f64::NAN);
        let places = Places::new(batch.shape, self.n);
        let mut sides = Sides { places, ways: Vec::new(), data: Vec::new() };
        let mut left = Vec::new();
        for (k, out) in out.chunks_mut(TOGETHER * self.n_models).enumerate() {
            let first = k * TOGETHER;
            simd::dispatch(Fill { modal: self, doubling, batch, first, sides: &mut sides });
            simd::dispatch(Sums { modal: self, sides: &sides, out });
            let ways = sides.ways.iter().enumerate();
            left.extend(ways.filter(|(_, way)| **way == Way::Doubling).map(|(k, _)| first + k));
        }
        left
    }
}

/// Points near the eigenvalues of a plant, none of them on the real line.
fn beside(values: &[Eigenvalue]) -> Vec<(f64, f64)> {
    let size = values.iter().map(|v| v.re.hypot(v.im)).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let mut points = Vec::with_capacity(values.len());
    for (k, v) in values.iter().enumerate() {
        let reach = ASIDE * v.re.hypot(v.im).max(1e-3 * size);
        let (sin, cos) = libm::sincos(1.0 + 2.4 * k as f64);
        points.push((v.re + reach * cos, v.im + reach * sin));
    }
    points
}

/// Row `r` of `A` and `B` if all models have the same.
fn shared_row(models: &[&PairModel], r: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let row = |m: &Mat<f64>| -> Vec<f64> { (0..m.ncols()).map(|j| m[(r, j)]).collect() };
    let of = |m: &PairModel| (row(&m.A), row(&m.B));
    let first = of(models.first()?);
    models.iter().all(|m| of(m) == first).then_some(first)
}
