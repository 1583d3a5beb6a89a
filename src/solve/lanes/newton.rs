//! Newton's correction of a Riccati solution, which also verifies it.

use super::double::{Form, Pair, PairMut, mul_add_two, symmetric_sum, two_sum};
use super::powers::{Cayley, gamma_of};
use super::riccati::{Data, Kind};
use super::smith::{lyapunov_dual, stein_dual};
use crate::real::{Mask, Real};
use crate::small::{Dyn, lu_factor, lu_solve, mul_add, mul_tn, norm_frobenius, transpose};

/// Corrections after which a lane is given up.
const MAX_CORRECTIONS: usize = 6;
/// Relative correction whose square is below rounding: it is the last.
const LAST: f64 = 1e-10;

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
    cayley: Cayley<T>,
    /// Gain, m by n, and a product of the same shape in two parts.
    k: Vec<T>,
    v: [Vec<T>; 2],
    /// `R + B'XB` and the exchanges of its factors.
    r: Vec<T>,
    perm: Vec<T>,
    /// Closed loop and a product, in two parts each.
    loop_: [Vec<T>; 2],
    p: [Vec<T>; 2],
    m: [Vec<T>; 2],
    dx: Vec<T>,
    work: Vec<T>,
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
            cayley: Cayley::new(n),
            k: zeros(m * n),
            v: two(m * n),
            r: zeros(m * m),
            perm: zeros(n.max(m)),
            loop_: two(n * n),
            p: two(n * n),
            m: two(n * n),
            dx: zeros(n * n),
            work: zeros(2 * n * n.max(m)),
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
        self.steps = T::zero();
        self.done = T::Mask::splat(false);
        let mut active = wanted;
        for _ in 0..MAX_CORRECTIONS {
            if !active.any() {
                return;
            }
            self.gain(kind, d, x);
            let size = self.residual_of(kind, d, x);
            let residual = norm_frobenius(&self.dx) / size;
            let stable = self.solve(kind, d.n);
            let correction = norm_frobenius(&self.dx) / norm_frobenius(x);
            // X = 0 is corrected by 0: not a failure
            let none = norm_frobenius(&self.dx).eq(T::zero());
            let correction = T::select(none, T::zero(), correction);
            let sound = active & stable & correction.is_finite();
            self.residual = T::select(active, residual, self.residual);
            self.correction = T::select(active, correction, self.correction);
            for (x, &y) in x.iter_mut().zip(&self.dx) {
                *x = T::select(sound, *x + y, *x);
            }
            let last = sound & correction.le(T::splat(LAST));
            let margin = T::from_fn(|lane| match kind {
                Kind::Continuous => self.cayley.margin(lane),
                Kind::Discrete => self.cayley.powers.margin(lane),
            });
            let squarings = T::from_fn(|lane| f64::from(self.cayley.powers.squarings(lane)));
            self.steps = T::select(active, self.steps + squarings, self.steps);
            self.margin = T::select(last, margin, self.margin);
            self.done = self.done | last;
            active = sound & !last;
        }
    }

    /// The gain for `x`.
    #[inline(always)]
    fn gain(&mut self, kind: Kind, d: &Data<T>, x: &[T]) {
        let (n, m) = (Dyn(d.n), Dyn(d.m));
        let product = &mut self.work[..d.m * d.n];
        self.r.copy_from_slice(&d.r);
        transpose(n, m, &d.s, &mut self.k);
        match kind {
            Kind::Continuous => crate::small::mul_add_tn(m, n, n, &d.b, x, &mut self.k),
            Kind::Discrete => {
                mul_tn(m, n, n, &d.b, x, product);
                mul_add(m, n, m, product, &d.b, &mut self.r);
                mul_add(m, n, n, product, &d.a, &mut self.k);
            }
        }
        let perm = &mut self.perm[..d.m];
        let _ = lu_factor(m, &mut self.r, perm);
        lu_solve(m, n, &self.r, perm, &mut self.k);
    }

    /// The residual of `x`, into `dx`; returns the sum of the norms of its terms.
    ///
    /// ```text
    /// continuous   Q + sym(2 X A_K + K'(R K - 2 S'))
    /// discrete     Q - X + sym(A_K' X A_K + K'(R K - 2 S')),     sym(M) = (M + M')/2
    /// ```
    /// For any `K` these differ from the equation by the square of the error in
    /// `K`: a gain in working precision will do, and `R^-1` never enters. They
    /// are summed in twice the working precision, on the data as given.
    #[inline(always)]
    fn residual_of(&mut self, kind: Kind, d: &Data<T>, x: &[T]) -> T {
        let (n, m) = (d.n, d.m);
        let [loop_hi, loop_lo] = &mut self.loop_;
        loop_hi.copy_from_slice(&d.a);
        loop_lo.fill(T::zero());
        let k = Pair::from(&self.k[..]);
        let target = PairMut { hi: loop_hi, lo: loop_lo };
        mul_add_two(Form::Plain, -1.0, Pair::from(&d.b[..]), k, target, [n, m, n]);
        // V = R K - 2 S'
        let [v_hi, v_lo] = &mut self.v;
        for j in 0..m {
            for i in 0..n {
                v_hi[j * n + i] = T::splat(-2.0) * d.s[i * m + j];
            }
        }
        v_lo.fill(T::zero());
        let target = PairMut { hi: v_hi, lo: v_lo };
        mul_add_two(Form::Plain, 1.0, Pair::from(&d.r[..]), k, target, [m, m, n]);
        let v = Pair { hi: &self.v[0], lo: &self.v[1] };
        // P = X A_K
        let closed = Pair { hi: &self.loop_[0], lo: &self.loop_[1] };
        let [p_hi, p_lo] = &mut self.p;
        p_hi.fill(T::zero());
        p_lo.fill(T::zero());
        let target = PairMut { hi: &mut *p_hi, lo: &mut *p_lo };
        mul_add_two(Form::Plain, 1.0, Pair::from(x), closed, target, [n, n, n]);
        // M = K' V, then + 2 P or + A_K' P
        let [m_hi, m_lo] = &mut self.m;
        m_hi.fill(T::zero());
        m_lo.fill(T::zero());
        let target = PairMut { hi: &mut *m_hi, lo: &mut *m_lo };
        mul_add_two(Form::LeftTransposed, 1.0, k, v, target, [n, m, n]);
        let mut size = norm_frobenius(&d.q) + norm_frobenius(m_hi);
        let two = T::splat(2.0);
        match kind {
            Kind::Continuous => {
                size = two.mul_add(norm_frobenius(p_hi), size);
                for i in 0..n * n {
                    let (s, e) = two_sum(m_hi[i], two * p_hi[i]);
                    m_hi[i] = s;
                    m_lo[i] = m_lo[i] + two.mul_add(p_lo[i], e);
                }
                let sum = Pair { hi: &self.m[0], lo: &self.m[1] };
                symmetric_sum(n, sum, &d.q, &mut self.dx);
            }
            Kind::Discrete => {
                size = size + two * norm_frobenius(x);
                let product = Pair { hi: &self.p[0], lo: &self.p[1] };
                let target = PairMut { hi: &mut *m_hi, lo: &mut *m_lo };
                mul_add_two(Form::LeftTransposed, 1.0, closed, product, target, [n, n, n]);
                for i in 0..n * n {
                    let (s, e) = two_sum(m_hi[i], -x[i]);
                    m_hi[i] = s;
                    m_lo[i] = m_lo[i] + e;
                }
                let sum = Pair { hi: &self.m[0], lo: &self.m[1] };
                symmetric_sum(n, sum, &d.q, &mut self.dx);
            }
        }
        T::select(size.gt(T::zero()), size, T::one())
    }

    /// Turns the residual in `dx` into the correction; true where the closed loop
    /// was shown to be stable.
    #[inline(always)]
    fn solve(&mut self, kind: Kind, n: usize) -> T::Mask {
        let closed = &self.loop_[0];
        match kind {
            Kind::Continuous => {
                let perm = &mut self.perm[..n];
                let gamma = gamma_of(n, closed, &mut self.work[..n * n], perm);
                self.cayley.set(closed, gamma);
                lyapunov_dual(&self.cayley, &mut self.dx, &mut self.work);
            }
            Kind::Discrete => {
                self.cayley.powers.set(closed);
                stein_dual(&self.cayley.powers, &mut self.dx, &mut self.work);
            }
        }
        self.cayley.powers.stable
    }
}
