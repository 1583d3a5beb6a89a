//! One lane block of Lyapunov or Sylvester equations: balance, sum, correct.

mod condition;

use self::condition::{condition, condition_at_most, share_there};
use super::balance::{apply, balance, exponent_of, shift};
use super::bound::{
    Amplification, FirstLook, is_enough, looks_first, rate_of_sums, rate_of_two, shares,
    shares_at_most,
};
use super::data::Kind;
use super::double::{Form, Pair, PairMut, mul_add_two, symmetric_sum, two_sum};
use super::ops::{add_where, largest, norm, outlined, transpose};
use super::powers::{Cayley, Digits, gamma_of};
use super::smith::{
    lyapunov_of_identity, lyapunov_to, stein_of_identity, stein_pair, stein_to, sylvester,
};
use crate::real::{Mask, Real};
use crate::small::{Dyn, mul, sym_mul_nt};

/// Corrections after which a lane is given up.
const MAX_CORRECTIONS: usize = 6;
/// Relative correction that is the last: what it leaves is below rounding.
const LAST: f64 = 1e-10;

/// Equations and solutions of a block.
///
/// ```text
/// continuous   A X + X B + C = 0
/// discrete     A X B - X + C = 0
/// ```
/// `A` n by n, `B` m by m, `C` and `X` n by m; a Lyapunov equation has `B = A'`
/// and symmetric `C`.
#[derive(Debug, Clone)]
pub(crate) struct Linear<T: Real> {
    kind: Kind,
    /// A Lyapunov equation.
    symmetric: bool,
    n: usize,
    m: usize,
    /// Fill before [`Linear::solve`].
    pub(crate) a: Vec<T>,
    /// Fill before [`Linear::solve`], but for a Lyapunov equation.
    pub(crate) b: Vec<T>,
    /// Fill before [`Linear::solve`].
    pub(crate) c: Vec<T>,
    /// The solutions.
    pub(crate) x: Vec<T>,
    /// Lanes that are solved, with stable coefficients.
    pub(crate) done: T::Mask,
    /// Relative residual before the last correction.
    pub(crate) residual: T,
    /// Relative size of the last correction.
    pub(crate) correction: T,
    /// Squarings.
    pub(crate) steps: T,
    /// Verified margin of the less stable coefficient, one a lane.
    pub(crate) margin: T,
    /// Bounds and conditions are computed.
    pub(crate) bounds: bool,
    /// Bound on the relative error.
    pub(crate) error_bound: T,
    /// Amplification of a relative residual.
    pub(crate) condition: T,
    /// Exponents of the balancing, of the time unit and of `C`.
    left: Vec<T>,
    right: Vec<T>,
    time: T,
    cost: T,
    left_cayley: Cayley<T>,
    right_cayley: Cayley<T>,
    dx: Vec<T>,
    p: [Vec<T>; 2],
    r: [Vec<T>; 2],
    work: Vec<T>,
    perm: Vec<T>,
}

impl<T: Real> Linear<T> {
    /// Room for equations with `X` n by m; a Lyapunov equation if `symmetric`.
    #[inline(always)]
    pub(crate) fn new(kind: Kind, symmetric: bool, n: usize, m: usize) -> Self {
        let zeros = |count| vec![T::zero(); count];
        let two = || [zeros(n * m), zeros(n * m)];
        let larger = n.max(m);
        Linear {
            kind,
            symmetric,
            n,
            m,
            a: zeros(n * n),
            b: zeros(m * m),
            c: zeros(n * m),
            x: zeros(n * m),
            done: T::Mask::splat(false),
            residual: T::zero(),
            correction: T::zero(),
            steps: T::zero(),
            margin: T::zero(),
            bounds: true,
            error_bound: T::zero(),
            condition: T::zero(),
            left: zeros(n),
            right: zeros(m),
            time: T::zero(),
            cost: T::zero(),
            left_cayley: if symmetric { Cayley::for_both_sides(n) } else { Cayley::new(n) },
            right_cayley: Cayley::new(if symmetric { 0 } else { m }),
            dx: zeros(n * m),
            p: two(),
            r: two(),
            work: zeros(2 * larger * larger),
            perm: zeros(larger),
        }
    }

