//! The second route: Upsilon as a frequency integral, with the exact delay.
//!
//! At each frequency the loop is solved as a complex linear system and the
//! observers are driven by its `y` and `u`:
//!
//! ```text
//! (s I - A - e^{-s tau} A_d) X = B + e^{-s tau} B_d,   s = jw  (z = e^{jw})
//! Y = C_y X + D_y,  U = C_u X + D_u,  E_i = Y - D_y - C_i (s I - F_i)^-1 [H_i Y + B_i U]
//! tr(W E[eps eps']) = 1/pi int_0^inf tr(W E_i E_i^H) dw
//! ```
//!
//! It shares nothing with the Lyapunov route but the matrices. The half line is
//! mapped to [0, 1] by `w = gamma s / (1 - s)` (discrete time: `tan(w/2) =
//! gamma/2 s / (1 - s)`), where the integrand of a stable loop is smooth, and
//! integrated by 15-point Gauss-Kronrod rules, bisected where the error
//! estimate asks for it.
//!
//! # Source
//! Hassani et al. (2009), eq. (19c) with the factor 1/2 restored; rule and
//! error estimate as in QUADPACK (Piessens et al. 1983).

use crate::eip::setup::PairModel;
use crate::model::{LoopBlock, Time};
use crate::real::{Mask, Real, sin_cos};
use crate::simd::{self, Kernel};
use crate::small::{Cx, Dyn, cx_solve};

/// Nodes of the 15-point Kronrod rule on [0, 1) of [-1, 1], largest first.
const NODES: [f64; 8] = [
    0.991_455_371_120_812_6,
    0.949_107_912_342_758_5,
    0.864_864_423_359_769_1,
    0.741_531_185_599_394_4,
    0.586_087_235_467_691_1,
    0.405_845_151_377_397_2,
    0.207_784_955_007_898_47,
    0.0,
];
/// Weights of the 15-point Kronrod rule.
const KRONROD: [f64; 8] = [
    0.022_935_322_010_529_224,
    0.063_092_092_629_978_56,
    0.104_790_010_322_250_18,
    0.140_653_259_715_525_92,
    0.169_004_726_639_267_9,
    0.190_350_578_064_785_4,
    0.204_432_940_075_298_9,
    0.209_482_141_084_727_82,
];
/// Weights of the 7-point Gauss rule at every other node.
const GAUSS: [f64; 4] = [
    0.129_484_966_168_869_7,
    0.279_705_391_489_276_64,
    0.381_830_050_505_118_9,
    0.417_959_183_673_469_4,
];
/// Points of the rule.
const POINTS: usize = 15;
/// Intervals at the start.
const FIRST: usize = 8;
/// Bisections of one interval at most.
const DEPTH: u32 = 40;
/// Intervals at most.
const MAX_INTERVALS: usize = 4096;

/// An energy and the error estimate of its quadrature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Integral {
    pub(crate) value: f64,
    pub(crate) error: f64,
}

/// Energies `tr(W E[eps eps'])` of one loop with each model, to about
/// `tolerance` relative; `gamma` is the frequency scale of the loop (per sample
/// in discrete time).
pub(crate) fn energies(
    block: &LoopBlock,
    models: &[&PairModel],
    gamma: f64,
    tolerance: f64,
) -> Vec<Integral> {
    if models.is_empty() {
        return Vec::new();
    }
    let mut done: Vec<Panel> = Vec::new();
    let mut pending: Vec<(f64, f64, u32)> =
        (0..FIRST).map(|k| (k as f64 / FIRST as f64, (k + 1) as f64 / FIRST as f64, 0)).collect();
    loop {
        let values = integrands(block, models, gamma, &pending);
        for (k, &(from, to, depth)) in pending.iter().enumerate() {
            let values = &values[k * POINTS * models.len()..][..POINTS * models.len()];
            done.push(Panel::new(from, to, depth, values, models.len()));
        }
        // totals in order of position: the path of the bisection leaves no trace
        done.sort_by(|p, q| p.from.total_cmp(&q.from));
        let total = totals(&done, models.len());
        let enough = total.iter().all(|t| t.error <= tolerance * t.value);
        let share = 0.5 * tolerance / done.len() as f64;
        let splits = |p: &Panel| {
            p.depth < DEPTH
                && p.integrals.iter().zip(&total).any(|(i, t)| i.error > share * t.value)
        };
        if enough || done.len() >= MAX_INTERVALS || !done.iter().any(splits) {
            return total;
        }
        pending.clear();
        done.retain(|p| {
            let split = splits(p);
            if split {
                let middle = 0.5 * (p.from + p.to);
                pending.push((p.from, middle, p.depth + 1));
                pending.push((middle, p.to, p.depth + 1));
            }
            !split
        });
    }
}

/// The integrals over one interval.
struct Panel {
    from: f64,
    to: f64,
    depth: u32,
    integrals: Vec<Integral>,
}

