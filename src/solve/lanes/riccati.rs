//! One lane block of Riccati equations: scale, start, double, correct, verify.

use super::balance::shift;
use super::data::{
    Data, Kind, Reduced, reduce, reduce_indefinite, scale_states, scale_units, tilt, unscale,
};
use super::doubling::{Coefficients, Doubling, start_continuous};
use super::newton::Newton;
use super::ops::{assign, largest};
use crate::real::{Mask, Real};

/// Factors on the Cayley parameter, or on the origin of `X`, one an attempt.
const ATTEMPTS: [f64; 3] = [1.0, 0.21, 5.3];

/// What became of the equations of a block.
#[derive(Debug, Clone)]
pub(crate) struct Block<T: Real> {
    /// The equations; fill before [`Block::solve`].
    pub(crate) data: Data<T>,
    /// The solutions.
    pub(crate) x: Vec<T>,
    /// Lanes that are solved and verified.
    pub(crate) done: T::Mask,
    /// Lanes whose `R` was not positive definite.
    pub(crate) indefinite: T::Mask,
    /// Lanes of a continuous equation with an `R` that was not positive.
    pub(crate) odd_weight: T::Mask,
    /// Relative residual before the last correction.
    pub(crate) residual: T,
    /// Relative size of the last correction.
    pub(crate) correction: T,
    /// Doubling steps, all attempts together.
    pub(crate) steps: T,
    /// Verified margin.
    pub(crate) margin: T,
    /// Bound on the relative error.
    pub(crate) error_bound: T,
    /// Amplification of a relative residual.
    pub(crate) condition: T,
    reduced: Reduced<T>,
    doubling: Doubling<T>,
    newton: Newton<T>,
}

impl<T: Real> Block<T> {
    /// Computes error bounds and conditions, or leaves them out.
    #[inline(always)]
    pub(crate) fn set_bounds(&mut self, on: bool) {
        self.newton.bounds = on;
    }

    /// Room for order `n` with `m` inputs.
    #[inline(always)]
    pub(crate) fn new(n: usize, m: usize) -> Self {
        Block {
            data: Data::new(n, m),
            x: vec![T::zero(); n * n],
            done: T::Mask::splat(false),
            indefinite: T::Mask::splat(false),
            odd_weight: T::Mask::splat(false),
            residual: T::zero(),
            correction: T::zero(),
            steps: T::zero(),
            margin: T::zero(),
            error_bound: T::zero(),
            condition: T::zero(),
            reduced: Reduced::new(n, m),
            doubling: Doubling::new(n),
            newton: Newton::new(n, m),
        }
    }

    /// Solves `data`, which is scaled in the course. Lanes that fail are tried
    /// again with another Cayley parameter, or in discrete time with another
    /// origin for `X`:
    ///
    /// ```text
    /// X = Y + x0 I:  the same equation in Y with  R + x0 B'B,  S + x0 A'B,  Q - x0 I + x0 A'A
    /// ```
    /// which also serves an `R` that is singular while `R + B'XB` is not.
    #[inline(always)]
    pub(crate) fn solve(&mut self, kind: Kind) {
        self.prepare(kind, false);
        for (attempt, factor) in ATTEMPTS.into_iter().enumerate() {
            let wanted = !self.done;
            if !wanted.any() {
                break;
            }
            let (started, origin) = match kind {
                Kind::Continuous => (self.start_continuous(factor), T::zero()),
                Kind::Discrete => self.start_discrete(attempt, factor),
            };
            let wanted = wanted & started;
            self.doubling.run(wanted);
            for i in 0..self.data.n {
                let at = i * self.data.n + i;
                self.doubling.h[at] = self.doubling.h[at] + origin;
            }
            self.correct(kind, wanted);
        }
        self.finish(kind);
    }

