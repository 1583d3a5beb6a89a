//! Loop blocks of one size, eight to a lane block.

use faer::Mat;

use crate::model::{LoopBlock, Time};
use crate::real::Real;
use crate::simd::{self, Block, LANES};

/// Loop blocks of one size (without exact delays), entry by entry in lanes.
pub(crate) struct LoopBatch {
    time: Time,
    pub(crate) shape: Shape,
    len: usize,
    data: Vec<Block>,
}

/// Sizes of the matrices of a block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Shape {
    pub(crate) np: usize,
    pub(crate) nw: usize,
    pub(crate) ny: usize,
    pub(crate) nu: usize,
}

impl Shape {
    pub(crate) fn of(block: &LoopBlock) -> Self {
        Self { np: block.np(), nw: block.nw(), ny: block.Cy.nrows(), nu: block.Cu.nrows() }
    }

    /// Rows and columns of `A, B, C_y, D_y, C_u, D_u`, in the order of storage.
    fn sizes(self) -> [[usize; 2]; 6] {
        let Shape { np, nw, ny, nu } = self;
        [[np, np], [np, nw], [ny, np], [ny, nw], [nu, np], [nu, nw]]
    }

    fn total(self) -> usize {
        self.sizes().iter().map(|[r, c]| r * c).sum()
    }
}

/// The matrices of one lane block, row by row.
pub(crate) struct Matrices<'a, T> {
    pub(crate) a: &'a [T],
    pub(crate) b: &'a [T],
    pub(crate) cy: &'a [T],
    pub(crate) dy: &'a [T],
    pub(crate) cu: &'a [T],
    pub(crate) du: &'a [T],
}

impl LoopBatch {
    pub(crate) fn new() -> Self {
        let (len, shape) = Default::default();
        Self { time: Time::Continuous, shape, len, data: Vec::new() }
    }

    /// Takes out every block.
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Number of blocks.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Adds a block; all have one size. The first of a group fills its lanes,
    /// so that lanes never filled hold a valid block.
    pub(crate) fn push(&mut self, block: &LoopBlock) {
        if self.len == 0 {
            self.shape = Shape::of(block);
            self.time = block.time;
        }
        debug_assert_eq!(self.shape, Shape::of(block), "blocks of one size");
        let total = self.shape.total();
        let (group, lane) = (self.len / LANES, self.len % LANES);
        if self.data.len() < (group + 1) * total {
            self.data.resize((group + 1) * total, Block::default());
        }
        let mut slots = self.data[group * total..(group + 1) * total].iter_mut();
        for m in [&block.A, &block.B, &block.Cy, &block.Dy, &block.Cu, &block.Du] {
            for i in 0..m.nrows() {
                for (j, slot) in (0..m.ncols()).zip(&mut slots) {
                    if lane == 0 {
                        slot.0 = [m[(i, j)]; LANES];
                    } else {
                        slot.0[lane] = m[(i, j)];
                    }
                }
            }
        }
        self.len += 1;
    }

    /// Block `k` as matrices.
    pub(crate) fn block(&self, k: usize) -> LoopBlock {
        let total = self.shape.total();
        let mut slots = self.data[k / LANES * total..].iter();
        let mut next = |[rows, cols]: [usize; 2]| {
            let mut m = Mat::zeros(rows, cols);
            for i in 0..rows {
                for (j, slot) in (0..cols).zip(&mut slots) {
                    m[(i, j)] = slot.0[k % LANES];
                }
            }
            m
        };
        let [a, b, cy, dy, cu, du] = self.shape.sizes();
        LoopBlock {
            time: self.time,
            A: next(a),
            B: next(b),
            Cy: next(cy),
            Dy: next(dy),
            Cu: next(cu),
            Du: next(du),
            delayed: None,
        }
    }

    /// Lane block `g`; `copy` serves where the storage cannot be seen as lanes.
    #[inline(always)]
    pub(crate) fn group<'a, T: Real>(&'a self, g: usize, copy: &'a mut Vec<T>) -> Matrices<'a, T> {
        let total = self.shape.total();
        let first = g * T::LANES;
        let blocks = &self.data[first / LANES * total..][..total];
        let lanes: &[T] = match T::view(blocks) {
            Some(lanes) => lanes,
            None => {
                copy.resize(total, T::zero());
                simd::load_group(blocks, first % LANES / T::LANES, copy);
                copy
            }
        };
        let [a, b, cy, dy, cu, _] = self.shape.sizes().map(|[r, c]| r * c);
        let (a, rest) = lanes.split_at(a);
        let (b, rest) = rest.split_at(b);
        let (cy, rest) = rest.split_at(cy);
        let (dy, rest) = rest.split_at(dy);
        let (cu, du) = rest.split_at(cu);
        Matrices { a, b, cy, dy, cu, du }
    }
}
