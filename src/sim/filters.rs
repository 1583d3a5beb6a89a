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

use crate::bank::{Repeat, correct, innovate, propagate, whiten};
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
        self.models(n, q);
    }
}

impl<T: Real> Step<'_, T> {
    /// The same with sizes that the compiler sees.
    #[inline(always)]
    fn sized<const N: usize, const Q: usize>(self) {
        let (mut next, mut r) = ([T::zero(); N], [T::zero(); Q]);
        let mut y = [T::zero(); Q];
        y.copy_from_slice(self.y);
        Step { next: &mut next, r: &mut r, y: &y, ..self }.models(N, Q);
    }

    #[inline(always)]
    fn models(self, n: usize, q: usize) {
        let Step { fixed, moving, moves, u, y, x, next, r, nis, log_lik, .. } = self;
        let m = u.len();
        let (may, each) = (n * n + n * m + q * n + q * q + 1, n * q + q * q + 1);
        for i in 0..nis.len() {
            let (a, rest) = fixed[i * may..][..may].split_at(n * n);
            let (b, rest) = rest.split_at(n * m);
            let c = &rest[..q * n];
            let (k, rest) = moving[i * each..][..each].split_at(n * q);
            let (w, log_norm) = (&rest[..q * q], rest[q * q]);
            let x = &mut x[i * n..][..n];
            if moves {
                propagate(Repeat(a), Repeat(b), u, x, next);
            }
            innovate(Repeat(c), x, y, r);
            let energy = whiten(Repeat(w), r);
            nis[i] = energy;
            log_lik[i] = T::splat(0.5).neg_mul_add(energy, T::splat(log_norm));
            correct(Repeat(k), r, x);
        }
    }
}
