//! Matrices of registers, read and written in tiles without a check an entry: the inner
//! loop of every product.

use std::marker::PhantomData;

/// A matrix of `rows` x `cols` entries, entry `(i, j)` at `i down + j right` of a slice.
pub(crate) struct Grid<'a, E> {
    at: *const E,
    rows: usize,
    cols: usize,
    down: usize,
    right: usize,
    alive: PhantomData<&'a [E]>,
}

impl<E> Clone for Grid<'_, E> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<E> Copy for Grid<'_, E> {}

/// Panics unless a slice of `len` holds all entries.
#[inline(always)]
#[track_caller]
fn check(len: usize, [rows, cols]: [usize; 2], [down, right]: [usize; 2]) {
    if rows > 0 && cols > 0 {
        let last = (rows - 1).checked_mul(down).zip((cols - 1).checked_mul(right));
        let held = last.and_then(|(x, y)| x.checked_add(y)).is_some_and(|e| e < len);
        assert!(held, "grid: a slice of {len} does not hold {rows}x{cols} entries");
    }
}

impl<'a, E: Copy> Grid<'a, E> {
    /// The matrix of `size` rows and columns with `steps` down and to the right from entry
    /// to entry. Panics unless `data` holds all entries.
    #[inline(always)]
    #[track_caller]
    pub(crate) fn new(data: &'a [E], size: [usize; 2], steps: [usize; 2]) -> Self {
        check(data.len(), size, steps);
        let ([rows, cols], [down, right]) = (size, steps);
        Grid { at: data.as_ptr(), rows, cols, down, right, alive: PhantomData }
    }

    /// The transpose.
    #[inline(always)]
    pub(crate) fn t(self) -> Self {
        let Grid { at, rows, cols, down, right, alive } = self;
        Grid { at, rows: cols, cols: rows, down: right, right: down, alive }
    }

    /// Entry `(i, j)`; panics outside.
    #[inline(always)]
    #[track_caller]
    pub(crate) fn at(self, i: usize, j: usize) -> E {
        assert!(i < self.rows && j < self.cols, "grid: entry outside");
        // SAFETY: the slice holds every entry, see `new`, and lives.
        unsafe { *self.at.add(i * self.down + j * self.right) }
    }

    /// Entries `i..i + R`, `j..j + C`; panics unless they are inside.
    #[inline(always)]
    #[track_caller]
    pub(crate) fn load<const R: usize, const C: usize>(self, i: usize, j: usize) -> [[E; C]; R] {
        inside::<R>(i, self.rows);
        inside::<C>(j, self.cols);
        let (at, down, right) = (self.at, self.down, self.right);
        // SAFETY: entries within the grid, which the slice holds, see `new`.
        unsafe {
            let at = at.add(i * down + j * right);
            std::array::from_fn(|r| std::array::from_fn(|s| *at.add(r * down + s * right)))
        }
    }
}

/// Panics unless `first..first + N` are among `count`.
#[inline(always)]
#[track_caller]
fn inside<const N: usize>(first: usize, count: usize) {
    const { assert!(N > 0) };
    assert!(count.checked_sub(N).is_some_and(|last| first <= last), "grid: tile outside");
}

/// A [`Grid`] to write.
pub(crate) struct GridMut<'a, E> {
    at: *mut E,
    rows: usize,
    cols: usize,
    down: usize,
    right: usize,
    alive: PhantomData<&'a mut [E]>,
}

impl<'a, E: Copy> GridMut<'a, E> {
    /// As [`Grid::new`].
    #[inline(always)]
    #[track_caller]
    pub(crate) fn new(data: &'a mut [E], size: [usize; 2], steps: [usize; 2]) -> Self {
        check(data.len(), size, steps);
        let ([rows, cols], [down, right]) = (size, steps);
        GridMut { at: data.as_mut_ptr(), rows, cols, down, right, alive: PhantomData }
    }

