//! Plant and continuous observers as one system, for measurements that the
//! observers see without sampling.

use std::collections::BTreeMap;

use faer::{Mat, Scale};

use super::channels::{Channels, order};
use crate::bank::{Members, whitener};
use crate::error::{Error, Result};
use crate::model::{Plant, check_shape};
use crate::observer::{Observer, design};
use crate::sim::signal::{Signals, Term};
use crate::sim::truth::{Truth, spread, start};
use crate::small::{Dyn, expm, expm_work};

/// Switches that are prepared in advance.
const SWITCHES: f64 = 1e6;
/// Share of a step within which a switch falls on its end.
const EDGE: f64 = 1e-9;

/// A stretch of time on which every signal is smooth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    /// Where it starts, in seconds.
    pub(super) t: f64,
    /// Its length.
    pub(super) len: f64,
    /// Which transition takes a node to the next.
    transition: usize,
}

/// From one node to the next, row by row.
#[derive(Debug, Clone)]
pub(super) struct Transition {
    /// The rows of plant and known signals, from `z`.
    pub(super) z: Vec<f64>,
    /// Each model's state from its own, shape (model, n, n).
    pub(super) own: Vec<f64>,
    /// Each model's state from `z`, shape (model, n, nz).
    pub(super) from_z: Vec<f64>,
}

/// The joint system
///
/// ```text
/// z = [x; e; xi],  x' = A x + B u + G w,   e' = E e,   xi' = 0 (within a step)
/// y = C x + v,     x_hat_i' = (A_i - L_i C_i) x_hat_i + L_i y + B_i u
/// ```
///
/// where `u`, `w` and `v` are linear in the states `e` of the known signals and
/// in the random numbers `xi` of the step.
#[derive(Debug, Clone)]
pub(in crate::sim) struct Joint {
    pub(super) sizes: Sizes,
    /// Parts of a stretch; even.
    pub(super) parts: usize,
    dt: f64,
    terms: Vec<Term>,
    /// Output of the plant of each phase from `z`, q by nz.
    outputs: Vec<Vec<f64>>,
    /// Commands from `[e; xi]`, m by e + xi; nothing if nothing drives the plant.
    inputs: Vec<f64>,
    /// First step of each phase.
    from: Vec<u64>,
    /// The first ones are those of whole steps, one a phase.
    transitions: Vec<Transition>,
    /// Steps in which a signal switches.
    broken: BTreeMap<u64, Vec<Stretch>>,
    pub(super) x0: Vec<f64>,
    /// Factor of `P(0)`, or nothing.
    pub(super) spread: Vec<f64>,
    /// `C_i`, `R_i^-1/2` and half of [`ito`] of each model.
    pub(super) c: Vec<f64>,
    pub(super) white: Vec<f64>,
    pub(super) bias: Vec<f64>,
    /// Whitener of `S_i = C_i P_i C_i' + R_i / dt`.
    pub(super) w: Vec<f64>,
}

/// How many of everything.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    /// States of the plant.
    pub(super) x: usize,
    /// States of the known signals.
    pub(super) e: usize,
    /// Random numbers of a step.
    pub(super) xi: usize,
    /// States of an observer.
    pub(super) n: usize,
    pub(super) q: usize,
    pub(super) models: usize,
}

impl Sizes {
    /// Entries of `z`.
    pub(super) fn z(&self) -> usize {
        self.x + self.e + self.xi
    }
}

/// `tr(R^-1 C L V)`: twice the mean of `h' R^-1 v` that a noise `v` of intensity
/// `V` brings about through the observer. `V` is `R` in the channels that are left
/// to their white noise; a known signal is not white.
fn ito(o: &Observer, signals: &Signals) -> Result<f64> {
    let (n, q) = (o.plant.nx(), o.plant.ny());
    let given = |j: usize| signals.noise.get(j).and_then(Option::as_ref);
    let v = Mat::from_fn(q, q, |i, j| match (given(i), given(j)) {
        (None, None) => o.plant.R[(i, j)],
        (Some(signal), _) if i == j => signal.intensity(),
        _ => 0.0,
    });
    // R^-1 = W' W
    let (w, _) = whitener("R", o.plant.R.as_ref())?;
    let (mut sum, cl) = (
        0.0,
        Mat::from_fn(q, q, |i, j| {
            (0..n).fold(0.0, |s, k| f64::mul_add(o.plant.C[(i, k)], o.L[(k, j)], s))
        }),
    );
    let (left, right) = (&w * cl, &w * v);
    for i in 0..q {
        for j in 0..q {
            sum += left[(i, j)] * right[(i, j)];
        }
    }
    Ok(sum)
}

