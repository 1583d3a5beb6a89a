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

use faer::{Mat, MatRef};

use crate::eip::setup::PairModel;
use crate::error::Result;
use crate::model::LoopBlock;
use crate::real::{Mask, Real};
use crate::simd::{self, Block, Kernel, LANES};
use crate::solve::backend;

/// Largest condition number of an eigenvalue that is accepted; those of plant
/// and model multiply.
const CONDITION: f64 = 3e3;

/// Eigenvalues with scaled eigenvectors: `left[j]` is row `j` of `V^-1`.
pub(crate) struct Modes {
    values: Vec<(f64, f64)>,
    right: Vec<Vec<(f64, f64)>>,
    left: Vec<Vec<(f64, f64)>>,
}

impl Modes {
    /// Diagonalises `a`; `None` where the eigenvectors are ill-conditioned.
    pub(crate) fn new(a: MatRef<'_, f64>) -> Result<Option<Self>> {
        let n = a.nrows();
        let eigen = backend::eigen(a)?;
        let mut modes = Self { values: Vec::new(), right: Vec::new(), left: Vec::new() };
        let mut j = 0;
        while j < n {
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
            j += if pair { 2 } else { 1 };
        }
        Ok(Some(modes))
    }
}

/// `sum_i row_i m_i,col`, a complex row times a real matrix.
fn row_times(row: &[(f64, f64)], m: MatRef<'_, f64>, col: usize) -> (f64, f64) {
    row.iter()
        .enumerate()
        .fold((0.0, 0.0), |(re, im), (i, &(r, s))| (re + r * m[(i, col)], im + s * m[(i, col)]))
}

/// A complex number in lanes: real and imaginary part.
type Complex<T> = (T, T);

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

struct Sums<'a> {
    modal: &'a Modal,
    block: &'a LoopBlock,
    x: MatRef<'a, f64>,
    plant: &'a PlantSide,
    out: &'a mut [f64],
}

impl Kernel for Sums<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let (np, ny) = (self.block.np(), self.modal.ny);
        let mut work = Work {
            nn: vec![T::zero(); self.modal.n * np],
            dd: vec![T::zero(); ny * np],
            rows: Vec::with_capacity(self.modal.n),
            nv: vec![(T::zero(), T::zero()); self.modal.n],
            nx: vec![(T::zero(), T::zero()); self.modal.n],
            dv: vec![(T::zero(), T::zero()); ny],
        };
        let total = self.modal.total();
        for (g, out) in self.out.chunks_mut(T::LANES).enumerate() {
            let first = g * T::LANES;
            let fields = &self.modal.data[first / LANES * total..][..total];
            let lane = ModelLane { modal: self.modal, fields, at: first % LANES };
            let energy = lane.energy(self.block, self.x, self.plant, &mut work);
            for (l, out) in out.iter_mut().enumerate() {
                *out = energy.lane(l);
            }
        }
    }
}

/// Buffers of a lane of pairs: `N`, `D`, the rows of `N` that are not zero, and
/// for one mode of the plant their products with its vectors.
struct Work<T> {
    nn: Vec<T>,
    dd: Vec<T>,
    rows: Vec<usize>,
    nv: Vec<Complex<T>>,
    nx: Vec<Complex<T>>,
    dv: Vec<Complex<T>>,
}

/// A lane of models.
struct ModelLane<'a> {
    modal: &'a Modal,
    fields: &'a [Block],
    /// Place of the first model in the blocks.
    at: usize,
}