    /// Solves the equations, which are scaled in the course.
    #[inline(always)]
    pub(crate) fn solve(&mut self) {
        scale(self);
        self.transform();
        self.x.fill(T::zero());
        self.correct(self.stable());
        let margin = self.margin_of_coefficients();
        self.margin = T::select(self.stable(), margin, T::splat(f64::NAN));
        finish(self);
    }

    /// Solves a block whose lanes all hold one equation with the solver that
    /// `make` returns for the scaled `A` and `B`, which need not be stable.
    #[inline(always)]
    pub(crate) fn solve_with(&mut self, make: impl FnOnce(&[T], &[T]) -> Option<Inverse<T>>) {
        scale(self);
        self.margin = T::splat(f64::NAN);
        self.done = T::Mask::splat(false);
        self.x.fill(T::zero());
        if let Some(inverse) = make(&self.a, &self.b) {
            iterate(self, T::Mask::splat(true), Some(&inverse));
        }
        finish(self);
    }

    /// Powers of the coefficients.
    #[inline(always)]
    fn transform(&mut self) {
        let (n, m) = (self.n, self.m);
        if self.kind == Kind::Discrete {
            self.left_cayley.powers.set(&self.a);
            if !self.symmetric {
                self.right_cayley.powers.set(&self.b);
            }
            return;
        }
        let gamma = gamma_of(n, &self.a, &mut self.work[..n * n], &mut self.perm[..n]);
        if self.symmetric {
            self.left_cayley.set(&self.a, gamma);
            return;
        }
        let other = gamma_of(m, &self.b, &mut self.work[..m * m], &mut self.perm[..m]);
        let gamma = (gamma * other).sqrt();
        self.left_cayley.set(&self.a, gamma);
        self.right_cayley.set(&self.b, gamma);
    }

    /// Lanes whose coefficients are stable.
    #[inline(always)]
    fn stable(&self) -> T::Mask {
        let left = self.left_cayley.powers.stable;
        if self.symmetric { left } else { left & self.right_cayley.powers.stable }
    }

    /// The smaller margin of the two coefficients.
    #[inline(always)]
    fn margin_of_coefficients(&self) -> T {
        let left = margin(self.kind, &self.left_cayley);
        if self.symmetric { left } else { left.min(margin(self.kind, &self.right_cayley)) }
    }

    /// Solves and corrects the lanes of `wanted`.
    #[inline(always)]
    fn correct(&mut self, wanted: T::Mask) {
        iterate(self, wanted, None);
        let mut steps = self.left_cayley.powers.squarings();
        if !self.symmetric {
            steps = steps + self.right_cayley.powers.squarings();
        }
        self.steps = steps;
    }

    /// The solution for the right-hand side in `dx`, in its place, by `inverse`
    /// (of a block whose lanes are all alike) or by Smith sums.
    #[inline(always)]
    fn invert(&mut self, inverse: Option<&Inverse<T>>, digits: Digits) {
        match inverse {
            None => self.apply_inverse(digits),
            Some(Inverse::Full(inverse)) => inverse(&mut self.dx),
            Some(Inverse::Plain(inverse)) => {
                let mut x: Vec<f64> = self.dx.iter().map(|v| v.lane(0)).collect();
                inverse(&mut x);
                for (to, x) in self.dx.iter_mut().zip(x) {
                    *to = T::splat(x);
                }
            }
        }
    }

    /// [`Linear::invert`] by Smith sums.
    #[inline(always)]
    fn apply_inverse(&mut self, digits: Digits) {
        let (x, work) = (&mut self.dx, &mut self.work);
        let (left, right) = (&self.left_cayley, &self.right_cayley);
        match (self.kind, self.symmetric) {
            (Kind::Continuous, true) => lyapunov_to(left, x, work, digits),
            (Kind::Continuous, false) => sylvester(left, right, x, work),
            (Kind::Discrete, true) => stein_to(&left.powers, x, work, digits),
            (Kind::Discrete, false) => stein_pair(&left.powers, &right.powers, x, work),
        }
    }
}

