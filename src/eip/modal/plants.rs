//! What the plants of a batch bring to their pairs, plants in lanes.

use super::Modal;
use super::spectrum::Spectrum;
use crate::eip::batch::{LoopBatch, Matrices, Shape};
use crate::eip::doubling::{Doubling, Plants};
use crate::model::Time;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, LANES};
use crate::small::{Cx, Dyn, mul_nt, sym_mul_nt};

/// Places of a plant's numbers: matrices row-major, then the modes, complex numbers as
/// two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Places {
    pub(super) shape: Shape,
    /// States of the models.
    pub(super) n: usize,
    /// Leading rows of `A`, `C_y`, `C_u`, `X`.
    pub(super) a: usize,
    pub(super) cy: usize,
    pub(super) cu: usize,
    pub(super) x: usize,
    /// `E B (E B)'`, `E B D'`, `D D'` with `D = [D_y; D_u]`.
    pub(super) ebb: usize,
    pub(super) ebd: usize,
    pub(super) dd: usize,
    /// Of each mode `lambda`, the column of `V`, the row of `V^-1 X` (discrete time: of
    /// `V^-1 A X`), the row of `V^-1 B [(E B)', -D']`.
    pub(super) mode: usize,
    pub(super) v: usize,
    pub(super) vx: usize,
    pub(super) constants: usize,
    pub(super) mode_len: usize,
    /// Numbers of a plant.
    pub(super) total: usize,
}

impl Places {
    pub(super) fn new(shape: Shape, n: usize) -> Self {
        let Shape { np, ny, nu, .. } = shape;
        let rank = ny + nu;
        let mut next = 0;
        let mut take = |len: usize| {
            let at = next;
            next += len;
            at
        };
        let (a, cy, cu, x) = (take(n * np), take(ny * np), take(nu * np), take(np * np));
        let (ebb, ebd, dd) = (take(n * n), take(n * rank), take(rank * rank));
        let mode = next;
        let (v, vx, constants) = (2, 2 + 2 * np, 2 + 4 * np);
        let mode_len = constants + 2 * (n + rank);
        let total = mode + np * mode_len;
        Places { shape, n, a, cy, cu, x, ebb, ebd, dd, mode, v, vx, constants, mode_len, total }
    }

    /// Constants of a mode.
    pub(super) fn constants_len(&self) -> usize {
        self.n + self.shape.ny + self.shape.nu
    }
}

/// How the energies of a plant are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// From its modes.
    Modes,
    /// Its eigenvectors are ill-conditioned.
    Doubling,
    /// It was not shown to be stable.
    Nothing,
}

/// Plants that are prepared together and meet a lane of models together, which is read
/// from memory once for them.
pub(super) const TOGETHER: usize = 2 * LANES;

/// Up to [`TOGETHER`] plants, one after the other.
pub(super) struct Sides {
    pub(super) places: Places,
    pub(super) ways: Vec<Way>,
    /// `places.total` numbers each.
    pub(super) data: Vec<f64>,
}

impl Sides {
    /// Numbers of plant `k`.
    pub(super) fn plant(&self, k: usize) -> &[f64] {
        &self.data[k * self.places.total..][..self.places.total]
    }
}

/// Fills [`Sides`] with up to [`TOGETHER`] plants of a batch, from `first` on.
pub(super) struct Fill<'a> {
    pub(super) modal: &'a Modal,
    pub(super) doubling: &'a Doubling,
    pub(super) batch: &'a LoopBatch,
    pub(super) first: usize,
    pub(super) sides: &'a mut Sides,
}

impl Kernel for Fill<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Fill { modal, doubling, batch, first, sides } = self;
        let places = sides.places;
        let Shape { np, nw, .. } = places.shape;
        let tall = places.constants_len();
        let mut work = modal
            .spare
            .take(|work: &Work<T>| work.places == places, || Work::new(doubling.time, places));
        let Work { plants, spectrum, numbers, stacked, constants, squares, copy, .. } = &mut *work;
        sides.ways.clear();
        sides.data.clear();
        let last = batch.len().min(first + TOGETHER);
        for g in first / T::LANES..last.div_ceil(T::LANES) {
            let block = batch.group(g, copy);
            plants.solve(doubling, &block);
            let stable = plants.factor.stable();
            let good = spectrum.set(block.a, &modal.start);
            keep_matrices(&places, &block, &plants.x, numbers);
            stack(&places, &block, stacked);
            mul_nt(Dyn(np), Dyn(nw), Dyn(tall), block.b, stacked, constants);
            sym_mul_nt(Dyn(tall), Dyn(nw), stacked, stacked, squares);
            keep_squares(&places, squares, numbers);
            for k in 0..np {
                keep_mode(modal, &places, spectrum, k, &plants.x, constants, numbers);
            }
            let count = T::LANES.min(last - g * T::LANES);
            for l in 0..count {
                sides.ways.push(if !stable.lane(l) {
                    Way::Nothing
                } else if good.lane(l) {
                    Way::Modes
                } else {
                    Way::Doubling
                });
            }
            let from = sides.data.len();
            sides.data.resize(from + count * places.total, 0.0);
            let mut lanes = [0.0; LANES];
            for (e, x) in numbers.iter().enumerate() {
                x.store(&mut lanes);
                for l in 0..count {
                    sides.data[from + l * places.total + e] = lanes[l];
                }
            }
        }
        modal.spare.put(work);
    }
}