impl Panel {
    fn new(from: f64, to: f64, depth: u32, values: &[f64], models: usize) -> Self {
        let half = 0.5 * (to - from);
        let integrals = (0..models)
            .map(|i| {
                let f = |k: usize| values[k * models + i];
                let (mut kronrod, mut gauss) = (0.0, 0.0);
                for k in 0..POINTS {
                    let at = k.min(POINTS - 1 - k);
                    kronrod += KRONROD[at] * f(k);
                    if at % 2 == 1 {
                        gauss += GAUSS[at / 2] * f(k);
                    }
                }
                let mean = 0.5 * kronrod;
                let spread: f64 =
                    (0..POINTS).map(|k| KRONROD[k.min(POINTS - 1 - k)] * (f(k) - mean).abs()).sum();
                let difference = (kronrod - gauss).abs();
                let error = if spread > 0.0 {
                    spread * (200.0 * difference / spread).powf(1.5).min(1.0)
                } else {
                    difference
                };
                Integral { value: kronrod * half, error: error * half }
            })
            .collect();
        Self { from, to, depth, integrals }
    }
}

fn totals(panels: &[Panel], models: usize) -> Vec<Integral> {
    (0..models)
        .map(|i| {
            panels.iter().fold(Integral { value: 0.0, error: 0.0 }, |t, p| Integral {
                value: t.value + p.integrals[i].value,
                error: t.error + p.integrals[i].error,
            })
        })
        .collect()
}

/// The integrand at the nodes of the intervals: intervals by nodes by models,
/// with the factor `1/pi dw/ds`.
fn integrands(
    block: &LoopBlock,
    models: &[&PairModel],
    gamma: f64,
    intervals: &[(f64, f64, u32)],
) -> Vec<f64> {
    let discrete = !block.time.is_continuous();
    let mut omega = Vec::with_capacity(intervals.len() * POINTS);
    let mut factor = Vec::with_capacity(intervals.len() * POINTS);
    for &(from, to, _) in intervals {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        for k in 0..POINTS {
            let at = k.min(POINTS - 1 - k);
            let s = if k == at { middle - half * NODES[at] } else { middle + half * NODES[at] };
            let left = 1.0 - s;
            let (w, dw) = if discrete {
                let g = 0.5 * gamma;
                (2.0 * libm::atan2(g * s, left), 2.0 * g / (left * left + g * g * s * s))
            } else {
                (gamma * s / left, gamma / (left * left))
            };
            omega.push(w);
            factor.push(dw / std::f64::consts::PI);
        }
    }
    let mut out = vec![0.0; omega.len() * models.len()];
    simd::dispatch(Responses { block, models, omega: &omega, out: &mut out });
    for (values, f) in out.chunks_mut(models.len()).zip(&factor) {
        for v in values {
            *v *= f;
        }
    }
    out
}

/// `tr(W E_i E_i^H)` at given frequencies, frequencies in lanes.
struct Responses<'a> {
    block: &'a LoopBlock,
    models: &'a [&'a PairModel],
    omega: &'a [f64],
    out: &'a mut [f64],
}

impl Kernel for Responses<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let n_models = self.models.len();
        let mut scratch = Scratch::<T>::new();
        for (omega, out) in
            self.omega.chunks(T::LANES).zip(self.out.chunks_mut(T::LANES * n_models))
        {
            let w = T::from_fn(|l| omega[l.min(omega.len() - 1)]);
            scratch.solve_loop(self.block, w);
            for (i, model) in self.models.iter().enumerate() {
                let energy = scratch.error_energy(self.block, model);
                for l in 0..omega.len() {
                    out[l * n_models + i] = energy.lane(l);
                }
            }
        }
    }
}

/// Buffers of one lane of frequencies.
struct Scratch<T: Real> {
    s: Cx<T>,
    /// Lanes whose loop could be solved.
    ok: T::Mask,
    matrix: Vec<Cx<T>>,
    x: Vec<Cx<T>>,
    /// `Y` without the direct noise.
    y: Vec<Cx<T>>,
    u: Vec<Cx<T>>,
    gain: Vec<Cx<T>>,
}

fn constant<T: Real>(x: f64) -> Cx<T> {
    Cx { re: T::splat(x), im: T::zero() }
}

impl<T: Real> Scratch<T> {
    fn new() -> Self {
        let (matrix, x, y, u, gain) = Default::default();
        Self { s: constant(0.0), ok: T::Mask::splat(false), matrix, x, y, u, gain }
    }