outlined! {
    /// The margin of one coefficient.
    fn margin(kind: Kind, c: &'a Cayley<T>) -> T {
        match kind {
            Kind::Continuous => c.margin(),
            Kind::Discrete => c.powers.margin(),
        }
    }
}

/// Solves an equation for the right-hand side in its argument, in place.
pub(crate) enum Inverse<T> {
    /// In one number of precision.
    Plain(InPlace<f64>),
    /// In that of `T`.
    Full(InPlace<T>),
}

/// A linear map of a matrix in place.
type InPlace<T> = Box<dyn Fn(&mut [T])>;

outlined! {
    /// `X <- X + (solution for the residual)`, from `X = 0`, until the correction
    /// is small.
    fn iterate(l: &'a mut Linear<T>, wanted: T::Mask, inverse: Option<&'a Inverse<T>>) {
        let nan = T::splat(f64::NAN);
        (l.residual, l.correction) = (nan, nan);
        (l.error_bound, l.condition) = (nan, nan);
        l.done = T::Mask::splat(false);
        l.steps = T::zero();
        let mut active = wanted;
        let mut before = T::one();
        for round in 0..=MAX_CORRECTIONS {
            if !active.any() {
                return;
            }
            // The residual of X = 0 is C.
            let size = if round == 0 {
                l.dx.copy_from_slice(&l.c);
                let size = norm(&l.c);
                T::select(size.gt(T::zero()), size, T::one())
            } else {
                residual(l)
            };
            let change = norm(&l.dx);
            let relative = change / size;
            l.invert(inverse, if round == 0 { Digits::All } else { Digits::Half });
            let change = norm(&l.dx);
            let none = change.eq(T::zero());
            add_where(active, &mut l.x, &l.dx);
            let correction = change / norm(&l.x);
            let correction = T::select(none, T::zero(), correction);
            if round > 0 {
                l.residual = T::select(active, relative, l.residual);
                l.correction = T::select(active, correction, l.correction);
            }
            let last = active & correction.le(T::splat(LAST));
            let mut finished = if round == 0 { active & none } else { last };
            if l.bounds && finished.any() {
                finished = measure(l, finished, [before, correction], size, inverse);
            }
            let plain = looks_first::<T>(l.n) && l.symmetric && inverse.is_none();
            if round == 0 && plain {
                finished = finished | accept(l, active & !finished);
            }
            before = correction;
            l.done = l.done | finished;
            l.correction = T::select(active & none, T::zero(), l.correction);
            l.residual = T::select(active & none, relative, l.residual);
            active = active & !finished & correction.is_finite();
        }
    }
}

