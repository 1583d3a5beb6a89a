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
//! Models in lanes. Limited by multiply-adds and one division for each pair of
//! eigenvalues.

mod modes;
mod sums;

use faer::{Mat, MatRef};

use self::modes::{Modes, row_times};
use self::sums::Sums;
use crate::eip::setup::PairModel;
use crate::error::Result;
use crate::model::LoopBlock;
use crate::simd::{self, Block, LANES};

/// The models as arrays over models, padded to whole lanes.
pub(crate) struct Modal {
    continuous: bool,
    n_models: usize,
    n: usize,
    ny: usize,
    nu: usize,
    /// Modes kept of each model: one of each pair.
    kept: usize,
    fields: Fields,
    /// Eight models after eight, each with its fields in lanes: the fields of one
    /// lane are read together, and lie together.
    data: Vec<Block>,
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
    /// Diagonalises the models; `None` if one is ill-conditioned.
    pub(crate) fn new<'m>(
        continuous: bool,
        models: impl Iterator<Item = &'m PairModel>,
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
        let slots = models.len().next_multiple_of(LANES);
        let fields = Fields::new(n, ny, nu);
        let mut modal =
            Self { continuous, n_models: models.len(), n, ny, nu, kept, fields, data: Vec::new() };
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

    /// Energies of one plant with all models, given its Gramian `x`; `None`
    /// where the plant's eigenvectors are ill-conditioned.
    pub(crate) fn energies(
        &self,
        block: &LoopBlock,
        x: MatRef<'_, f64>,
    ) -> Result<Option<Vec<f64>>> {
        let Some(modes) = Modes::new(block.A.as_ref())? else { return Ok(None) };
        let rank = self.ny + self.nu;
        let d = Mat::from_fn(rank, block.nw(), |i, j| {
            if i < self.ny { block.Dy[(i, j)] } else { block.Du[(i - self.ny, j)] }
        });
        let eb = block.B.submatrix(0, 0, self.n, block.nw());
        let plant = PlantSide {
            modes: plant_modes(&modes, self.continuous, block, x, eb, &d),
            ebb: eb * eb.transpose(),
            ebd: eb * d.transpose(),
            dd: &d * d.transpose(),
        };
        let mut out = vec![0.0; self.n_models];
        simd::dispatch(Sums { modal: self, block, x, plant: &plant, out: &mut out });
        Ok(Some(out))
    }
}

/// What a plant brings to every pair.
struct PlantSide {
    modes: Vec<PlantMode>,
    ebb: Mat<f64>,
    ebd: Mat<f64>,
    dd: Mat<f64>,
}

/// One mode of the plant; of a pair one member stands for both.
struct PlantMode {
    value: (f64, f64),
    paired: bool,
    /// Column of `V`.
    v: Vec<(f64, f64)>,
    /// Row of `V^-1 X` (discrete time: of `V^-1 A X`).
    vx: Vec<(f64, f64)>,
    /// Row of `V^-1 B (E B)'`.
    eb: Vec<(f64, f64)>,
    /// Row of `-V^-1 B D'`.
    bd: Vec<(f64, f64)>,
}

fn plant_modes(
    modes: &Modes,
    continuous: bool,
    block: &LoopBlock,
    x: MatRef<'_, f64>,
    eb: MatRef<'_, f64>,
    d: &Mat<f64>,
) -> Vec<PlantMode> {
    let beb = &block.B * eb.transpose();
    let bd = &block.B * d.transpose();
    let rows = |left: &[(f64, f64)], m: MatRef<'_, f64>| -> Vec<(f64, f64)> {
        (0..m.ncols()).map(|c| row_times(left, m, c)).collect()
    };
    (0..modes.values.len())
        .map(|k| {
            let (re, im) = modes.values[k];
            let left = &modes.left[k];
            let mut vx = rows(left, x);
            if !continuous {
                for v in &mut vx {
                    *v = (v.0 * re - v.1 * im, v.0 * im + v.1 * re);
                }
            }
            PlantMode {
                value: (re, im),
                paired: im != 0.0,
                v: modes.right[k].clone(),
                vx,
                eb: rows(left, beb.as_ref()),
                bd: rows(left, bd.as_ref()).into_iter().map(|(re, im)| (-re, -im)).collect(),
            }
        })
        .collect()
}