    /// Solves the loop at `w`: fills `y` and `u` (rows by noises).
    #[inline(always)]
    fn solve_loop(&mut self, block: &LoopBlock, w: T) {
        let (np, nw) = (block.np(), block.nw());
        self.s = match block.time {
            Time::Continuous => Cx { re: T::zero(), im: w },
            Time::Discrete { .. } => {
                let (sin, cos) = sin_cos(w);
                Cx { re: cos, im: sin }
            }
        };
        // e^{-jw tau}
        let shift = block.delayed.as_ref().map(|d| {
            let (sin, cos) = sin_cos(w * T::splat(d.tau));
            (d, Cx { re: cos, im: -sin })
        });
        self.matrix.clear();
        for i in 0..np {
            for j in 0..np {
                let mut v = constant(-block.A[(i, j)]);
                if let Some((d, e)) = &shift {
                    let a = T::splat(-d.A[(i, j)]);
                    v = Cx { re: e.re.mul_add(a, v.re), im: e.im.mul_add(a, v.im) };
                }
                if i == j {
                    v = Cx { re: v.re + self.s.re, im: v.im + self.s.im };
                }
                self.matrix.push(v);
            }
        }
        self.x.clear();
        for i in 0..np {
            for j in 0..nw {
                let mut v = constant(block.B[(i, j)]);
                if let Some((d, e)) = &shift {
                    let b = T::splat(d.B[(i, j)]);
                    v = Cx { re: e.re.mul_add(b, v.re), im: e.im.mul_add(b, v.im) };
                }
                self.x.push(v);
            }
        }
        self.ok = cx_solve(Dyn(np), Dyn(nw), &mut self.matrix, &mut self.x);
        for (out, c, direct) in
            [(&mut self.y, &block.Cy, None), (&mut self.u, &block.Cu, Some(&block.Du))]
        {
            out.clear();
            for i in 0..c.nrows() {
                for j in 0..nw {
                    let mut v = constant(direct.map_or(0.0, |d| d[(i, j)]));
                    for k in 0..np {
                        let c = T::splat(c[(i, k)]);
                        let x = self.x[k * nw + j];
                        v = Cx { re: c.mul_add(x.re, v.re), im: c.mul_add(x.im, v.im) };
                    }
                    out.push(v);
                }
            }
        }
    }

    /// `tr(W E E^H)` of one model.
    #[inline(always)]
    fn error_energy(&mut self, block: &LoopBlock, model: &PairModel) -> T {
        let (n, ny, nu, nw) = (model.F.nrows(), block.Cy.nrows(), block.Cu.nrows(), block.nw());
        // G = C (s - F)^-1: the transposed system with the rows of C
        self.matrix.clear();
        for i in 0..n {
            for j in 0..n {
                let mut v = constant(-model.F[(j, i)]);
                if i == j {
                    v = Cx { re: v.re + self.s.re, im: v.im + self.s.im };
                }
                self.matrix.push(v);
            }
        }
        self.gain.clear();
        for i in 0..n {
            for j in 0..ny {
                self.gain.push(constant(model.C[(j, i)]));
            }
        }
        let ok = self.ok & cx_solve(Dyn(n), Dyn(ny), &mut self.matrix, &mut self.gain);
        let mut energy = T::zero();
        let mut error = vec![constant::<T>(0.0); ny];
        for col in 0..nw {
            for row in 0..ny {
                let mut e = self.y[row * nw + col];
                for (width, from, with_noise) in [(ny, &model.H, true), (nu, &model.B, false)] {
                    for k in 0..width {
                        let mut signal =
                            if with_noise { self.y[k * nw + col] } else { self.u[k * nw + col] };
                        if with_noise {
                            signal.re = signal.re + T::splat(block.Dy[(k, col)]);
                        }
                        // (G from)_{row, k}
                        let mut t = constant(0.0);
                        for i in 0..n {
                            let f = T::splat(from[(i, k)]);
                            let g: Cx<T> = self.gain[i * ny + row];
                            t = Cx { re: f.mul_add(g.re, t.re), im: f.mul_add(g.im, t.im) };
                        }
                        e = Cx {
                            re: t.im.mul_add(signal.im, t.re.neg_mul_add(signal.re, e.re)),
                            im: t.im.neg_mul_add(signal.re, t.re.neg_mul_add(signal.im, e.im)),
                        };
                    }
                }
                error[row] = e;
            }
            for i in 0..ny {
                for j in 0..ny {
                    let w = T::splat(model.W[(i, j)]);
                    let product = error[i].re.mul_add(error[j].re, error[i].im * error[j].im);
                    energy = w.mul_add(product, energy);
                }
            }
        }
        // a pole on the axis has no response
        T::select(ok, energy, T::splat(f64::NAN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rule_is_exact_for_polynomials() {
        for degree in (0..=22).step_by(2) {
            let values: Vec<f64> = (0..POINTS)
                .map(|k| {
                    let at = k.min(POINTS - 1 - k);
                    let x = if k == at { -NODES[at] } else { NODES[at] };
                    x.powi(degree)
                })
                .collect();
            let panel = Panel::new(-1.0, 1.0, 0, &values, 1);
            let exact = 2.0 / f64::from(degree + 1);
            assert!((panel.integrals[0].value - exact).abs() < 4e-16 * 4.0, "degree {degree}");
        }
    }
}
