//! What the worst case of a frequency is made of: responses of the loop with one
//! more input, the output of `Delta`.
//!
//! ```text
//! E_i = a_i + p b_i,   b_i = (Y_d - G_i [Y_d; U_d]) U_0,   T = -U_d
//! tr(W_i E_i E_i^H) = A_i + 2 Re(c_i p) + B_i |p|^2
//! ```
//!
//! `a_i` is the response without `Delta`, `U_0` the command's, `Y_d` and `U_d` the
//! responses to the output of `Delta` at the plant's input.

use faer::Mat;

use crate::eip::frequency::{Frequency, ModelWork, Scratch, lane_of};
use crate::eip::quadrature::{Integral, Interval, POINTS, integrate};
use crate::eip::robust::disc::Quadratic;
use crate::eip::setup::{PairModel, Setup};
use crate::error::Result;
use crate::model::{DelayForm, LoopBlock};
use crate::real::Real;
use crate::simd::{self, Block, Kernel, LANES};
use crate::small::Cx;

/// Numbers of the loop itself, and of each model.
const OWN: usize = 2;
const EACH: usize = 4;

/// A loop whose last noise is the output of `Delta`.
pub(super) struct Opened {
    block: LoopBlock,
}

impl Opened {
    /// The loop of the plant at `theta` with an exact delay.
    ///
    /// # Errors
    /// A plant that cannot be built.
    pub(super) fn new(setup: &Setup, theta: &[f64], delay: f64) -> Result<Self> {
        let (mut block, _) = setup.block(theta, delay, DelayForm::Exact)?;
        let plant = setup.study.family.plant(theta)?;
        let (np, nw) = (block.np(), block.nw());
        let input = |i: usize| if i < plant.nx() { plant.B[(i, 0)] } else { 0.0 };
        let widened = |m: &Mat<f64>, last: &dyn Fn(usize) -> f64| {
            Mat::from_fn(m.nrows(), nw + 1, |i, j| if j < nw { m[(i, j)] } else { last(i) })
        };
        let none = |_| 0.0;
        match &mut block.delayed {
            // u_plant(t) = ((1 + Delta) u)(t - tau)
            Some(delayed) => {
                delayed.B = widened(&delayed.B, &input);
                block.B = widened(&block.B, &none);
            }
            None => block.B = widened(&block.B, &input),
        }
        block.Dy = widened(&block.Dy, &none);
        block.Du = widened(&block.Du, &none);
        debug_assert_eq!(block.B.nrows(), np);
        Ok(Self { block })
    }
}

/// The parts at one frequency.
#[derive(Clone, Copy)]
pub(super) struct Parts<'a> {
    data: &'a [f64],
    /// `1/2` of the factor that integrates energies.
    scale: f64,
}

impl Parts<'_> {
    /// The complementary sensitivity `T`.
    pub(super) fn t(&self) -> Cx<f64> {
        Cx::new(self.data[0], self.data[1])
    }

    /// Upsilon of the model at place `m`, as a density.
    pub(super) fn upsilon(&self, m: usize) -> Quadratic {
        let d = &self.data[OWN + m * EACH..][..EACH];
        let s = self.scale;
        Quadratic { a: s * d[0], c: Cx::new(s * d[1], s * d[2]), b: s * d[3] }
    }
}

