//! The coefficients of a step: all that does not depend on the data.

use faer::Mat;

use super::continuous::{self, Held};
use super::covariance::{HALF_LN_2_PI, Predict, Update, scratch_len};
use super::matrices::{Matrices, Sizes, panel, whiten};
use super::members::{Members, StartTime};
use crate::error::{Error, Result};
use crate::model::{Plant, Time};
use crate::observer::{self, Observer};
use crate::simd::{Block, Panel, dispatch};
use crate::solve::backend;

/// Where the gains come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GainMode {
    /// From the steady-state covariance of each model.
    #[default]
    Steady,
    /// From the covariance recursion, starting at `P(0)`. In continuous time the
    /// Riccati differential equation, exact, and the gain of the middle of each
    /// step.
    Recursive,
}

/// How the observers of a bank are run.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Steady or recursive gains.
    pub gains: GainMode,
    /// Seconds between measurements; discrete plants bring their own.
    pub dt: Option<f64>,
    /// Norm `W` of the energy `r' W r` that is common to all models, q by q;
    /// `None` for the identity.
    pub norm: Option<Mat<f64>>,
    /// Equal parts of an interval at whose ends the outputs are wanted, for
    /// Dunn's law as a differential equation; 0 for none.
    pub parts: usize,
}

/// What a step needs of every model, eight models to a block.
#[derive(Debug, Clone)]
pub struct Coefficients {
    pub(crate) a: Panel,
    pub(crate) b: Panel,
    pub(crate) c: Panel,
    /// Filter gain; in continuous time the response to a held residual.
    pub(crate) k: Panel,
    /// Whitens the residual in the norm of the innovation covariance.
    pub(crate) w: Panel,
    /// `-1/2 ln det (2 pi S)`.
    pub(crate) log_norm: Panel,
    /// A second norm of the residual and what is taken from its evidence. In
    /// continuous time `R^-1/2` and `1/2 tr(C L)`, in discrete time the whitener
    /// of the steady `S` and `1/2 ln det (2 pi S)` (NaN where there is none).
    pub(crate) white: Panel,
    pub(crate) bias: Panel,
}

impl Coefficients {
    /// Copies all of another of the same sizes.
    fn copy_from(&mut self, other: &Self) {
        for (to, from) in [
            (&mut self.a, &other.a),
            (&mut self.b, &other.b),
            (&mut self.c, &other.c),
            (&mut self.k, &other.k),
            (&mut self.w, &other.w),
            (&mut self.log_norm, &other.log_norm),
            (&mut self.white, &other.white),
            (&mut self.bias, &other.bias),
        ] {
            to.copy_from(from);
        }
    }
}

/// The covariances of all models, and the coefficients that follow from them.
#[derive(Debug, Clone)]
pub struct Gains {
    pub(super) sizes: Sizes,
    mode: GainMode,
    pub(super) continuous: bool,
    /// Seconds between measurements.
    pub(super) dt: f64,
    pub(super) matrices: Matrices,
    /// `P(k|k)`, or `P(k|k-1)` between prediction and update.
    p: Panel,
    /// Steady filters: `P(k|k-1)`, from which the gain for present outputs
    /// follows.
    prior: Panel,
    pub(super) coefficients: Coefficients,
    /// The outputs that `coefficients` are for.
    pattern: Vec<bool>,
    /// Steady filters: the coefficients for all outputs.
    full: Option<Box<Coefficients>>,
    /// Steady innovation covariance of each discrete model, NaN where unknown.
    pub(super) steady: Option<Panel>,
    /// Continuous observers: the models, the length of a part of a step, and
    /// whether the covariance has come to rest.
    pub(super) plants: Vec<Plant>,
    part: f64,
    pub(super) settled: bool,
    scratch: Vec<Block>,
    /// Scratch for two q by q matrices.
    square: Vec<f64>,
}