    /// Solves `data`, scaled in the course, from a start that `start` makes of
    /// the scaled equation without cross term; `tilted` brings `G` to the size of
    /// `A` instead of to that of `Q`.
    #[inline(always)]
    pub(crate) fn solve_from(
        &mut self,
        kind: Kind,
        tilted: bool,
        start: impl FnOnce(Coefficients<'_, T>) -> Option<(Vec<T>, T)>,
    ) {
        self.prepare(kind, true);
        if tilted {
            tilt(&mut self.data, &mut self.reduced);
        }
        if let Some((x, steps)) = start(self.reduced.coefficients()) {
            self.doubling.h.copy_from_slice(&x);
            self.doubling.settled = T::Mask::splat(true);
            self.doubling.steps = steps;
            self.correct(kind, T::Mask::splat(true));
        }
        self.finish(kind);
    }

    /// Scales the data and clears the results. With `any_sign` an `R` that is not
    /// positive is inverted all the same, in a block whose lanes are all alike.
    #[inline(always)]
    fn prepare(&mut self, kind: Kind, any_sign: bool) {
        scale_units(&mut self.data);
        self.indefinite = !reduce(&mut self.reduced, &self.data, T::zero());
        let continuous = T::Mask::splat(kind == Kind::Continuous);
        self.odd_weight = self.indefinite & continuous;
        if any_sign && self.indefinite.any() {
            reduce_indefinite(&mut self.reduced, &self.data);
        }
        scale_states(&mut self.data, kind, &mut self.reduced, &mut self.doubling);
        self.done = T::Mask::splat(false);
        self.steps = T::zero();
        let nan = T::splat(f64::NAN);
        (self.residual, self.correction, self.margin) = (nan, nan, nan);
        (self.error_bound, self.condition) = (nan, nan);
    }

    /// Starts with the given factor on the Cayley parameter; false in lanes where
    /// that is not possible.
    #[inline(always)]
    fn start_continuous(&mut self, factor: f64) -> T::Mask {
        let gamma = self.reduced.gamma * T::splat(factor);
        let c = self.reduced.coefficients();
        start_continuous(&mut self.doubling, c, gamma) & !self.indefinite
    }

    /// Starts with `X = 0` as the origin, then with others, which are returned;
    /// false in lanes where that is not possible.
    #[inline(always)]
    fn start_discrete(&mut self, attempt: usize, factor: f64) -> (T::Mask, T) {
        let mut origin = T::zero();
        let mut started = !self.indefinite;
        if attempt > 0 {
            let (_, e) = largest(&self.data.q).split();
            origin = T::splat(factor) * T::pow2i(e.max(T::splat(-1000.0)));
            started = reduce(&mut self.reduced, &self.data, origin);
        }
        self.doubling.start_discrete(self.reduced.coefficients());
        (started, origin)
    }

    /// Corrects and verifies what the doubling left, and takes over the lanes
    /// that pass.
    #[inline(always)]
    fn correct(&mut self, kind: Kind, wanted: T::Mask) {
        let settled = wanted & self.doubling.settled;
        self.steps = T::select(wanted, self.steps + self.doubling.steps, self.steps);
        let newton = &mut self.newton;
        newton.run(kind, &self.data, &mut self.doubling.h, settled);
        self.steps = T::select(settled, self.steps + newton.steps, self.steps);
        self.residual = T::select(settled, newton.residual, self.residual);
        self.correction = T::select(settled, newton.correction, self.correction);
        let passed = settled & newton.done;
        self.margin = T::select(passed, newton.margin, self.margin);
        self.error_bound = T::select(passed, newton.error_bound, self.error_bound);
        self.condition = T::select(passed, newton.condition, self.condition);
        assign(passed, &mut self.x, &self.doubling.h);
        self.done = self.done | passed;
    }

    /// Brings the results to the user's units.
    #[inline(always)]
    fn finish(&mut self, kind: Kind) {
        unscale(&self.data, &mut self.x);
        if kind == Kind::Continuous {
            shift(std::slice::from_mut(&mut self.margin), self.data.time);
        }
    }
}
