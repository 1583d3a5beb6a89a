//! Trials in which continuous observers see a continuous plant without sampling.
//!
//! ```text
//! x' = A x + B u + G w,   y = C x + v                the truth
//! x_hat_i' = (A_i - L_i C_i) x_hat_i + L_i y + B_i u the observers, steady gains
//! l_i' = h_i' R^-1 (y - ..),   h_i = C_i x_hat_i     the law of the weights
//! ```
//!
//! Plant, observers and the generators of known signals are one linear system,
//! propagated exactly from node to node; a signal that jumps ends a stretch.
//! White noise is held over a step.

mod channels;
mod system;

pub(super) use system::Joint;

use super::consistency::Spreads;
use super::monte_carlo::Plan;
use super::random::Streams;
use super::recorder::{Recorder, Seen};
use super::tally::{Tally, Trajectory};
use super::truth::add_product;
use crate::bank::{Repeat, whiten};
use crate::error::Result;
use crate::real::Real;
use crate::simd::{Block, Kernel, groups, load_group};
use crate::weight::{Evidence, Law, OdeNodes, Weights};
use system::Sizes;

/// Steps whose normal numbers are made at a time; even, so that none is wasted.
const AHEAD: usize = 16;

/// Trials `first` to `first + valid - 1`, from the start to the end.
pub(super) struct Unsampled<'a, 's> {
    pub(super) plan: &'a Plan,
    pub(super) joint: &'a Joint,
    pub(super) first: u64,
    pub(super) valid: usize,
    pub(super) spreads: &'a Spreads,
    pub(super) tally: &'a mut Tally<'s>,
    pub(super) kept: &'a mut Vec<Trajectory>,
}

impl Kernel for Unsampled<'_, '_> {
    type Out = Result<()>;

    #[inline(always)]
    fn run<T: Real>(mut self) -> Result<()> {
        for group in 0..groups::<T>() {
            if group * T::LANES < self.valid {
                self.group::<T>(group)?;
            }
        }
        Ok(())
    }
}

/// Plant and observers of some trials, and what a stretch says of the models.
struct State<T> {
    s: Sizes,
    /// `[x; e; xi]`.
    z: Vec<T>,
    x_hat: Vec<T>,
    next: Vec<T>,
    next_z: Vec<T>,
    /// `R^-1/2 h_i` and `R^-1/2 y` at the nodes.
    h: Vec<T>,
    y: Vec<T>,
    /// `y` itself at the node.
    seen: Vec<T>,
    r: Vec<T>,
    nis: Vec<T>,
    increment: Vec<T>,
}

impl<T: Real> State<T> {
    #[inline(always)]
    fn new(joint: &Joint, x_hat: &[f64], streams: &mut Streams, group: usize) -> Self {
        let s = joint.sizes;
        let mut z = vec![T::zero(); s.z()];
        for (z, &x) in z.iter_mut().zip(&joint.x0) {
            *z = T::splat(x);
        }
        if !joint.spread.is_empty() {
            let mut blocks = vec![Block::default(); s.x];
            streams.normals::<T>(&mut blocks);
            let mut normals = vec![T::zero(); s.x];
            load_group(&blocks, group, &mut normals);
            add_product(&joint.spread, &normals, &mut z[..s.x]);
        }
        let nodes = joint.parts + 1;
        let room = |len: usize| vec![T::zero(); len];
        Self {
            s,
            z,
            x_hat: x_hat.iter().map(|&v| T::splat(v)).collect(),
            next: room(s.models * s.n),
            next_z: room(s.x + s.e),
            h: room(nodes * s.models * s.q),
            y: room(nodes * s.q),
            seen: room(s.q),
            r: room(s.q),
            nis: room(s.models),
            increment: room(s.models),
        }
    }

    /// Outputs at `node`.
    #[inline(always)]
    fn observe(&mut self, joint: &Joint, output: &[f64], node: usize) {
        let Sizes { n, q, models, .. } = self.s;
        for j in 0..q {
            self.seen[j] = T::zero();
        }
        add_product(output, &self.z, &mut self.seen);
        lower(&joint.white[..q * q], &self.seen, &mut self.y[node * q..][..q]);
        for i in 0..models {
            for j in 0..q {
                self.r[j] = T::zero();
            }
            add_product(&joint.c[i * q * n..][..q * n], &self.x_hat[i * n..][..n], &mut self.r);
            let white = &joint.white[i * q * q..][..q * q];
            lower(white, &self.r, &mut self.h[(node * models + i) * q..][..q]);
        }
    }

    /// `r' S^-1 r` of the sample at the present node, for which `observe` was
    /// called last.
    #[inline(always)]
    fn judge(&mut self, joint: &Joint) {
        let Sizes { n, q, models, .. } = self.s;
        for i in 0..models {
            for j in 0..q {
                self.r[j] = T::zero();
            }
            add_product(&joint.c[i * q * n..][..q * n], &self.x_hat[i * n..][..n], &mut self.r);
            for j in 0..q {
                self.r[j] = self.seen[j] - self.r[j];
            }
            self.nis[i] = whiten(Repeat(&joint.w[i * q * q..][..q * q]), &self.r);
        }
    }

