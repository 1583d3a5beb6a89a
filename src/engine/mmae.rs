//! The engine on one measurement stream.

use faer::Mat;

use super::estimate::Estimate;
use super::mixing::Moments;
use super::weighting::{Innovation, Mixing, Weighting};
use crate::bank::{Bank, GainMode, Members, Schedule, Settings, Step};
use crate::error::{Error, Result};
use crate::model::Plant;
use crate::real::{LaneKernel, Real, exp, ln};
use crate::weight::{Evidence, Law, OdeNodes, TOGETHER, Weights};

/// Multiple-model adaptive estimator: predict, innovate, weigh, fuse.
#[derive(Debug, Clone)]
pub struct Mmae {
    bank: Bank,
    weights: Weights<f64>,
    law: Law,
    innovation: Innovation,
    mixing: Mixing,
    moments: Moments,
    estimate: Estimate,
    /// Evidence with the members that failed masked.
    masked: [Vec<f64>; 3],
    x: Vec<f64>,
}

impl Mmae {
    /// Designs the observers and puts bank and weights at their start.
    ///
    /// `prior` holds a probability a model, in any common scale.
    ///
    /// # Errors
    /// As [`Bank::new`] and [`Weights::new`]; `Shape` for a prior of the wrong
    /// length; `Conflict` for a law that does not fit the observers.
    pub fn new(
        members: &Members,
        settings: &Settings,
        weighting: &Weighting,
        prior: &[f64],
    ) -> Result<Self> {
        let models = members.plants.len();
        if prior.len() != models && models > 0 {
            let got = [prior.len(), 1];
            return Err(Error::Shape { what: "prior".into(), want: [models, 1], got });
        }
        weighting.mixing.check()?;
        let continuous = members.observer.is_continuous();
        let law = weighting.law;
        if !continuous && matches!(law, Law::Likelihood | Law::Ode { .. }) {
            return Err(Error::Conflict {
                problem: "Dunn's laws on discrete filters".into(),
                remedy: "use Bayes's law, which is the same posterior for samples".into(),
            });
        }
        if continuous && matches!(weighting.mixing, Mixing::Imm(_)) {
            return Err(Error::Conflict {
                problem: "interacting models with continuous observers".into(),
                remedy: "mix the weights only (markov), or sample the plant".into(),
            });
        }
        let bank = Bank::new(members, &bank_settings(settings, law, &weighting.innovation))?;
        let transition = weighting.mixing.transition().cloned();
        let weights = Weights::new(law, weighting.modifiers.clone(), transition, prior)?;
        let [n, _, q] = bank.sizes();
        let mut mmae = Self {
            weights,
            law,
            innovation: weighting.innovation.clone(),
            mixing: weighting.mixing.clone(),
            moments: Moments::new(models, n),
            estimate: Estimate::new(models, n, q),
            masked: [vec![0.0; models], vec![0.0; models], vec![0.0; models]],
            x: vec![0.0; n],
            bank,
        };
        mmae.restart();
        Ok(mmae)
    }

    /// Back to the start.
    pub fn reset(&mut self) {
        self.bank.reset();
        self.weights.reset();
        self.restart();
    }

    fn restart(&mut self) {
        let e = &mut self.estimate;
        e.step = 0;
        e.log_lik_models.fill(0.0);
        e.explained = true;
        e.log_lik = f64::NAN;
        for (failed, cause) in e.failed.iter_mut().zip(self.bank.failures()) {
            *failed = cause.is_some();
        }
        self.weights.leave_out(&e.failed);
        self.fuse();
    }

