//! The residual of a Riccati solution in twice the working precision.

use super::bound::FirstLook;
use super::data::{Data, Kind};
use super::double::{Form, Pair, PairMut, mul_add_two, symmetric_sum, two_sum};
use super::newton::Newton;
use super::ops::{norm, outlined, transpose};
use crate::real::Real;
use crate::small::{
    Dyn, lu_factor, lu_solve, mul, mul_add, mul_add_tn, mul_sub, mul_tn, scale, sym_mul_sub_tn,
};

/// `S'`, m by n.
#[inline(always)]
fn cross<T: Real>(d: &Data<T>, out: &mut [T]) {
    if d.has_cross {
        transpose(d.n, d.m, &d.s, out);
    } else {
        out.fill(T::zero());
    }
}

outlined! {
    /// The gain for `x`.
    pub(super) fn gain(s: &'a mut Newton<T>, kind: Kind, d: &'a Data<T>, x: &'a [T]) -> T::Mask {
        let (n, m) = (Dyn(d.n), Dyn(d.m));
        let product = &mut s.work[..d.m * d.n];
        s.r.copy_from_slice(&d.r);
        cross(d, &mut s.k);
        match kind {
            Kind::Continuous => mul_add_tn(m, n, n, &d.b, x, &mut s.k),
            Kind::Discrete => {
                mul_tn(m, n, n, &d.b, x, product);
                mul_add(m, n, m, product, &d.b, &mut s.r);
                mul_add(m, n, n, product, &d.a, &mut s.k);
            }
        }
        let perm = &mut s.perm[..d.m];
        let regular = lu_factor(m, &mut s.r, perm).ok;
        lu_solve(m, n, &s.r, perm, &mut s.k);
        regular
    }
}

outlined! {
    /// The residual of `x` and the closed loop, in plain arithmetic; otherwise as
    /// [`residual`].
    pub(super) fn plain_residual(w: &'a mut Newton<T>, kind: Kind, d: &'a Data<T>, x: &'a [T]) -> FirstLook<T> {
        let (order, inputs) = (d.n, d.m);
        let (n, m) = (Dyn(order), Dyn(inputs));
        let (two, half) = (T::splat(2.0), T::splat(0.5));
        let (closed, p, sum, v) = (&mut w.loop_[0], &mut w.p[0], &mut w.m[0], &mut w.v[0]);
        closed.copy_from_slice(&d.a);
        mul_sub(n, m, n, &d.b, &w.k, closed);
        // V = R K - 2 S'
        cross(d, v);
        if d.has_cross {
            scale(v, T::splat(-2.0));
        }
        mul_add(m, m, n, &d.r, &w.k, v);
        mul(n, n, n, x, closed, p);
        mul_tn(n, m, n, &w.k, v, sum);
        let (of_x, of_loop) = (norm(x), norm(closed));
        let others = norm(&d.q) + norm(sum);
        let others_apart = norm(&w.k).mul_add(norm(v), norm(&d.q));
        let (size, terms) = match kind {
            Kind::Continuous => {
                let sizes = two.mul_add(norm(p), others);
                for (s, &p) in sum.iter_mut().zip(p.iter()) {
                    *s = two.mul_add(p, *s);
                }
                (sizes, two.mul_add(of_x * of_loop, others_apart))
            }
            Kind::Discrete => {
                mul_add_tn(n, n, n, closed, p, sum);
                for (s, &x) in sum.iter_mut().zip(x) {
                    *s = *s - x;
                }
                let terms = (of_loop * of_loop).mul_add(of_x, of_x + others_apart);
                (two.mul_add(of_x, others), terms)
            }
        };
        for i in 0..order {
            for j in 0..=i {
                let (u, v) = (i * order + j, j * order + i);
                let r = half.mul_add(sum[u] + sum[v], d.q[u]);
                w.dx[u] = r;
                w.dx[v] = r;
            }
        }
        let size = T::select(size.gt(T::zero()), size, T::one());
        FirstLook { residual: norm(&w.dx) / size, size, terms: terms / size }
    }
}

