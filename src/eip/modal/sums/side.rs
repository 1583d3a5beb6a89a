//! What plants and models bring to their sums, and which of it counts.

use super::super::Modal;
use super::super::plants::{Places, Sides};
use super::wide::Wide;
use crate::real::Real;
use crate::simd::{Block, LANES};

/// Which numbers count: the same for most plants of a study.
#[derive(Clone, PartialEq)]
pub(super) struct Plan {
    /// The plant's outputs are those of every model: `D = 0`.
    pub(super) same_output: bool,
    /// Rows of `N` that may differ from zero.
    pub(super) rows: Vec<usize>,
    /// Constants that are not zero in every mode.
    constants: Vec<usize>,
    /// Places in a mode of the models: `mu`, the factors of `kv`, of `tv`, of the constants.
    of_a_mode: Vec<usize>,
}

/// A plant.
pub(super) struct Plant<'a> {
    pub(super) places: &'a Places,
    pub(super) numbers: &'a [f64],
    /// Its place among the plans.
    pub(super) plan: usize,
    /// Fields of the models with their factors in what the noise alone makes.
    pub(super) own: Vec<(usize, f64)>,
    /// Real modes, and of each pair the upper one, see [`Mode`]; complex numbers as two.
    modes: [Vec<f64>; 2],
    /// Numbers of one of either.
    lens: [usize; 2],
    /// How many of its modes are real, and how many pairs there are.
    pub(super) counts: [usize; 2],
}

/// A mode of a plant: `lambda`, its column of `V`, its row of `V^-1 X`, the constants.
#[derive(Clone, Copy)]
pub(super) struct Mode<'a> {
    pub(super) value: (f64, f64),
    pub(super) v: &'a [f64],
    pub(super) vx: &'a [f64],
    pub(super) constants: &'a [f64],
}

impl<'a> Plant<'a> {
    /// Plant `k`; a plan that is not among `plans` joins them.
    pub(super) fn new(modal: &Modal, sides: &'a Sides, k: usize, plans: &mut Vec<Plan>) -> Self {
        let (p, numbers) = (&sides.places, sides.plant(k));
        let plan = Plan::new(modal, p, numbers);
        let (mut reals, mut pairs) = (Vec::new(), Vec::new());
        for k in 0..p.shape.np {
            let mode = &numbers[p.mode + k * p.mode_len..][..p.mode_len];
            // the parts that are kept
            let (to, step) = match mode[1] {
                0.0 => (&mut reals, 2),
                im if im > 0.0 => (&mut pairs, 1),
                _ => continue,
            };
            to.extend(mode[..p.constants].iter().step_by(step));
            for c in &plan.constants {
                to.extend(mode[p.constants + 2 * c..][..2].iter().step_by(step));
            }
        }
        let own = own(modal, p, numbers);
        let at = plans.iter().position(|p| *p == plan).unwrap_or(plans.len());
        let constants = plan.constants.len();
        if at == plans.len() {
            plans.push(plan);
        }
        let lens = [1 + 2 * p.shape.np + constants, 2 + 4 * p.shape.np + 2 * constants];
        let counts = [reals.len() / lens[0], pairs.len() / lens[1]];
        Plant { places: p, numbers, plan: at, own, modes: [reals, pairs], lens, counts }
    }

    /// Real mode `k`.
    #[inline(always)]
    pub(super) fn real(&self, k: usize) -> Mode<'_> {
        let np = self.places.shape.np;
        let x = &self.modes[0][k * self.lens[0]..][..self.lens[0]];
        let (v, rest) = x[1..].split_at(np);
        let (vx, constants) = rest.split_at(np);
        Mode { value: (x[0], 0.0), v, vx, constants }
    }

    /// The upper member of pair `k`.
    #[inline(always)]
    pub(super) fn pair(&self, k: usize) -> Mode<'_> {
        let np = self.places.shape.np;
        let x = &self.modes[1][k * self.lens[1]..][..self.lens[1]];
        let (v, rest) = x[2..].split_at(2 * np);
        let (vx, constants) = rest.split_at(2 * np);
        Mode { value: (x[0], x[1]), v, vx, constants }
    }
}

