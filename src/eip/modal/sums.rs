//! The couplings of a batch of plants with all models, models in lanes.

use super::plants::{Places, Sides, Way};
use super::{Fields, Modal};
use crate::real::Real;
use crate::simd::{Block, Kernel, LANES};

/// A complex number in lanes: real and imaginary part.
type Complex<T> = (T, T);

/// The plants and where their energies go, plants by models.
pub(super) struct Sums<'a> {
    pub(super) modal: &'a Modal,
    pub(super) sides: &'a Sides,
    pub(super) out: &'a mut [f64],
}

impl Kernel for Sums<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Sums { modal, sides, out } = self;
        let (n, np, ny) = (modal.n, sides.places.shape.np, modal.ny);
        let mut work = Work {
            nn: vec![T::zero(); n * np],
            dd: vec![T::zero(); ny * np],
            nv: vec![(T::zero(), T::zero()); n],
            nx: vec![(T::zero(), T::zero()); n],
            dv: vec![(T::zero(), T::zero()); ny],
        };
        let total = modal.total();
        let mut plants = Vec::with_capacity(sides.ways.len());
        for (k, &way) in sides.ways.iter().enumerate() {
            if way == Way::Modes {
                plants.push((k, Plant::new(modal, sides, k)));
            }
        }
        for first in (0..modal.n_models).step_by(T::LANES) {
            let fields = &modal.data[first / LANES * total..][..total];
            let lane = ModelLane { modal, fields, at: first % LANES };
            let valid = T::LANES.min(modal.n_models - first);
            for (k, plant) in &plants {
                let energy = lane.energy(plant, &mut work);
                let mut lanes = [0.0; LANES];
                energy.store(&mut lanes);
                out[k * modal.n_models + first..][..valid].copy_from_slice(&lanes[..valid]);
            }
        }
    }
}

/// A plant, and which of its numbers count.
struct Plant<'a> {
    places: &'a Places,
    numbers: &'a [f64],
    /// Real modes, and of each pair the upper one.
    reals: Vec<usize>,
    pairs: Vec<usize>,
    /// Its outputs are those of every model.
    same_output: bool,
    /// Rows of `N` that may differ from zero.
    rows: Vec<usize>,
    /// Fields of the models with their factors in what the noise alone makes.
    own: Vec<(usize, f64)>,
    /// Constants that are not zero in every mode.
    constants: Vec<usize>,
}

impl<'a> Plant<'a> {
    fn new(modal: &Modal, sides: &'a Sides, k: usize) -> Self {
        let (p, numbers) = (&sides.places, sides.plant(k));
        let (n, np, ny, nu) = (modal.n, p.shape.np, modal.ny, modal.nu);
        let f = &modal.fields;
        let (mut reals, mut pairs) = (Vec::new(), Vec::new());
        for k in 0..np {
            let im = numbers[p.mode + k * p.mode_len + 1];
            if im == 0.0 {
                reals.push(k);
            } else if im > 0.0 {
                pairs.push(k);
            }
        }
        let row = |at: usize, r: usize, cols: usize| &numbers[at + r * cols..][..cols];
        let same_output = modal.shared_c.as_ref().is_some_and(|c| {
            (0..ny).all(|i| {
                let leading = (0..np).map(|j| if j < n { c[(i, j)] } else { 0.0 });
                row(p.cy, i, np).iter().zip(leading).all(|(&x, c)| x == c)
            })
        });
        let is_zero = |r: usize| {
            let Some((a, b)) = &modal.shared_rows[r] else { return false };
            (0..np).all(|j| {
                let shared = if j < n { a[j] } else { 0.0 };
                let fed = b
                    .iter()
                    .enumerate()
                    .fold(shared, |sum, (k, b)| numbers[p.cu + k * np + j].mul_add(*b, sum));
                numbers[p.a + r * np + j] == fed
            })
        };
        let rows = (0..n).filter(|&r| !same_output || !is_zero(r)).collect();
        let rank = ny + nu;
        // tr(Z M M') = tr(Z EB EB') - 2 tr((Z J)' EB D') + tr(J' Z J D D')
        let mut own = Vec::new();
        for (at, factor, field, len) in [
            (p.ebb, 1.0, f.z, n * n),
            (p.ebd, -2.0, f.zj, n * rank),
            (p.dd, 1.0, f.jzj, rank * rank),
        ] {
            for e in 0..len {
                if numbers[at + e] != 0.0 {
                    own.push((field + e, factor * numbers[at + e]));
                }
            }
        }
        let constants = (0..p.constants_len())
            .filter(|c| {
                (0..np).any(|k| {
                    let at = p.mode + k * p.mode_len + p.constants + 2 * c;
                    numbers[at] != 0.0 || numbers[at + 1] != 0.0
                })
            })
            .collect();
        Plant { places: p, numbers, reals, pairs, same_output, rows, own, constants }
    }

