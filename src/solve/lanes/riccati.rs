//! One lane block of Riccati equations: scale, start, double, correct, verify.

use super::balance::{apply, balance, exponent_of, shift};
use super::doubling::{Coefficients, Doubling};
use super::newton::Newton;
use crate::real::{Mask, Real};
use crate::small::{
    Dyn, cholesky, mul_add_tn, mul_sub_tn, norm_max, solve_lower, sym_mul_sub_tn, sym_mul_tn,
    transpose,
};

/// Continuous or discrete time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0`.
    Continuous,
    /// `A'XA - X - (A'XB + S)(R + B'XB)^-1(B'XA + S') + Q = 0`.
    Discrete,
}

/// Factors on the Cayley parameter, one an attempt.
const ATTEMPTS: [f64; 3] = [1.0, 0.21, 5.3];

/// The data of the equations, and their solutions; sizes as in
/// [`crate::solve::Riccati`].
#[derive(Debug, Clone)]
pub(crate) struct Data<T> {
    pub(crate) n: usize,
    pub(crate) m: usize,
    pub(crate) a: Vec<T>,
    pub(crate) b: Vec<T>,
    pub(crate) q: Vec<T>,
    pub(crate) r: Vec<T>,
    pub(crate) s: Vec<T>,
    /// Exponents of the states: `X = 2^cost D^-1 X_s D^-1`.
    scale: Vec<T>,
    cost: T,
    /// Exponent of the time unit, `A = 2^time A_s`.
    time: T,
}

impl<T: Real> Data<T> {
    /// Room for order `n` with `m` inputs; fill `a` to `s`, then [`Data::scale`].
    #[inline(always)]
    pub(crate) fn new(n: usize, m: usize) -> Self {
        let zeros = |count| vec![T::zero(); count];
        Data {
            n,
            m,
            a: zeros(n * n),
            b: zeros(n * m),
            q: zeros(n * n),
            r: zeros(m * m),
            s: zeros(n * m),
            scale: zeros(n),
            cost: T::zero(),
            time: T::zero(),
        }
    }

    /// Brings inputs to `R_jj ~ 1`, the cost to `|Q| ~ 1` and `B` to the size of
    /// `Q`, all by powers of two, so that nothing after it can overflow.
    ///
    /// ```text
    /// u = D_r u_s:   B D_r, S D_r, D_r R D_r
    /// X = 2^c X_s:   Q 2^-c, S 2^(-c/2), B 2^(c/2)
    /// x = 2^k x_s:   B 2^-k, Q 2^2k, S 2^k
    /// ```
    #[inline(always)]
    fn scale_units(&mut self) {
        let (n, m) = (self.n, self.m);
        let half = T::splat(0.5);
        for j in 0..m {
            let r = self.r[j * m + j];
            let e = (r.split().1 * half).round_ties_even();
            let e = T::select(r.gt(T::zero()), -e, T::zero());
            for i in 0..m {
                shift(&mut self.r[j * m + i..][..1], e);
                shift(&mut self.r[i * m + j..][..1], e);
            }
            for i in 0..n {
                shift(&mut self.b[i * m + j..][..1], e);
                shift(&mut self.s[i * m + j..][..1], e);
            }
        }
        let half_cost = (exponent_of(&self.q) * half).round_ties_even();
        let states = ((exponent_of(&self.b) + half_cost) * half).round_ties_even();
        shift(&mut self.q, states + states - half_cost - half_cost);
        shift(&mut self.s, states - half_cost);
        shift(&mut self.b, half_cost - states);
        self.cost = half_cost + half_cost;
        self.scale.fill(states);
    }

