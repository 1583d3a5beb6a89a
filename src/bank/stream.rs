//! The bank: states of all models, one measurement at a time.

use faer::Mat;

use super::advance::{Advance, Part, scratch_len};
use super::gains::{Gains, Settings};
use super::members::{Members, StartTime};
use crate::error::{Error, Result};
use crate::model::{check_covariance, check_finite, check_shape};
use crate::simd::{Block, LANES, Panel, dispatch};
use crate::small::{Dyn, cholesky};

/// What one step says of every model.
#[derive(Debug, Clone, Default)]
pub struct Step {
    /// `ln N(r; 0, S)` of the outputs present; NaN for a member that failed.
    pub log_lik: Vec<f64>,
    /// Normalised innovation squared, `r' S^-1 r`.
    pub nis: Vec<f64>,
    /// `|r|^2`.
    pub energy: Vec<f64>,
    /// Continuous time: increment of the log-likelihood along the interval
    /// (Dunn's law, trapezoid). Discrete time: `ln N(r; 0, S)` with the steady
    /// `S`.
    pub increment: Vec<f64>,
    /// Innovation `y - C x_hat`, shape (model, output); of the start of the
    /// interval in continuous time.
    pub r: Vec<f64>,
    /// `R^-1/2 C x_hat` at the ends of the parts of an interval, shape (node,
    /// model, output); empty unless [`Settings::parts`] asks for it.
    pub h: Vec<f64>,
    /// `R^-1/2 y` there, shape (node, output).
    pub y: Vec<f64>,
}

/// Observers of all models on one measurement stream.
#[derive(Debug, Clone)]
pub struct Bank {
    gains: Gains,
    models: usize,
    failures: Vec<Option<Error>>,
    start: StartTime,
    started: bool,
    first_x: Panel,
    first_gains: Box<Gains>,
    x: Panel,
    /// Innovations, and `[log_lik, nis, energy, increment]`.
    r: Panel,
    numbers: Panel,
    nodes: Option<Panel>,
    /// Factor of the common norm.
    norm: Vec<f64>,
    step: Step,
    y: Vec<f64>,
    present: Vec<bool>,
    scratch: Vec<Block>,
}

impl Bank {
    /// Designs the observers and puts them at their initial estimates.
    ///
    /// # Errors
    /// As [`Gains::new`]; a model that cannot be used is flagged in
    /// [`Bank::failures`].
    pub fn new(members: &Members, settings: &Settings) -> Result<Self> {
        let (gains, failures) = Gains::new(members, settings)?;
        let (models, n, q) = (members.plants.len(), gains.sizes.n, gains.sizes.q);
        let x = Panel::from_fn(n, 1, models, |k, i, _| {
            if failures[k].is_none() { members.initial(k).x_hat[i] } else { 0.0 }
        });
        let room = |len: usize| vec![f64::NAN; len];
        let nodes = if settings.parts > 0 { settings.parts + 1 } else { 0 };
        let norm = match &settings.norm {
            None => Vec::new(),
            Some(w) => norm_factor(w, q)?,
        };
        Ok(Self {
            norm,
            nodes: (nodes > 0).then(|| Panel::new(nodes * q, 1, models)),
            models,
            start: members.start,
            started: false,
            first_x: x.clone(),
            first_gains: Box::new(gains.clone()),
            x,
            r: Panel::new(q, 1, models),
            numbers: Panel::new(4, 1, models),
            step: Step {
                log_lik: room(models),
                nis: room(models),
                energy: room(models),
                increment: room(models),
                r: room(models * q),
                h: room(nodes * models * q),
                y: room(nodes * q),
            },
            y: vec![0.0; q],
            present: vec![true; q],
            scratch: vec![Block::default(); scratch_len(gains.sizes)],
            gains,
            failures,
        })
    }

    /// Back to the initial estimates.
    pub fn reset(&mut self) {
        self.x.clone_from(&self.first_x);
        self.gains.clone_from(&self.first_gains);
        self.started = false;
    }

    /// Number of models.
    pub fn models(&self) -> usize {
        self.models
    }

    /// States, inputs and outputs of each model.
    pub fn sizes(&self) -> [usize; 3] {
        let s = self.gains.sizes;
        [s.n, s.m, s.q]
    }

