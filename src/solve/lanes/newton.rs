//! Newton's correction of a Riccati solution, which also verifies it.

use super::bound::{Amplification, in_units, is_enough, looks_first, rate_of_sums, rate_of_two};
use super::data::{Data, Kind};
use super::ops::{add_where, largest, norm, outlined, transpose};
use super::powers::{Cayley, Digits, gamma_of};
use super::residual::{gain, plain_residual, residual, sharpen};
use super::smith::{lyapunov_dual_to, stein_dual_to};
use crate::real::{Mask, Real};
use crate::small::{Dyn, cholesky, mul, mul_tn, solve_lower, sym_mul_nt, symmetrize};

/// Corrections after which a lane is given up.
const MAX_CORRECTIONS: usize = 8;
/// Relative correction whose square is below rounding: it is the last.
const LAST: f64 = 1e-10;
/// A correction larger than this must be followed, with the same closed loop, by
/// one a sixteenth its size. On the boundary of stability, where there is no
/// solution, that one is a quarter.
const ROUNDING: f64 = 1e-14;

/// Added to the diagonal of `X` before it is factored, relative to the entry and
/// (times the share) to the largest: a singular `X` has roundings for eigenvalues.
const SLACK: f64 = 1.0 / (1_u64 << 40) as f64;
/// See [`SLACK`].
const SLACK_SHARE: f64 = 1.0 / (1_u64 << 10) as f64;

/// Scratch and results of the correction.
#[derive(Debug, Clone)]
pub(crate) struct Newton<T: Real> {
    /// Lanes that are corrected, with a stable closed loop.
    pub(crate) done: T::Mask,
    /// Residual before the last correction over the norms of its terms.
    pub(crate) residual: T,
    /// Size of the last correction relative to `X`.
    pub(crate) correction: T,
    /// Verified margin of the closed loop.
    pub(crate) margin: T,
    /// Squarings spent.
    pub(crate) steps: T,
    /// Bounds and conditions are computed.
    pub(crate) bounds: bool,
    /// Bound on the error left, see [`Amplification::bound`].
    pub(crate) error_bound: T,
    /// What rounding of the residual is amplified by, relative to `X`.
    pub(crate) condition: T,
    cayley: Cayley<T>,
    /// Gain, m by n, and a product of the same shape in two parts.
    pub(super) k: Vec<T>,
    pub(super) v: [Vec<T>; 2],
    /// `R + B'XB` and the exchanges of its factors.
    pub(super) r: Vec<T>,
    pub(super) perm: Vec<T>,
    /// Closed loop and a product, in two parts each.
    pub(super) loop_: [Vec<T>; 2],
    pub(super) p: [Vec<T>; 2],
    pub(super) m: [Vec<T>; 2],
    pub(super) dx: Vec<T>,
    pub(super) work: Vec<T>,
    /// Factor of `X`, in whose coordinates the correction is computed.
    factor: Vec<T>,
}

impl<T: Real> Newton<T> {
    /// Room for order `n` with `m` inputs.
    #[inline(always)]
    pub(crate) fn new(n: usize, m: usize) -> Self {
        let zeros = |count| vec![T::zero(); count];
        let two = |count| [zeros(count), zeros(count)];
        Newton {
            done: T::Mask::splat(false),
            residual: T::zero(),
            correction: T::zero(),
            margin: T::zero(),
            steps: T::zero(),
            bounds: true,
            error_bound: T::zero(),
            condition: T::zero(),
            cayley: Cayley::for_both_sides(n),
            k: zeros(m * n),
            v: two(m * n),
            r: zeros(m * m),
            perm: zeros(n.max(m)),
            loop_: two(n * n),
            p: two(n * n),
            m: two(n * n),
            dx: zeros(n * n),
            work: zeros(2 * n * n.max(m)),
            factor: zeros(n * n),
        }
    }