    /// Balances the states and, in continuous time, brings the unit of time to
    /// that of the Hamiltonian. Needs the scaled `A`, `G`, `Q` without cross
    /// term, and scales them along.
    #[inline(always)]
    fn scale_states(&mut self, kind: Kind, c: &mut Reduced<T>, doubling: &mut Doubling<T>) {
        let (n, m) = (self.n, self.m);
        let k = &mut c.exponents;
        let (a, g, q) = (&mut c.work[0], &mut c.g_abs, &mut c.q_abs);
        a.copy_from_slice(&c.a);
        g.copy_from_slice(&c.g);
        q.copy_from_slice(&c.q);
        balance(n, a, g, q, k);
        for x in [&mut self.a, &mut c.a] {
            apply(k, [-1.0, 1.0], x, [n, n]);
        }
        for x in [&mut self.q, &mut c.q] {
            apply(k, [1.0, 1.0], x, [n, n]);
        }
        apply(k, [-1.0, -1.0], &mut c.g, [n, n]);
        apply(k, [-1.0, 0.0], &mut self.b, [n, m]);
        apply(k, [1.0, 0.0], &mut self.s, [n, m]);
        for (e, &k) in self.scale.iter_mut().zip(k.iter()) {
            *e = *e + k;
        }
        if kind == Kind::Discrete {
            return;
        }
        let size = |x: &[T]| norm_max(x);
        let largest = size(&c.a).max(size(&c.g)).max(size(&c.q));
        let (_, e) = largest.split();
        let e = T::select(largest.gt(T::zero()), e, T::zero());
        let j = (e * T::splat(0.5)).round_ties_even();
        self.time = j + j;
        for x in [&mut self.a, &mut self.q, &mut c.a, &mut c.g, &mut c.q] {
            shift(x, -self.time);
        }
        for x in [&mut self.b, &mut self.s] {
            shift(x, -j);
        }
        c.gamma = doubling.gamma(c.coefficients());
    }

    /// Undoes the scaling of a solution.
    #[inline(always)]
    fn unscale(&self, x: &mut [T]) {
        apply(&self.scale, [-1.0, -1.0], x, [self.n, self.n]);
        shift(x, self.cost);
    }
}

/// `A - B R^-1 S'`, `B R^-1 B'`, `Q - S R^-1 S'`: the equation without cross
/// term, and scratch for making it.
#[derive(Debug, Clone)]
struct Reduced<T> {
    a: Vec<T>,
    g: Vec<T>,
    q: Vec<T>,
    g_abs: Vec<T>,
    q_abs: Vec<T>,
    exponents: Vec<T>,
    gamma: T,
    /// n by n, m by m, twice m by n.
    work: [Vec<T>; 4],
}

impl<T: Real> Reduced<T> {
    #[inline(always)]
    fn new(n: usize, m: usize) -> Self {
        let zeros = |count| vec![T::zero(); count];
        Reduced {
            a: zeros(n * n),
            g: zeros(n * n),
            q: zeros(n * n),
            g_abs: zeros(n * n),
            q_abs: zeros(n * n),
            exponents: zeros(n),
            gamma: T::one(),
            work: [zeros(n * n), zeros(m * m), zeros(m * n), zeros(m * n)],
        }
    }

    #[inline(always)]
    fn coefficients(&self) -> Coefficients<'_, T> {
        Coefficients { a: &self.a, g: &self.g, q: &self.q }
    }

    /// Reduces `d`, or `d` shifted by `x0 I` (see [`Block::solve`]) in lanes
    /// where `x0` is not zero. False in lanes where `R` is not positive.
    ///
    /// ```text
    /// R = L L',   A - (B L^-T)(S L^-T)',   G = (B L^-T)(B L^-T)',   Q - (S L^-T)(S L^-T)'
    /// shifted:  R + x0 B'B,  S + x0 A'B,  Q - x0 I + x0 A'A
    /// ```
    #[inline(always)]
    fn set(&mut self, d: &Data<T>, x0: T) -> T::Mask {
        let (n, m) = (Dyn(d.n), Dyn(d.m));
        let [t, l, bt, st] = &mut self.work;
        self.a.copy_from_slice(&d.a);
        self.q.copy_from_slice(&d.q);
        l.copy_from_slice(&d.r);
        transpose(n, m, &d.b, bt);
        transpose(n, m, &d.s, st);
        if !x0.eq(T::zero()).all() {
            for (t, &x) in t.iter_mut().zip(&d.a) {
                *t = x0 * x;
            }
            mul_add_tn(m, n, n, &d.b, t, st);
            mul_add_tn(n, n, n, &d.a, t, &mut self.q);
            for i in 0..d.n {
                self.q[i * d.n + i] = self.q[i * d.n + i] - x0;
            }
            let scaled = &mut self.g_abs[..];
            // x0 B, n by m, in scratch that is free here (n by n may be smaller)
            let mut scaled_b = Vec::new();
            let scaled = if d.n * d.m <= scaled.len() {
                &mut scaled[..d.n * d.m]
            } else {
                scaled_b.resize(d.n * d.m, T::zero());
                &mut scaled_b[..]
            };
            for (t, &x) in scaled.iter_mut().zip(&d.b) {
                *t = x0 * x;
            }
            mul_add_tn(m, n, m, &d.b, scaled, l);
        }
        let positive = cholesky(m, l);
        solve_lower(m, n, l, bt);
        solve_lower(m, n, l, st);
        mul_sub_tn(n, m, n, bt, st, &mut self.a);
        sym_mul_tn(n, m, bt, bt, &mut self.g);
        sym_mul_sub_tn(n, m, st, st, &mut self.q);
        positive
    }
}

