//! Upsilon of a (plant, model) pair by the full augmented Lyapunov equation.

use super::equations::*;
use super::matrix::*;

/// A plant and the covariances (intensities) of its white noises.
///
/// ```text
/// x' = A x + B u + w, w ~ Q;  y = C x + v, v ~ R      (x+ in discrete time)
/// ```
#[derive(Clone)]
pub struct Plant {
    /// `A`.
    pub a: M,
    /// `B`.
    pub b: M,
    /// `C`.
    pub c: M,
    /// `Q`.
    pub q: M,
    /// `R`.
    pub r: M,
}

/// A coloured signal `z = C x`, `x' = A x + w`, `w ~ Q`.
pub struct Signal {
    /// `A`.
    pub a: M,
    /// `C`.
    pub c: M,
    /// `Q`.
    pub q: M,
}

/// A controller `u = C x`, `x' = A x + B y`.
pub struct Controller {
    /// `A`.
    pub a: M,
    /// `B`.
    pub b: M,
    /// `C`.
    pub c: M,
}

/// Everything but the observer; the plant's own states come first.
///
/// ```text
/// x' = A x + w + N v,  y = C_y x + v,  u = C_u x,  w ~ Q,  v ~ R
/// ```
pub struct Block {
    /// `A`.
    pub a: M,
    /// `Q`.
    pub q: M,
    /// `N`, the way of the measurement noise into the loop.
    pub n: M,
    /// `R`.
    pub r: M,
    /// `C_y`.
    pub c_y: M,
    /// `C_u`.
    pub c_u: M,
}

/// An observer `xhat' = A xhat + B u + H (y - C xhat)` of the block's first states.
pub struct Observer {
    /// `A`.
    pub a: M,
    /// `B`.
    pub b: M,
    /// `C`.
    pub c: M,
    /// Gain.
    pub h: M,
}

fn block_diag(a: &M, b: &M) -> M {
    let ((n, m), (k, l)) = (shape(a), shape(b));
    blocks(&[&[a, &zeros(n, l)], &[&zeros(k, m), b]])
}

impl Signal {
    /// A filter `x' = A x + B nu`, `nu` white of covariance `xi`.
    pub fn filter(a: &M, b: &M, c: &M, xi: &M) -> Signal {
        let q = prod(&[b, xi, &t(b)]);
        let (a, c) = (a.clone(), c.clone());
        Signal { a, c, q }
    }

    /// The signal at multiples of `dt`.
    pub fn sampled(&self, dt: f64) -> Signal {
        Signal {
            a: expm(&scale(dt, &self.a)),
            c: self.c.clone(),
            q: van_loan(&self.a, &self.q, dt),
        }
    }
}

impl Controller {
    /// Zero-order hold.
    pub fn sampled(&self, dt: f64) -> Controller {
        let (a, b) = hold(&self.a, &self.b, dt);
        let c = self.c.clone();
        Controller { a, b, c }
    }
}

impl Plant {
    /// The plant with a coloured disturbance `G d` in addition, its states appended.
    pub fn with_disturbance(&self, g: &M, d: &Signal) -> Plant {
        let (n, k) = (self.a.len(), d.a.len());
        Plant {
            a: blocks(&[&[&self.a, &mul(g, &d.c)], &[&zeros(k, n), &d.a]]),
            b: blocks(&[&[&self.b], &[&zeros(k, shape(&self.b).1)]]),
            c: blocks(&[&[&self.c, &zeros(self.c.len(), k)]]),
            q: block_diag(&self.q, &d.q),
            r: self.r.clone(),
        }
    }

    /// Zero-order hold, sampled process noise, measurement noise `R/dt`.
    pub fn sampled(&self, dt: f64) -> Plant {
        let (a, b) = hold(&self.a, &self.b, dt);
        Plant {
            a,
            b,
            c: self.c.clone(),
            q: van_loan(&self.a, &self.q, dt),
            r: scale(1.0 / dt, &self.r),
        }
    }