    /// Mode `k`.
    #[inline(always)]
    fn mode(&self, k: usize) -> Mode<'a> {
        let p = self.places;
        let numbers = &self.numbers[p.mode + k * p.mode_len..][..p.mode_len];
        let (v, rest) = numbers[p.v..].split_at(p.vx - p.v);
        let (vx, constants) = rest.split_at(p.constants - p.vx);
        Mode { value: (numbers[0], numbers[1]), v, vx, constants }
    }
}

/// A mode of a plant, complex numbers as two.
struct Mode<'a> {
    value: (f64, f64),
    v: &'a [f64],
    vx: &'a [f64],
    constants: &'a [f64],
}

/// Buffers of a lane of pairs: `N`, `D`, and for one mode of the plant their products
/// with its vectors.
struct Work<T> {
    nn: Vec<T>,
    dd: Vec<T>,
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

    /// Numbers `at` and `at + 1` of the fields of a mode.
    #[inline(always)]
    fn complex<T: Real>(&self, fields: &[Block], at: usize) -> Complex<T> {
        (T::load(&fields[at].0[self.at..]), T::load(&fields[at + 1].0[self.at..]))
    }

    #[inline(always)]
    fn energy<T: Real>(&self, plant: &Plant<'_>, work: &mut Work<T>) -> T {
        let (m, f, p) = (self.modal, &self.modal.fields, plant.places);
        let (n, np, ny) = (m.n, p.shape.np, m.ny);
        self.differences(plant, work);
        let mut energy = T::zero();
        for &(field, factor) in &plant.own {
            energy = self.field::<T>(field).mul_add(T::splat(factor), energy);
        }
        let x = &plant.numbers[p.x..][..np * np];
        if !plant.same_output {
            for i in 0..ny {
                for j in 0..ny {
                    let w = self.field::<T>(f.w + i * ny + j);
                    energy = w.mul_add(form(x, np, &work.dd, i, j), energy);
                }
            }
        }
        if !m.continuous {
            for &i in &plant.rows {
                for &j in &plant.rows {
                    let z = self.field::<T>(f.z + i * n + j);
                    energy = z.mul_add(form(x, np, &work.nn, i, j), energy);
                }
            }
        }
        let mut coupling = T::zero();
        for &k in &plant.reals {
            coupling = coupling + self.coupling::<T, false>(plant, &plant.mode(k), work);
        }
        for &k in &plant.pairs {
            coupling = coupling + self.coupling::<T, true>(plant, &plant.mode(k), work);
        }
        coupling.mul_add(T::splat(if m.continuous { -2.0 } else { 2.0 }), energy)
    }

    /// Fills `D` (unless it is zero) and the rows of `N`.
    #[inline(always)]
    fn differences<T: Real>(&self, plant: &Plant<'_>, work: &mut Work<T>) {
        let (m, f, p) = (self.modal, &self.modal.fields, plant.places);
        let (n, np, ny, nu) = (m.n, p.shape.np, m.ny, m.nu);
        let numbers = plant.numbers;
        if !plant.same_output {
            for i in 0..ny {
                for j in 0..np {
                    let mut d = T::splat(numbers[p.cy + i * np + j]);
                    if j < n {
                        d = d - self.field(f.c + i * n + j);
                    }
                    work.dd[i * np + j] = d;
                }
            }
        }
        for &i in &plant.rows {
            for j in 0..np {
                let mut v = T::splat(numbers[p.a + i * np + j]);
                if j < n {
                    v = v - self.field(f.a + i * n + j);
                }
                for k in 0..nu {
                    let b = self.field::<T>(f.b + i * nu + k);
                    v = b.neg_mul_add(T::splat(numbers[p.cu + k * np + j]), v);
                }
                if !plant.same_output {
                    for k in 0..ny {
                        let h = self.field::<T>(f.h + i * ny + k);
                        v = h.neg_mul_add(work.dd[k * np + j], v);
                    }
                }
                work.nn[i * np + j] = v;
            }
        }
    }

    /// `Re sum_k K_kj T_jk / (lambda_j + mu_k)` for mode `j` of the plant, over both
    /// members if it is of a pair, and one, counted twice, of a pair of the model.
    #[inline(always)]
    fn coupling<T: Real, const PAIR: bool>(
        &self,
        plant: &Plant<'_>,
        mode: &Mode<'_>,
        work: &mut Work<T>,
    ) -> T {
        let (m, f) = (self.modal, &self.modal.fields);
        let np = plant.places.shape.np;
        let Work { nn, dd, nv, nx, dv } = work;
        for &r in &plant.rows {
            nv[r] = real_row::<T, PAIR>(&nn[r * np..][..np], mode.v);
            nx[r] = real_row::<T, PAIR>(&nn[r * np..][..np], mode.vx);
        }
        if !plant.same_output {
            for (i, d) in dv.iter_mut().enumerate() {
                *d = real_row::<T, PAIR>(&dd[i * np..][..np], mode.v);
            }
        }
        let mut sum = T::zero();
        let mut k = 0;
        // One division for two terms: it costs as much as 32 products.
        while k + 1 < m.kept {
            let (a, b) = self.term::<T, PAIR>(plant, mode, [nv, nx, dv], f, k);
            let (c, d) = self.term::<T, PAIR>(plant, mode, [nv, nx, dv], f, k + 1);
            sum = sum + a.mul_add(d, c * b) / (b * d);
            k += 2;
        }
        if k < m.kept {
            let (a, b) = self.term::<T, PAIR>(plant, mode, [nv, nx, dv], f, k);
            sum = sum + a / b;
        }
        sum
    }

