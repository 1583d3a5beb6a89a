//! Structure-preserving doubling for Riccati equations, across lanes.

use super::balance::exponent_of;
use super::ops::outlined;
use super::powers::{gamma_near, mean_log2_of_pivots};
use crate::real::{Mask, Real};
use crate::small::{Dyn, dot, inverse, lu_factor, lu_solve, mul, sym_mul_add_nt, sym_mul_tn};

/// Steps after which a lane is given up.
const MAX_STEPS: usize = 48;
/// Relative change of `H` at which the next step would change nothing: the
/// error is squared in each, and a Newton step follows.
const SETTLED: f64 = 1.0 / (1_u64 << 27) as f64;

/// The coefficients `A`, `G`, `Q` (n by n, `G` and `Q` symmetric) of a Riccati
/// equation without cross term, in one lane block.
///
/// ```text
/// continuous   A'X + XA - X G X + Q = 0
/// discrete     A'X (I + G X)^-1 A - X + Q = 0
/// ```
#[derive(Clone, Copy)]
pub(crate) struct Coefficients<'a, T> {
    pub(crate) a: &'a [T],
    pub(crate) g: &'a [T],
    pub(crate) q: &'a [T],
}

/// The iterates of the doubling, and its scratch.
#[derive(Debug, Clone)]
pub(crate) struct Doubling<T: Real> {
    n: usize,
    e: Vec<T>,
    g: Vec<T>,
    /// Tends to `X`.
    pub(crate) h: Vec<T>,
    /// Lanes in which `H` settled.
    pub(crate) settled: T::Mask,
    /// Steps made in each lane.
    pub(crate) steps: T,
    next_g: Vec<T>,
    next_h: Vec<T>,
    w: Vec<T>,
    /// `W^-1 E`, then `W^-1 G`.
    v: Vec<T>,
    u: Vec<T>,
    perm: Vec<T>,
    /// Order 2 n, for the start of the continuous equation.
    big: [Vec<T>; 2],
}

impl<T: Real> Doubling<T> {
    /// Room for order `n`.
    #[inline(always)]
    pub(crate) fn new(n: usize) -> Self {
        let square = || vec![T::zero(); n * n];
        Doubling {
            n,
            e: square(),
            g: square(),
            h: square(),
            settled: T::Mask::splat(false),
            steps: T::zero(),
            next_g: square(),
            next_h: square(),
            w: square(),
            v: square(),
            u: square(),
            perm: vec![T::zero(); 2 * n],
            big: [Vec::new(), Vec::new()],
        }
    }

    /// Starts on a discrete equation: `E = A`, `G = G`, `H = Q`.
    #[inline(always)]
    pub(crate) fn start_discrete(&mut self, c: Coefficients<'_, T>) {
        self.e.copy_from_slice(c.a);
        self.g.copy_from_slice(c.g);
        self.h.copy_from_slice(c.q);
    }

    /// Doubles until `H` settles in every lane of `wanted`, or the steps run out.
    ///
    /// ```text
    /// W = I + G H
    /// E <- E W^-1 E,   G <- G + E W^-1 G E',   H <- H + E' H W^-1 E
    /// ```
    /// (Anderson 1978; Chu, Fan, Lin, Wang 2004.) A lane that has settled or
    /// failed keeps its values.
    #[inline(always)]
    pub(crate) fn run(&mut self, wanted: T::Mask) {
        self.settled = T::Mask::splat(false);
        self.steps = T::zero();
        let mut active = wanted;
        for _ in 0..MAX_STEPS {
            if !active.any() {
                return;
            }
            let (change, size, regular) = step_h(self);
            let sound = regular & change.is_finite() & size.is_finite();
            let settled = sound & change.le(size * T::splat(SETTLED * SETTLED));
            // A lane that settled or failed has no use for the rest of the step.
            if (active & sound & !settled).any() {
                step_rest(self);
            }
            self.keep(active & sound);
            self.steps = T::select(active, self.steps + T::one(), self.steps);
            self.settled = self.settled | (active & settled);
            active = active & sound & !settled;
        }
    }

    /// Takes over the step where `taken`.
    #[inline(always)]
    fn keep(&mut self, taken: T::Mask) {
        if taken.all() {
            std::mem::swap(&mut self.e, &mut self.u);
            std::mem::swap(&mut self.g, &mut self.next_g);
            std::mem::swap(&mut self.h, &mut self.next_h);
            return;
        }
        let pairs =
            [(&mut self.e, &self.u), (&mut self.g, &self.next_g), (&mut self.h, &self.next_h)];
        for (old, new) in pairs {
            for (x, &y) in old.iter_mut().zip(new) {
                *x = T::select(taken, y, *x);
            }
        }
    }
}

