//! A step of discrete filters for eight trials, models one after the other.
//!
//! ```text
//! x <- A x + B u,   r = y - C x,   e = |W r|^2,   l = log_norm - e / 2,   x <- x + K r
//! ```
//! Each model is a chain of some five multiply-adds a state that wait for each
//! other; models do not, and with constant sizes the processor works on four or
//! five at a time. What then limits the step are the multiply-adds, each of which
//! takes its coefficient from the first cache. With sizes of run time the counting
//! took longer than the arithmetic.

use crate::bank::{Filter, Repeat, correct, filter_step, innovate, propagate, whiten};
use crate::real::{LaneKernel, Real};

/// One step of all models.
pub(super) struct Step<'a, T> {
    /// `A B C`, whitener and bias of each model.
    pub(super) fixed: &'a [f64],
    /// `K W log_norm` of each model in this step.
    pub(super) moving: &'a [f64],
    /// States, outputs.
    pub(super) sizes: [usize; 2],
    /// False if the states stay as they are before the measurement.
    pub(super) moves: bool,
    pub(super) u: &'a [T],
    pub(super) y: &'a [T],
    /// States, shape (model, state).
    pub(super) x: &'a mut [T],
    pub(super) next: &'a mut [T],
    pub(super) r: &'a mut [T],
    pub(super) nis: &'a mut [T],
    pub(super) log_lik: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Step<'_, T> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let [n, q] = self.sizes;
        if T::UNROLLS {
            match (n, q) {
                (1, 1) => return self.sized::<1, 1>(),
                (2, 1) => return self.sized::<2, 1>(),
                (3, 1) => return self.sized::<3, 1>(),
                (4, 1) => return self.sized::<4, 1>(),
                (5, 1) => return self.sized::<5, 1>(),
                (6, 1) => return self.sized::<6, 1>(),
                (2, 2) => return self.sized::<2, 2>(),
                (3, 2) => return self.sized::<3, 2>(),
                (4, 2) => return self.sized::<4, 2>(),
                (5, 2) => return self.sized::<5, 2>(),
                (6, 2) => return self.sized::<6, 2>(),
                _ => {}
            }
        }
        self.any(n, q);
    }
}

impl<T: Real> Step<'_, T> {
    /// The same with sizes that the compiler sees.
    #[inline(always)]
    fn sized<const N: usize, const Q: usize>(self) {
        let sizes = [N, self.u.len(), Q];
        let u = self.u.as_chunks::<1>().0;
        let mut y = [[T::zero(); 1]; Q];
        y.copy_from_slice(self.y.as_chunks::<1>().0);
        let states = self.x.as_chunks_mut::<1>().0.as_chunks_mut::<N>().0;
        for i in 0..self.nis.len() {
            let filter = Filter::of(i, self.fixed, self.moving, sizes);
            // in registers
            let mut x = states[i];
            let [energy] = filter_step(filter, self.moves, u, &y, &mut x);
            states[i] = x;
            self.nis[i] = energy;
            self.log_lik[i] = T::splat(0.5).neg_mul_add(energy, T::splat(filter.log_norm));
        }
    }

    /// The same for sizes of run time.
    #[inline(always)]
    fn any(self, n: usize, q: usize) {
        let Step { fixed, moving, moves, u, y, x, next, r, nis, log_lik, .. } = self;
        for i in 0..nis.len() {
            let f = Filter::of(i, fixed, moving, [n, u.len(), q]);
            let x = &mut x[i * n..][..n];
            if moves {
                propagate(Repeat(f.a), Repeat(f.b), u, x, next);
            }
            innovate(Repeat(f.c), x, y, r);
            let energy = whiten(Repeat(f.w), r);
            nis[i] = energy;
            log_lik[i] = T::splat(0.5).neg_mul_add(energy, T::splat(f.log_norm));
            correct(Repeat(f.k), r, x);
        }
    }
}
