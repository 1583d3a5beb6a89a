//! One lane block of Riccati differential equations over a step, in symmetric
//! doubling form.

use super::balance::{apply, shift};
use super::data::{Data, Kind, Reduced, reduce, scale_states, scale_units, unscale};
use super::doubling::Doubling;
use super::ops::{assign, largest, norm, outlined, transpose};
use crate::real::{Mask, Real};
use crate::small::{
    Dyn, add_assign, cholesky, lu_factor, lu_solve, mul, mul_add, scale, sym_mul_add_nt,
    sym_mul_add_tn, sym_mul_tn, symmetrize,
};

/// Terms of the exponential of a Hamiltonian of norm `2^-4`.
const TERMS: usize = 10;
/// `2^-4`, as the exponent that a step is brought to.
const STEP_EXPONENT: f64 = -4.0;
/// More doublings than the range of numbers has room for.
const MAX_DOUBLINGS: usize = 2200;
/// Where the transition is this small its square is zero.
const GONE: f64 = f64::from_bits((1023 - 520) << 52);
/// A transition this large is applied step by step from there on.
const LARGE: f64 = f64::from_bits((1023 + 200) << 52);
/// Steps after that.
const MAX_STEPS: usize = 64;
/// Share of the largest diagonal entry by which a matrix may miss being
/// semidefinite.
const SLACK: f64 = 1.0 / (1_u64 << 44) as f64;

/// Equations `dP/dt = F P + P F' - P H'R^-1 H P + Q` and steps of a block.
#[derive(Debug, Clone)]
pub(crate) struct Flow<T: Real> {
    /// `A = F'`, `B = H'`, `Q`, `R`; `S` zero. Fill before [`Flow::solve`].
    pub(crate) data: Data<T>,
    /// `P` before and after the step.
    pub(crate) p: Vec<T>,
    /// The step.
    pub(crate) h: T,
    /// Lanes whose `R` was not positive definite.
    pub(crate) indefinite: T::Mask,
    /// Lanes in which `P` left the finite within the step.
    pub(crate) escaped: T::Mask,
    /// Lanes that are solved.
    pub(crate) done: T::Mask,
    /// Doublings.
    pub(crate) steps: T,
    reduced: Reduced<T>,
    doubling: Doubling<T>,
    /// Transition, and what it differs from the identity by.
    e: Vec<T>,
    d: Vec<T>,
    g: Vec<T>,
    x: Vec<T>,
    next: [Vec<T>; 4],
    w: Vec<T>,
    v: Vec<T>,
    u: Vec<T>,
    perm: Vec<T>,
    big: [Vec<T>; 3],
}

impl<T: Real> Flow<T> {
    /// Room for order `n` with `m` outputs.
    #[inline(always)]
    pub(crate) fn new(n: usize, m: usize) -> Self {
        let zeros = |count: usize| vec![T::zero(); count];
        let square = || zeros(n * n);
        let none = T::Mask::splat(false);
        Flow {
            data: Data::new(n, m),
            p: square(),
            h: T::zero(),
            indefinite: none,
            escaped: none,
            done: none,
            steps: T::zero(),
            reduced: Reduced::new(n, m),
            doubling: Doubling::new(n),
            e: square(),
            d: square(),
            g: square(),
            x: square(),
            next: [square(), square(), square(), square()],
            w: square(),
            v: zeros(3 * n * n),
            u: square(),
            perm: zeros(n),
            big: [zeros(4 * n * n), zeros(4 * n * n), zeros(4 * n * n)],
        }
    }

    /// Makes the step, after scaling.
    ///
    /// ```text
    /// P(h) = H + E' P (I + G P)^-1 E
    /// ```
    #[inline(always)]
    pub(crate) fn solve(&mut self) {
        let n = self.data.n;
        scale_units(&mut self.data);
        self.indefinite = !reduce(&mut self.reduced, &self.data, T::zero());
        scale_states(&mut self.data, Kind::Continuous, &mut self.reduced, &mut self.doubling);
        apply(&self.data.scale, [1.0, 1.0], &mut self.p, [n, n]);
        shift(&mut self.p, -self.data.cost);
        let mut h = [self.h];
        shift(&mut h, self.data.time);
        let doublings = start(self, h[0]);
        let left = self.double(doublings);
        self.steps = doublings - left;
        self.advance(left);
        unscale(&self.data, &mut self.p);
    }