impl Gains {
    /// Designs or starts the filters of `members`.
    ///
    /// A model that cannot be used is flagged; its place is taken by the first
    /// that can.
    ///
    /// # Errors
    /// Of the whole: `Empty`, `Shape`, `InvalidDt`, and `AllFailed` if no model
    /// can be used.
    pub fn new(members: &Members, settings: &Settings) -> Result<(Self, Vec<Option<Error>>)> {
        let mode = settings.gains;
        let (sizes, mut failures) = members.check()?;
        let continuous = members.observer.is_continuous();
        let models = members.plants.len();
        // a recursion that starts at a given P can do without a steady state
        let needs_design =
            |i: usize| continuous || mode == GainMode::Steady || members.initial(i).P.is_none();
        let chosen: Vec<usize> = (0..models).filter(|&i| failures[i].is_none()).collect();
        let plants: Vec<Plant> = chosen.iter().map(|&i| members.plants[i].clone()).collect();
        let mut designs: Vec<Option<Observer>> = vec![None; models];
        for (&i, design) in chosen.iter().zip(observer::design(members.observer, &plants)) {
            match design {
                Ok(design) => designs[i] = Some(design),
                Err(e) if needs_design(i) => failures[i] = Some(e),
                Err(_) => {}
            }
        }
        let Some(good) = failures.iter().position(Option::is_none) else {
            let source = failures.into_iter().flatten().next();
            return Err(Error::AllFailed {
                what: "models",
                count: models,
                source: Box::new(source.unwrap_or(Error::Empty { what: "models".into() })),
            });
        };
        // a failed model runs as a copy of a good one, its evidence masked
        let used: Vec<usize> =
            (0..models).map(|i| if failures[i].is_none() { i } else { good }).collect();
        let plants: Vec<&Plant> = used.iter().map(|&i| &members.plants[i]).collect();
        let matrices = Matrices::new(&plants);
        let dt = interval(plants[0], settings.dt)?;
        let steady: Vec<Option<&Observer>> = used.iter().map(|&i| designs[i].as_ref()).collect();
        let start: Vec<Mat<f64>> = used
            .iter()
            .zip(&steady)
            .map(|(&i, design)| match (&members.initial(i).P, design) {
                (Some(p), _) if mode == GainMode::Recursive => p.clone(),
                (_, Some(design)) => design.P.clone(),
                (Some(p), None) => p.clone(),
                (None, None) => Mat::zeros(sizes.n, sizes.n),
            })
            .collect();
        let p = panel(&start.iter().collect::<Vec<_>>());
        let (n, q) = (sizes.n, sizes.q);
        let room = |rows, cols| Panel::new(rows, cols, models);
        let coefficients = Coefficients {
            a: matrices.a.clone(),
            b: matrices.b.clone(),
            c: matrices.c.clone(),
            k: room(n, q),
            w: room(q, q),
            log_norm: room(1, 1),
            white: room(q, q),
            bias: room(1, 1),
        };
        let mut gains = Self {
            sizes,
            mode,
            continuous,
            dt,
            matrices,
            prior: p.clone(),
            p,
            coefficients,
            pattern: vec![true; q],
            full: None,
            steady: None,
            plants: Vec::new(),
            part: dt,
            settled: false,
            scratch: vec![Block::default(); scratch_len(sizes)],
            square: vec![0.0; 2 * q * q],
        };
        if continuous {
            let parts = settings.parts.max(1);
            if settings.parts > 0 && plants.iter().any(|p| p.R != plants[0].R) {
                return Err(Error::Conflict {
                    problem: "models with different R under Dunn's differential equation".into(),
                    remedy: "give all models one R, or use another law".into(),
                });
            }
            gains.part = dt / parts as f64;
            gains.plants = plants.iter().map(|p| (*p).clone()).collect();
            let all = vec![true; q];
            if mode == GainMode::Recursive {
                // shows whether the first step can be taken
                gains.advance(&all);
                gains.p = gains.prior.clone();
                gains.settled = false;
            } else {
                let held: Vec<Held<'_>> =
                    steady.iter().flatten().map(|o| Held::steady(o)).collect();
                continuous::hold(&held, &all, gains.part, dt, &mut gains.coefficients)?;
                gains.full = Some(Box::new(gains.coefficients.clone()));
            }
        } else {
            gains.steady = Some(Panel::from_fn(q, q, models, |k, i, j| {
                steady[k].map_or(f64::NAN, |o| o.S[(i, j)])
            }));
            let all = vec![true; q];
            gains.steady_norm(&all);
            gains.filter(&all);
            if mode == GainMode::Steady {
                gains.full = Some(Box::new(gains.coefficients.clone()));
            } else {
                // a steady covariance is that of the prediction; before the first
                // step stands that of the filter
                for (k, &i) in used.iter().enumerate() {
                    let given = members.initial(i).P.is_some();
                    if given || members.start == StartTime::FirstMeasurement {
                        let mut p = vec![0.0; n * n];
                        gains.prior.read_item(k, &mut p);
                        gains.p.write_item(k, &p);
                    }
                }
                gains.p.fill_padding();
            }
        }
        Ok((gains, failures))
    }