outlined! {
    /// A first look at the solution of a Lyapunov equation, in plain arithmetic;
    /// returns the lanes of `wanted` that need no correction.
    ///
    /// ```text
    /// R = A X + X A' + C,    R = A X A' - X + C
    /// ```
    fn accept(l: &'a mut Linear<T>, wanted: T::Mask) -> T::Mask {
        if !wanted.any() {
            return wanted;
        }
        let n = l.n;
        let (p, r) = (&mut l.p[0], &mut l.r[0]);
        let (scale, of_a, of_c) = (norm(&l.x), norm(&l.a), norm(&l.c));
        // P = A X
        mul(Dyn(n), Dyn(n), Dyn(n), &l.a, &l.x, p);
        let (size, terms) = match l.kind {
            Kind::Continuous => {
                for i in 0..n {
                    for j in 0..=i {
                        let (u, v) = (i * n + j, j * n + i);
                        let x = (p[u] + p[v]) + l.c[u];
                        r[u] = x;
                        r[v] = x;
                    }
                }
                let two = T::splat(2.0);
                (two.mul_add(norm(p), of_c), two.mul_add(of_a * scale, of_c))
            }
            Kind::Discrete => {
                sym_mul_nt(Dyn(n), Dyn(n), p, &l.a, r);
                let others = scale + of_c;
                let sizes = (norm(r) + others, (of_a * of_a).mul_add(scale, others));
                for e in 0..n * n {
                    r[e] = (r[e] - l.x[e]) + l.c[e];
                }
                sizes
            }
        };
        let residual = norm(r) / size;
        let look = FirstLook { residual, size, terms: terms / size };
        // the norms of the powers tell most lanes that they are well-conditioned
        let (mut here, mut there) = condition_at_most(l, look.size, scale);
        let told = is_enough(look.bound(here.max(there)));
        if (wanted & !told).any() {
            let (exact, exact_there) = condition(l, look.size, scale, None);
            here = T::select(told, here, exact);
            there = T::select(told, there, exact_there);
        }
        let bound = look.bound(here.max(there));
        let enough = wanted & is_enough(bound) & scale.gt(T::zero());
        l.residual = T::select(enough, residual, l.residual);
        l.correction = T::select(enough, T::zero(), l.correction);
        if l.bounds {
            l.condition = T::select(enough, here, l.condition);
            l.error_bound = T::select(enough, bound, l.error_bound);
        }
        enough
    }
}

outlined! {
    /// Bounds the error left in `x` where `finished`; where more is left than
    /// rounding, corrects once more on a residual made afresh and measures how
    /// much that changed. Returns the lanes in which that correction was no
    /// larger than the one before.
    ///
    /// The condition is that of the worst of a few right-hand sides as large as
    /// the terms of the residual (`size`); of a stable Lyapunov equation the
    /// identity is the worst there is (see the correction of Riccati solutions).
    fn measure(l: &'a mut Linear<T>, finished: T::Mask, corrections: [T; 2], size: T, inverse: Option<&'a Inverse<T>>) -> T::Mask {
        let larger = l.n.max(l.m);
        let [before, correction] = corrections;
        let scale = norm(&l.x);
        let zero = scale.eq(T::zero());
        let there = T::select(zero, T::zero(), share_there(l));
        let (condition, condition_there) = condition(l, size, scale, inverse);
        l.condition = T::select(finished, condition, l.condition);
        let rate = rate_of_sums(larger, condition, T::zero()).max(rate_of_two(before, correction));
        let condition = condition.max(condition_there);
        let once = Amplification { last: correction.max(there), rate, condition };
        let mut clear = finished & once.is_clear();
        if inverse.is_some() {
            clear = T::Mask::splat(false);
        }
        l.error_bound = T::select(clear, once.bound(larger), l.error_bound);
        let unclear = finished & !clear;
        if !unclear.any() {
            return finished;
        }
        residual(l);
        l.invert(inverse, Digits::All);
        let again = T::select(zero, T::zero(), norm(&l.dx) / scale);
        let agreed = unclear & again.le(correction.max(T::splat(LAST)));
        add_where(agreed, &mut l.x, &l.dx);
        let there = T::select(zero, T::zero(), share_there(l));
        let rate = rate_of_two(correction, again);
        let twice = Amplification { last: again.max(there), rate, condition };
        l.error_bound = T::select(agreed, twice.bound(larger), l.error_bound);
        clear | agreed
    }
}

