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
//! integrated adaptively, from the mesh that one plant of the study took. What
//! the models do at the nodes of that mesh is computed once.
//!
//! # Source
//! Hassani et al. (2009), eq. (19c) with the factor 1/2 restored.

use crate::eip::quadrature::{Integral, Interval, POINTS, even_mesh, integrate};
use crate::eip::setup::PairModel;
use crate::model::{LoopBlock, Time};
use crate::real::{Mask, Real, sin_cos};
use crate::simd::{self, Block, Kernel, LANES};
use crate::small::{Cx, Dyn, cx_solve};

/// Relative tolerance of the integral. The estimate is pessimistic: the routes
/// agree to 1e-12 with it, and a delay's fast ripples cost less.
const TOLERANCE: f64 = 1e-10;
/// Most intervals of a mesh to start from: more are a loop near its limit.
const LARGEST_MESH: usize = 512;
/// Most blocks of model gains that are kept (64 MiB).
const KEPT: usize = 1 << 20;

/// The route for one study and delay.
pub(crate) struct Frequency<'m> {
    /// Frequency scale of the loop (per sample in discrete time).
    pub(super) gamma: f64,
    discrete: bool,
    pub(super) models: Vec<&'m PairModel>,
    pub(super) mesh: Vec<Interval>,
    /// Gains of the models at the nodes of the mesh; empty where they are too
    /// many to keep.
    pub(super) gains: Vec<Block>,
}

impl<'m> Frequency<'m> {
    /// Prepares the models; the mesh to start from is that of `sample`.
    pub(crate) fn new(
        time: Time,
        gamma: f64,
        models: Vec<&'m PairModel>,
        sample: Option<&LoopBlock>,
    ) -> Self {
        let (mesh, gains) = (even_mesh(), Vec::new());
        let discrete = !time.is_continuous();
        let mut route = Self { gamma, discrete, models, mesh, gains };
        if let Some(block) = sample {
            let all: Vec<usize> = (0..route.models.len()).collect();
            let (_, mesh) = route.integrate(block, &all);
            if mesh.len() <= LARGEST_MESH {
                route.mesh = mesh;
            }
        }
        route.keep_gains();
        route
    }

    /// Energies `tr(W E[eps eps'])` of one loop with some of the models, by their
    /// indices.
    pub(crate) fn energies(&self, block: &LoopBlock, models: &[usize]) -> Vec<Integral> {
        self.integrate(block, models).0
    }

    fn integrate(&self, block: &LoopBlock, models: &[usize]) -> (Vec<Integral>, Vec<Interval>) {
        let mut kept = &self.gains[..];
        integrate(&self.mesh, models.len(), TOLERANCE, |intervals, values| {
            let (omega, factor) = self.frequencies(intervals);
            values.resize(omega.len() * models.len(), 0.0);
            let work = Responses { route: self, block, models, omega: &omega, kept, out: values };
            simd::dispatch(work);
            kept = &[]; // the rest is off the mesh
            for (values, f) in values.chunks_mut(models.len().max(1)).zip(&factor) {
                for v in values {
                    *v *= f;
                }
            }
        })
    }

    /// Frequencies of the nodes, and the factor `1/pi dw/ds`.
    pub(super) fn frequencies(&self, intervals: &[Interval]) -> (Vec<f64>, Vec<f64>) {
        let nodes = intervals.iter().flat_map(|i| (0..POINTS).map(|k| i.node(k)));
        let map = |s: f64| {
            let left = 1.0 - s;
            let (w, dw) = if self.discrete {
                let g = 0.5 * self.gamma;
                (2.0 * libm::atan2(g * s, left), 2.0 * g / (left * left + g * g * s * s))
            } else {
                (self.gamma * s / left, self.gamma / (left * left))
            };
            (w, dw / std::f64::consts::PI)
        };
        nodes.map(map).unzip()
    }

    /// Complex numbers of a model's gains `G_i [H_i, B_i]`.
    pub(super) fn gain_len(&self) -> usize {
        self.models.first().map_or(0, |m| m.C.nrows() * (m.C.nrows() + m.B.ncols()))
    }

    fn keep_gains(&mut self) {
        let (omega, _) = self.frequencies(&self.mesh);
        let blocks = omega.len().div_ceil(LANES) * self.models.len() * 2 * self.gain_len();
        if blocks <= KEPT {
            let mut gains = vec![Block::default(); blocks];
            simd::dispatch(KeepGains { route: self, omega: &omega, out: &mut gains });
            self.gains = gains;
        }
    }

    /// `jw`, or `e^{jw}`.
    #[inline(always)]
    pub(super) fn variable<T: Real>(&self, w: T) -> Cx<T> {
        if self.discrete {
            let (sin, cos) = sin_cos(w);
            Cx::new(cos, sin)
        } else {
            Cx::new(T::zero(), w)
        }
    }
}