    /// `P <- A P A' + G Q G'`; of no effect on steady filters.
    pub fn predict(&mut self) {
        if self.mode == GainMode::Recursive && !self.continuous {
            dispatch(Predict {
                sizes: self.sizes,
                matrices: &self.matrices,
                p: &mut self.p,
                scratch: &mut self.scratch,
            });
        }
    }

    /// Gains and covariances for a measurement of the outputs that are present.
    pub fn update(&mut self, present: &[bool]) {
        let all = present.iter().all(|&p| p);
        let same = self.pattern == present;
        match (self.continuous, self.mode) {
            (_, GainMode::Steady) if same => {}
            (_, GainMode::Steady) if all => {
                if let Some(full) = &self.full {
                    self.coefficients.copy_from(full);
                }
            }
            (true, GainMode::Steady) => {
                let p = self.p.clone();
                self.hold(present, &p);
            }
            (true, GainMode::Recursive) => {
                if !(self.settled && same && all) {
                    self.advance(present);
                }
            }
            (false, _) => {
                if !same {
                    self.steady_norm(present);
                }
                self.filter(present);
            }
        }
        self.pattern.copy_from_slice(present);
    }

    /// Discrete time: the gain for the covariance of the moment, and with the
    /// recursion what the measurement leaves of it.
    fn filter(&mut self, present: &[bool]) {
        let c = &mut self.coefficients;
        if self.mode == GainMode::Recursive {
            self.prior.copy_from(&self.p);
        }
        dispatch(Update {
            sizes: self.sizes,
            matrices: &self.matrices,
            present,
            p: &self.prior,
            next: (self.full.is_none()).then_some(&mut self.p),
            k: &mut c.k,
            w: &mut c.w,
            log_norm: &mut c.log_norm,
            scratch: &mut self.scratch,
        });
    }

    /// Discrete time: the norm of the steady `S`, of the outputs present.
    fn steady_norm(&mut self, present: &[bool]) {
        let Some(steady) = &self.steady else { return };
        let q = self.sizes.q;
        let turns = 2.0 * present.iter().filter(|p| **p).count() as f64 * HALF_LN_2_PI;
        let (s, w) = self.square.split_at_mut(q * q);
        for k in 0..steady.len() {
            for (i, j) in (0..q * q).map(|e| (e / q, e % q)) {
                s[i * q + j] = match (present[i] && present[j], i == j) {
                    (true, _) => steady.get(k, i, j),
                    (false, true) => 1.0,
                    (false, false) => 0.0,
                };
            }
            let ln_det = whiten(q, s, w);
            let bias = ln_det.map_or(f64::NAN, |ln_det| 0.5 * (ln_det + turns));
            self.coefficients.bias.set(k, 0, 0, bias);
            for (i, j) in (0..q * q).map(|e| (e / q, e % q)) {
                let used = ln_det.is_some() && present[i];
                self.coefficients.white.set(k, i, j, if used { w[i * q + j] } else { 0.0 });
            }
        }
        self.coefficients.white.fill_padding();
        self.coefficients.bias.fill_padding();
    }