    /// One measurement: `u` acted since the last one, `y` is what was seen (NaN
    /// for an output that is missing).
    ///
    /// In continuous time both are held from the present time to the next, which
    /// is where the estimate then stands.
    ///
    /// # Errors
    /// As [`Bank::update`]; the engine is then as before. `AllFailed` once every
    /// member has failed: no estimate is left.
    pub fn step(&mut self, u: &[f64], y: &[f64]) -> Result<&Estimate> {
        self.bank.check(u, y)?;
        if self.bank.moves() {
            if let Mixing::Imm(pi) = &self.mixing {
                self.moments.interact(&mut self.bank, pi, &self.estimate.p);
            }
            self.weights.predict();
            // those that failed take no part in what comes and goes
            self.weights.leave_out(&self.estimate.failed);
        }
        self.bank.predict(u);
        let step = self.bank.update(u, y)?;
        let seen = y.iter().any(|v| !v.is_nan());
        self.estimate.nis.copy_from_slice(&step.nis);
        self.estimate.r.copy_from_slice(&step.r);
        f64::outline(Judge { engine: self, seen: Some(seen) });
        if self.estimate.failed.iter().all(|f| *f) {
            return Err(Error::AllFailed {
                what: "models",
                count: self.estimate.failed.len(),
                source: Box::new(Error::NonFinite { what: "x_hat".into(), row: 0, col: 0 }),
            });
        }
        if let Mixing::Reseed { threshold } = self.mixing {
            let (p, failed) = (&self.estimate.p, &self.estimate.failed);
            self.moments.reseed(&mut self.bank, p, |i| p[i] < threshold && !failed[i]);
        }
        self.estimate.step += 1;
        Ok(&self.estimate)
    }

    /// Moves the weights by what the bank found.
    #[inline(always)]
    fn weigh(&mut self, seen: bool) {
        let step: &Step = self.bank.last();
        let e = &mut self.estimate;
        let [log_lik, increment, energy] = &mut self.masked;
        for i in 0..e.failed.len() {
            // a member that ran away is out for good
            let healthy = step.log_lik[i].is_nan() == step.nis[i].is_nan()
                && !step.nis[i].is_nan()
                && self.bank.is_finite(i);
            e.failed[i] |= !healthy;
            log_lik[i] = match self.innovation {
                Innovation::Filter => step.log_lik[i],
                Innovation::Steady if self.bank.is_continuous() => step.log_lik[i],
                Innovation::Steady => step.increment[i],
                Innovation::Common(_) => -0.5 * step.energy[i],
            };
            increment[i] = step.increment[i];
            energy[i] = step.energy[i];
            if e.failed[i] {
                (log_lik[i], increment[i], energy[i]) = (f64::NAN, f64::NAN, f64::NAN);
            }
        }
        if !seen {
            // nothing was measured: nothing is learnt
            e.log_lik = 0.0;
            return;
        }
        let likelihood = if self.law == Law::Likelihood { &*increment } else { &*log_lik };
        let before = self.weights.log_p();
        e.log_lik = match self.law {
            Law::Bayes | Law::Likelihood | Law::Dwsg { .. } => mixture_log_lik(before, likelihood),
            Law::Zhang { .. } | Law::Ode { .. } => f64::NAN,
        };
        for (total, l) in e.log_lik_models.iter_mut().zip(likelihood) {
            *total += l;
        }
        let dt = if self.bank.is_continuous() { self.bank.dt() } else { 1.0 };
        let nodes = (!step.h.is_empty()).then(|| OdeNodes { h: &step.h, y: &step.y, dt });
        e.explained = self.weights.step(&Evidence { log_lik, increment, energy, dt, nodes });
    }

    /// Fused estimate and figures from weights and states.
    fn fuse(&mut self) {
        f64::outline(Judge { engine: self, seen: None });
    }

    #[inline(always)]
    fn fuse_here(&mut self) {
        let e = &mut self.estimate;
        e.log_p.copy_from_slice(self.weights.log_p());
        self.weights.p_into(&mut e.p);
        e.x_hat.fill(0.0);
        e.best = None;
        let mut squares = 0.0;
        for i in 0..e.p.len() {
            let p = e.p[i];
            squares += p * p;
            if e.log_p[i] > e.best.map_or(f64::NEG_INFINITY, |b| e.log_p[b]) {
                e.best = Some(i);
            }
            // a member without weight may hold anything
            if p > 0.0 {
                self.bank.x_hat_into(i, &mut self.x);
                for (sum, &x) in e.x_hat.iter_mut().zip(&self.x) {
                    *sum = p.mul_add(x, *sum);
                }
            }
        }
        e.n_eff = 1.0 / squares;
    }

