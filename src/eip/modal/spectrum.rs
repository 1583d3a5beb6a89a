//! Eigenvalues and eigenvectors of plants, one plant a lane.
//!
//! ```text
//! D^-1 A D = A_s,   Q' A_s Q = H     balanced, then Hessenberg
//! det(H - lambda I) = 0              Hyman's recursion, roots by Ehrlich and Aberth
//! (H - lambda I) x = b               two steps of inverse iteration, left and right
//! U' <- U' - (U' V - I) U'                                 left and right together
//! sum_k x_k u_k' = I,  sum_k lambda_k x_k u_k' = A_s       what is checked at the end
//! ```
//! Hyman (1957); Ehrlich (1967), Comm. ACM 10, 107-108; Aberth (1973), Math. Comp. 27,
//! 339-344; Wilkinson (1965), The Algebraic Eigenvalue Problem.
//!
//! No step looks at another lane, and a lane that has its roots keeps them while its
//! neighbours go on: its results have the same bits in any company. A lane that fails the
//! check (an ill-conditioned or a multiple eigenvalue) is left to another method.
//!
//! Limited by multiply-adds, some `100 n^3` of them.

mod vectors;

use crate::real::{Mask, Real};
use crate::small::Cx;
use crate::solve::lanes::balance;

/// Largest condition number of an eigenvalue that is accepted; those of plant and model
/// multiply.
pub(super) const CONDITION: f64 = 3e3;
/// Steps of the iteration for the roots; each triples the digits at the end.
const STEPS: usize = 60;
/// A step of this share of the root was the last but for its cube.
const SETTLED: f64 = 1e-7;
/// What the check allows: the errors of good vectors are some thousand roundings.
const ALLOWED: f64 = 1e-10;
/// An imaginary part below this share is the rounding of a real eigenvalue.
const REAL: f64 = 1e-10;

/// The eigenvalues of one lane block, and its buffers.
pub(super) struct Spectrum<T: Real> {
    n: usize,
    /// Both members of a pair are there; a real eigenvalue has a zero imaginary part
    /// and real vectors.
    pub(super) values: Vec<Cx<T>>,
    /// Column `k` of `V`, at `k n`.
    pub(super) right: Vec<Cx<T>>,
    /// Row `k` of `V^-1`, at `k n`.
    pub(super) left: Vec<Cx<T>>,
    next: Vec<Cx<T>>,
    a: Vec<T>,
    h: Vec<T>,
    q: Vec<T>,
    /// Exponents of `D`.
    scale: Vec<T>,
    v: Vec<T>,
    /// Of Hyman's recursion, and its derivative.
    x: Vec<Cx<T>>,
    dx: Vec<Cx<T>>,
    /// `H - lambda I = P L U`: `U`, the reciprocals of its diagonal, the entries of `L`.
    upper: Vec<Cx<T>>,
    inverse: Vec<Cx<T>>,
    factor: Vec<Cx<T>>,
    exchanged: Vec<T::Mask>,
}

/// `1 / z` for moderate `z`.
#[inline(always)]
fn reciprocal<T: Real>(z: Cx<T>) -> Cx<T> {
    z.conj().scale(z.norm_sqr().recip())
}

impl<T: Real> Spectrum<T> {
    /// Room for order `n`.
    pub(super) fn new(n: usize) -> Self {
        let (real, complex) = (|len| vec![T::zero(); len], |len| vec![Cx::zero(); len]);
        Spectrum {
            n,
            values: complex(n),
            right: complex(n * n),
            left: complex(n * n),
            next: complex(n * n),
            a: real(n * n),
            h: real(n * n),
            q: real(n * n),
            scale: real(n),
            v: real(n),
            x: complex(n),
            dx: complex(n),
            upper: complex(n * n),
            inverse: complex(n),
            factor: complex(n),
            exchanged: vec![T::Mask::splat(false); n],
        }
    }

    /// Diagonalises `a` (n by n), the roots looked for from `start` on; the lanes in
    /// which that passed the check.
    #[inline(always)]
    pub(super) fn set(&mut self, a: &[T], start: &[(f64, f64)]) -> T::Mask {
        self.balance(a);
        self.reduce();
        let least = self.anchor();
        self.roots(start, least);
        let mut good = T::Mask::splat(true);
        for k in 0..self.n {
            self.factor(self.values[k], least);
            good = good & self.vectors(k);
        }
        self.pair_up();
        for k in 0..self.n {
            self.classify(k, least);
        }
        good = good & self.check();
        self.unscale();
        for i in 0..self.n {
            // beyond it the powers of two of the balance are not normal numbers
            good = good & self.scale[i].abs().le(T::splat(500.0));
        }
        good
    }