/// The frequencies of lane block `g`; missing lanes repeat the last one.
#[inline(always)]
pub(super) fn lane_of<T: Real>(omega: &[f64], g: usize) -> T {
    let mut lane = [0.0; LANES];
    for (l, w) in lane.iter_mut().enumerate().take(T::LANES) {
        *w = omega[(g * T::LANES + l).min(omega.len() - 1)];
    }
    T::load(&lane)
}

/// Gains of every model at given frequencies.
struct KeepGains<'a, 'm> {
    route: &'a Frequency<'m>,
    omega: &'a [f64],
    out: &'a mut [Block],
}

impl Kernel for KeepGains<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let len = self.route.gain_len();
        let size = self.route.models.len() * 2 * len;
        let mut work = ModelWork::<T>::new();
        let mut flat = vec![T::zero(); 2 * len];
        for g in 0..self.omega.len().div_ceil(T::LANES) {
            let s = self.route.variable(lane_of::<T>(self.omega, g));
            let first = g * T::LANES;
            let blocks = &mut self.out[first / LANES * size..][..size];
            for (model, blocks) in self.route.models.iter().zip(blocks.chunks_mut(2 * len)) {
                work.solve(model, s);
                for i in 0..len {
                    (flat[2 * i], flat[2 * i + 1]) = (work.gain[i].re, work.gain[i].im);
                }
                simd::store_group(&flat, first % LANES / T::LANES, blocks);
            }
        }
    }
}

/// Buffers for the gains of a model, frequencies in lanes.
pub(super) struct ModelWork<T> {
    matrix: Vec<Cx<T>>,
    g: Vec<Cx<T>>,
    /// `G [H, B]` row by row, NaN where it has none: a pole on the axis.
    pub(super) gain: Vec<Cx<T>>,
}

impl<T: Real> ModelWork<T> {
    pub(super) fn new() -> Self {
        let (matrix, g, gain) = Default::default();
        Self { matrix, g, gain }
    }

    /// Takes gains that were kept; `flat` is a buffer for one.
    #[inline(always)]
    pub(super) fn load(&mut self, blocks: &[Block], group: usize, flat: &mut [T]) {
        simd::load_group(blocks, group, flat);
        self.gain.clear();
        for k in 0..flat.len() / 2 {
            self.gain.push(Cx::new(flat[2 * k], flat[2 * k + 1]));
        }
    }

    /// `C (s I - F)^-1 [H, B]`, by the transposed system with the rows of `C`.
    #[inline(always)]
    pub(super) fn solve(&mut self, model: &PairModel, s: Cx<T>) {
        let (n, ny, nu) = (model.F.nrows(), model.C.nrows(), model.B.ncols());
        self.matrix.clear();
        self.g.clear();
        for i in 0..n {
            for j in 0..n {
                let mut v = Cx::real(T::splat(-model.F[(j, i)]));
                if i == j {
                    v = v + s;
                }
                self.matrix.push(v);
            }
            for j in 0..ny {
                self.g.push(Cx::real(T::splat(model.C[(j, i)])));
            }
        }
        let ok = cx_solve(Dyn(n), Dyn(ny), &mut self.matrix, &mut self.g);
        let nan = T::splat(f64::NAN);
        self.gain.clear();
        for row in 0..ny {
            for k in 0..ny + nu {
                let mut t = Cx::zero();
                for i in 0..n {
                    let f = if k < ny { model.H[(i, k)] } else { model.B[(i, k - ny)] };
                    let (f, g) = (T::splat(f), self.g[i * ny + row]);
                    t = Cx::new(f.mul_add(g.re, t.re), f.mul_add(g.im, t.im));
                }
                self.gain.push(Cx::select(ok, t, Cx::new(nan, nan)));
            }
        }
    }
}

/// `tr(W E_i E_i^H)` at given frequencies, frequencies in lanes.
struct Responses<'a, 'm> {
    route: &'a Frequency<'m>,
    block: &'a LoopBlock,
    models: &'a [usize],
    omega: &'a [f64],
    /// Gains of all models at these frequencies, or nothing.
    kept: &'a [Block],
    out: &'a mut [f64],
}

impl Kernel for Responses<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Responses { route, block, models, omega, kept, out } = self;
        let len = route.gain_len();
        let size = route.models.len() * 2 * len;
        let mut scratch = Scratch::<T>::new();
        let mut work = ModelWork::<T>::new();
        let mut flat = vec![T::zero(); 2 * len];
        for g in 0..omega.len().div_ceil(T::LANES) {
            let w = lane_of::<T>(omega, g);
            let s = route.variable(w);
            scratch.solve_loop(block, w, s);
            let first = g * T::LANES;
            for (i, &m) in models.iter().enumerate() {
                let model = route.models[m];
                if kept.is_empty() {
                    work.solve(model, s);
                } else {
                    let blocks = &kept[first / LANES * size + m * 2 * len..][..2 * len];
                    work.load(blocks, first % LANES / T::LANES, &mut flat);
                }
                let energy = scratch.error_energy(model, &work.gain, block.nw());
                for l in 0..T::LANES.min(omega.len() - first) {
                    out[(first + l) * models.len() + i] = energy.lane(l);
                }
            }
        }
    }
}