    /// Goes on with other models from the next step on: matrices `A(t)`, `B(t)`,
    /// `C(t)` that vary, or samples at uneven times. Estimates, covariances and
    /// weights stay.
    ///
    /// ```
    /// use mmae::bank::{GainMode, Initial, Members, Settings};
    /// use mmae::engine::{Mmae, Weighting};
    /// use mmae::model::{Plant, Time, sample};
    /// use mmae::observer::ObserverKind;
    /// use mmae::{Mat, mat};
    /// // random walks of intensity 1 and 4, seen when it happens
    /// let walk = |q: f64| Plant {
    ///     time: Time::Continuous,
    ///     A: mat![[0.0]], B: Mat::zeros(1, 0), G: mat![[1.0]], C: mat![[1.0]],
    ///     Q: mat![[q]], R: mat![[1.0]],
    /// };
    /// let over = |seconds: f64| -> mmae::Result<Vec<Plant>> {
    ///     let sampled = |q| Ok(Plant { R: mat![[1.0]], ..sample(&walk(q), seconds, 0.0)?.0 });
    ///     [1.0, 4.0].map(sampled).into_iter().collect()
    /// };
    /// let mut members = Members::new(ObserverKind::Kalman, over(1.0)?);
    /// members.initial = vec![Initial { x_hat: vec![0.0], P: Some(mat![[0.0]]) }];
    /// let settings = Settings { gains: GainMode::Recursive, ..Settings::default() };
    /// let mut mmae = Mmae::new(&members, &settings, &Weighting::default(), &[1.0, 1.0])?;
    /// mmae.set_models(&over(3.0)?)?;
    /// mmae.step(&[], &[0.5])?;
    /// // P(k|k-1) = 3 q, P = 3 q / (3 q + 1)
    /// assert!((mmae.bank().covariance(1)[(0, 0)] - 12.0 / 13.0).abs() < 1e-14);
    /// # Ok::<(), mmae::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Bank::set_models`]; `Conflict` for weights in the norm of the steady
    /// `S`, which models that change do not have. The engine is then as before.
    pub fn set_models(&mut self, plants: &[Plant]) -> Result<()> {
        if self.innovation == Innovation::Steady && !self.bank.is_continuous() {
            return Err(Error::Conflict {
                problem: "models that change under the norm of their steady S".into(),
                remedy: "judge the residuals by the running filter or one W".into(),
            });
        }
        self.bank.set_models(plants)
    }

    /// Goes on with another model in the place of `member`: `members` are those of the
    /// bank but for it. It starts at the fused estimate with the weight `floor`; the
    /// others stay as they are, their weights in proportion.
    ///
    /// # Errors
    /// As [`Mmae::new`], and the cause if the new member cannot be used; the engine is
    /// then as before.
    pub(crate) fn replace(
        &mut self,
        members: &Members,
        settings: &Settings,
        member: usize,
        floor: f64,
    ) -> Result<()> {
        let mut bank = Bank::new(members, &bank_settings(settings, self.law, &self.innovation))?;
        if let Some(cause) = &bank.failures()[member] {
            return Err(cause.clone());
        }
        let recursive = bank.gains().mode() == GainMode::Recursive;
        let fused = self.moments.covariance(&self.bank, &self.estimate.p);
        for i in 0..self.estimate.p.len() {
            if i == member {
                bank.set(i, &self.estimate.x_hat, recursive.then_some(&fused));
                continue;
            }
            self.bank.x_hat_into(i, &mut self.x);
            let own = self.bank.covariance(i);
            bank.set(i, &self.x, recursive.then_some(&own));
        }
        bank.resume();
        self.bank = bank;
        let rest = 1.0 - self.estimate.p[member];
        let share = if rest > 0.0 { ln((1.0 - floor) / rest) } else { 0.0 };
        for (i, log_p) in self.weights.log_p_mut().iter_mut().enumerate() {
            *log_p = if i == member { ln(floor) } else { *log_p + share };
        }
        self.weights.renormalise();
        let e = &mut self.estimate;
        e.failed[member] = false;
        // of the record so far it has none
        e.log_lik_models[member] = f64::NAN;
        self.fuse();
        Ok(())
    }