    /// Seconds between measurements.
    pub fn dt(&self) -> f64 {
        self.gains.dt
    }

    /// True for observers in continuous time.
    pub fn is_continuous(&self) -> bool {
        self.gains.continuous
    }

    /// Continuous observers: the largest `|pole of A - L C| dt` of a steady
    /// design, a measure of how coarse the samples are; 0 in discrete time.
    pub fn pace(&self) -> f64 {
        self.gains.pace()
    }

    /// Why a model cannot be used.
    pub fn failures(&self) -> &[Option<Error>] {
        &self.failures
    }

    /// The estimate of model `i`, n numbers.
    pub fn x_hat_into(&self, i: usize, x: &mut [f64]) {
        self.x.read_item(i, x);
    }

    /// False if the estimate of model `i` has run away.
    pub(crate) fn is_finite(&self, i: usize) -> bool {
        let lane = i % LANES;
        // in vectors: no way out in between
        self.x.block(i / LANES).iter().fold(true, |all, x| all & x.0[lane].is_finite())
    }

    /// The initial estimate of model `i`.
    pub(crate) fn first_x_hat_into(&self, i: usize, x: &mut [f64]) {
        self.first_x.read_item(i, x);
    }

    /// Covariances and coefficients at the start.
    pub(crate) fn first_gains(&self) -> &Gains {
        &self.first_gains
    }

    /// Factor of the common norm, row by row; empty for the identity.
    pub(crate) fn norm(&self) -> &[f64] {
        &self.norm
    }

    /// True if the first step predicts before it measures.
    pub(crate) fn moves_first(&self) -> bool {
        self.start == StartTime::StepBefore || self.gains.continuous
    }

    /// What the last update found.
    pub fn last(&self) -> &Step {
        &self.step
    }

    /// True if the next step predicts before it measures.
    pub(crate) fn moves(&self) -> bool {
        self.started || self.moves_first()
    }

    /// Copies the covariance of model `i`.
    pub(crate) fn covariance_into(&self, i: usize, p: &mut Mat<f64>) {
        self.gains.covariance_into(i, p);
    }

    /// Covariance of model `i`: `P(k|k)` of a discrete filter.
    pub fn covariance(&self, i: usize) -> Mat<f64> {
        self.gains.covariance(i)
    }

    pub(super) fn gains_mut(&mut self) -> &mut Gains {
        &mut self.gains
    }

    /// True if outputs are wanted in the norm of one `R` for all models.
    pub(super) fn needs_one_norm(&self) -> bool {
        self.nodes.is_some()
    }

    /// Standard deviation that model `i` expects of each innovation, `sqrt(S_jj)`,
    /// at the last measurement; NaN for an output that was missing.
    pub fn sigma(&self, i: usize) -> Vec<f64> {
        let q = self.r.rows();
        let w = &self.gains.coefficients().w;
        // L = W^-1 row by row, over the outputs present
        let mut l = vec![0.0; q * q];
        let mut sigma = vec![f64::NAN; q];
        for r in 0..q {
            let pivot = w.get(i, r, r);
            if pivot.abs() == 0.0 {
                continue;
            }
            for c in 0..=r {
                let unit = if r == c { 1.0 } else { 0.0 };
                let sum = (c..r).fold(unit, |s, k| s - w.get(i, r, k) * l[k * q + c]);
                l[r * q + c] = sum / pivot;
            }
            sigma[r] = l[r * q..][..q].iter().map(|v| v * v).sum::<f64>().sqrt();
        }
        sigma
    }

    /// Covariances and coefficients.
    pub fn gains(&self) -> &Gains {
        &self.gains
    }

    /// Replaces estimate and covariance of model `i`: re-seeding and mixing.
    pub(crate) fn set(&mut self, i: usize, x: &[f64], p: Option<&Mat<f64>>) {
        self.x.write_item(i, x);
        self.x.fill_padding();
        if let Some(p) = p {
            self.gains.set_covariance(i, p);
        }
    }

    /// Marks a bank that was put together on the way: it is past its first step.
    pub(crate) fn resume(&mut self) {
        self.started = true;
    }

    /// Time goes on by a step without a measurement.
    pub fn predict(&mut self, u: &[f64]) {
        let skip = !self.started && self.start == StartTime::FirstMeasurement;
        self.started = true;
        if self.gains.continuous || skip {
            return;
        }
        self.gains.predict();
        self.present.fill(false);
        self.run(Part::Predict, u);
    }