/// Buffers of one lane of frequencies.
pub(super) struct Scratch<T: Real> {
    /// Lanes whose loop could be solved.
    pub(super) ok: T::Mask,
    matrix: Vec<Cx<T>>,
    x: Vec<Cx<T>>,
    /// `Y` without the direct noise, rows by noises.
    pub(super) y: Vec<Cx<T>>,
    /// `[Y; U]`, rows by noises.
    pub(super) signals: Vec<Cx<T>>,
    error: Vec<Cx<T>>,
}

impl<T: Real> Scratch<T> {
    pub(super) fn new() -> Self {
        let (matrix, x, y, signals, error) = Default::default();
        Self { ok: T::Mask::splat(false), matrix, x, y, signals, error }
    }

    /// Solves the loop at `w`: fills `y` and `signals`.
    #[inline(always)]
    pub(super) fn solve_loop(&mut self, block: &LoopBlock, w: T, s: Cx<T>) {
        let (np, nw) = (block.np(), block.nw());
        // e^{-jw tau}
        let mut shift = None;
        if let Some(d) = &block.delayed {
            let (sin, cos) = sin_cos(w * T::splat(d.tau));
            shift = Some((d, Cx { re: cos, im: -sin }));
        }
        self.matrix.clear();
        for i in 0..np {
            for j in 0..np {
                let mut v = real::<T>(-block.A[(i, j)]);
                if let Some((d, e)) = &shift {
                    let a = T::splat(-d.A[(i, j)]);
                    v = Cx { re: e.re.mul_add(a, v.re), im: e.im.mul_add(a, v.im) };
                }
                if i == j {
                    v = Cx { re: v.re + s.re, im: v.im + s.im };
                }
                self.matrix.push(v);
            }
        }
        self.x.clear();
        for i in 0..np {
            for j in 0..nw {
                let mut v = real::<T>(block.B[(i, j)]);
                if let Some((d, e)) = &shift {
                    let b = T::splat(d.B[(i, j)]);
                    v = Cx { re: e.re.mul_add(b, v.re), im: e.im.mul_add(b, v.im) };
                }
                self.x.push(v);
            }
        }
        self.ok = cx_solve(Dyn(np), Dyn(nw), &mut self.matrix, &mut self.x);
        self.y.clear();
        self.signals.clear();
        for (c, direct) in [(&block.Cy, &block.Dy), (&block.Cu, &block.Du)] {
            for i in 0..c.nrows() {
                for j in 0..nw {
                    let mut v = real::<T>(0.0);
                    for k in 0..np {
                        let c = T::splat(c[(i, k)]);
                        let x = self.x[k * nw + j];
                        v = Cx { re: c.mul_add(x.re, v.re), im: c.mul_add(x.im, v.im) };
                    }
                    if self.y.len() < block.Cy.nrows() * nw {
                        self.y.push(v);
                    }
                    v.re = v.re + T::splat(direct[(i, j)]);
                    self.signals.push(v);
                }
            }
        }
    }

    /// Appends the output errors of one model with the given gains, outputs by
    /// noises.
    #[inline(always)]
    pub(super) fn errors_into(
        &self,
        model: &PairModel,
        gain: &[Cx<T>],
        nw: usize,
        out: &mut Vec<Cx<T>>,
    ) {
        let ny = model.C.nrows();
        let width = ny + model.B.ncols();
        for row in 0..ny {
            for col in 0..nw {
                let mut e = self.y[row * nw + col];
                for k in 0..width {
                    e = gain[row * width + k].neg_mul_add(self.signals[k * nw + col], e);
                }
                out.push(e);
            }
        }
    }

    /// `tr(W E E^H)` of one model with the given gains.
    #[inline(always)]
    fn error_energy(&mut self, model: &PairModel, gain: &[Cx<T>], nw: usize) -> T {
        let ny = model.C.nrows();
        let width = ny + model.B.ncols();
        let mut energy = T::zero();
        for col in 0..nw {
            self.error.clear();
            for row in 0..ny {
                let mut e = self.y[row * nw + col];
                for k in 0..width {
                    e = gain[row * width + k].neg_mul_add(self.signals[k * nw + col], e);
                }
                self.error.push(e);
            }
            for i in 0..ny {
                for j in 0..ny {
                    let (p, q) = (self.error[i], self.error[j]);
                    let w = T::splat(model.W[(i, j)]);
                    energy = w.mul_add(p.re.mul_add(q.re, p.im * q.im), energy);
                }
            }
        }
        // a pole on the axis has no response
        T::select(self.ok, energy, T::splat(f64::NAN))
    }
}

fn real<T: Real>(x: f64) -> Cx<T> {
    Cx::real(T::splat(x))
}