impl Joint {
    /// Builds the transitions of every phase and of the steps in which a signal
    /// switches; `parts` is an even number of parts of each stretch.
    ///
    /// # Errors
    /// `Conflict` for a truth that is not continuous; `Shape`; those of the
    /// signals; `Range` for a step that is too long; `Limit` for too many
    /// switches.
    pub(in crate::sim) fn new(
        truth: &Truth,
        members: &Members,
        failed: &[bool],
        [dt, duration]: [f64; 2],
        parts: usize,
    ) -> Result<Self> {
        let Some((_, first)) = truth.phases.first() else {
            return Err(Error::Empty { what: "phases of the truth".into() });
        };
        let designs = design(members.observer, &members.plants);
        // a failed model runs as a copy of a good one, its evidence masked
        let Some(good) = designs.iter().flatten().next() else {
            return Err(Error::Empty { what: "models that can be used".into() });
        };
        let usable = |i: usize| designs[i].as_ref().ok().filter(|_| !failed[i]).unwrap_or(good);
        let observers: Vec<&Observer> = (0..designs.len()).map(usable).collect();
        truth.signals.check(first.nu(), first.nw(), first.ny())?;
        if truth.controller.is_some() || truth.input.is_some() || truth.delay > 0.0 {
            return Err(Error::Conflict {
                problem: "a loop or a filter with continuous measurement".into(),
                remedy: "use sampled measurement, or drive the plant by known signals".into(),
            });
        }
        let mut joint = Self {
            sizes: Sizes { x: 0, e: 0, xi: 0, n: 0, q: 0, models: observers.len() },
            parts,
            dt,
            terms: Vec::new(),
            outputs: Vec::new(),
            inputs: Vec::new(),
            from: Vec::new(),
            transitions: Vec::new(),
            broken: BTreeMap::new(),
            x0: start(&truth.x0, first.nx())?,
            spread: spread(truth.P0.as_ref(), first.nx())?,
            c: observers.iter().flat_map(|o| rows(&o.plant.C)).collect(),
            white: Vec::new(),
            bias: Vec::new(),
            w: Vec::new(),
        };
        for o in &observers {
            let (white, _) = whitener("R", o.plant.R.as_ref())?;
            let s = &o.plant.C * &o.P * o.plant.C.transpose() + &o.plant.R * Scale(1.0 / dt);
            let (w, _) = whitener("S = C P C' + R / dt", s.as_ref())?;
            joint.white.extend(rows(&white));
            joint.w.extend(rows(&w));
            joint.bias.push(0.5 * ito(o, &truth.signals)?);
        }
        let mut systems = Vec::new();
        let columns = Channels::columns(truth.phases.iter().map(|p| &p.1), &truth.signals);
        for (from, plant) in &truth.phases {
            plant.check()?;
            if !plant.time.is_continuous() {
                return Err(Error::Conflict {
                    problem: "a discrete plant measured continuously".into(),
                    remedy: "use sampled measurements".into(),
                });
            }
            check_shape("A of the truth", plant.A.as_ref(), [first.nx(), first.nx()])?;
            check_shape("C of the truth", plant.C.as_ref(), [first.ny(), first.nx()])?;
            let channels = Channels::new(plant, &truth.signals, columns, dt);
            joint.sizes = Sizes {
                x: plant.nx(),
                e: channels.e.nrows(),
                xi: channels.xi,
                n: observers[0].plant.nx(),
                q: plant.ny(),
                models: observers.len(),
            };
            joint.terms.clone_from(&channels.terms);
            if !truth.signals.inputs.is_empty() {
                joint.inputs = rows(&channels.u);
            }
            joint.from.push(*from);
            joint.outputs.push(joint.output(plant, &channels));
            systems.push((plant, channels));
        }
        for (plant, channels) in &systems {
            let made = joint.transition(plant, channels, &observers, dt)?;
            joint.transitions.push(made);
        }
        joint.break_up(&truth.signals, &systems, &observers, duration)?;
        Ok(joint)
    }

    /// `[C V]`, row by row.
    fn output(&self, plant: &Plant, channels: &Channels) -> Vec<f64> {
        let s = self.sizes;
        let entry = |i: usize, j: usize| {
            if j < s.x { plant.C[(i, j)] } else { channels.v[(i, j - s.x)] }
        };
        (0..s.q).flat_map(|i| (0..s.z()).map(move |j| (i, j))).map(|(i, j)| entry(i, j)).collect()
    }