impl Plan {
    fn new(modal: &Modal, p: &Places, numbers: &[f64]) -> Self {
        let (n, np, ny) = (modal.n, p.shape.np, modal.ny);
        let row = |at: usize, r: usize| &numbers[at + r * np..][..np];
        let same_output = modal.shared_c.as_ref().is_some_and(|c| {
            (0..ny).all(|i| {
                let leading = (0..np).map(|j| if j < n { c[(i, j)] } else { 0.0 });
                row(p.cy, i).iter().zip(leading).all(|(&x, c)| x == c)
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
        let rows: Vec<usize> = (0..n).filter(|&r| !same_output || !is_zero(r)).collect();
        let constants: Vec<usize> = (0..p.constants_len())
            .filter(|c| {
                (0..np).any(|k| {
                    let at = p.mode + k * p.mode_len + p.constants + 2 * c;
                    numbers[at] != 0.0 || numbers[at + 1] != 0.0
                })
            })
            .collect();
        let f = &modal.fields;
        let mut of_a_mode = vec![0];
        of_a_mode.extend(rows.iter().map(|r| f.uz + 2 * r));
        if !same_output {
            of_a_mode.extend((0..ny).map(|i| f.ucw + 2 * i));
        }
        // the rows of U^-1, then those of U^-1 J
        of_a_mode.extend(rows.iter().chain(&constants).map(|c| f.inv + 2 * c));
        Plan { same_output, rows, constants, of_a_mode }
    }
}

/// `tr(Z M M') = tr(Z EB EB') - 2 tr((Z J)' EB D') + tr(J' Z J D D')`: the fields of the
/// models with their factors.
fn own(modal: &Modal, p: &Places, numbers: &[f64]) -> Vec<(usize, f64)> {
    let (n, rank, f) = (modal.n, modal.ny + modal.nu, &modal.fields);
    let mut own = Vec::new();
    for (at, factor, field, len) in
        [(p.ebb, 1.0, f.z, n * n), (p.ebd, -2.0, f.zj, n * rank), (p.dd, 1.0, f.jzj, rank * rank)]
    {
        for e in 0..len {
            if numbers[at + e] != 0.0 {
                own.push((field + e, factor * numbers[at + e]));
            }
        }
    }
    own
}

/// Models side by side, with what counts of them one after the other.
pub(super) struct Side<'a, T, const V: usize> {
    pub(super) modal: &'a Modal,
    /// The blocks of each lane.
    fields: [&'a [Block]; V],
    /// Place of its first model in the blocks.
    at: usize,
    /// The place of the plan that is followed.
    plan: Option<usize>,
    pub(super) numbers: Numbers<Wide<T, V>>,
}

/// The numbers of some models that count.
pub(super) struct Numbers<T> {
    /// `A`, `B`, `H` of the rows that count.
    rows: Vec<T>,
    c: Vec<T>,
    /// Real modes and pairs: `mu`, the factors of `kv`, of `tv` and of the constants.
    reals: Vec<T>,
    pairs: Vec<T>,
    /// Numbers of one of either.
    lens: [usize; 2],
}

impl<T> Default for Numbers<T> {
    fn default() -> Self {
        let none = Vec::new;
        Numbers { rows: none(), c: none(), reals: none(), pairs: none(), lens: [0; 2] }
    }
}

impl<'a, T: Real, const V: usize> Side<'a, T, V> {
    /// Call [`Side::enter`] and [`Side::follow`] before use.
    pub(super) fn new(modal: &'a Modal, numbers: Numbers<Wide<T, V>>) -> Self {
        Side { modal, fields: [&[]; V], at: 0, plan: None, numbers }
    }

    /// Goes to the models from `first` on; lanes that are not there repeat the first.
    #[inline(always)]
    pub(super) fn enter(&mut self, first: usize) {
        let total = self.modal.total();
        for v in 0..V {
            let model = first + v * T::LANES;
            let model = if model < self.modal.n_models { model } else { first };
            self.fields[v] = &self.modal.data[model / LANES * total..][..total];
        }
        self.at = first % LANES;
        self.plan = None;
    }

    /// Takes out what counts by the plan at this place.
    #[inline(always)]
    pub(super) fn follow(&mut self, place: usize, plan: &Plan) {
        if self.plan == Some(place) {
            return;
        }
        let m = self.modal;
        let (n, ny, nu, f) = (m.n, m.ny, m.nu, m.fields);
        self.numbers.rows.clear();
        for &r in &plan.rows {
            for (at, len) in [(f.a, n), (f.b, nu), (f.h, ny)] {
                for e in 0..len {
                    let x = self.field(at + r * len + e);
                    self.numbers.rows.push(x);
                }
            }
        }
        self.numbers.c.clear();
        self.numbers.reals.clear();
        self.numbers.pairs.clear();
        let outputs = if plan.same_output { 0 } else { ny };
        for e in 0..outputs * n {
            let x = self.field(f.c + e);
            self.numbers.c.push(x);
        }
        for k in 0..m.kept {
            let mode = f.mode + k * f.mode_len;
            for at in &plan.of_a_mode {
                let re = self.field(mode + at);
                if k < m.reals {
                    self.numbers.reals.push(re);
                } else {
                    let im = self.field(mode + at + 1);
                    self.numbers.pairs.extend([re, im]);
                }
            }
        }
        let each = plan.of_a_mode.len();
        self.numbers.lens = [each, 2 * each];
        self.plan = Some(place);
    }

    #[inline(always)]
    pub(super) fn field(&self, field: usize) -> Wide<T, V> {
        let mut out = [T::zero(); V];
        for v in 0..V {
            out[v] = T::load(&self.fields[v][field].0[self.at..]);
        }
        Wide(out)
    }

    /// `A`, `B`, `H` of the row of this place in the plan.
    #[inline(always)]
    pub(super) fn row(&self, place: usize) -> [&[Wide<T, V>]; 3] {
        let (n, nu, ny) = (self.modal.n, self.modal.nu, self.modal.ny);
        let (a, rest) = self.numbers.rows[place * (n + nu + ny)..][..n + nu + ny].split_at(n);
        let (b, h) = rest.split_at(nu);
        [a, b, h]
    }

    /// Row `i` of `C`.
    #[inline(always)]
    pub(super) fn row_c(&self, i: usize) -> &[Wide<T, V>] {
        &self.numbers.c[i * self.modal.n..][..self.modal.n]
    }

    /// How many modes are real in every model, and how many others are kept.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.modal.reals, self.modal.kept - self.modal.reals]
    }

    /// The numbers of mode `k` of those that are real in every model.
    #[inline(always)]
    pub(super) fn real(&self, k: usize) -> &[Wide<T, V>] {
        let len = self.numbers.lens[0];
        &self.numbers.reals[k * len..][..len]
    }

    /// The numbers of mode `k` of the others.
    #[inline(always)]
    pub(super) fn pair(&self, k: usize) -> &[Wide<T, V>] {
        let len = self.numbers.lens[1];
        &self.numbers.pairs[k * len..][..len]
    }
}