    /// Open loop, `u` a coloured signal.
    pub fn open(&self, u: &Signal) -> Block {
        let (n, k, q) = (self.a.len(), u.a.len(), self.c.len());
        Block {
            a: blocks(&[&[&self.a, &mul(&self.b, &u.c)], &[&zeros(k, n), &u.a]]),
            q: block_diag(&self.q, &u.q),
            n: zeros(n + k, q),
            r: self.r.clone(),
            c_y: blocks(&[&[&self.c, &zeros(q, k)]]),
            c_u: blocks(&[&[&zeros(u.c.len(), n), &u.c]]),
        }
    }

    /// Closed loop.
    pub fn closed(&self, k: &Controller) -> Block {
        let (n, nk, q) = (self.a.len(), k.a.len(), self.c.len());
        Block {
            a: blocks(&[&[&self.a, &mul(&self.b, &k.c)], &[&mul(&k.b, &self.c), &k.a]]),
            q: block_diag(&self.q, &zeros(nk, nk)),
            n: blocks(&[&[&zeros(n, q)], &[&k.b]]),
            r: self.r.clone(),
            c_y: blocks(&[&[&self.c, &zeros(q, nk)]]),
            c_u: blocks(&[&[&zeros(k.c.len(), n), &k.c]]),
        }
    }

    /// The steady Kalman-Bucy filter of this plant.
    pub fn kalman_bucy(&self) -> Observer {
        self.observer(kalman_bucy(&self.a, &self.c, &self.q, &self.r).1)
    }

    /// The steady discrete one-step predictor of this plant, and its `S`.
    pub fn kalman(&self) -> (Observer, M) {
        let (_, h, s) = kalman(&self.a, &self.c, &self.q, &self.r);
        (self.observer(h), s)
    }

    fn observer(&self, h: M) -> Observer {
        let (a, b, c) = (self.a.clone(), self.b.clone(), self.c.clone());
        Observer { a, b, c, h }
    }
}

/// Covariance of the output error of one pair.
///
/// Error coordinates `[x; E x - xhat]` keep all digits. In continuous time the
/// error is noise-free, `eps = C_y x - C xhat` (white noise has infinite
/// power); in discrete time it is `r = y - C xhat`, noise included.
pub fn error_covariance(block: &Block, observer: &Observer, time: Time) -> M {
    let (n, m) = (block.a.len(), observer.a.len());
    let e = blocks(&[&[&eye(m), &zeros(m, n - m)]]);
    let hc = mul(&observer.h, &observer.c);
    let f = sub(&observer.a, &hc);
    // y - C E x: zero for the pendulum, not in general.
    let d = sub(&block.c_y, &mul(&observer.c, &e));
    let drift = sub(&mul(&e, &block.a), &mul(&observer.a, &e));
    let input = add(&mul(&observer.b, &block.c_u), &mul(&observer.h, &d));
    let a = blocks(&[&[&block.a, &zeros(n, m)], &[&sub(&drift, &input), &f]]);
    let w = blocks(&[&[&eye(n)], &[&e]]);
    let v = blocks(&[&[&block.n], &[&sub(&mul(&e, &block.n), &observer.h)]]);
    let noise = add(&prod(&[&w, &block.q, &t(&w)]), &prod(&[&v, &block.r, &t(&v)]));
    let x = lyapunov(&a, &noise, time);
    let c = blocks(&[&[&d, &observer.c]]);
    let noise_free = symmetric(&prod(&[&c, &x, &t(&c)]));
    match time {
        Time::Continuous => noise_free,
        Time::Discrete => add(&noise_free, &block.r),
    }
}

/// `1/2 tr(W E[eps eps'])`: `W = Theta^-1` is the Ito convention, `W = I` the identity one.
pub fn weighted(covariance: &M, weight: &M) -> f64 {
    0.5 * trace(&mul(weight, covariance))
}

/// `1/2 ln det(R^-1 S) + 1/2 tr(S^-1 Gamma) - q/2`, per sample.
pub fn likelihood(gamma: &M, s: &M, r: &M) -> f64 {
    let q = r.len() as f64;
    0.5 * (log_det(s) - log_det(r)) + 0.5 * (trace(&solve(s, gamma)) - q)
}