/// What became of the equations of a block, in scaled and in user's units.
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
    /// Relative residual before the last correction.
    pub(crate) residual: T,
    /// Relative size of the last correction.
    pub(crate) correction: T,
    /// Doubling steps, all attempts together.
    pub(crate) steps: T,
    /// Verified margin, one a lane.
    pub(crate) margin: T,
    reduced: Reduced<T>,
    doubling: Doubling<T>,
    newton: Newton<T>,
}

impl<T: Real> Block<T> {
    /// Room for order `n` with `m` inputs.
    #[inline(always)]
    pub(crate) fn new(n: usize, m: usize) -> Self {
        Block {
            data: Data::new(n, m),
            x: vec![T::zero(); n * n],
            done: T::Mask::splat(false),
            indefinite: T::Mask::splat(false),
            residual: T::zero(),
            correction: T::zero(),
            steps: T::zero(),
            margin: T::zero(),
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
        self.prepare(kind);
        let (zero, positive) = (T::zero(), !self.indefinite);
        for factor in ATTEMPTS {
            let mut wanted = !self.done;
            let origin = match kind {
                Kind::Continuous => {
                    wanted = wanted & positive;
                    let gamma = self.reduced.gamma * T::splat(factor);
                    let c = self.reduced.coefficients();
                    wanted = wanted & self.doubling.start_continuous(c, gamma);
                    zero
                }
                Kind::Discrete => {
                    let first = factor == 1.0;
                    let (_, e) = norm_max(&self.data.q).split();
                    let origin = T::pow2i(e.max(T::splat(-1000.0))) * T::splat(factor);
                    let origin = if first { zero } else { origin };
                    let sound = if first { positive } else { self.reduced.set(&self.data, origin) };
                    wanted = wanted & sound;
                    self.doubling.start_discrete(self.reduced.coefficients());
                    origin
                }
            };
            if !wanted.any() {
                continue;
            }
            self.doubling.run(wanted);
            for i in 0..self.data.n {
                let at = i * self.data.n + i;
                self.doubling.h[at] = self.doubling.h[at] + origin;
            }
            self.correct(kind, wanted);
            if self.done.all() {
                break;
            }
        }
        self.finish(kind);
    }

    /// Solves `data`, scaled in the course, from a start that `start` makes of
    /// the scaled equation without cross term.
    #[inline(always)]
    pub(crate) fn solve_from(
        &mut self,
        kind: Kind,
        start: impl FnOnce(Coefficients<'_, T>) -> Option<(Vec<T>, T)>,
    ) {
        self.prepare(kind);
        if let Some((x, steps)) = start(self.reduced.coefficients()) {
            self.doubling.h.copy_from_slice(&x);
            self.doubling.settled = T::Mask::splat(true);
            self.doubling.steps = steps;
            self.correct(kind, T::Mask::splat(true));
        }
        self.finish(kind);
    }

    /// Scales the data and clears the results.
    #[inline(always)]
    fn prepare(&mut self, kind: Kind) {
        self.data.scale_units();
        let positive = self.reduced.set(&self.data, T::zero());
        self.indefinite = !positive;
        self.data.scale_states(kind, &mut self.reduced, &mut self.doubling);
        self.done = T::Mask::splat(false);
        self.steps = T::zero();
        let nan = T::splat(f64::NAN);
        (self.residual, self.correction, self.margin) = (nan, nan, nan);
    }

    /// Brings the results to the user's units.
    #[inline(always)]
    fn finish(&mut self, kind: Kind) {
        self.data.unscale(&mut self.x);
        if kind == Kind::Continuous {
            shift(std::slice::from_mut(&mut self.margin), self.data.time);
        }
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
        let seen = settled | (wanted & !self.done);
        self.residual = T::select(seen, newton.residual, self.residual);
        self.correction = T::select(seen, newton.correction, self.correction);
        let passed = settled & newton.done;
        self.margin = T::select(passed, newton.margin, self.margin);
        for (x, &h) in self.x.iter_mut().zip(&self.doubling.h) {
            *x = T::select(passed, h, *x);
        }
        self.done = self.done | passed;
    }
}