    /// From one node to the next.
    #[inline(always)]
    fn go(&mut self, to: &system::Transition) {
        let Sizes { x, e, n, models, .. } = self.s;
        let nz = self.z.len();
        for i in 0..models * n {
            self.next[i] = T::zero();
        }
        for i in 0..x + e {
            self.next_z[i] = T::zero();
        }
        for i in 0..models {
            let next = &mut self.next[i * n..][..n];
            add_product(&to.from_z[i * n * nz..][..n * nz], &self.z, next);
            add_product(&to.own[i * n * n..][..n * n], &self.x_hat[i * n..][..n], next);
        }
        add_product(&to.z, &self.z, &mut self.next_z);
        self.x_hat.copy_from_slice(&self.next);
        self.z[..x + e].copy_from_slice(&self.next_z);
    }

    /// The log-likelihoods along a stretch of `len` seconds, by Simpson's rule.
    ///
    /// ```text
    /// int h' R^-1 y - 1/2 |h|^2 dt - 1/2 tr(C L) len
    /// ```
    #[inline(always)]
    fn add_up(&mut self, joint: &Joint, len: f64) {
        let Sizes { q, models, .. } = self.s;
        let third = len / (3.0 * joint.parts as f64);
        for i in 0..models {
            let mut sum = T::splat(-joint.bias[i] * len);
            for node in 0..=joint.parts {
                let ends = node == 0 || node == joint.parts;
                let weight = if ends { 1.0 } else { 2.0 + 2.0 * (node % 2) as f64 };
                let mut rate = T::zero();
                for j in 0..q {
                    let h = self.h[(node * models + i) * q + j];
                    let y = self.y[node * q + j];
                    rate = h.mul_add(T::splat(-0.5).mul_add(h, y), rate);
                }
                sum = T::splat(weight * third).mul_add(rate, sum);
            }
            self.increment[i] = sum;
        }
    }
}

/// `out = M v` for a lower triangular `M`.
#[inline(always)]
fn lower<T: Real>(m: &[f64], v: &[T], out: &mut [T]) {
    let q = v.len();
    for i in 0..q {
        let mut sum = T::zero();
        for j in 0..=i {
            sum = T::splat(m[i * q + j]).mul_add(v[j], sum);
        }
        out[i] = sum;
    }
}

impl Unsampled<'_, '_> {
    #[inline(always)]
    fn group<T: Real>(&mut self, group: usize) -> Result<()> {
        let (plan, joint) = (self.plan, self.joint);
        let Sizes { x: nx, e, xi, models, .. } = joint.sizes;
        let mut streams = Streams::new(plan.seed, self.first);
        let mut state = State::<T>::new(joint, &plan.x_hat, &mut streams, group);
        let mut weights = Weights::<T>::new(
            plan.law,
            plan.modifiers.clone(),
            plan.transition.clone(),
            &plan.prior,
        )?;
        let mut normals = vec![Block::default(); AHEAD * xi];
        let mut known = vec![0.0; e];
        let mut stretches = Vec::new();
        let mut recorder = Recorder::new(plan, self.first, self.valid, group);
        let mut y = vec![T::zero(); joint.sizes.q];
        let mut u = vec![T::zero(); joint.inputs().len() / (e + xi).max(1)];
        for k in 1..=plan.steps {
            if xi > 0 {
                let at = ((k - 1) % AHEAD as u64) as usize;
                if at == 0 {
                    streams.normals::<T>(&mut normals);
                }
                load_group(&normals[at * xi..][..xi], group, &mut state.z[nx + e..]);
            }
            weights.predict();
            let output = joint.output_of(k);
            joint.stretches(k, &mut stretches);
            for (part, stretch) in stretches.iter().enumerate() {
                joint.known(stretch, &mut known);
                for j in 0..e {
                    state.z[nx + j] = T::splat(known[j]);
                }
                state.observe(joint, output, 0);
                if part == 0 {
                    state.judge(joint);
                    y.copy_from_slice(&state.seen);
                    u.fill(T::zero());
                    add_product(joint.inputs(), &state.z[nx..], &mut u);
                }
                let transition = joint.at(stretch);
                for node in 1..=joint.parts {
                    state.go(transition);
                    state.observe(joint, output, node);
                }
                state.add_up(joint, stretch.len);
                for i in 0..models {
                    let gone = plan.failed[i];
                    let lost = T::splat(f64::NAN);
                    state.increment[i] = if gone { lost } else { state.increment[i] };
                    state.nis[i] = if gone { lost } else { state.nis[i] };
                }
                let nodes = OdeNodes { h: &state.h, y: &state.y, dt: stretch.len };
                let _ = weights.step(&Evidence {
                    log_lik: &state.increment,
                    increment: &state.increment,
                    energy: &state.increment,
                    dt: stretch.len,
                    nodes: matches!(plan.law, Law::Ode { .. }).then_some(nodes),
                });
            }
            let seen = Seen {
                x: &state.z[..nx],
                y: &y,
                u: &u,
                x_hat: &state.x_hat,
                nis: &state.nis,
                log_p: weights.log_p(),
                spread: self.spreads.at(0),
            };
            recorder.step(k, &seen, self.tally);
        }
        recorder.finish(self.kept);
        Ok(())
    }
}