    /// Continuous time: coefficients of a step with the gains that belong to the
    /// covariances `p` and the outputs present. With none of them the observers
    /// are models that run alone.
    fn hold(&mut self, present: &[bool], p: &Panel) {
        let n = self.sizes.n;
        let plants: Vec<Plant> =
            self.plants.iter().map(|plant| continuous::masked(plant, present)).collect();
        let mut bad = Vec::new();
        let held: Vec<Held<'_>> = plants
            .iter()
            .enumerate()
            .map(|(k, plant)| {
                let p = Mat::from_fn(n, n, |i, j| p.get(k, i, j));
                let finite = (0..n * n).all(|e| p[(e / n, e % n)].is_finite());
                let held = if finite { Held::at(plant, p) } else { None };
                held.unwrap_or_else(|| {
                    bad.push(k);
                    Held::alone(plant)
                })
            })
            .collect();
        let c = &mut self.coefficients;
        let failed = continuous::hold(&held, present, self.part, self.dt, c).is_err();
        for k in 0..plants.len() {
            if failed || bad.contains(&k) {
                // evidence that is no number marks the member
                c.log_norm.set(k, 0, 0, f64::NAN);
                c.bias.set(k, 0, 0, f64::NAN);
            }
        }
        c.log_norm.fill_padding();
        c.bias.fill_padding();
    }

    /// Continuous time: the gain of the middle of the step, and `P` at its end.
    fn advance(&mut self, present: &[bool]) {
        let noise = self.matrices.q.to_row_major();
        let half = 0.5 * self.dt;
        let plants: Vec<Plant> =
            self.plants.iter().map(|plant| continuous::masked(plant, present)).collect();
        self.prior.clone_from(&self.p);
        let mut middle = self.p.clone();
        continuous::flow(&plants, &noise, &mut middle, half);
        self.hold(present, &middle);
        continuous::flow(&plants, &noise, &mut middle, half);
        self.p = middle;
        // at rest once a step changes no covariance by more than rounding
        let n = self.sizes.n;
        let (before, after) = (self.prior.to_row_major(), self.p.to_row_major());
        self.settled = before.chunks(n * n).zip(after.chunks(n * n)).all(|(a, b)| {
            let size = b.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 4.0 * f64::EPSILON * size)
        });
    }

    /// The coefficients of the present step.
    pub fn coefficients(&self) -> &Coefficients {
        &self.coefficients
    }

    /// Covariance of model `i`: `P(k|k)` after an update.
    pub fn covariance(&self, i: usize) -> Mat<f64> {
        let mut p = Mat::zeros(self.sizes.n, self.sizes.n);
        self.covariance_into(i, &mut p);
        p
    }

    /// Copies it.
    pub(super) fn covariance_into(&self, i: usize, p: &mut Mat<f64>) {
        for r in 0..self.sizes.n {
            for c in 0..self.sizes.n {
                p[(r, c)] = self.p.get(i, r, c);
            }
        }
    }

    /// Replaces the covariance of model `i`.
    pub(super) fn set_covariance(&mut self, i: usize, p: &Mat<f64>) {
        let n = self.sizes.n;
        for r in 0..n {
            for c in 0..n {
                self.p.set(i, r, c, p[(r, c)]);
            }
        }
        self.p.fill_padding();
    }

    /// All covariances: the recursion goes on from them alone.
    pub(crate) fn covariances(&self) -> &Panel {
        &self.p
    }

    /// The largest `|eigenvalue of A - L C| dt` of a continuous observer.
    pub(super) fn pace(&self) -> f64 {
        let n = self.sizes.n;
        let poles = self.plants.iter().enumerate().filter_map(|(k, plant)| {
            let p = Mat::from_fn(n, n, |i, j| self.p.get(k, i, j));
            let f = Held::at(plant, p)?.closed();
            let values = backend::eigenvalues(f.as_ref()).ok()?;
            Some(values.iter().fold(0.0_f64, |m, v| m.max(v.re.hypot(v.im))))
        });
        poles.fold(0.0, f64::max) * self.dt
    }

    /// True for observers in continuous time.
    pub(crate) fn is_continuous(&self) -> bool {
        self.continuous
    }

    /// Where the gains come from.
    pub fn mode(&self) -> GainMode {
        self.mode
    }
}

/// The time between measurements.
fn interval(plant: &Plant, dt: Option<f64>) -> Result<f64> {
    match (plant.time, dt) {
        (Time::Discrete { dt }, _) => Ok(dt),
        (Time::Continuous, Some(dt)) if dt > 0.0 && dt.is_finite() => Ok(dt),
        (Time::Continuous, dt) => Err(Error::InvalidDt { dt: dt.unwrap_or(f64::NAN) }),
    }
}