/// Buffers of [`Fill`].
struct Work<T: Real> {
    places: Places,
    plants: Plants<T>,
    spectrum: Spectrum<T>,
    numbers: Vec<T>,
    /// `[E B; D]` and `B [E B; D]'`.
    stacked: Vec<T>,
    constants: Vec<T>,
    squares: Vec<T>,
    copy: Vec<T>,
}

impl<T: Real> Work<T> {
    fn new(time: Time, places: Places) -> Self {
        let Shape { np, nw, .. } = places.shape;
        let (tall, zeros) = (places.constants_len(), |len| vec![T::zero(); len]);
        Work {
            places,
            plants: Plants::new(time, places.shape),
            spectrum: Spectrum::new(np),
            numbers: zeros(places.total),
            stacked: zeros(tall * nw),
            constants: zeros(np * tall),
            squares: zeros(tall * tall),
            copy: Vec::new(),
        }
    }
}

#[inline(always)]
fn keep_matrices<T: Real>(p: &Places, block: &Matrices<'_, T>, x: &[T], numbers: &mut [T]) {
    let np = p.shape.np;
    for (at, m) in [(p.a, &block.a[..p.n * np]), (p.cy, block.cy), (p.cu, block.cu), (p.x, x)] {
        numbers[at..][..m.len()].copy_from_slice(m);
    }
}

/// `[E B; D_y; D_u]`.
#[inline(always)]
fn stack<T: Real>(p: &Places, block: &Matrices<'_, T>, out: &mut [T]) {
    let leading = &block.b[..p.n * p.shape.nw];
    let (first, rest) = out.split_at_mut(leading.len());
    let (second, third) = rest.split_at_mut(block.dy.len());
    first.copy_from_slice(leading);
    second.copy_from_slice(block.dy);
    third.copy_from_slice(block.du);
}

/// The blocks of `[E B; D] [E B; D]'`.
#[inline(always)]
fn keep_squares<T: Real>(p: &Places, squares: &[T], numbers: &mut [T]) {
    let (n, tall) = (p.n, p.constants_len());
    let rank = tall - n;
    for i in 0..tall {
        for j in 0..tall {
            let x = squares[i * tall + j];
            if i < n && j < n {
                numbers[p.ebb + i * n + j] = x;
            } else if i < n {
                numbers[p.ebd + i * rank + j - n] = x;
            } else if j >= n {
                numbers[p.dd + (i - n) * rank + j - n] = x;
            }
        }
    }
}

#[inline(always)]
fn keep_mode<T: Real>(
    modal: &Modal,
    p: &Places,
    spectrum: &Spectrum<T>,
    k: usize,
    x: &[T],
    constants: &[T],
    numbers: &mut [T],
) {
    let (np, tall) = (p.shape.np, p.constants_len());
    let numbers = &mut numbers[p.mode + k * p.mode_len..][..p.mode_len];
    let value = spectrum.values[k];
    let (right, left) = (&spectrum.right[k * np..][..np], &spectrum.left[k * np..][..np]);
    (numbers[0], numbers[1]) = (value.re, value.im);
    for i in 0..np {
        (numbers[p.v + 2 * i], numbers[p.v + 2 * i + 1]) = (right[i].re, right[i].im);
        let mut vx = row_times(left, x, np, i);
        if !modal.continuous {
            vx = vx * value;
        }
        (numbers[p.vx + 2 * i], numbers[p.vx + 2 * i + 1]) = (vx.re, vx.im);
    }
    for i in 0..tall {
        let c = row_times(left, constants, tall, i);
        let c = if i < p.n { c } else { -c };
        (numbers[p.constants + 2 * i], numbers[p.constants + 2 * i + 1]) = (c.re, c.im);
    }
}

/// `sum_i row_i m_i,col`, `m` with `cols` columns.
#[inline(always)]
fn row_times<T: Real>(row: &[Cx<T>], m: &[T], cols: usize, col: usize) -> Cx<T> {
    let mut sum = Cx::zero();
    for (i, x) in row.iter().enumerate() {
        let m = m[i * cols + col];
        sum = Cx::new(x.re.mul_add(m, sum.re), x.im.mul_add(m, sum.im));
    }
    sum
}