impl ModelLane<'_> {
    #[inline(always)]
    fn field<T: Real>(&self, field: usize) -> T {
        T::load(&self.fields[field].0[self.at..])
    }

    #[inline(always)]
    fn complex<T: Real>(&self, field: usize) -> Complex<T> {
        (self.field(field), self.field(field + 1))
    }

    #[inline(always)]
    fn energy<T: Real>(
        &self,
        block: &LoopBlock,
        x: MatRef<'_, f64>,
        plant: &PlantSide,
        work: &mut Work<T>,
    ) -> T {
        let (m, f) = (self.modal, &self.modal.fields);
        let (n, np, ny, rank) = (m.n, block.np(), m.ny, m.ny + m.nu);
        let same_output = self.differences(block, work);
        // tr(Z M M') = tr(Z EB EB') - 2 tr((Z J)' EB D') + tr(J' Z J D D')
        let mut energy = T::zero();
        for i in 0..n {
            for j in 0..n {
                let z = self.field::<T>(f.z + i * n + j);
                energy = z.mul_add(T::splat(plant.ebb[(i, j)]), energy);
            }
            for j in 0..rank {
                let zj = self.field::<T>(f.zj + i * rank + j);
                energy = zj.mul_add(T::splat(-2.0 * plant.ebd[(i, j)]), energy);
            }
        }
        for i in 0..rank {
            for j in 0..rank {
                let jzj = self.field::<T>(f.jzj + i * rank + j);
                energy = jzj.mul_add(T::splat(plant.dd[(i, j)]), energy);
            }
        }
        if !same_output {
            for i in 0..ny {
                for j in 0..ny {
                    let w = self.field::<T>(f.w + i * ny + j);
                    energy = w.mul_add(form(x, np, &work.dd, i, j), energy);
                }
            }
        }
        if !m.continuous {
            for &i in &work.rows {
                for &j in &work.rows {
                    let z = self.field::<T>(f.z + i * n + j);
                    energy = z.mul_add(form(x, np, &work.nn, i, j), energy);
                }
            }
        }
        let coupling = self.coupling(np, plant, work, same_output);
        coupling.mul_add(T::splat(if m.continuous { -2.0 } else { 2.0 }), energy)
    }

    /// Fills `N` and `D`; true where `D` is zero in every lane.
    #[inline(always)]
    fn differences<T: Real>(&self, block: &LoopBlock, work: &mut Work<T>) -> bool {
        let (m, f) = (self.modal, &self.modal.fields);
        let (n, np, ny, nu) = (m.n, block.np(), m.ny, m.nu);
        let mut same_output = true;
        for i in 0..ny {
            for j in 0..np {
                let mut d = T::splat(block.Cy[(i, j)]);
                if j < n {
                    d = d - self.field(f.c + i * n + j);
                }
                same_output &= d.eq(T::zero()).all();
                work.dd[i * np + j] = d;
            }
        }
        work.rows.clear();
        for i in 0..n {
            let mut zero = true;
            for j in 0..np {
                let mut v = T::splat(block.A[(i, j)]);
                if j < n {
                    v = v - self.field(f.a + i * n + j);
                }
                for k in 0..nu {
                    let b = self.field::<T>(f.b + i * nu + k);
                    v = b.neg_mul_add(T::splat(block.Cu[(k, j)]), v);
                }
                if !same_output {
                    for k in 0..ny {
                        let h = self.field::<T>(f.h + i * ny + k);
                        v = h.neg_mul_add(work.dd[k * np + j], v);
                    }
                }
                zero &= v.eq(T::zero()).all();
                work.nn[i * np + j] = v;
            }
            if !zero {
                work.rows.push(i);
            }
        }
        same_output
    }

    /// `Re sum_jk K_kj T_jk / (lambda_j + mu_k)`, over both members of a pair
    /// of the plant and one, counted twice, of a pair of the model.
    #[inline(always)]
    fn coupling<T: Real>(
        &self,
        np: usize,
        plant: &PlantSide,
        work: &mut Work<T>,
        same_output: bool,
    ) -> T {
        let (m, f) = (self.modal, &self.modal.fields);
        let zero = (T::zero(), T::zero());
        let mut sum = T::zero();
        let Work { nn, dd, rows, nv, nx, dv } = work;
        for mode in &plant.modes {
            for &r in rows.iter() {
                nv[r] = real_row(&nn[r * np..(r + 1) * np], &mode.v);
                nx[r] = real_row(&nn[r * np..(r + 1) * np], &mode.vx);
            }
            if !same_output {
                for (i, d) in dv.iter_mut().enumerate() {
                    *d = real_row(&dd[i * np..(i + 1) * np], &mode.v);
                }
            }
            let lambda = (T::splat(mode.value.0), T::splat(mode.value.1));
            for k in 0..m.kept {
                let at = f.mode + k * f.mode_len;
                let mu: Complex<T> = self.complex(at);
                let (mut kk, mut tt) = ([T::zero(); 4], [T::zero(); 4]);
                for &r in rows.iter() {
                    add_product(&mut kk, self.complex(at + f.uz + 2 * r), nv[r]);
                    add_product(&mut tt, self.complex(at + f.inv + 2 * r), nx[r]);
                }
                if !same_output {
                    for (i, &d) in dv.iter().enumerate() {
                        add_product(&mut kk, self.complex(at + f.ucw + 2 * i), d);
                    }
                }
                for (from, constants) in [(f.inv, &mode.eb), (f.inv_j, &mode.bd)] {
                    for (r, &(re, im)) in constants.iter().enumerate() {
                        if (re, im) != (0.0, 0.0) {
                            let b = (T::splat(re), T::splat(im));
                            add_product(&mut tt, self.complex(at + from + 2 * r), b);
                        }
                    }
                }
                // the plant's mode, then its conjugate
                let product = fma(zero, plain(kk), plain(tt));
                let (mut num, mut den) = m.term(product, lambda, mu);
                if mode.paired {
                    let product = fma(zero, conjugated(kk), conjugated(tt));
                    let (a, b) = m.term(product, (lambda.0, -lambda.1), mu);
                    // one division for two terms: it costs as much as 32 products
                    (num, den) = (num.mul_add(b, a * den), den * b);
                }
                sum = sum + num / den;
            }
        }
        sum
    }
}