    /// `A_s` into `a` and `h`.
    #[inline(always)]
    fn balance(&mut self, a: &[T]) {
        let n = self.n;
        self.h.copy_from_slice(a);
        balance(n, &mut self.h, &mut [], &mut [], &mut self.scale);
        for i in 0..n {
            for j in 0..n {
                let factor = T::pow2i(self.scale[j] - self.scale[i]);
                self.a[i * n + j] = a[i * n + j] * factor;
            }
        }
        self.h.copy_from_slice(&self.a);
    }

    /// Householder's reduction of `h` to `H`, its reflections gathered in `Q`.
    #[inline(always)]
    fn reduce(&mut self) {
        let n = self.n;
        let (h, q, v) = (&mut self.h[..], &mut self.q[..], &mut self.v[..]);
        crate::small::identity(crate::small::Dyn(n), q);
        for k in 0..n.saturating_sub(2) {
            let first = h[(k + 1) * n + k];
            let mut below = T::zero();
            for i in k + 2..n {
                v[i] = h[i * n + k];
                below = v[i].mul_add(v[i], below);
            }
            v[k + 1] = first + first.mul_add(first, below).sqrt().copysign(first);
            let size = v[k + 1].mul_add(v[k + 1], below);
            let needed = below.gt(T::zero());
            let beta = T::select(needed, T::splat(2.0) / size, T::zero());
            for j in k..n {
                let mut sum = T::zero();
                for i in k + 1..n {
                    sum = v[i].mul_add(h[i * n + j], sum);
                }
                let sum = sum * beta;
                for i in k + 1..n {
                    h[i * n + j] = v[i].neg_mul_add(sum, h[i * n + j]);
                }
            }
            for m in [&mut *h, &mut *q] {
                for row in m.chunks_exact_mut(n) {
                    let mut sum = T::zero();
                    for j in k + 1..n {
                        sum = row[j].mul_add(v[j], sum);
                    }
                    let sum = sum * beta;
                    for j in k + 1..n {
                        row[j] = v[j].neg_mul_add(sum, row[j]);
                    }
                }
            }
        }
    }

    /// Lifts the entries below the diagonal to one rounding of `|H|`, which is returned:
    /// the recursion divides by them.
    #[inline(always)]
    fn anchor(&mut self) -> T {
        let n = self.n;
        let mut size = T::zero();
        for i in 0..n {
            for j in i.saturating_sub(1)..n {
                size = self.h[i * n + j].mul_add(self.h[i * n + j], size);
            }
        }
        let least = T::splat(T::EPSILON) * size.sqrt();
        for i in 1..n {
            let x = self.h[i * n + i - 1];
            self.h[i * n + i - 1] = x.abs().max(least).copysign(x);
            self.v[i] = -self.h[i * n + i - 1].recip();
        }
        least
    }

    /// `p / p'` of the characteristic polynomial at `z`:
    ///
    /// ```text
    /// x_n = 1,   h_{i,i-1} x_{i-1} = z x_i - sum_{j >= i} h_ij x_j,   p ~ (h - z)_1 x
    /// ```
    #[inline(always)]
    fn newton(&mut self, z: Cx<T>) -> Cx<T> {
        let n = self.n;
        let (x, dx) = (&mut self.x[..], &mut self.dx[..]);
        (x[n - 1], dx[n - 1]) = (Cx::real(T::one()), Cx::zero());
        for i in (0..n).rev() {
            // row i of (H - z) x, and its derivative
            let row = &self.h[i * n..][..n];
            let mut sum = -(z * x[i]);
            let mut slope = -(z * dx[i]) - x[i];
            for j in i..n {
                sum = Cx::new(row[j].mul_add(x[j].re, sum.re), row[j].mul_add(x[j].im, sum.im));
                slope =
                    Cx::new(row[j].mul_add(dx[j].re, slope.re), row[j].mul_add(dx[j].im, slope.im));
            }
            if i == 0 {
                return sum * reciprocal(slope);
            }
            (x[i - 1], dx[i - 1]) = (sum.scale(self.v[i]), slope.scale(self.v[i]));
        }
        Cx::zero()
    }