    /// Corrects `x` in the lanes of `wanted` until the correction is small.
    ///
    /// ```text
    /// K = R^-1 (B'X + S')            A_K = A - B K            (continuous)
    /// A_K' dX + dX A_K + Res = 0,    X <- X + dX
    /// K = (R + B'XB)^-1 (B'XA + S')                           (discrete)
    /// A_K' dX A_K - dX + Res = 0,    X <- X + dX
    /// ```
    /// (Kleinman 1968; Hewer 1971.) The margin is that of the closed loop before
    /// the last correction, whose relative size is below 1e-10.
    #[inline(always)]
    pub(crate) fn run(&mut self, kind: Kind, d: &Data<T>, x: &mut [T], wanted: T::Mask) {
        let nan = T::splat(f64::NAN);
        (self.residual, self.correction, self.margin) = (nan, nan, nan);
        (self.error_bound, self.condition) = (nan, nan);
        self.steps = T::zero();
        self.done = T::Mask::splat(false);
        let mut active = wanted;
        if looks_first::<T>(d.n) && active.any() {
            active = active & !self.look(kind, d, x, active);
        }
        for _ in 0..MAX_CORRECTIONS {
            if !active.any() {
                return;
            }
            let regular = gain(self, kind, d, x);
            let size = residual(self, kind, d, x);
            sharpen(self, kind, d, x);
            let residual = norm(&self.dx) / size;
            enter(self, d.n, x);
            enter_residual(self, d.n);
            let stable = self.powers(kind, d.n);
            self.sum(kind, Digits::Half);
            leave(self, d.n);
            let change = norm(&self.dx);
            let correction = change / norm(x);
            // X = 0 is corrected by 0: not a failure
            let none = change.eq(T::zero());
            let correction = T::select(none, T::zero(), correction);
            let sound = active & regular & stable & correction.is_finite();
            self.residual = T::select(active, residual, self.residual);
            self.correction = T::select(active, correction, self.correction);
            add_where(sound, x, &self.dx);
            let mut last = sound & correction.le(T::splat(LAST));
            let margin = self.margin_of_loop(kind);
            let squarings = self.cayley.powers.squarings();
            self.steps = T::select(active, self.steps + squarings, self.steps);
            if last.any() {
                last = measure(self, kind, d, x, last, correction, size);
            }
            self.margin = T::select(last, margin, self.margin);
            self.done = self.done | last;
            active = sound & !last;
        }
    }

    /// A first look at `x`: its residual in plain arithmetic, a proof of stability,
    /// and the condition. Where they bound the error by a few roundings nothing is
    /// corrected; where by more, `x` is corrected with the powers at hand. Returns
    /// the lanes of `wanted` that are done with.
    #[inline(always)]
    fn look(&mut self, kind: Kind, d: &Data<T>, x: &mut [T], wanted: T::Mask) -> T::Mask {
        let n = d.n;
        let regular = gain(self, kind, d, x);
        let look = plain_residual(self, kind, d, x);
        enter(self, n, x);
        let sound = wanted & regular & self.powers(kind, n);
        let scale = norm(x);
        let (here, there) = condition(self, kind, d, x, look.size);
        let bound = look.bound(here.max(there));
        // A zero that is no solution has no relative error.
        let sound = sound & (scale.gt(T::zero()) | look.residual.eq(T::zero()));
        let enough = sound & is_enough(bound);
        self.residual = T::select(enough, look.residual, self.residual);
        self.correction = T::select(enough, T::zero(), self.correction);
        let mut error_bound = bound;
        let mut taken = enough;
        let close = sound & !enough & bound.le(T::splat(LAST));
        if close.any() {
            let regular = gain(self, kind, d, x);
            let size = residual(self, kind, d, x);
            sharpen(self, kind, d, x);
            let residual = norm(&self.dx) / size;
            enter_residual(self, n);
            self.sum(kind, Digits::Half);
            leave(self, n);
            let correction = norm(&self.dx) / scale;
            // As small as was said; if not, the iteration starts from here.
            let agreed = close & regular & correction.le(bound);
            add_where(agreed, x, &self.dx);
            let shown = T::select(scale.eq(T::zero()), T::zero(), in_units(&d.scale, &self.dx, x));
            let rate = rate_of_sums(n, here, correction);
            let condition = here.max(there);
            let once = Amplification { last: correction.max(shown), rate, condition };
            let clear = agreed & once.is_clear();
            self.residual = T::select(clear, residual, self.residual);
            self.correction = T::select(clear, correction, self.correction);
            error_bound = T::select(enough, error_bound, once.bound(n));
            taken = taken | clear;
        }
        let squarings = self.cayley.powers.squarings();
        self.steps = T::select(wanted, squarings, self.steps);
        self.margin = T::select(taken, self.margin_of_loop(kind), self.margin);
        if self.bounds {
            self.condition = T::select(taken, here, self.condition);
            self.error_bound = T::select(taken, error_bound, self.error_bound);
        }
        self.done = self.done | taken;
        taken
    }