    /// The transition over one part of a stretch of length `len`.
    fn transition(
        &self,
        plant: &Plant,
        channels: &Channels,
        observers: &[&Observer],
        len: f64,
    ) -> Result<Transition> {
        let s = self.sizes;
        let (nz, n) = (s.z(), s.n);
        let h = len / self.parts as f64;
        // [z; x_hat], the observer last
        let drive = add(&(&plant.B * &channels.u), &(&plant.G * &channels.w));
        let mut made = Transition { z: Vec::new(), own: Vec::new(), from_z: Vec::new() };
        for o in observers {
            let own = &o.plant.A - &o.L * &o.plant.C;
            let through = &o.L * &plant.C;
            let held = add(&(&o.L * &channels.v), &(&o.plant.B * &channels.u));
            let order = nz + n;
            let entry = |i: usize, j: usize| match i {
                _ if i < s.x && j < s.x => plant.A[(i, j)],
                _ if i < s.x && j < nz => drive[(i, j - s.x)],
                _ if i < s.x + s.e && (s.x..s.x + s.e).contains(&j) => {
                    channels.e[(i - s.x, j - s.x)]
                }
                _ if i < nz => 0.0,
                _ if j < s.x => through[(i - nz, j)],
                _ if j < nz => held[(i - nz, j - s.x)],
                _ => own[(i - nz, j - nz)],
            };
            let a: Vec<f64> = (0..order * order).map(|k| entry(k / order, k % order) * h).collect();
            let (mut e, mut work) = (vec![0.0; order * order], vec![0.0; expm_work(order)]);
            if !expm(Dyn(order), &a, &mut e, &mut work) {
                return Err(Error::Range {
                    what: "step of the simulation".into(),
                    value: len,
                    remedy: "plant or observers move too far in one step; take a shorter dt".into(),
                });
            }
            if made.z.is_empty() {
                for i in 0..s.x + s.e {
                    made.z.extend(&e[i * order..][..nz]);
                }
            }
            for i in nz..order {
                made.from_z.extend(&e[i * order..][..nz]);
                made.own.extend(&e[i * order + nz..][..n]);
            }
        }
        Ok(made)
    }

    /// Prepares the steps in which a signal switches.
    fn break_up(
        &mut self,
        signals: &Signals,
        systems: &[(&Plant, Channels)],
        observers: &[&Observer],
        duration: f64,
    ) -> Result<()> {
        let (dt, mut t) = (self.dt, 0.0);
        let most = signals.switches(duration);
        if most > SWITCHES {
            return Err(Error::Limit {
                what: "the switches of the signals".into(),
                bytes: (most * 64.0) as u128,
                limit: (SWITCHES * 64.0) as u128,
                remedy: "give longer periods, or simulate fewer steps",
            });
        }
        // by phase and bits of the length
        let mut made: BTreeMap<(usize, u64), usize> = BTreeMap::new();
        let mut cuts: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
        while let Some(next) = signals.next_switch(t).filter(|next| *next < duration) {
            t = next;
            let step = (next / dt).floor();
            let into = next - step * dt;
            if into > EDGE * dt && into < (1.0 - EDGE) * dt {
                cuts.entry(step as u64 + 1).or_default().push(next);
            }
        }
        for (k, at) in cuts {
            let start = (k - 1) as f64 * dt;
            let mut ends = vec![start];
            ends.extend(at);
            ends.push(k as f64 * dt);
            let phase = self.phase(k);
            let mut stretches = Vec::new();
            for pair in ends.windows(2) {
                let len = pair[1] - pair[0];
                let transition = match made.get(&(phase, len.to_bits())) {
                    Some(index) => *index,
                    None => {
                        let (plant, channels) = &systems[phase];
                        let new = self.transition(plant, channels, observers, len)?;
                        self.transitions.push(new);
                        made.insert((phase, len.to_bits()), self.transitions.len() - 1);
                        self.transitions.len() - 1
                    }
                };
                stretches.push(Stretch { t: pair[0], len, transition });
            }
            self.broken.insert(k, stretches);
        }
        Ok(())
    }

    /// The phase of step `k`, from 1.
    fn phase(&self, k: u64) -> usize {
        self.from.partition_point(|from| *from <= k).max(1) - 1
    }

    /// Commands from `[e; xi]`, row by row.
    pub(super) fn inputs(&self) -> &[f64] {
        &self.inputs
    }

    /// The output of the plant in step `k` from `z`, row by row.
    pub(super) fn output_of(&self, k: u64) -> &[f64] {
        &self.outputs[self.phase(k)]
    }

    /// The stretches of step `k`, from 1.
    pub(super) fn stretches(&self, k: u64, out: &mut Vec<Stretch>) {
        out.clear();
        match self.broken.get(&k) {
            Some(list) => out.extend(list),
            None => {
                let t = (k - 1) as f64 * self.dt;
                out.push(Stretch { t, len: self.dt, transition: self.phase(k) });
            }
        }
    }

    /// The transition between two nodes of a stretch.
    pub(super) fn at(&self, stretch: &Stretch) -> &Transition {
        &self.transitions[stretch.transition]
    }

    /// The states of the known signals at the start of a stretch.
    pub(super) fn known(&self, stretch: &Stretch, out: &mut [f64]) {
        let mut at = 0;
        for term in &self.terms {
            let [first, second] = term.states(stretch.t, self.dt);
            out[at] = first;
            if order(term) == 2 {
                out[at + 1] = second;
            }
            at += order(term);
        }
    }
}

fn rows(m: &Mat<f64>) -> Vec<f64> {
    (0..m.nrows() * m.ncols()).map(|e| m[(e / m.ncols(), e % m.ncols())]).collect()
}

fn add(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    a + b
}