    /// Doubles the step `wanted` times; returns the doublings that were left
    /// undone where the transition became too large.
    #[inline(always)]
    fn double(&mut self, wanted: T) -> T {
        let n = self.data.n;
        self.escaped = T::Mask::splat(false);
        let definite = semidefinite(n, self.reduced.coefficients().q, &mut self.u);
        let mut left = wanted;
        for _ in 0..MAX_DOUBLINGS {
            let size = norm(&self.e);
            let active = left.gt(T::zero()) & size.gt(T::splat(GONE)) & size.le(T::splat(LARGE));
            if !active.any() {
                break;
            }
            if !definite.all() {
                let finite = stays_finite(n, &self.g, &self.x, &mut self.w, &mut self.u);
                self.escaped = self.escaped | (active & !definite & !finite);
            }
            double(self);
            let [d, e, g, x] = &self.next;
            assign(active, &mut self.d, d);
            assign(active, &mut self.e, e);
            assign(active, &mut self.g, g);
            assign(active, &mut self.x, x);
            left = T::select(active, left - T::one(), left);
        }
        // What has decayed stays so.
        let gone = norm(&self.e).le(T::splat(GONE));
        for e in &mut self.e {
            *e = T::select(gone, T::zero(), *e);
        }
        T::select(gone, T::zero(), left)
    }

    /// Takes `P` over `2^left` of the steps at hand, or until it settles.
    #[inline(always)]
    fn advance(&mut self, left: T) {
        let n = self.data.n;
        let definite = semidefinite(n, &self.p, &mut self.u);
        self.done = T::Mask::splat(false);
        let mut active = T::Mask::splat(true);
        for step in 0..MAX_STEPS {
            if !active.any() {
                break;
            }
            if !definite.all() {
                let finite = stays_finite(n, &self.g, &self.p, &mut self.w, &mut self.u);
                self.escaped = self.escaped | (active & !definite & !finite);
            }
            let change = move_p(self);
            let size = norm(&self.next[3]);
            assign(active, &mut self.p, &self.next[3]);
            let settled = change.le(size * T::splat(f64::EPSILON));
            let count = T::splat((step + 1) as f64);
            let small = left.le(T::splat(60.0));
            let all = small & T::pow2i(T::select(small, left, T::zero())).le(count);
            self.done = self.done | (active & size.is_finite() & (settled | all));
            active = active & !self.done & size.is_finite();
        }
        self.done = self.done & !self.escaped & !self.indefinite;
    }
}