outlined! {
    /// The first half of a step, into `next_h`; returns `|H+ - H|^2`, `|H+|^2` and
    /// the lanes in which `W` was regular. Leaves the factors of `W` in `w`, `W^-1 E`
    /// in `v`.
    fn step_h(d: &'a mut Doubling<T>) -> (T, T, T::Mask) {
        let size = d.n;
        let n = Dyn(size);
        let (w, v, u) = (&mut d.w, &mut d.v, &mut d.u);
        mul(n, n, n, &d.g, &d.h, w);
        for i in 0..size {
            w[i * size + i] = w[i * size + i] + T::one();
        }
        v.copy_from_slice(&d.e);
        let regular = lu_factor(n, w, &mut d.perm[..size]).ok;
        lu_solve(n, n, w, &d.perm[..size], v);
        // H+ = H + E' (H V)
        mul(n, n, n, &d.h, v, u);
        sym_mul_tn(n, n, &d.e, u, &mut d.next_h);
        let change = dot(&d.next_h, &d.next_h);
        for (x, &h) in d.next_h.iter_mut().zip(&d.h) {
            *x = *x + h;
        }
        (change, dot(&d.next_h, &d.next_h), regular)
    }
}

outlined! {
    /// The second half of a step, into `u` (next `E`) and `next_g`.
    fn step_rest(d: &'a mut Doubling<T>) {
        let n = Dyn(d.n);
        // E+ = E W^-1 E, into `next_g` for the time being
        mul(n, n, n, &d.e, &d.v, &mut d.next_g);
        d.v.copy_from_slice(&d.g);
        lu_solve(n, n, &d.w, &d.perm[..d.n], &mut d.v);
        // G+ = G + (E V) E'
        mul(n, n, n, &d.e, &d.v, &mut d.u);
        d.v.copy_from_slice(&d.g);
        sym_mul_add_nt(n, n, &d.u, &d.e, &mut d.v);
        std::mem::swap(&mut d.u, &mut d.next_g);
        std::mem::swap(&mut d.next_g, &mut d.v);
    }
}

outlined! {
    /// `N = [[A - gamma I, -G], [-Q, -(A - gamma I)']]`.
    fn hamiltonian(d: &'a mut Doubling<T>, c: Coefficients<'a, T>, gamma: T) {
        let n = d.n;
        for big in &mut d.big {
            big.resize(4 * n * n, T::zero());
        }
        let [m, _] = &mut d.big;
        for i in 0..n {
            for j in 0..n {
                let shift = if i == j { gamma } else { T::zero() };
                m[i * 2 * n + j] = c.a[i * n + j] - shift;
                m[i * 2 * n + n + j] = -c.g[i * n + j];
                m[(n + i) * 2 * n + j] = -c.q[i * n + j];
                m[(n + i) * 2 * n + n + j] = shift - c.a[j * n + i];
            }
        }
    }
}

outlined! {
    /// A Cayley parameter: about the geometric mean of `|lambda|` over the
    /// eigenvalues of the Hamiltonian, from its determinant.
    pub(crate) fn gamma(d: &'a mut Doubling<T>, c: Coefficients<'a, T>) -> T {
        let n = d.n;
        hamiltonian(d, c, T::zero());
        let [m, _] = &mut d.big;
        let size = exponent_of(m);
        let regular = lu_factor(Dyn(2 * n), m, &mut d.perm).ok;
        let mean = mean_log2_of_pivots(2 * n, m);
        gamma_near(T::select(regular, mean, size), size)
    }
}

outlined! {
    /// Starts on a continuous equation with the Cayley parameter `gamma`.
    ///
    /// ```text
    /// T = N^-1:   E = I + 2 gamma T11,   G = -2 gamma T12,   H = -2 gamma T21
    /// ```
    /// One inverse of order 2n, which exists whenever `gamma` is no eigenvalue of
    /// the Hamiltonian, even where `A - gamma I` is singular. False in lanes
    /// where it does not.
    pub(crate) fn start_continuous(d: &'a mut Doubling<T>, c: Coefficients<'a, T>, gamma: T) -> T::Mask {
        let n = d.n;
        hamiltonian(d, c, gamma);
        let [m, t] = &mut d.big;
        let regular = inverse(Dyn(2 * n), m, t, &mut d.perm).ok;
        let two_gamma = T::select(regular, gamma + gamma, T::zero());
        let half = -T::splat(0.5) * two_gamma;
        for i in 0..n {
            for j in 0..n {
                let one = if i == j { T::one() } else { T::zero() };
                d.e[i * n + j] = two_gamma.mul_add(t[i * 2 * n + j], one);
                d.g[i * n + j] = half * (t[i * 2 * n + n + j] + t[j * 2 * n + n + i]);
                d.h[i * n + j] = half * (t[(n + i) * 2 * n + j] + t[(n + j) * 2 * n + i]);
            }
        }
        regular
    }
}