    /// To read.
    #[inline(always)]
    pub(crate) fn view(&self) -> Grid<'_, E> {
        let &GridMut { at, rows, cols, down, right, .. } = self;
        Grid { at, rows, cols, down, right, alive: PhantomData }
    }

    /// Writes entries `i..i + R`, `j..j + C`; panics unless they are inside.
    #[inline(always)]
    #[track_caller]
    pub(crate) fn store<const R: usize, const C: usize>(
        &mut self,
        tile: &[[E; C]; R],
        (i, j): (usize, usize),
    ) {
        inside::<R>(i, self.rows);
        inside::<C>(j, self.cols);
        // SAFETY: entries within the grid, which the slice holds, see `new`; it is borrowed
        // for as long as `self` lives, to write.
        unsafe {
            let at = self.at.add(i * self.down + j * self.right);
            for r in 0..R {
                for s in 0..C {
                    *at.add(r * self.down + s * self.right) = tile[r][s];
                }
            }
        }
    }
}

/// `N` neighbouring rows of a matrix, walked along its columns.
struct Side<E, const N: usize> {
    /// The entry of the first row.
    at: *const E,
    /// From row to row.
    down: usize,
    /// To the next column of the walk.
    along: isize,
}

impl<E: Copy, const N: usize> Side<E, N> {
    /// Rows `first..first + N`, columns from `low` or, falling, from `high - 1`; panics
    /// unless rows and columns are inside.
    #[inline(always)]
    #[track_caller]
    fn new(m: Grid<'_, E>, first: usize, (low, high): (usize, usize), falling: bool) -> Self {
        inside::<N>(first, m.rows);
        assert!(high <= m.cols, "grid: walk outside");
        let start = if falling { high.wrapping_sub(1) } else { low };
        let at =
            m.at.wrapping_add(first.wrapping_mul(m.down)).wrapping_add(start.wrapping_mul(m.right));
        // A slice is at most isize::MAX bytes long, and a step within it (if there is one).
        let along = m.right as isize;
        Side { at, down: m.down, along: if falling { along.wrapping_neg() } else { along } }
    }

    /// The entries of this column; goes on to the next.
    ///
    /// # Safety
    /// Fewer steps than the `high - low` of [`Side::new`] were made, and its slice lives.
    #[inline(always)]
    unsafe fn step(&mut self, out: &mut [E; N]) {
        for r in 0..N {
            // SAFETY: row `first + r` and a column of `low..high`: an entry of the grid.
            out[r] = unsafe { *self.at.wrapping_add(r * self.down) };
        }
        // Wraps only after the last step, when it is no longer read.
        self.at = self.at.wrapping_offset(self.along);
    }
}

/// Steps through `A(i + r, p)`, `r < R`, and `B(p, j + s)`, `s < C`, for `p` in a range.
pub(crate) struct Walk<'a, A, B, const R: usize, const C: usize> {
    a: Side<A, R>,
    b: Side<B, C>,
    left: usize,
    alive: PhantomData<(&'a [A], &'a [B])>,
}

impl<'a, A: Copy, B: Copy, const R: usize, const C: usize> Walk<'a, A, B, R, C> {
    /// From the first `p` to the last, or from the last to the first if `FALLING`.
    /// Panics unless the entries are inside.
    #[inline(always)]
    #[track_caller]
    pub(crate) fn new<const FALLING: bool>(
        a: Grid<'a, A>,
        b: Grid<'a, B>,
        (i, j): (usize, usize),
        range: (usize, usize),
    ) -> Self {
        Walk {
            a: Side::new(a, i, range, FALLING),
            b: Side::new(b.t(), j, range, FALLING),
            left: range.1.saturating_sub(range.0),
            alive: PhantomData,
        }
    }

    /// The entries of the next `p`; false after the last.
    #[inline(always)]
    pub(crate) fn step(&mut self, a: &mut [A; R], b: &mut [B; C]) -> bool {
        if self.left == 0 {
            return false;
        }
        self.left -= 1;
        // SAFETY: `left` counts the steps of the range that both sides were made for, and
        // `alive` holds their slices.
        unsafe {
            self.a.step(a);
            self.b.step(b);
        }
        true
    }
}