outlined! {
    /// The step over `h 2^-k`, `k` large enough for the series; returns `k`.
    ///
    /// ```text
    /// M = [[-A, G], [Q, A']],   S = exp(M h 2^-k) - I
    /// E = (I + S11)^-1,   G = E S12,   H = S21 E
    /// ```
    fn start(f: &'a mut Flow<T>, h: T) -> T {
        let n = f.data.n;
        let c = f.reduced.coefficients();
        let sum = norm(c.a) + norm(c.g) + norm(c.q);
        let theta = h * sum;
        let (_, exponent) = theta.split();
        let k = exponent + T::splat(1.0 - STEP_EXPONENT);
        let k = T::select(k.gt(T::zero()) & theta.gt(T::zero()), k, T::zero());
        let mut delta = [h];
        shift(&mut delta, -k);
        let [z, s, t] = &mut f.big;
        let wide = 2 * n;
        for i in 0..n {
            for j in 0..n {
                z[i * wide + j] = -c.a[i * n + j] * delta[0];
                z[i * wide + n + j] = c.g[i * n + j] * delta[0];
                z[(n + i) * wide + j] = c.q[i * n + j] * delta[0];
                z[(n + i) * wide + n + j] = c.a[j * n + i] * delta[0];
            }
        }
        // S = Z (I + Z/2 (I + Z/3 (...)))
        s.copy_from_slice(z);
        scale(s, T::splat(1.0 / TERMS as f64));
        for term in (1..TERMS).rev() {
            for i in 0..wide {
                s[i * wide + i] = s[i * wide + i] + T::one();
            }
            mul(Dyn(wide), Dyn(wide), Dyn(wide), z, s, t);
            scale(t, T::splat(1.0 / term as f64));
            std::mem::swap(s, t);
        }
        // (I + S11) [D G] = [-S11 S12]
        let right = &mut f.v[..2 * n * n];
        for i in 0..n {
            for j in 0..n {
                let one = if i == j { T::one() } else { T::zero() };
                f.w[i * n + j] = s[i * wide + j] + one;
                right[i * wide + j] = -s[i * wide + j];
                right[i * wide + n + j] = s[i * wide + n + j];
                f.u[i * n + j] = s[(n + i) * wide + j];
            }
        }
        lu_factor(Dyn(n), &mut f.w, &mut f.perm);
        lu_solve(Dyn(n), Dyn(wide), &f.w, &f.perm, right);
        for i in 0..n {
            f.d[i * n..][..n].copy_from_slice(&right[i * wide..][..n]);
            f.g[i * n..][..n].copy_from_slice(&right[i * wide + n..][..n]);
        }
        with_identity(n, &f.d, &mut f.e);
        f.x.copy_from_slice(&f.u);
        mul_add(Dyn(n), Dyn(n), Dyn(n), &f.u, &f.d, &mut f.x);
        symmetrize(Dyn(n), &mut f.x);
        symmetrize(Dyn(n), &mut f.g);
        k
    }
}

/// `out = I + d`.
#[inline(always)]
fn with_identity<T: Real>(n: usize, d: &[T], out: &mut [T]) {
    out.copy_from_slice(d);
    for i in 0..n {
        out[i * n + i] = out[i * n + i] + T::one();
    }
}

outlined! {
    /// Two steps in one, into `next`: `D`, `E`, `G`, `H`.
    ///
    /// ```text
    /// W = I + G H,   N = W^-1 (D - G H)          E = I + D,  W^-1 E = I + N
    /// D <- D + N + D N,   G <- G + E W^-1 G E',   H <- H + E' H W^-1 E
    /// ```
    /// While `D` is small it is known to its own size, so that the slow modes of
    /// a stiff equation keep their rates through all doublings.
    fn double(f: &'a mut Flow<T>) {
        let size = f.data.n;
        let n = Dyn(size);
        let wide = 3 * size;
        let (w, v, u) = (&mut f.w, &mut f.v, &mut f.u);
        let [next_d, next_e, next_g, next_x] = &mut f.next;
        mul(n, n, n, &f.g, &f.x, u);
        with_identity(size, u, w);
        for i in 0..size {
            for j in 0..size {
                let at = i * size + j;
                v[i * wide + j] = f.d[at] - u[at];
                v[i * wide + size + j] = f.e[at];
                v[i * wide + 2 * size + j] = f.g[at];
            }
        }
        lu_factor(n, w, &mut f.perm);
        lu_solve(n, Dyn(wide), w, &f.perm, v);
        // G
        copy_columns(size, wide, 2 * size, v, w);
        mul(n, n, n, &f.e, w, u);
        next_g.copy_from_slice(&f.g);
        sym_mul_add_nt(n, n, u, &f.e, next_g);
        // H
        copy_columns(size, wide, size, v, w);
        mul(n, n, n, &f.x, w, u);
        next_x.copy_from_slice(&f.x);
        sym_mul_add_tn(n, n, &f.e, u, next_x);
        // E, and D where it is small
        mul(n, n, n, &f.e, w, next_e);
        copy_columns(size, wide, 0, v, w);
        mul(n, n, n, &f.d, w, next_d);
        add_assign(next_d, w);
        add_assign(next_d, &f.d);
        let small = norm(&f.d).le(T::splat(0.5));
        for i in 0..size {
            for j in 0..size {
                let at = i * size + j;
                let one = if i == j { T::one() } else { T::zero() };
                let (d, e) = (next_d[at], next_e[at]);
                next_e[at] = T::select(small, d + one, e);
                next_d[at] = T::select(small, d, e - one);
            }
        }
    }
}