    /// The roots, one after the other, each step with the latest of the others:
    ///
    /// ```text
    /// w = p / p',   z_i <- z_i - w / (1 - w sum_{j != i} 1 / (z_i - z_j))
    /// ```
    #[inline(always)]
    fn roots(&mut self, start: &[(f64, f64)], least: T) {
        let n = self.n;
        for (z, &(re, im)) in self.values.iter_mut().zip(start) {
            *z = Cx::new(T::splat(re), T::splat(im));
        }
        let (one, none) = (Cx::real(T::one()), T::Mask::splat(false));
        // `exchanged` serves for the roots that have settled.
        self.exchanged.fill(none);
        for _ in 0..STEPS {
            let mut all = T::Mask::splat(true);
            for i in 0..n {
                if self.exchanged[i].all() {
                    continue;
                }
                let z = self.values[i];
                let w = self.newton(z);
                let mut pull = Cx::zero();
                for j in 0..n {
                    if j != i {
                        pull = pull + reciprocal(z - self.values[j]);
                    }
                }
                let step = w * reciprocal(one - w * pull);
                let finite = step.abs1().is_finite();
                let moves = !self.exchanged[i] & finite;
                self.values[i] = Cx::select(moves, z - step, z);
                let close = step.abs1().le(T::splat(SETTLED).mul_add(z.abs1(), least));
                // A root where nothing is finite is found, or lost to the check.
                self.exchanged[i] = self.exchanged[i] | !finite | close;
                all = all & self.exchanged[i];
            }
            if all.all() {
                return;
            }
        }
    }

    /// Makes the left vectors the inverse of the right ones, of which they are some
    /// roundings over the distance of eigenvalues off:
    ///
    /// ```text
    /// E = U' V - I,   U' <- U' - E U'
    /// ```
    #[inline(always)]
    fn pair_up(&mut self) {
        let n = self.n;
        let (right, left, e) = (&self.right[..], &self.left[..], &mut self.upper[..]);
        for k in 0..n {
            for l in 0..n {
                let mut sum = Cx::zero();
                for i in 0..n {
                    sum = left[k * n + i].mul_add(right[l * n + i], sum);
                }
                if k == l {
                    sum.re = sum.re - T::one();
                }
                e[k * n + l] = sum;
            }
        }
        for k in 0..n {
            for i in 0..n {
                let mut sum = left[k * n + i];
                for l in 0..n {
                    sum = e[k * n + l].neg_mul_add(left[l * n + i], sum);
                }
                self.next[k * n + i] = sum;
            }
        }
        std::mem::swap(&mut self.left, &mut self.next);
    }

    /// Whether values and vectors give the identity and `A_s` again, as they are used: a
    /// real mode once, of a pair the upper member for both.
    #[inline(always)]
    fn check(&mut self) -> T::Mask {
        let n = self.n;
        for k in 0..n {
            let im = self.values[k].im;
            let one = T::select(im.eq(T::zero()), T::one(), T::zero());
            self.v[k] = T::select(im.gt(T::zero()), T::splat(2.0), one);
        }
        let (mut of_one, mut of_a, mut size) = (T::zero(), T::zero(), T::zero());
        let mut good = T::Mask::splat(true);
        for i in 0..n {
            for j in 0..n {
                let (mut one, mut a) = (T::zero(), -self.a[i * n + j]);
                if i == j {
                    one = -T::one();
                }
                for k in 0..n {
                    let part = self.right[k * n + i] * self.left[k * n + j];
                    one = part.re.mul_add(self.v[k], one);
                    a = (part * self.values[k]).re.mul_add(self.v[k], a);
                }
                of_one = one.abs().max(of_one);
                of_a = a.abs().max(of_a);
                size = self.a[i * n + j].abs().max(size);
                // the maximum passes over what is not a number
                good = good & one.is_finite() & a.is_finite();
            }
        }
        let allowed = T::splat(ALLOWED);
        good & of_one.le(allowed) & of_a.le(allowed * size)
    }

    /// Makes an eigenvalue that is real to rounding real, and its vectors.
    #[inline(always)]
    fn classify(&mut self, k: usize, least: T) {
        let n = self.n;
        let (right, left) = (&mut self.right[k * n..][..n], &mut self.left[k * n..][..n]);
        let value = self.values[k];
        let rounding = T::splat(REAL).mul_add(value.re.abs(), T::splat(64.0) * least);
        let real = value.im.abs().le(rounding);
        let (mut largest, mut turn) = (T::zero(), Cx::real(T::one()));
        for &x in right.iter() {
            let more = x.abs1().gt(largest);
            largest = T::select(more, x.abs1(), largest);
            turn = Cx::select(more, x, turn);
        }
        let back = reciprocal(turn);
        for i in 0..n {
            let (x, u) = (right[i] * back, left[i] * turn);
            right[i] = Cx::select(real, Cx::real(x.re), right[i]);
            left[i] = Cx::select(real, Cx::real(u.re), left[i]);
        }
        self.values[k].im = T::select(real, T::zero(), value.im);
    }

    /// Takes the balance out of the vectors.
    #[inline(always)]
    fn unscale(&mut self) {
        let n = self.n;
        for i in 0..n {
            let (up, down) = (T::pow2i(self.scale[i]), T::pow2i(-self.scale[i]));
            for k in 0..n {
                self.right[k * n + i] = self.right[k * n + i].scale(up);
                self.left[k * n + i] = self.left[k * n + i].scale(down);
            }
        }
    }
}