impl Frequency<'_> {
    /// Integrates `width` functions of the parts of all models, which
    /// `fill(omega, parts, values)` computes at one frequency.
    pub(super) fn integrate_parts(
        &self,
        opened: &Opened,
        width: usize,
        tolerance: f64,
        mut fill: impl FnMut(f64, Parts<'_>, &mut [f64]),
    ) -> (Vec<Integral>, Vec<Interval>) {
        let mut kept = &self.gains[..];
        let size = OWN + EACH * self.models.len();
        let mut data = Vec::new();
        integrate(&self.mesh, width, tolerance, |intervals, values| {
            let (omega, factor) = self.frequencies(intervals);
            data.clear();
            data.resize(omega.len() * size, 0.0);
            simd::dispatch(Responses {
                route: self,
                block: &opened.block,
                models: &self.models,
                omega: &omega,
                kept,
                out: &mut data,
            });
            kept = &[]; // the rest is off the mesh
            values.resize(omega.len() * width, 0.0);
            let rows = values.chunks_mut(width).zip(data.chunks(size));
            for ((row, data), (&w, f)) in rows.zip(omega.iter().zip(&factor)) {
                fill(w, Parts { data, scale: 0.5 * f }, row);
            }
        })
    }

    /// The parts at the nodes of `mesh`, with the weights of the rule: `fill`
    /// is called once a node.
    pub(super) fn parts_on(
        &self,
        opened: &Opened,
        mesh: &[Interval],
        mut fill: impl FnMut(f64, Parts<'_>),
    ) {
        let (omega, factor) = self.frequencies(mesh);
        let size = OWN + EACH * self.models.len();
        let mut data = vec![0.0; omega.len() * size];
        simd::dispatch(Responses {
            route: self,
            block: &opened.block,
            models: &self.models,
            omega: &omega,
            kept: &[],
            out: &mut data,
        });
        for (k, data) in data.chunks(size).enumerate() {
            let weight = mesh[k / POINTS].weight(k % POINTS);
            fill(omega[k], Parts { data, scale: 0.5 * factor[k] * weight });
        }
    }

    /// `|T|` at given frequencies.
    pub(super) fn loop_gain(&self, opened: &Opened, omega: &[f64]) -> Vec<f64> {
        let mut data = vec![0.0; omega.len() * OWN];
        simd::dispatch(Responses {
            route: self,
            block: &opened.block,
            models: &[],
            omega,
            kept: &[],
            out: &mut data,
        });
        data.chunks(OWN).map(|t| t[0].hypot(t[1])).collect()
    }
}

/// The parts of a loop at given frequencies, frequencies in lanes.
struct Responses<'a, 'm> {
    route: &'a Frequency<'m>,
    block: &'a LoopBlock,
    models: &'a [&'m PairModel],
    omega: &'a [f64],
    /// Gains of the models at these frequencies, or nothing.
    kept: &'a [Block],
    out: &'a mut [f64],
}

impl Kernel for Responses<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Responses { route, block, models, omega, kept, out } = self;
        let len = route.gain_len();
        let size = models.len() * 2 * len;
        let width = OWN + EACH * models.len();
        let mut scratch = Scratch::<T>::new();
        let mut work = ModelWork::<T>::new();
        let mut flat = vec![T::zero(); 2 * len];
        let mut error = Vec::new();
        let (ny, nw) = (block.Cy.nrows(), block.nw());
        let nan = Cx::real(T::splat(f64::NAN));
        for g in 0..omega.len().div_ceil(T::LANES) {
            let w = lane_of::<T>(omega, g);
            let s = route.variable(w);
            scratch.solve_loop(block, w, s);
            let first = g * T::LANES;
            let lanes = T::LANES.min(omega.len() - first);
            let commands = &scratch.signals[ny * nw..(ny + 1) * nw];
            let t = Cx::select(scratch.ok, -commands[nw - 1], nan);
            for l in 0..lanes {
                let row = &mut out[(first + l) * width..][..OWN];
                (row[0], row[1]) = (t.re.lane(l), t.im.lane(l));
            }
            for (m, model) in models.iter().enumerate() {
                if kept.is_empty() {
                    work.solve(model, s);
                } else {
                    let blocks = &kept[first / LANES * size + m * 2 * len..][..2 * len];
                    work.load(blocks, first % LANES / T::LANES, &mut flat);
                }
                // those to the noise are a_i, the last column is b_i without U_0
                error.clear();
                scratch.errors_into(model, &work.gain, nw, &mut error);
                let parts = quadratic(model, commands, &error, nw);
                for l in 0..lanes {
                    let row = &mut out[(first + l) * width + OWN + EACH * m..][..EACH];
                    for (value, part) in row.iter_mut().zip(&parts) {
                        *value = part.lane(l);
                    }
                }
            }
        }
    }
}

/// `A`, `Re c`, `Im c` and `B` of one model.
#[inline(always)]
fn quadratic<T: Real>(
    model: &PairModel,
    commands: &[Cx<T>],
    error: &[Cx<T>],
    nw: usize,
) -> [T; EACH] {
    let ny = model.C.nrows();
    let last = nw - 1;
    let (mut a, mut b) = (T::zero(), T::zero());
    let mut c = Cx::<T>::zero();
    for i in 0..ny {
        for j in 0..ny {
            let w = T::splat(model.W[(i, j)]);
            let (p, q) = (error[i * nw + last], error[j * nw + last]);
            b = w.mul_add(p.re.mul_add(q.re, p.im * q.im), b);
            for col in 0..last {
                let (p, r) = (error[i * nw + col], error[j * nw + col]);
                a = w.mul_add(p.re.mul_add(r.re, p.im * r.im), a);
                // conj(a_i) W b_i, b_i = q U_0
                c = p.conj().scale(w).mul_add(q * commands[col], c);
            }
        }
    }
    let mut power = T::zero();
    for u in &commands[..last] {
        power = power + u.norm_sqr();
    }
    [a, c.re, c.im, b * power]
}
