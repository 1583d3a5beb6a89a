//! Structure-of-arrays storage: many matrices of one size, eight to a block.

use crate::error::{Error, Result};
use crate::real::Real;
use bytemuck::{Pod, Zeroable};

/// Numbers in a block: one cache line.
pub const LANES: usize = 8;

/// Eight `f64` on a cache line: the same entry of eight consecutive items.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Block(pub [f64; LANES]);

/// How many `T` a block holds: one lane, or eight scalars.
#[must_use]
pub const fn groups<T: Real>() -> usize {
    LANES / T::LANES
}

/// Copies the `group`-th `T` of every block: with a lane type all eight items,
/// with `f64` item `group` of the block.
///
/// ```text
/// out[e] = blocks[e][group * T::LANES ..][.. T::LANES]
/// ```
/// A kernel that loops over `group` in `0..groups::<T>()` runs on lanes and on
/// the oracle alike. Panics unless `out.len() == blocks.len()` and
/// `group < groups::<T>()`.
#[inline(always)]
#[track_caller]
pub fn load_group<T: Real>(blocks: &[Block], group: usize, out: &mut [T]) {
    assert_eq!(out.len(), blocks.len(), "load_group: one number a block");
    for (x, block) in out.iter_mut().zip(blocks) {
        *x = T::load(&block.0[group * T::LANES..]);
    }
}

/// The inverse of [`load_group`]; other groups of the blocks keep their values.
#[inline(always)]
#[track_caller]
pub fn store_group<T: Real>(src: &[T], group: usize, blocks: &mut [Block]) {
    assert_eq!(src.len(), blocks.len(), "store_group: one number a block");
    for (x, block) in src.iter().zip(blocks) {
        x.store(&mut block.0[group * T::LANES..]);
    }
}

/// `len` matrices of `rows` x `cols`, interleaved so that each block holds one
/// entry of eight consecutive matrices.
///
/// ```text
/// item k, entry (i, j)  =  block[(k / 8) rows cols + i cols + j][k % 8]
/// ```
/// Memory starts on a cache line. If `len` is not a multiple of eight the last
/// blocks are padded with copies of the last matrix, so that padding lanes run
/// through the same arithmetic as a valid one and never meet a surprise.
///
/// # Examples
/// ```
/// use mmae::simd::Panel;
/// let p = Panel::from_fn(2, 3, 11, |k, i, j| (100 * k + 10 * i + j) as f64);
/// assert_eq!(p.get(9, 1, 2), 912.0);
/// assert_eq!(p.block(1)[1 * 3 + 2].0[9 - 8], 912.0);
/// assert_eq!(p.to_row_major()[9 * 6 + 5], 912.0);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    rows: usize,
    cols: usize,
    len: usize,
    blocks: Vec<Block>,
}

impl Panel {
    /// `len` zero matrices of `rows` x `cols`.
    #[must_use]
    pub fn new(rows: usize, cols: usize, len: usize) -> Self {
        let blocks = vec![Block::default(); len.div_ceil(LANES) * rows * cols];
        Panel { rows, cols, len, blocks }
    }

    /// Entry `(i, j)` of matrix `k` is `f(k, i, j)`.
    #[must_use]
    pub fn from_fn(
        rows: usize,
        cols: usize,
        len: usize,
        mut f: impl FnMut(usize, usize, usize) -> f64,
    ) -> Self {
        let mut panel = Panel::new(rows, cols, len);
        for k in 0..len {
            for i in 0..rows {
                for j in 0..cols {
                    panel.set(k, i, j, f(k, i, j));
                }
            }
        }
        panel.fill_padding();
        panel
    }

    /// From an array of shape `(len, rows, cols)` in C order.
    ///
    /// # Errors
    /// [`Error::Shape`] unless `data` holds `len * rows * cols` numbers.
    pub fn from_row_major(rows: usize, cols: usize, len: usize, data: &[f64]) -> Result<Self> {
        if data.len() != len * rows * cols {
            return Err(Error::Shape {
                what: "panel data".into(),
                want: [len, rows * cols],
                got: [1, data.len()],
            });
        }
        Ok(Panel::from_fn(rows, cols, len, |k, i, j| data[(k * rows + i) * cols + j]))
    }

    /// Copies the numbers of a panel of the same shape, allocating nothing; panics
    /// unless it has as many.
    #[track_caller]
    pub fn copy_from(&mut self, other: &Panel) {
        self.blocks.copy_from_slice(&other.blocks);
    }

    /// The array of shape `(len, rows, cols)` in C order.
    #[must_use]
    pub fn to_row_major(&self) -> Vec<f64> {
        let mut out = vec![0.0; self.len * self.item_len()];
        for (k, item) in out.chunks_exact_mut(self.item_len().max(1)).enumerate() {
            self.read_item(k, item);
        }
        out
    }

    /// Rows of each matrix.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Columns of each matrix.
    #[must_use]
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Number of matrices, padding not counted.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there is no matrix.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Entries of one matrix, `rows * cols`: also the blocks that eight of them
    /// take.
    #[must_use]
    pub fn item_len(&self) -> usize {
        self.rows * self.cols
    }

    /// Groups of eight matrices, the last one perhaps padded.
    #[must_use]
    pub fn n_blocks(&self) -> usize {
        self.len.div_ceil(LANES)
    }

