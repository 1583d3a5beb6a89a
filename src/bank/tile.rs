//! Some steps of all discrete filters of a bank, models inside time.
//!
//! ```text
//! x <- A x + B u,   r = y - C x,   l <- l + log_norm - |W r|^2 / 2,   x <- x + K r
//! ```
//! Each model is a chain of some five multiply-adds a state that wait for each other;
//! models do not, and with constant sizes the processor works on four or five at a
//! time. What then limits the step are the multiply-adds: the states of a model stay in
//! registers for a step, and each coefficient is broadcast once for `V` vectors of
//! records or trials. Sizes that have no kernel of their own sum four rows side by side
//! ([`wide_step`]): more loads and stores, which with seven states and more take less time
//! than the arithmetic.

use super::filter::{Filter, SizedFilter, by_size, filter_step};
use super::schedule::Schedule;
use super::wide::wide_step;
use crate::real::{LaneKernel, Real};

/// Some steps; run by `T::outline`.
pub(crate) struct Tile<'a, T, const V: usize> {
    /// With numbers that are fixed, see [`Schedule::of_all`].
    pub(crate) schedule: &'a Schedule,
    /// The first step, from 1.
    pub(crate) k: u64,
    /// The states stay as they are before the measurement; one step then.
    pub(crate) still: bool,
    /// Shape (step, input, vector), or nothing.
    pub(crate) u: &'a [T],
    /// Shape (step, output, vector).
    pub(crate) y: &'a [T],
    /// Shape (model, state, vector).
    pub(crate) x: &'a mut [T],
    /// What log-likelihoods are added to, shape (model, vector).
    pub(crate) total: &'a mut [T],
    /// `|W r|^2` of the last step, shape (model, vector), or nothing.
    pub(crate) nis: &'a mut [T],
    pub(crate) scratch: &'a mut Vec<T>,
}

impl<T: Real, const V: usize> LaneKernel<T> for Tile<'_, T, V> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        if const { T::UNROLLS } && !self.still {
            let (n, q) = (self.schedule.n, self.schedule.q);
            // eight lanes of `TILE` 2 are two registers already, and there are sixteen
            if const { V == 4 || V == 1 } {
                by_size!(self, n, q, (1, 1), (2, 1), (3, 1), (2, 2), (3, 2));
            }
            if const { V == 2 || V == 1 } {
                by_size!(self, n, q, (4, 1), (5, 1), (6, 1), (4, 2), (5, 2), (6, 2));
            }
        }
        self.any();
    }
}

impl<T: Real, const V: usize> Tile<'_, T, V> {
    #[inline(always)]
    fn sized<const N: usize, const Q: usize, const AC: usize, const KW: usize>(self) {
        // two branches that never go the other way cost a tenth of a small step
        if self.u.is_empty() && self.nis.is_empty() {
            self.steps::<N, Q, AC, KW, true>();
        } else {
            self.steps::<N, Q, AC, KW, false>();
        }
    }

    /// `PLAIN` without commands, and if nobody asks for the last `|W r|^2`.
    #[inline(always)]
    fn steps<
        const N: usize,
        const Q: usize,
        const AC: usize,
        const KW: usize,
        const PLAIN: bool,
    >(
        self,
    ) {
        let steps = self.y.as_chunks::<V>().0.as_chunks::<Q>().0;
        let commands = self.u.as_chunks::<V>().0;
        let m = commands.len() / steps.len().max(1);
        let states = self.x.as_chunks_mut::<V>().0.as_chunks_mut::<N>().0;
        let totals = self.total.as_chunks_mut::<V>().0;
        let squares = self.nis.as_chunks_mut::<V>().0;
        let each = self.schedule.fixed_numbers();
        for (s, y) in steps.iter().enumerate() {
            let place = self.schedule.place(self.k + s as u64);
            let Some([fixed, moving]) = self.schedule.of_all(place) else {
                return;
            };
            let u = if PLAIN { &[] } else { &commands[s * m..][..m] };
            let own = moving.as_chunks::<KW>().0;
            // one check for all models
            let count = totals.len().min(states.len()).min(own.len());
            for i in 0..count {
                let filter = SizedFilter::<AC, KW>::of(
                    &fixed[i * each..],
                    &own[i],
                    if PLAIN { 0 } else { N * m },
                );
                // in registers
                let mut x = states[i];
                let square = filter_step(filter, u, y, &mut x);
                states[i] = x;
                let log_norm = T::splat(filter.log_norm());
                for v in 0..V {
                    let more = T::splat(0.5).neg_mul_add(square[v], log_norm);
                    totals[i][v] = totals[i][v] + more;
                }
                if !PLAIN && i < squares.len() {
                    squares[i] = square;
                }
            }
        }
    }

    /// The same for sizes of run time.
    #[inline(always)]
    fn any(self) {
        let Schedule { n, m, q, .. } = *self.schedule;
        let measured = self.y.as_chunks::<V>().0;
        let commands = self.u.as_chunks::<V>().0;
        let states = self.x.as_chunks_mut::<V>().0;
        let totals = self.total.as_chunks_mut::<V>().0;
        let squares = self.nis.as_chunks_mut::<V>().0;
        let steps = measured.len() / q;
        let inputs = commands.len() / steps.max(1);
        self.scratch.resize((n + q) * V, T::zero());
        let (next, r) = self.scratch.as_chunks_mut::<V>().0.split_at_mut(n);
        for s in 0..steps {
            let place = self.schedule.place(self.k + s as u64);
            let Some([fixed, moving]) = self.schedule.of_all(place) else {
                return;
            };
            let (u, y) = (&commands[s * inputs..][..inputs], &measured[s * q..][..q]);
            for i in 0..totals.len() {
                let f = Filter::of(i, fixed, moving, [n, m, q]);
                let x = &mut states[i * n..][..n];
                let square = wide_step(f, self.still, u, y, x, next, r);
                let log_norm = T::splat(f.log_norm);
                for v in 0..V {
                    let more = T::splat(0.5).neg_mul_add(square[v], log_norm);
                    totals[i][v] = totals[i][v] + more;
                }
                if i < squares.len() {
                    squares[i] = square;
                }
            }
        }
    }
}
