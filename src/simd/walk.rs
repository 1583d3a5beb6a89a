//! A walk along two matrices: the inner loop of every product, without a check a step.

use std::marker::PhantomData;

/// A row-major matrix of `stride` columns.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a, T> {
    pub(crate) data: &'a [T],
    pub(crate) stride: usize,
}

/// Where `N` entries of one matrix stand for each step of a walk.
struct Side<T, const N: usize> {
    /// The first of them.
    at: *const T,
    /// From one to the next.
    apart: usize,
    /// To those of the next step.
    along: isize,
}

impl<T: Copy, const N: usize> Side<T, N> {
    /// Entries `(first + r) apart + p along`, `r < N`, for `p` in `low..high`, or from
    /// the last to the first.
    ///
    /// Panics unless `data` holds them all.
    #[inline(always)]
    #[track_caller]
    fn new(
        data: &[T],
        first: usize,
        [apart, along]: [usize; 2],
        (low, high): (usize, usize),
        down: bool,
    ) -> Self {
        if low < high {
            let last = (first + (N - 1)).checked_mul(apart).zip((high - 1).checked_mul(along));
            let held = last.and_then(|(x, y)| x.checked_add(y)).is_some_and(|e| e < data.len());
            assert!(held, "walk: a slice of {} does not hold the matrix", data.len());
        }
        let start = if down { high.wrapping_sub(1) } else { low };
        let at = data.as_ptr().wrapping_add(first * apart + start.wrapping_mul(along));
        // A slice is at most isize::MAX bytes long, and `along` within it (if there is a step).
        let along = along as isize;
        Side { at, apart, along: if down { along.wrapping_neg() } else { along } }
    }

    /// The entries of this step; goes on to the next.
    ///
    /// # Safety
    /// Fewer steps than the `high - low` of [`Side::new`] were made, and its slice lives.
    #[inline(always)]
    unsafe fn step(&mut self, out: &mut [T; N]) {
        for r in 0..N {
            // SAFETY: entry `(first + r) apart + p along` for some `p` in `low..high`; the
            // largest of these was seen to be within the slice.
            out[r] = unsafe { *self.at.wrapping_add(r * self.apart) };
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
    /// From the first `p` to the last, or from the last to the first if `DOWN`.
    ///
    /// `A(i, p)` is `a[i][p]`, or `a[p][i]` when `TA`; `B(p, j)` is `b[p][j]`, or
    /// `b[j][p]` when `TB`. Panics unless the slices hold them.
    #[inline(always)]
    #[track_caller]
    pub(crate) fn new<const TA: bool, const TB: bool, const DOWN: bool>(
        a: Rows<'a, A>,
        b: Rows<'a, B>,
        (i, j): (usize, usize),
        range: (usize, usize),
    ) -> Self {
        let of_a = if TA { [1, a.stride] } else { [a.stride, 1] };
        let of_b = if TB { [b.stride, 1] } else { [1, b.stride] };
        Walk {
            a: Side::new(a.data, i, of_a, range, DOWN),
            b: Side::new(b.data, j, of_b, range, DOWN),
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
