//! The couplings of one plant with all models, models in lanes.

use faer::MatRef;

use super::{Modal, PlantSide};
use crate::model::LoopBlock;
use crate::real::{Mask, Real};
use crate::simd::{Block, Kernel, LANES};

/// A complex number in lanes: real and imaginary part.
type Complex<T> = (T, T);

/// The plant and where its energies go.
pub(super) struct Sums<'a> {
    pub(super) modal: &'a Modal,
    pub(super) block: &'a LoopBlock,
    pub(super) x: MatRef<'a, f64>,
    pub(super) plant: &'a PlantSide,
    pub(super) out: &'a mut [f64],
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