    /// Powers of the closed loop; the lanes in which they show it to be stable.
    #[inline(always)]
    fn powers(&mut self, kind: Kind, n: usize) -> T::Mask {
        let closed = &self.loop_[0];
        match kind {
            Kind::Continuous => {
                let perm = &mut self.perm[..n];
                let gamma = gamma_of(n, closed, &mut self.work[..n * n], perm);
                self.cayley.set(closed, gamma);
            }
            Kind::Discrete => self.cayley.powers.set(closed),
        }
        self.cayley.powers.stable
    }

    /// The margin that the powers show.
    #[inline(always)]
    fn margin_of_loop(&self, kind: Kind) -> T {
        match kind {
            Kind::Continuous => self.cayley.margin(),
            Kind::Discrete => self.cayley.powers.margin(),
        }
    }

    /// The solution for the right-hand side in `dx`, in its place, with the
    /// powers at hand.
    #[inline(always)]
    fn sum(&mut self, kind: Kind, digits: Digits) {
        let (x, work) = (&mut self.dx, &mut self.work);
        match kind {
            Kind::Continuous => lyapunov_dual_to(&self.cayley, x, work, digits),
            Kind::Discrete => stein_dual_to(&self.cayley.powers, x, work, digits),
        }
    }
}

outlined! {
    /// Brings the closed loop to coordinates in which `X` is the identity, or leaves
    /// it alone in lanes where `X` is not positive.
    ///
    /// ```text
    /// X + tiny = L L',   A_K -> L' A_K L^-T
    /// ```
    /// `x'Xx` falls along the closed loop (if `Q >= 0`): in these coordinates its
    /// powers never grow, however far from normal it is, and a correction is
    /// small if it is small beside `X` in every direction.
    fn enter(w: &'a mut Newton<T>, n: usize, x: &'a [T]) {
        let l = &mut w.factor;
        l.copy_from_slice(x);
        let size = largest(x);
        for i in 0..n {
            let d = l[i * n + i];
            l[i * n + i] = d + (d * T::splat(SLACK) + size * T::splat(SLACK * SLACK_SHARE));
        }
        let positive = cholesky(Dyn(n), l);
        for i in 0..n {
            for j in 0..n {
                let unit = if i == j { T::one() } else { T::zero() };
                let entry = if j > i { T::zero() } else { l[i * n + j] };
                l[i * n + j] = T::select(positive, entry, unit);
            }
        }
        let l = &w.factor[..];
        let half = &mut w.work[..n * n];
        // (L^-1 A_K')' = A_K L^-T
        transpose(n, n, &w.loop_[0], &mut w.p[0]);
        solve_lower(Dyn(n), Dyn(n), l, &mut w.p[0]);
        transpose(n, n, &w.p[0], half);
        mul_tn(Dyn(n), Dyn(n), Dyn(n), l, half, &mut w.loop_[0]);
    }
}

outlined! {
    /// Brings the residual to the coordinates of [`enter`]: `L^-1 Res L^-T`.
    fn enter_residual(w: &'a mut Newton<T>, n: usize) {
        let l = &w.factor[..];
        let half = &mut w.work[..n * n];
        // L^-1 (L^-1 Res)'
        solve_lower(Dyn(n), Dyn(n), l, &mut w.dx);
        transpose(n, n, &w.dx, half);
        solve_lower(Dyn(n), Dyn(n), l, half);
        w.dx.copy_from_slice(half);
        symmetrize(Dyn(n), &mut w.dx);
    }
}