outlined! {
    /// The residual of `x`, into `dx`; returns the sum of the norms of its terms.
    ///
    /// ```text
    /// continuous   Q + sym(2 X A_K + K'(R K - 2 S'))
    /// discrete     Q - X + sym(A_K' X A_K + K'(R K - 2 S')),     sym(M) = (M + M')/2
    /// ```
    /// For any `K` these differ from the equation by the square of the error in
    /// `K`, and `R^-1` never enters. They are summed in twice the working
    /// precision, on the data as given.
    pub(super) fn residual(w: &'a mut Newton<T>, kind: Kind, d: &'a Data<T>, x: &'a [T]) -> T {
        let (n, m) = (d.n, d.m);
        let [loop_hi, loop_lo] = &mut w.loop_;
        loop_hi.copy_from_slice(&d.a);
        loop_lo.fill(T::zero());
        let k = Pair::from(&w.k[..]);
        let target = PairMut { hi: loop_hi, lo: loop_lo };
        mul_add_two(Form::Plain, -1.0, Pair::from(&d.b[..]), k, target, [n, m, n]);
        // V = R K - 2 S'
        let [v_hi, v_lo] = &mut w.v;
        cross(d, v_hi);
        if d.has_cross {
            scale(v_hi, T::splat(-2.0));
        }
        v_lo.fill(T::zero());
        let target = PairMut { hi: v_hi, lo: v_lo };
        mul_add_two(Form::Plain, 1.0, Pair::from(&d.r[..]), k, target, [m, m, n]);
        let v = Pair { hi: &w.v[0], lo: &w.v[1] };
        // P = X A_K
        let closed = Pair { hi: &w.loop_[0], lo: &w.loop_[1] };
        let [p_hi, p_lo] = &mut w.p;
        p_hi.fill(T::zero());
        p_lo.fill(T::zero());
        let target = PairMut { hi: &mut *p_hi, lo: &mut *p_lo };
        mul_add_two(Form::Plain, 1.0, Pair::from(x), closed, target, [n, n, n]);
        // M = K' V, then + 2 P or + A_K' P
        let [m_hi, m_lo] = &mut w.m;
        m_hi.fill(T::zero());
        m_lo.fill(T::zero());
        let target = PairMut { hi: &mut *m_hi, lo: &mut *m_lo };
        mul_add_two(Form::LeftTransposed, 1.0, k, v, target, [n, m, n]);
        let mut size = norm(&d.q) + norm(m_hi);
        let two = T::splat(2.0);
        match kind {
            Kind::Continuous => {
                size = two.mul_add(norm(p_hi), size);
                for i in 0..n * n {
                    let (s, e) = two_sum(m_hi[i], two * p_hi[i]);
                    m_hi[i] = s;
                    m_lo[i] = m_lo[i] + two.mul_add(p_lo[i], e);
                }
                let sum = Pair { hi: &w.m[0], lo: &w.m[1] };
                symmetric_sum(n, sum, &d.q, &mut w.dx);
            }
            Kind::Discrete => {
                size = size + two * norm(x);
                let product = Pair { hi: &w.p[0], lo: &w.p[1] };
                let target = PairMut { hi: &mut *m_hi, lo: &mut *m_lo };
                mul_add_two(Form::LeftTransposed, 1.0, closed, product, target, [n, n, n]);
                for i in 0..n * n {
                    let (s, e) = two_sum(m_hi[i], -x[i]);
                    m_hi[i] = s;
                    m_lo[i] = m_lo[i] + e;
                }
                let sum = Pair { hi: &w.m[0], lo: &w.m[1] };
                symmetric_sum(n, sum, &d.q, &mut w.dx);
            }
        }
        T::select(size.gt(T::zero()), size, T::one())
    }
}

outlined! {
    /// Takes the error of the computed gain out of the residual and the closed
    /// loop: in an ill-conditioned problem even its square can be seen.
    ///
    /// ```text
    /// E = B'X + S' - R K   (B'X A_K in discrete time),   d = (R + B'XB)^-1 E
    /// Res <- Res - E'd,    A_K <- A_K - B d
    /// ```
    pub(super) fn sharpen(w: &'a mut Newton<T>, kind: Kind, d: &'a Data<T>, x: &'a [T]) {
        let (n, m) = (d.n, d.m);
        let [e_hi, e_lo] = &mut w.v;
        cross(d, e_hi);
        e_lo.fill(T::zero());
        let target = PairMut { hi: &mut *e_hi, lo: &mut *e_lo };
        let k = Pair::from(&w.k[..]);
        mul_add_two(Form::Plain, -1.0, Pair::from(&d.r[..]), k, target, [m, m, n]);
        let right = match kind {
            Kind::Continuous => Pair::from(x),
            Kind::Discrete => Pair { hi: &w.p[0], lo: &w.p[1] },
        };
        let target = PairMut { hi: &mut *e_hi, lo: &mut *e_lo };
        mul_add_two(Form::LeftTransposed, 1.0, Pair::from(&d.b[..]), right, target, [m, n, n]);
        e_lo.copy_from_slice(e_hi);
        let (n, m) = (Dyn(n), Dyn(m));
        lu_solve(m, n, &w.r, &w.perm[..d.m], e_lo);
        sym_mul_sub_tn(n, m, e_hi, e_lo, &mut w.dx);
        mul_sub(n, m, n, &d.b, e_lo, &mut w.loop_[0]);
    }
}