/// Columns `from..from + n` of the n by `wide` matrix `v`.
#[inline(always)]
fn copy_columns<T: Real>(n: usize, wide: usize, from: usize, v: &[T], out: &mut [T]) {
    for i in 0..n {
        out[i * n..][..n].copy_from_slice(&v[i * wide + from..][..n]);
    }
}

outlined! {
    /// `H + E' P (I + G P)^-1 E` into the last of `next`; returns its distance
    /// from `P`.
    fn move_p(f: &'a mut Flow<T>) -> T {
        let n = Dyn(f.data.n);
        let (w, v, u) = (&mut f.w, &mut f.v[..f.data.n * f.data.n], &mut f.u);
        mul(n, n, n, &f.g, &f.p, u);
        with_identity(f.data.n, u, w);
        v.copy_from_slice(&f.e);
        lu_factor(n, w, &mut f.perm);
        lu_solve(n, n, w, &f.perm, v);
        mul(n, n, n, &f.p, v, u);
        let next = &mut f.next[3];
        next.copy_from_slice(&f.x);
        sym_mul_add_tn(n, n, &f.e, u, next);
        for (d, (&x, &p)) in u.iter_mut().zip(next.iter().zip(&f.p)) {
            *d = x - p;
        }
        norm(u)
    }
}

outlined! {
    /// Lanes in which the symmetric `a` is positive semidefinite, to rounding.
    fn semidefinite(n: usize, a: &'a [T], work: &'a mut [T]) -> T::Mask {
        raised(n, a, work);
        cholesky(Dyn(n), work)
    }
}

/// `a` with its diagonal raised by more than rounding.
#[inline(always)]
fn raised<T: Real>(n: usize, a: &[T], out: &mut [T]) {
    out.copy_from_slice(a);
    let size = largest(a);
    let tiny = T::splat(f64::MIN_POSITIVE);
    for i in 0..n {
        out[i * n + i] = out[i * n + i] + size.mul_add(T::splat(SLACK), tiny);
    }
}

outlined! {
    /// Lanes in which a solution that starts at `p` stays finite over a step with
    /// the (positive semidefinite) `g`, where that from zero does.
    ///
    /// ```text
    /// G = L L',   I + L' P L > 0
    /// ```
    /// `G` grows with the step, so this holds at all earlier times too.
    fn stays_finite(n: usize, g: &'a [T], p: &'a [T], work: &'a mut [T], l: &'a mut [T]) -> T::Mask {
        raised(n, g, l);
        let sound = cholesky(Dyn(n), l);
        for i in 0..n {
            for j in i + 1..n {
                l[i * n + j] = T::zero();
            }
        }
        let mut product = vec![T::zero(); n * n];
        mul(Dyn(n), Dyn(n), Dyn(n), p, l, &mut product);
        sym_mul_tn(Dyn(n), Dyn(n), l, &product, work);
        for i in 0..n {
            work[i * n + i] = work[i * n + i] + T::one();
        }
        cholesky(Dyn(n), work) & sound
    }
}

outlined! {
    /// Turns `F` (n by n) and `H` (m by n) in `a` and `b` into their transposes.
    pub(crate) fn transpose_data(d: &'a mut Data<T>) {
        let (n, m) = (d.n, d.m);
        let a = d.a.clone();
        transpose(n, n, &a, &mut d.a);
        let b = d.b.clone();
        transpose(m, n, &b, &mut d.b);
    }
}