outlined! {
    /// Brings the correction back: `dX -> L dX L'`.
    fn leave(w: &'a mut Newton<T>, n: usize) {
        let half = &mut w.work[..n * n];
        mul(Dyn(n), Dyn(n), Dyn(n), &w.factor, &w.dx, half);
        sym_mul_nt(Dyn(n), Dyn(n), half, &w.factor, &mut w.dx);
    }
}

outlined! {
    /// What a residual as large as `size` could do to `x`, relative to it, in
    /// balanced units and in those of the user.
    ///
    /// It is that of the largest such residual in the sense of order:
    ///
    /// ```text
    /// -s I <= Res <= s I   =>   -Y <= dX <= Y,   Y the solution for s I
    /// ```
    /// `s` the sum of the norms of the terms of the residual. The operator is
    /// positive, so `|Y|` is attained (Hewer, Kenney 1988, SIAM J. Control Optim.
    /// 26, 321-344): the quantity that sep estimates.
    fn condition(w: &'a mut Newton<T>, kind: Kind, d: &'a Data<T>, x: &'a [T], size: T) -> (T, T) {
        let n = d.n;
        let scale = norm(x);
        let zero = scale.eq(T::zero());
        w.dx.fill(T::zero());
        for i in 0..n {
            w.dx[i * n + i] = size;
        }
        enter_residual(w, n);
        w.sum(kind, Digits::Few);
        leave(w, n);
        let here = T::select(zero, T::zero(), norm(&w.dx) / scale);
        (here, T::select(zero, T::zero(), in_units(&d.scale, &w.dx, x)))
    }
}

outlined! {
    /// Bounds the error left in `x` where `last`; where more is left than
    /// rounding, corrects once more on a residual made afresh and measures how
    /// much that changed. Returns the lanes in which that correction was no larger
    /// than the one before.
    fn measure(w: &'a mut Newton<T>, kind: Kind, d: &'a Data<T>, x: &'a mut [T], last: T::Mask, correction: T, size: T) -> T::Mask {
        let n = d.n;
        let scale = norm(x);
        let zero = scale.eq(T::zero());
        let mut clear = last & correction.le(T::splat(ROUNDING));
        let mut condition = T::zero();
        if w.bounds {
            let there = T::select(zero, T::zero(), in_units(&d.scale, &w.dx, x));
            let (here, here_in_units) = self::condition(w, kind, d, x, size);
            w.condition = T::select(last, here, w.condition);
            // What is left of a correction by Newton's method is of its square.
            let rate = rate_of_sums(n, here, correction);
            condition = here.max(here_in_units);
            let once = Amplification { last: correction.max(there), rate, condition };
            clear = clear & once.is_clear();
            w.error_bound = T::select(clear, once.bound(n), w.error_bound);
        }
        let unclear = last & !clear;
        if !unclear.any() {
            return last;
        }
        let regular = gain(w, kind, d, x);
        residual(w, kind, d, x);
        sharpen(w, kind, d, x);
        // The powers are those of the loop before the correction, as they were.
        enter_residual(w, n);
        w.sum(kind, Digits::All);
        leave(w, n);
        let again = T::select(zero, T::zero(), norm(&w.dx) / scale);
        let fast = again.le(correction * T::splat(0.0625)) | correction.le(T::splat(ROUNDING));
        let agreed = unclear & regular & fast & again.le(T::splat(LAST));
        add_where(agreed, x, &w.dx);
        if w.bounds {
            let there = T::select(zero, T::zero(), in_units(&d.scale, &w.dx, x));
            let rate = rate_of_two(correction, again);
            let twice = Amplification { last: again.max(there), rate, condition };
            w.error_bound = T::select(agreed, twice.bound(n), w.error_bound);
        }
        clear | agreed
    }
}
