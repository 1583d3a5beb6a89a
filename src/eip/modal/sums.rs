//! The couplings of a batch of plants with all models, models in lanes.

mod side;
mod terms;
mod wide;

use self::side::{Numbers, Plan, Plant, Side};
use self::terms::{Factors, Terms};
use self::wide::{Models, Wide};
use super::Modal;
use super::plants::{Sides, Way};
use crate::real::Real;
use crate::simd::{Kernel, LANES};

/// A complex number of some models: real and imaginary part.
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
        // eight lanes of `TILE` 2 are two registers already, and there are sixteen
        if const { T::TILE == 4 } {
            self.wide::<T, 2>();
        } else {
            self.wide::<T, 1>();
        }
    }
}

impl Sums<'_> {
    #[inline(always)]
    fn wide<T: Real, const V: usize>(self) {
        let Sums { modal, sides, out } = self;
        let (np, ny) = (sides.places.shape.np, modal.ny);
        let mut plans = Vec::new();
        let mut plants = Vec::with_capacity(sides.ways.len());
        for (k, &way) in sides.ways.iter().enumerate() {
            if way == Way::Modes {
                plants.push((k, Plant::new(modal, sides, k, &mut plans)));
            }
        }
        let sizes = [modal.n, np, ny];
        let mut work =
            modal.spare.take(|w: &Work<Wide<T, V>>| w.sizes == sizes, || Work::new(sizes));
        let mut side = Side::<T, V>::new(modal, std::mem::take(&mut work.side));
        for first in (0..modal.n_models).step_by(V * T::LANES) {
            side.enter(first);
            for (k, plant) in &plants {
                let plan = &plans[plant.plan];
                side.follow(plant.plan, plan);
                let energy = energy(&side, plant, plan, &mut work);
                let mut row = &mut out[k * modal.n_models..][first..modal.n_models];
                for v in 0..V {
                    let mut lanes = [0.0; LANES];
                    energy.0[v].store(&mut lanes);
                    let (now, rest) = row.split_at_mut(T::LANES.min(row.len()));
                    now.copy_from_slice(&lanes[..now.len()]);
                    row = rest;
                }
            }
        }
        work.side = side.numbers;
        modal.spare.put(work);
    }
}

/// Buffers of a lane of pairs: the rows of `N` that may differ from zero, `D`, and for one
/// mode of the plant the products with `v` (of both) and with `V^-1 X` (of `N`).
struct Work<T> {
    /// Orders of models and plants, outputs.
    sizes: [usize; 3],
    nn: Vec<T>,
    dd: Vec<T>,
    kv: Vec<Complex<T>>,
    tv: Vec<Complex<T>>,
    side: Numbers<T>,
}

impl<T: Models> Work<T> {
    fn new(sizes: [usize; 3]) -> Self {
        let [n, np, ny] = sizes;
        let zeros = |len| vec![(T::zero(), T::zero()); len];
        Work {
            sizes,
            nn: vec![T::zero(); n * np],
            dd: vec![T::zero(); ny * np],
            kv: zeros(n + ny),
            tv: zeros(n),
            side: Numbers::default(),
        }
    }
}

/// The energy of a plant with a lane of models.
#[inline(always)]
fn energy<T: Real, const V: usize>(
    side: &Side<'_, T, V>,
    plant: &Plant<'_>,
    plan: &Plan,
    work: &mut Work<Wide<T, V>>,
) -> Wide<T, V> {
    let (m, p) = (side.modal, plant.places);
    let f = &m.fields;
    let (n, np, ny) = (m.n, p.shape.np, m.ny);
    differences(side, plant, plan, work);
    let mut energy = Wide::zero();
    for &(field, factor) in &plant.own {
        energy = side.field(field).mul_add(Wide::splat(factor), energy);
    }
    let x = &plant.numbers[p.x..][..np * np];
    if !plan.same_output {
        for i in 0..ny {
            for j in 0..ny {
                let w = side.field(f.w + i * ny + j);
                energy = w.mul_add(form(x, np, &work.dd, i, j), energy);
            }
        }
    }
    if !m.continuous {
        for (i, &row) in plan.rows.iter().enumerate() {
            for (j, &col) in plan.rows.iter().enumerate() {
                let z = side.field(f.z + row * n + col);
                energy = z.mul_add(form(x, np, &work.nn, i, j), energy);
            }
        }
    }
    // the usual: one parameter enters one row of A, or two
    let coupling = match (plan.rows.len(), plan.same_output, m.continuous) {
        (1, true, true) => couplings::<T, V, 1, true>(side, plant, plan, work),
        (2, true, true) => couplings::<T, V, 2, true>(side, plant, plan, work),
        (_, _, true) => couplings::<T, V, 0, true>(side, plant, plan, work),
        _ => couplings::<T, V, 0, false>(side, plant, plan, work),
    };
    coupling.mul_add(Wide::splat(if m.continuous { -2.0 } else { 2.0 }), energy)
}