    /// The estimate after the last measurement, or at the start.
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// Covariance of the fused estimate, n by n.
    ///
    /// ```text
    /// P = sum p_i (P_i + (x_i - x_hat)(x_i - x_hat)')
    /// ```
    pub fn covariance(&mut self) -> Mat<f64> {
        self.moments.covariance(&self.bank, &self.estimate.p)
    }

    /// The observers.
    pub fn bank(&self) -> &Bank {
        &self.bank
    }

    pub(super) fn law(&self) -> Law {
        self.law
    }

    pub(super) fn innovation(&self) -> &Innovation {
        &self.innovation
    }

    /// The weights at their prior, in lanes.
    pub(super) fn fresh_weights<T: Real>(&self) -> Weights<T> {
        self.weights.fresh()
    }

    /// True if many records can run in lanes: all that differs between them is
    /// states and weights.
    pub(super) fn in_lanes(&self) -> bool {
        !self.bank.is_continuous() && matches!(self.mixing, Mixing::None | Mixing::Markov(_))
    }

    /// Coefficients of `steps` steps from the start.
    pub(super) fn schedule(&self, steps: u64) -> Result<Schedule> {
        let mut gains = self.bank.first_gains().clone();
        let moves = self.bank.moves_first();
        Schedule::new(&mut gains, self.bank.sizes(), self.bank.models(), steps, moves)
    }
}

/// Weights after a measurement, if there was one (`seen` if anything was measured then),
/// and what is fused with them: in a function of its own, where a fused multiply-add is an
/// instruction and not a call.
struct Judge<'a> {
    engine: &'a mut Mmae,
    seen: Option<bool>,
}

impl LaneKernel<f64> for Judge<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let Judge { engine, seen } = self;
        if let Some(seen) = seen {
            engine.weigh(seen);
            engine.weights.leave_out(&engine.estimate.failed);
        }
        engine.fuse_here();
    }
}

/// The settings of a bank as its law wants them.
fn bank_settings(settings: &Settings, law: Law, innovation: &Innovation) -> Settings {
    let mut settings = settings.clone();
    if let Law::Ode { substeps } = law {
        settings.parts = 2 * substeps;
    }
    if let Innovation::Common(w) = innovation {
        settings.norm = Some(w.clone());
    }
    settings
}

/// `ln sum p_i l_i` of normalised weights; terms that are no number are left out.
#[inline(always)]
pub(super) fn mixture_log_lik<T: Real>(log_p: &[T], log_lik: &[T]) -> T {
    let mut top = T::splat(f64::NEG_INFINITY);
    for i in 0..log_p.len() {
        // a NaN never replaces a number
        top = (log_p[i] + log_lik[i]).max(top);
    }
    let shift = T::select(top.is_finite(), top, T::zero());
    let mut sum = T::zero();
    if const { T::LANES > 1 } {
        for i in 0..log_p.len() {
            let term = log_p[i] + log_lik[i];
            sum = T::select(term.eq(term), sum + exp(term - shift), sum);
        }
    } else {
        // one record: its models in lanes
        for (log_p, log_lik) in log_p.chunks(TOGETHER).zip(log_lik.chunks(TOGETHER)) {
            let mut terms = [T::zero(); TOGETHER];
            let terms = &mut terms[..log_p.len()];
            for i in 0..terms.len() {
                terms[i] = (log_p[i] + log_lik[i]) - shift;
            }
            T::exp_each(terms);
            for &mut term in terms {
                sum = T::select(term.eq(term), sum + term, sum);
            }
        }
    }
    T::select(top.is_finite(), top + ln(sum), top)
}
