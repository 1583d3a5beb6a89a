//! What plants and models bring to their sums, and which of it counts.

use super::super::Modal;
use super::super::plants::{Places, Sides};
use crate::real::Real;
use crate::simd::Block;

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
    pub(super) plan: Plan,
    /// Fields of the models with their factors in what the noise alone makes.
    pub(super) own: Vec<(usize, f64)>,
    /// Real modes, and of each pair the upper one, see [`Mode`]; complex numbers as two.
    reals: Vec<f64>,
    pairs: Vec<f64>,
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
    pub(super) fn new(modal: &Modal, sides: &'a Sides, k: usize) -> Self {
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
        Plant { places: p, numbers, plan, own, reals, pairs }
    }

    /// Its real modes.
    pub(super) fn reals(&self) -> impl Iterator<Item = Mode<'_>> {
        let np = self.places.shape.np;
        self.reals.chunks_exact(1 + 2 * np + self.plan.constants.len()).map(move |x| {
            let (v, rest) = x[1..].split_at(np);
            let (vx, constants) = rest.split_at(np);
            Mode { value: (x[0], 0.0), v, vx, constants }
        })
    }

    /// The upper members of its pairs.
    pub(super) fn pairs(&self) -> impl Iterator<Item = Mode<'_>> {
        let np = self.places.shape.np;
        self.pairs.chunks_exact(2 + 4 * np + 2 * self.plan.constants.len()).map(move |x| {
            let (v, rest) = x[2..].split_at(2 * np);
            let (vx, constants) = rest.split_at(2 * np);
            Mode { value: (x[0], x[1]), v, vx, constants }
        })
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

/// A lane of models, with what counts of it one after the other.
pub(super) struct Side<'a, T> {
    pub(super) modal: &'a Modal,
    fields: &'a [Block],
    /// Place of the first model in the blocks.
    at: usize,
    plan: Option<&'a Plan>,
    pub(super) numbers: Numbers<T>,
}

/// The numbers of a lane of models that count.
pub(super) struct Numbers<T> {
    /// `A`, `B`, `H` of the rows that count.
    rows: Vec<T>,
    c: Vec<T>,
    /// Real modes and pairs: `mu`, the factors of `kv`, of `tv` and of the constants.
    reals: Vec<T>,
    pairs: Vec<T>,
}

impl<T> Default for Numbers<T> {
    fn default() -> Self {
        let none = Vec::new;
        Numbers { rows: none(), c: none(), reals: none(), pairs: none() }
    }
}

impl<'a, T: Real> Side<'a, T> {
    /// Call [`Side::enter`] and [`Side::follow`] before use.
    pub(super) fn new(modal: &'a Modal, numbers: Numbers<T>) -> Self {
        Side { modal, fields: &[], at: 0, plan: None, numbers }
    }

    /// Goes to the lane of models from `first` on.
    #[inline(always)]
    pub(super) fn enter(&mut self, first: usize) {
        let total = self.modal.total();
        self.fields = &self.modal.data[first / crate::simd::LANES * total..][..total];
        self.at = first % crate::simd::LANES;
        self.plan = None;
    }

    /// Takes out what counts by `plan`.
    #[inline(always)]
    pub(super) fn follow(&mut self, plan: &'a Plan) {
        if self.plan == Some(plan) {
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
        self.plan = Some(plan);
    }

    #[inline(always)]
    pub(super) fn field(&self, field: usize) -> T {
        T::load(&self.fields[field].0[self.at..])
    }

    /// `A`, `B`, `H` of the row of this place in the plan.
    #[inline(always)]
    pub(super) fn row(&self, place: usize) -> (&[T], &[T], &[T]) {
        let (n, nu, ny) = (self.modal.n, self.modal.nu, self.modal.ny);
        let (a, rest) = self.numbers.rows[place * (n + nu + ny)..][..n + nu + ny].split_at(n);
        let (b, h) = rest.split_at(nu);
        (a, b, h)
    }

    /// Row `i` of `C`.
    #[inline(always)]
    pub(super) fn row_c(&self, i: usize) -> &[T] {
        &self.numbers.c[i * self.modal.n..][..self.modal.n]
    }

    /// The modes that are real in every model.
    #[inline(always)]
    pub(super) fn reals(&self) -> std::slice::ChunksExact<'_, T> {
        each(&self.numbers.reals, self.modal.reals)
    }

    /// The others.
    #[inline(always)]
    pub(super) fn pairs(&self) -> std::slice::ChunksExact<'_, T> {
        each(&self.numbers.pairs, self.modal.kept - self.modal.reals)
    }
}

/// The slots of `count` modes.
#[inline(always)]
fn each<T>(numbers: &[T], count: usize) -> std::slice::ChunksExact<'_, T> {
    numbers.chunks_exact((numbers.len() / count.max(1)).max(1))
}