    /// Entry `(i, j)` of matrix `k`; panics unless `k < len`, `i < rows`,
    /// `j < cols`.
    #[must_use]
    #[track_caller]
    pub fn get(&self, k: usize, i: usize, j: usize) -> f64 {
        self.blocks[self.index(k, i, j)].0[k % LANES]
    }

    /// Sets entry `(i, j)` of matrix `k`; panics as [`Panel::get`]. After
    /// changing the last matrix call [`Panel::fill_padding`].
    #[track_caller]
    pub fn set(&mut self, k: usize, i: usize, j: usize, value: f64) {
        let at = self.index(k, i, j);
        self.blocks[at].0[k % LANES] = value;
    }

    /// Copies matrix `k` to `out`, row by row; panics unless `k < len` and
    /// `out.len() == rows * cols`.
    #[track_caller]
    pub fn read_item(&self, k: usize, out: &mut [f64]) {
        assert!(k < self.len && out.len() == self.item_len(), "read_item: shape");
        for (x, block) in out.iter_mut().zip(self.block(k / LANES)) {
            *x = block.0[k % LANES];
        }
    }

    /// Sets matrix `k` from its rows; panics as [`Panel::read_item`]. After
    /// changing the last matrix call [`Panel::fill_padding`].
    #[track_caller]
    pub fn write_item(&mut self, k: usize, item: &[f64]) {
        assert!(k < self.len && item.len() == self.item_len(), "write_item: shape");
        for (x, block) in item.iter().zip(self.block_mut(k / LANES)) {
            block.0[k % LANES] = *x;
        }
    }

    /// The blocks of matrices `8 b .. 8 b + 8`, entry by entry in row order;
    /// panics unless `b < n_blocks`.
    #[must_use]
    #[track_caller]
    pub fn block(&self, b: usize) -> &[Block] {
        &self.blocks[b * self.item_len()..][..self.item_len()]
    }

    /// As [`Panel::block`], to write.
    #[track_caller]
    pub fn block_mut(&mut self, b: usize) -> &mut [Block] {
        let n = self.item_len();
        &mut self.blocks[b * n..][..n]
    }

    /// Every group of eight matrices in turn, for threads to write.
    pub fn blocks_mut(&mut self) -> impl ExactSizeIterator<Item = &mut [Block]> {
        let n = self.item_len().max(1);
        self.blocks.chunks_exact_mut(n)
    }

    /// All blocks, groups of eight matrices one after the other.
    #[must_use]
    pub fn as_blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// As [`Panel::as_blocks`], to write.
    pub fn as_blocks_mut(&mut self) -> &mut [Block] {
        &mut self.blocks
    }

    /// All numbers, padding included: a row-major matrix of
    /// `n_blocks * rows * cols` rows and 8 columns.
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        bytemuck::cast_slice(&self.blocks)
    }

    /// As [`Panel::as_slice`], to write.
    pub fn as_mut_slice(&mut self) -> &mut [f64] {
        bytemuck::cast_slice_mut(&mut self.blocks)
    }

    /// Copies the last matrix into the padding lanes.
    pub fn fill_padding(&mut self) {
        let valid = self.len % LANES;
        if valid == 0 {
            return;
        }
        let last = self.block_mut(self.len / LANES);
        for block in last {
            let value = block.0[valid - 1];
            block.0[valid..].fill(value);
        }
    }

    /// Block index of entry `(i, j)` of matrix `k`.
    #[track_caller]
    fn index(&self, k: usize, i: usize, j: usize) -> usize {
        assert!(
            k < self.len && i < self.rows && j < self.cols,
            "entry ({i}, {j}) of matrix {k} in a panel of {} matrices {}x{}",
            self.len,
            self.rows,
            self.cols
        );
        (k / LANES) * self.item_len() + i * self.cols + j
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_round_trip_and_padding() {
        for len in [0, 1, 7, 8, 9, 16, 17] {
            let data: Vec<f64> = (0..len * 6).map(|x| x as f64).collect();
            let panel = Panel::from_row_major(2, 3, len, &data).unwrap();
            assert_eq!(panel.to_row_major(), data);
            assert_eq!(panel.as_slice().as_ptr().align_offset(64), 0);
            for k in len..panel.n_blocks() * LANES {
                for (e, block) in panel.block(k / LANES).iter().enumerate() {
                    assert_eq!(block.0[k % LANES], data[(len - 1) * 6 + e]);
                }
            }
        }
    }

    #[test]
    fn groups_are_items_for_the_oracle() {
        let panel = Panel::from_fn(1, 4, 8, |k, _, j| (10 * k + j) as f64);
        let mut item = [0.0_f64; 4];
        load_group(panel.block(0), 3, &mut item);
        assert_eq!(item, [30.0, 31.0, 32.0, 33.0]);
        let mut copy = Panel::new(1, 4, 8);
        store_group(&item, 3, copy.block_mut(0));
        assert_eq!(copy.get(3, 0, 2), 32.0);
        assert_eq!(copy.get(2, 0, 2), 0.0);
    }

    #[test]
    fn wrong_amount_of_data_is_refused() {
        assert!(Panel::from_row_major(2, 2, 2, &[0.0; 7]).is_err());
    }
}
