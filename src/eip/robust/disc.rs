//! The worst case of one frequency: a quadratic over a disc, in closed form.
//!
//! ```text
//! u_plant = (1 + Delta) u,  u = U_0 w - T Delta u,  so  Delta u = p U_0 w,  p = Delta / (1 + T Delta)
//! |Delta| <= W  <=>  |p - c_0| <= r,   c_0 = -conj(T) W^2 / (1 - |T W|^2),  r = W / (1 - |T W|^2)
//! D(p) = A + 2 Re(c p) + B |p|^2
//! ```
//!
//! with `p = c_0 + rho e^{i phi}` and `g = c + B conj(c_0)`, over the phase
//! `D = D(c_0) + 2 |g| rho + B rho^2`: a parabola on `0 <= rho <= r`, which never
//! divides by a small `B`.

use crate::small::Cx;

/// The disc of `p`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    centre: Cx<f64>,
    radius: f64,
}

impl Disc {
    /// For `T` at this frequency and `|W|`; `None` where `|T W|` reaches 1 and
    /// some `Delta` has no response.
    pub(super) fn new(t: Cx<f64>, w: f64) -> Option<Self> {
        let left = 1.0 - t.norm_sqr() * w * w;
        // false for NaN, too
        if left > 0.0 {
            Some(Self { centre: t.conj().scale(-w * w / left), radius: w / left })
        } else {
            None
        }
    }
}

/// `p` of a given `Delta`.
pub(super) fn image(t: Cx<f64>, delta: Cx<f64>) -> Cx<f64> {
    delta / (Cx::real(1.0) + t * delta)
}

/// `D(p) = a + 2 Re(c p) + b |p|^2`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadratic {
    pub(super) a: f64,
    pub(super) c: Cx<f64>,
    pub(super) b: f64,
}

impl Quadratic {
    pub(super) fn minus(self, o: Self) -> Self {
        Self { a: self.a - o.a, c: self.c - o.c, b: self.b - o.b }
    }

    pub(super) fn at(&self, p: Cx<f64>) -> f64 {
        self.a + 2.0 * (self.c * p).re + self.b * p.norm_sqr()
    }

    /// Its maximum over the disc.
    pub(super) fn max(&self, disc: &Disc) -> f64 {
        let g = self.c + disc.centre.conj().scale(self.b);
        let (slope, r) = (g.re.hypot(g.im), disc.radius);
        let rise = if self.b < 0.0 && slope < -self.b * r {
            -slope * slope / self.b
        } else {
            (2.0 * slope + self.b * r) * r
        };
        self.at(disc.centre) + rise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed form of the theory, which divides by `B`.
    fn textbook(q: &Quadratic, d: &Disc) -> f64 {
        let size = |z: Cx<f64>| z.re.hypot(z.im);
        if q.b == 0.0 {
            return q.a + 2.0 * (q.c * d.centre).re + 2.0 * size(q.c) * d.radius;
        }
        let z = -q.c.conj().scale(1.0 / q.b);
        let away = size(d.centre - z);
        let rho = if q.b > 0.0 { away + d.radius } else { (away - d.radius).max(0.0) };
        q.a - q.c.norm_sqr() / q.b + q.b * rho * rho
    }

    #[test]
    fn the_maximum_is_that_of_the_textbook_and_of_samples() {
        let mut state = 1_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 23) - 1.0
        };
        for round in 0..2000 {
            let t = Cx::new(draw(), draw()).scale(0.7);
            let w = 0.7 * draw().abs();
            let disc = Disc::new(t, w).expect("|T W| < 1");
            let b = if round % 7 == 0 { 0.0 } else { draw() };
            let q = Quadratic { a: draw(), c: Cx::new(draw(), draw()), b };
            let max = q.max(&disc);
            assert!((max - textbook(&q, &disc)).abs() < 1e-9, "{q:?} {disc:?}");
            let mut best = f64::NEG_INFINITY;
            for k in 0..720 {
                let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 720.0).sin_cos();
                for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
                    let p = image(t, Cx::new(cos, sin).scale(w * share));
                    best = best.max(q.at(p));
                }
            }
            assert!(best <= max + 1e-12, "{best} above {max}");
            if b >= 0.0 {
                assert!(best > max - 1e-2, "{best} far below {max}");
            }
        }
    }

    #[test]
    fn no_disc_where_the_loop_may_be_singular() {
        assert!(Disc::new(Cx::real(2.0), 0.5).is_none());
        assert!(Disc::new(Cx::real(f64::NAN), 0.5).is_none());
    }
}
