//! The data of Riccati equations, scaled, and without their cross term.

use super::balance::{apply, balance, exponent_of, shift};
use super::doubling::{Coefficients, Doubling, gamma};
use super::ops::{largest, outlined, transpose};
use crate::real::{Mask, Real};
use crate::small::{
    Dyn, cholesky, lu_factor, lu_solve, mul, mul_add_tn, mul_sub, mul_sub_tn, solve_lower,
    sym_mul_sub_tn, sym_mul_tn, symmetrize,
};

/// Continuous or discrete time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0`.
    Continuous,
    /// `A'XA - X - (A'XB + S)(R + B'XB)^-1(B'XA + S') + Q = 0`.
    Discrete,
}

/// The data of the equations in one lane block; sizes as in
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
    /// False if `s` is zero throughout.
    pub(crate) has_cross: bool,
    /// Exponents of the states: `X = 2^cost D^-1 X_s D^-1`.
    pub(super) scale: Vec<T>,
    /// Exponents of the inputs.
    inputs: Vec<T>,
    pub(super) cost: T,
    /// Exponent of the time unit, `A = 2^time A_s`.
    pub(super) time: T,
}

impl<T: Real> Data<T> {
    /// Room for order `n` with `m` inputs; fill `a` to `s` before use.
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
            has_cross: false,
            scale: zeros(n),
            inputs: zeros(m),
            cost: T::zero(),
            time: T::zero(),
        }
    }
}

/// `A - B R^-1 S'`, `B R^-1 B'`, `Q - S R^-1 S'`: the equation without cross
/// term, and scratch for making it.
#[derive(Debug, Clone)]
pub(super) struct Reduced<T> {
    a: Vec<T>,
    g: Vec<T>,
    q: Vec<T>,
    /// Cayley parameter of the continuous equation.
    pub(super) gamma: T,
    exponents: Vec<T>,
    /// Three n by n, m by m, twice m by n, n by m.
    squares: [Vec<T>; 3],
    factor: Vec<T>,
    tall: [Vec<T>; 2],
    wide: Vec<T>,
}

impl<T: Real> Reduced<T> {
    #[inline(always)]
    pub(super) fn new(n: usize, m: usize) -> Self {
        let zeros = |count| vec![T::zero(); count];
        let square = || zeros(n * n);
        Reduced {
            a: square(),
            g: square(),
            q: square(),
            gamma: T::one(),
            exponents: zeros(n),
            squares: [square(), square(), square()],
            factor: zeros(m * m),
            tall: [zeros(m * n), zeros(m * n)],
            wide: zeros(n * m),
        }
    }

    #[inline(always)]
    pub(super) fn coefficients(&self) -> Coefficients<'_, T> {
        Coefficients { a: &self.a, g: &self.g, q: &self.q }
    }
}

outlined! {
    /// Brings inputs to `R_jj ~ 1`, the cost to `|Q| ~ 1` and `B` to the size of
    /// `Q`, all by powers of two, so that nothing after it overflows.
    ///
    /// ```text
    /// u = D_r u_s:   B D_r, S D_r, D_r R D_r
    /// X = 2^c X_s:   Q 2^-c, S 2^(-c/2), B 2^(c/2)
    /// x = 2^k x_s:   B 2^-k, Q 2^2k, S 2^k
    /// ```
    pub(super) fn scale_units(d: &'a mut Data<T>) {
        let (n, m) = (d.n, d.m);
        let half = T::splat(0.5);
        let inputs = &mut d.inputs;
        for j in 0..m {
            let r = d.r[j * m + j];
            let e = (r.split().1 * half).round_ties_even();
            inputs[j] = T::select(r.abs().gt(T::zero()), -e, T::zero());
        }
        apply(inputs, [1.0, 1.0], &mut d.r, [m, m]);
        apply(inputs, [0.0, 1.0], &mut d.b, [n, m]);
        if d.has_cross {
            apply(inputs, [0.0, 1.0], &mut d.s, [n, m]);
        }
        let half_cost = (exponent_of(&d.q) * half).round_ties_even();
        let states = ((exponent_of(&d.b) + half_cost) * half).round_ties_even();
        shift(&mut d.q, states + states - half_cost - half_cost);
        if d.has_cross {
            shift(&mut d.s, states - half_cost);
        }
        shift(&mut d.b, half_cost - states);
        d.cost = half_cost + half_cost;
        d.scale.fill(states);
        d.time = T::zero();
    }
}

outlined! {
    /// Balances the states and, in continuous time, brings the unit of time to
    /// that of the Hamiltonian. Scales the reduced equation `c` along.
    pub(super) fn scale_states(d: &'a mut Data<T>, kind: Kind, c: &'a mut Reduced<T>, doubling: &'a mut Doubling<T>) {
        let (n, m) = (d.n, d.m);
        let [a, g, q] = &mut c.squares;
        a.copy_from_slice(&c.a);
        g.copy_from_slice(&c.g);
        q.copy_from_slice(&c.q);
        let k = &mut c.exponents;
        balance(n, a, g, q, k);
        for (x, sides) in [
            (&mut d.a, [-1.0, 1.0]),
            (&mut c.a, [-1.0, 1.0]),
            (&mut d.q, [1.0, 1.0]),
            (&mut c.q, [1.0, 1.0]),
            (&mut c.g, [-1.0, -1.0]),
        ] {
            apply(k, sides, x, [n, n]);
        }
        apply(k, [-1.0, 0.0], &mut d.b, [n, m]);
        if d.has_cross {
            apply(k, [1.0, 0.0], &mut d.s, [n, m]);
        }
        for (e, &k) in d.scale.iter_mut().zip(k.iter()) {
            *e = *e + k;
        }
        if kind == Kind::Continuous {
            let size = largest(&c.a).max(largest(&c.g)).max(largest(&c.q));
            let e = T::select(size.gt(T::zero()), size.split().1, T::zero());
            let j = (e * T::splat(0.5)).round_ties_even();
            d.time = j + j;
            for x in [&mut d.a, &mut d.q, &mut c.a, &mut c.g, &mut c.q] {
                shift(x, -d.time);
            }
            shift(&mut d.b, -j);
            if d.has_cross {
                shift(&mut d.s, -j);
            }
            c.gamma = gamma(doubling, c.coefficients());
        }
    }
}