    /// Numerator and denominator of the term of mode `k` of the models.
    #[inline(always)]
    fn term<T: Real, const PAIR: bool>(
        &self,
        plant: &Plant<'_>,
        mode: &Mode<'_>,
        [nv, nx, dv]: [&[Complex<T>]; 3],
        f: &Fields,
        k: usize,
    ) -> (T, T) {
        let m = self.modal;
        let fields = &self.fields[f.mode + k * f.mode_len..][..f.mode_len];
        let mu: Complex<T> = self.complex(fields, 0);
        let (mut kk, mut tt) = ([T::zero(); 4], [T::zero(); 4]);
        for &r in &plant.rows {
            let at = f.uz + 2 * r;
            add_product::<T, PAIR>(&mut kk, self.complex(fields, at), nv[r]);
        }
        if !plant.same_output {
            for (i, &d) in dv.iter().enumerate() {
                let at = f.ucw + 2 * i;
                add_product::<T, PAIR>(&mut kk, self.complex(fields, at), d);
            }
        }
        for &r in &plant.rows {
            let at = f.inv + 2 * r;
            add_product::<T, PAIR>(&mut tt, self.complex(fields, at), nx[r]);
        }
        for &c in &plant.constants {
            // the rows of U^-1, then those of U^-1 J
            let at = f.inv + 2 * c;
            let b = (T::splat(mode.constants[2 * c]), T::splat(mode.constants[2 * c + 1]));
            add_product::<T, PAIR>(&mut tt, self.complex(fields, at), b);
        }
        let lambda = (T::splat(mode.value.0), T::splat(mode.value.1));
        let product = times(plain::<T, PAIR>(kk), plain::<T, PAIR>(tt));
        let (num, den) = m.term(product, lambda, mu);
        if !PAIR {
            return (num, den);
        }
        // the conjugate of the plant's mode
        let product = times(conjugated(kk), conjugated(tt));
        let (a, b) = m.term(product, (lambda.0, -lambda.1), mu);
        (num.mul_add(b, a * den), den * b)
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
            let (re, im) = times(lambda, mu);
            (T::one() - re, -im)
        };
        (product.1.mul_add(im, product.0 * re), re.mul_add(re, im * im))
    }
}

/// `(M X M')_ij`, `M` given by its rows in lanes.
#[inline(always)]
fn form<T: Real>(x: &[f64], np: usize, m: &[T], i: usize, j: usize) -> T {
    let mut sum = T::zero();
    for p in 0..np {
        let mut xm = T::zero();
        for q in 0..np {
            xm = m[j * np + q].mul_add(T::splat(x[p * np + q]), xm);
        }
        sum = m[i * np + p].mul_add(xm, sum);
    }
    sum
}

/// Adds the products of the parts of `a b`: from their sums come both `sum a b` and
/// `sum a conj(b)`. Unless `PAIR` `b` is real.
#[inline(always)]
fn add_product<T: Real, const PAIR: bool>(sums: &mut [T; 4], a: Complex<T>, b: Complex<T>) {
    sums[0] = a.0.mul_add(b.0, sums[0]);
    sums[3] = a.1.mul_add(b.0, sums[3]);
    if PAIR {
        sums[1] = a.1.mul_add(b.1, sums[1]);
        sums[2] = a.0.mul_add(b.1, sums[2]);
    }
}

/// `sum a b`.
#[inline(always)]
fn plain<T: Real, const PAIR: bool>(sums: [T; 4]) -> Complex<T> {
    if PAIR { (sums[0] - sums[1], sums[3] + sums[2]) } else { (sums[0], sums[3]) }
}

/// `sum a conj(b)`.
#[inline(always)]
fn conjugated<T: Real>(sums: [T; 4]) -> Complex<T> {
    (sums[0] + sums[1], sums[3] - sums[2])
}

/// A row in lanes times a column of the plant, which is real unless `PAIR`.
#[inline(always)]
fn real_row<T: Real, const PAIR: bool>(row: &[T], column: &[f64]) -> Complex<T> {
    // a loop, not a fold: closures are not compiled for the lanes' instructions
    let (mut re, mut im) = (T::zero(), T::zero());
    for (&r, c) in row.iter().zip(column.as_chunks::<2>().0) {
        re = r.mul_add(T::splat(c[0]), re);
        if PAIR {
            im = r.mul_add(T::splat(c[1]), im);
        }
    }
    (re, im)
}

/// `a b`.
#[inline(always)]
fn times<T: Real>(a: Complex<T>, b: Complex<T>) -> Complex<T> {
    (a.1.neg_mul_add(b.1, a.0 * b.0), a.1.mul_add(b.0, a.0 * b.1))
}