    /// Takes in a measurement; NaN stands for an output that is missing.
    ///
    /// In continuous time `y` and `u` are held from the present time to the
    /// next.
    ///
    /// # Errors
    /// `Shape`; `NonFinite` for an infinite output or an input that is no
    /// number. The bank is then as before.
    pub fn update(&mut self, u: &[f64], y: &[f64]) -> Result<&Step> {
        self.check(u, y)?;
        for (j, &v) in y.iter().enumerate() {
            self.present[j] = !v.is_nan();
            self.y[j] = if v.is_nan() { 0.0 } else { v };
        }
        self.started = true;
        let present = std::mem::take(&mut self.present);
        self.gains.update(&present);
        self.present = present;
        let part = if self.gains.continuous { Part::Hold } else { Part::Update };
        self.run(part, u);
        self.publish();
        Ok(&self.step)
    }

    /// Refuses signals of the wrong size, and numbers that are none.
    pub(crate) fn check(&self, u: &[f64], y: &[f64]) -> Result<()> {
        let [_, m, q] = self.sizes();
        for (what, got, want) in [("y", y.len(), q), ("u", u.len(), m)] {
            if got != want {
                return Err(Error::Shape { what: what.into(), want: [want, 1], got: [got, 1] });
            }
        }
        if let Some(row) = y.iter().position(|v| v.is_infinite()) {
            return Err(Error::NonFinite { what: "y".into(), row, col: 0 });
        }
        if let Some(row) = u.iter().position(|v| !v.is_finite()) {
            return Err(Error::NonFinite { what: "u".into(), row, col: 0 });
        }
        Ok(())
    }

    fn run(&mut self, part: Part, u: &[f64]) {
        dispatch(Advance {
            part,
            dt: self.gains.dt,
            c: self.gains.coefficients(),
            norm: &self.norm,
            u,
            y: &self.y,
            present: &self.present,
            x: &mut self.x,
            r: &mut self.r,
            numbers: &mut self.numbers,
            nodes: if part == Part::Hold { self.nodes.as_mut() } else { None },
            scratch: &mut self.scratch,
        });
    }

    /// Copies the numbers of the kernels to plain arrays.
    fn publish(&mut self) {
        let q = self.r.rows();
        for i in 0..self.models {
            self.r.read_item(i, &mut self.step.r[i * q..][..q]);
            let mut numbers = [0.0; 4];
            self.numbers.read_item(i, &mut numbers);
            if self.failures[i].is_some() {
                numbers = [f64::NAN; 4];
            }
            [self.step.log_lik[i], self.step.nis[i], self.step.energy[i], self.step.increment[i]] =
                numbers;
        }
        let Some(nodes) = &self.nodes else { return };
        let count = nodes.rows() / q;
        let white = &self.gains.coefficients().white;
        for node in 0..count {
            for i in 0..self.models {
                for j in 0..q {
                    self.step.h[(node * self.models + i) * q + j] = nodes.get(i, node * q + j, 0);
                }
            }
            for j in 0..q {
                self.step.y[node * q + j] =
                    (0..=j).fold(0.0, |s, l| f64::mul_add(white.get(0, j, l), self.y[l], s));
            }
        }
    }
}

/// Lower triangular `M` with `M' M = W`, row-major: `|M r|^2 = r' W r`.
pub(crate) fn norm_factor(w: &Mat<f64>, q: usize) -> Result<Vec<f64>> {
    check_shape("W", w.as_ref(), [q, q])?;
    check_finite("W", w.as_ref())?;
    check_covariance("W", w.as_ref(), true)?;
    // in reversed order: W_rev = L L', so M is L' reversed, lower triangular
    let mut l: Vec<f64> = (0..q * q).map(|e| w[(q - 1 - e / q, q - 1 - e % q)]).collect();
    if !cholesky(Dyn(q), &mut l) {
        return Err(Error::NotPositiveDefinite { what: "W".into() });
    }
    let entry = |i: usize, j: usize| if j <= i { l[(q - 1 - j) * q + (q - 1 - i)] } else { 0.0 };
    Ok((0..q * q).map(|e| entry(e / q, e % q)).collect())
}