outlined! {
    /// Changes the unit of all states so that `G` comes to the size of `A`: of use
    /// where `A` is unstable and `Q` is so weak that `X` hardly depends on it.
    ///
    /// ```text
    /// x = 2^e x_s:   B 2^-e,  G 2^-2e,  Q 2^2e,  S 2^e
    /// ```
    pub(super) fn tilt(d: &'a mut Data<T>, c: &'a mut Reduced<T>) {
        let wanted = exponent_of(&c.g) - exponent_of(&c.a).max(T::zero());
        let e = (wanted * T::splat(0.5)).round_ties_even();
        shift(&mut d.b, -e);
        shift(&mut d.s, e);
        shift(&mut c.g, -(e + e));
        for x in [&mut d.q, &mut c.q] {
            shift(x, e + e);
        }
        for k in d.scale.iter_mut() {
            *k = *k + e;
        }
    }
}

outlined! {
    /// Undoes the scaling of a solution.
    pub(super) fn unscale(d: &'a Data<T>, x: &'a mut [T]) {
        apply(&d.scale, [-1.0, -1.0], x, [d.n, d.n]);
        shift(x, d.cost);
    }
}

outlined! {
    /// [`reduce`] without a shift for an `R` that is regular but not positive;
    /// false in lanes where it is singular.
    pub(super) fn reduce_indefinite(c: &'a mut Reduced<T>, d: &'a Data<T>) -> T::Mask {
        let (n, m) = (Dyn(d.n), Dyn(d.m));
        let ([bt, st], l) = (&mut c.tall, &mut c.factor);
        let mut perm = vec![T::zero(); d.m];
        c.a.copy_from_slice(&d.a);
        c.q.copy_from_slice(&d.q);
        l.copy_from_slice(&d.r);
        transpose(d.n, d.m, &d.b, bt);
        transpose(d.n, d.m, &d.s, st);
        let regular = lu_factor(m, l, &mut perm).ok;
        lu_solve(m, n, l, &perm, bt);
        lu_solve(m, n, l, &perm, st);
        mul_sub(n, m, n, &d.b, st, &mut c.a);
        mul(n, m, n, &d.b, bt, &mut c.g);
        mul_sub(n, m, n, &d.s, st, &mut c.q);
        symmetrize(n, &mut c.g);
        symmetrize(n, &mut c.q);
        regular
    }
}

outlined! {
    /// Reduces `d`, shifted by `x0 I` (see [`super::Block::solve`]). False in
    /// lanes where `R` is not positive.
    ///
    /// ```text
    /// R = L L',   A - (B L^-T)(S L^-T)',   G = (B L^-T)(B L^-T)',   Q - (S L^-T)(S L^-T)'
    /// shifted:  R + x0 B'B,  S + x0 A'B,  Q - x0 I + x0 A'A
    /// ```
    pub(super) fn reduce(c: &'a mut Reduced<T>, d: &'a Data<T>, x0: T) -> T::Mask {
        let (n, m) = (Dyn(d.n), Dyn(d.m));
        let ([scaled, ..], [bt, st], l) = (&mut c.squares, &mut c.tall, &mut c.factor);
        c.a.copy_from_slice(&d.a);
        c.q.copy_from_slice(&d.q);
        l.copy_from_slice(&d.r);
        transpose(d.n, d.m, &d.b, bt);
        let shifted = !x0.eq(T::zero()).all();
        if d.has_cross {
            transpose(d.n, d.m, &d.s, st);
        } else {
            st.fill(T::zero());
        }
        if shifted {
            for (t, &x) in scaled.iter_mut().zip(&d.a) {
                *t = x0 * x;
            }
            for (t, &x) in c.wide.iter_mut().zip(&d.b) {
                *t = x0 * x;
            }
            mul_add_tn(m, n, n, &d.b, scaled, st);
            mul_add_tn(m, n, m, &d.b, &c.wide, l);
            mul_add_tn(n, n, n, &d.a, scaled, &mut c.q);
            for i in 0..d.n {
                c.q[i * d.n + i] = c.q[i * d.n + i] - x0;
            }
        }
        let positive = cholesky(m, l);
        solve_lower(m, n, l, bt);
        sym_mul_tn(n, m, bt, bt, &mut c.g);
        if d.has_cross || shifted {
            solve_lower(m, n, l, st);
            mul_sub_tn(n, m, n, bt, st, &mut c.a);
            sym_mul_sub_tn(n, m, st, st, &mut c.q);
        }
        positive
    }
}