impl Modal {
    /// Numerator and denominator of `Re(product / (lambda + mu))`, in discrete
    /// time over `1 - lambda mu`.
    #[inline(always)]
    fn term<T: Real>(&self, product: Complex<T>, lambda: Complex<T>, mu: Complex<T>) -> (T, T) {
        let (re, im) = if self.continuous {
            (lambda.0 + mu.0, lambda.1 + mu.1)
        } else {
            let (re, im) = fma((-T::one(), T::zero()), lambda, mu);
            (-re, -im)
        };
        (product.1.mul_add(im, product.0 * re), re.mul_add(re, im * im))
    }
}

/// `(M X M')_ij`, `M` given by its rows in lanes.
#[inline(always)]
fn form<T: Real>(x: MatRef<'_, f64>, np: usize, m: &[T], i: usize, j: usize) -> T {
    let mut sum = T::zero();
    for p in 0..np {
        let mut xm = T::zero();
        for q in 0..np {
            xm = m[j * np + q].mul_add(T::splat(x[(p, q)]), xm);
        }
        sum = m[i * np + p].mul_add(xm, sum);
    }
    sum
}

/// Adds the four products of the parts of `a b`: from their sums come both
/// `sum a b` and `sum a conj(b)`.
#[inline(always)]
fn add_product<T: Real>(sums: &mut [T; 4], a: Complex<T>, b: Complex<T>) {
    sums[0] = a.0.mul_add(b.0, sums[0]);
    sums[1] = a.1.mul_add(b.1, sums[1]);
    sums[2] = a.0.mul_add(b.1, sums[2]);
    sums[3] = a.1.mul_add(b.0, sums[3]);
}

/// `sum a b`.
#[inline(always)]
fn plain<T: Real>(sums: [T; 4]) -> Complex<T> {
    (sums[0] - sums[1], sums[3] + sums[2])
}

/// `sum a conj(b)`.
#[inline(always)]
fn conjugated<T: Real>(sums: [T; 4]) -> Complex<T> {
    (sums[0] + sums[1], sums[3] - sums[2])
}

/// A row in lanes times a complex column of the plant.
#[inline(always)]
fn real_row<T: Real>(row: &[T], column: &[(f64, f64)]) -> Complex<T> {
    // a loop, not a fold: closures are not compiled for the lanes' instructions
    let (mut re, mut im) = (T::zero(), T::zero());
    for (&r, &(cr, ci)) in row.iter().zip(column) {
        re = r.mul_add(T::splat(cr), re);
        im = r.mul_add(T::splat(ci), im);
    }
    (re, im)
}

/// `sum + a b`.
#[inline(always)]
fn fma<T: Real>(sum: Complex<T>, a: Complex<T>, b: Complex<T>) -> Complex<T> {
    (a.1.neg_mul_add(b.1, a.0.mul_add(b.0, sum.0)), a.1.mul_add(b.0, a.0.mul_add(b.1, sum.1)))
}