outlined! {
    /// The residual of `x` in twice the working precision, into `dx`; returns the
    /// sum of the norms of its terms.
    fn residual(l: &'a mut Linear<T>) -> T {
        let (n, m) = (l.n, l.m);
        let two = T::splat(2.0);
        let [p_hi, p_lo] = &mut l.p;
        let [r_hi, r_lo] = &mut l.r;
        for part in [&mut *p_hi, &mut *p_lo, &mut *r_hi, &mut *r_lo] {
            part.fill(T::zero());
        }
        let x = Pair::from(&l.x[..]);
        let (a, b) = (Pair::from(&l.a[..]), Pair::from(&l.b[..]));
        let mut size = norm(&l.c);
        match l.kind {
            Kind::Continuous => {
                // R = A X + X B, or 2 A X to be symmetrised
                let target = PairMut { hi: r_hi, lo: r_lo };
                let times = if l.symmetric { 2.0 } else { 1.0 };
                mul_add_two(Form::Plain, times, a, x, target, [n, n, m]);
                size = size + two * norm(&l.r[0]);
                if !l.symmetric {
                    let [r_hi, r_lo] = &mut l.r;
                    let target = PairMut { hi: r_hi, lo: r_lo };
                    mul_add_two(Form::Plain, 1.0, x, b, target, [n, m, m]);
                }
            }
            Kind::Discrete => {
                // P = X B, R = A P - X
                let target = PairMut { hi: p_hi, lo: p_lo };
                mul_add_two(Form::Plain, 1.0, x, b, target, [n, m, m]);
                let p = Pair { hi: &l.p[0], lo: &l.p[1] };
                let target = PairMut { hi: r_hi, lo: r_lo };
                mul_add_two(Form::Plain, 1.0, a, p, target, [n, n, m]);
                size = size + norm(&l.r[0]) + norm(&l.x);
                let [r_hi, r_lo] = &mut l.r;
                for i in 0..n * m {
                    let (s, e) = two_sum(r_hi[i], -l.x[i]);
                    r_hi[i] = s;
                    r_lo[i] = r_lo[i] + e;
                }
            }
        }
        if l.symmetric {
            let r = Pair { hi: &l.r[0], lo: &l.r[1] };
            symmetric_sum(n, r, &l.c, &mut l.dx);
        } else {
            for i in 0..n * m {
                let (s, e) = two_sum(l.c[i], l.r[0][i]);
                l.dx[i] = s + (e + l.r[1][i]);
            }
        }
        T::select(size.gt(T::zero()), size, T::one())
    }
}

outlined! {
    /// Balances the coefficients and brings time and `C` to unit size, all by
    /// powers of two.
    ///
    /// ```text
    /// X = 2^(c - t) D X_s E^-1,   A 2^-t -> D^-1 A D,   B 2^-t -> E^-1 B E,   C 2^-c -> D^-1 C E
    /// ```
    fn scale(l: &'a mut Linear<T>) {
        let (n, m) = (l.n, l.m);
        let magnitudes = &mut l.work[..n * n];
        magnitudes.copy_from_slice(&l.a);
        balance(n, magnitudes, &mut [], &mut [], &mut l.left);
        apply(&l.left, [-1.0, 1.0], &mut l.a, [n, n]);
        if l.symmetric {
            transpose(n, n, &l.a, &mut l.b);
            for (right, &left) in l.right.iter_mut().zip(&l.left) {
                *right = -left;
            }
        } else {
            let magnitudes = &mut l.work[..m * m];
            magnitudes.copy_from_slice(&l.b);
            balance(m, magnitudes, &mut [], &mut [], &mut l.right);
            apply(&l.right, [-1.0, 1.0], &mut l.b, [m, m]);
        }
        l.cost = exponent_of(&l.c);
        shift(&mut l.c, -l.cost);
        apply(&l.left, [-1.0, 0.0], &mut l.c, [n, m]);
        apply(&l.right, [0.0, 1.0], &mut l.c, [n, m]);
        l.time = T::zero();
        if l.kind == Kind::Continuous {
            let size = largest(&l.a).max(largest(&l.b));
            let (_, e) = size.split();
            l.time = T::select(size.gt(T::zero()), e, T::zero());
            shift(&mut l.a, -l.time);
            shift(&mut l.b, -l.time);
        }
    }
}

outlined! {
    /// Brings the results to the user's units.
    fn finish(l: &'a mut Linear<T>) {
        let size = [l.n, l.m];
        apply(&l.left, [1.0, 0.0], &mut l.x, size);
        apply(&l.right, [0.0, -1.0], &mut l.x, size);
        shift(&mut l.x, l.cost - l.time);
        shift(std::slice::from_mut(&mut l.margin), l.time);
    }
}