/// Fills `D` (unless it is zero) and the rows of `N`.
#[inline(always)]
fn differences<T: Real, const V: usize>(
    side: &Side<'_, T, V>,
    plant: &Plant<'_>,
    plan: &Plan,
    work: &mut Work<Wide<T, V>>,
) {
    let (m, p) = (side.modal, plant.places);
    let (np, same_output) = (p.shape.np, plan.same_output);
    let row = |at: usize, r: usize| &plant.numbers[at + r * np..][..np];
    if !same_output {
        for i in 0..m.ny {
            let d = &mut work.dd[i * np..][..np];
            for (d, &cy) in d.iter_mut().zip(row(p.cy, i)) {
                *d = Wide::splat(cy);
            }
            for (d, &c) in d.iter_mut().zip(side.row_c(i)) {
                *d = *d - c;
            }
        }
    }
    for (at, &r) in plan.rows.iter().enumerate() {
        let nn = &mut work.nn[at * np..][..np];
        let [a, b, h] = side.row(at);
        let (leading, rest) = row(p.a, r).split_at(a.len());
        let (nn_leading, nn_rest) = nn.split_at_mut(a.len());
        for ((v, &x), &a) in nn_leading.iter_mut().zip(leading).zip(a) {
            *v = Wide::splat(x) - a;
        }
        for (v, &x) in nn_rest.iter_mut().zip(rest) {
            *v = Wide::splat(x);
        }
        for (k, b) in b.iter().enumerate() {
            for (v, &cu) in nn.iter_mut().zip(row(p.cu, k)) {
                *v = b.neg_mul_add(Wide::splat(cu), *v);
            }
        }
        if !same_output {
            for (k, h) in h.iter().enumerate() {
                for (v, &d) in nn.iter_mut().zip(&work.dd[k * np..][..np]) {
                    *v = h.neg_mul_add(d, *v);
                }
            }
        }
    }
}

/// `Re sum_jk K_kj T_jk / (lambda_j + mu_k)`, over both members of the plant's pairs, and
/// one, counted twice, of the models'. With `ROWS` there are that many rows of `N`, and `D`
/// is zero; without, what the plan says.
#[inline(always)]
fn couplings<T: Real, const V: usize, const ROWS: usize, const CONTINUOUS: bool>(
    side: &Side<'_, T, V>,
    plant: &Plant<'_>,
    plan: &Plan,
    work: &mut Work<Wide<T, V>>,
) -> Wide<T, V> {
    let np = plant.places.shape.np;
    let rows = if ROWS > 0 { ROWS } else { plan.rows.len() };
    let outputs = if ROWS > 0 || plan.same_output { 0 } else { side.modal.ny };
    let Work { nn, dd, kv, tv, .. } = work;
    let (kv, tv) = (&mut kv[..rows + outputs], &mut tv[..rows]);
    let mut sum = Wide::zero();
    let ([reals, pairs], [model_reals, model_pairs]) = (plant.counts, side.counts());
    for k in 0..reals {
        let mode = plant.real(k);
        for r in 0..rows {
            let row = &nn[r * np..][..np];
            kv[r].0 = real_row(row, mode.v);
            tv[r].0 = real_row(row, mode.vx);
        }
        for i in 0..outputs {
            kv[rows + i].0 = real_row(&dd[i * np..][..np], mode.v);
        }
        let factors = Factors { mode, kv: &*kv, tv: &*tv };
        let mut terms = Terms::new();
        for i in 0..model_reals {
            terms.add(factors.real_real::<ROWS, CONTINUOUS>(side.real(i)), &mut sum);
        }
        for i in 0..model_pairs {
            terms.add(factors.real_pair::<ROWS, CONTINUOUS>(side.pair(i)), &mut sum);
        }
        terms.finish(&mut sum);
    }
    for k in 0..pairs {
        let mode = plant.pair(k);
        for r in 0..rows {
            let row = &nn[r * np..][..np];
            kv[r] = complex_row(row, mode.v);
            tv[r] = complex_row(row, mode.vx);
        }
        for i in 0..outputs {
            kv[rows + i] = complex_row(&dd[i * np..][..np], mode.v);
        }
        let factors = Factors { mode, kv: &*kv, tv: &*tv };
        let mut terms = Terms::new();
        for i in 0..model_reals {
            terms.add(factors.pair_real::<ROWS, CONTINUOUS>(side.real(i)), &mut sum);
        }
        for i in 0..model_pairs {
            terms.add(factors.pair_pair::<ROWS, CONTINUOUS>(side.pair(i)), &mut sum);
        }
        terms.finish(&mut sum);
    }
    sum
}

/// `(M X M')_ij`, `M` given by its rows in lanes.
#[inline(always)]
fn form<T: Models>(x: &[f64], np: usize, m: &[T], i: usize, j: usize) -> T {
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

/// A row in lanes times a real column.
#[inline(always)]
fn real_row<T: Models>(row: &[T], column: &[f64]) -> T {
    // a loop, not a fold: closures are not compiled for the lanes' instructions
    let mut sum = T::zero();
    for (&r, &c) in row.iter().zip(column) {
        sum = r.mul_add(T::splat(c), sum);
    }
    sum
}

/// A row in lanes times a complex column.
#[inline(always)]
fn complex_row<T: Models>(row: &[T], column: &[f64]) -> Complex<T> {
    let (mut re, mut im) = (T::zero(), T::zero());
    for (&r, c) in row.iter().zip(column.as_chunks::<2>().0) {
        re = r.mul_add(T::splat(c[0]), re);
        im = r.mul_add(T::splat(c[1]), im);
    }
    (re, im)
}
