//! A bank that is re-centred: an adaptive observer beside it builds a new member.
//!
//! ```text
//! NIS of the best member, mean over a window, outside its band
//! and theta_hat of the adaptive observer settled and inside its box
//!     the member of lowest weight  <-  model(theta_hat), started at the fused x, P,
//!                                      with the weight of the floor
//! ```
//! The adaptive observer stays outside the recursion of the weights: it only says where
//! a model is missing.

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;

use super::estimate::Estimate;
use super::mmae::Mmae;
use super::weighting::Weighting;
use crate::adaptive::Adaptive;
use crate::bank::{Members, Settings};
use crate::error::{Error, Result};
use crate::model::Plant;
use crate::weight::Law;

/// A model of the bank from the parameters of the adaptive observer.
pub type Build = Arc<dyn Fn(&[f64]) -> Result<Plant> + Send + Sync>;

/// When a bank is re-centred, and by what.
#[derive(Clone)]
pub struct Recentre {
    /// Measurements over which the NIS of the best member is averaged; as many pass
    /// after a move before the next.
    pub window: usize,
    /// Lowest and highest mean NIS that speak for the best member, such as the
    /// chi-square band of the window.
    pub band: [f64; 2],
    /// Largest relative change of `theta_hat` over a window of the adaptive observer
    /// that counts as settled.
    pub tolerance: f64,
    /// Weight of a new member, in (0, 1).
    pub floor: f64,
    /// Moves at most.
    pub most: usize,
    /// The model at `theta_hat`.
    pub build: Build,
}

impl fmt::Debug for Recentre {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recentre")
            .field("window", &self.window)
            .field("band", &self.band)
            .field("tolerance", &self.tolerance)
            .field("floor", &self.floor)
            .field("most", &self.most)
            .finish_non_exhaustive()
    }
}

impl Recentre {
    fn check(&self) -> Result<()> {
        let range = |what: &str, value: f64, remedy: &str| {
            Err(Error::Range { what: what.into(), value, remedy: remedy.into() })
        };
        if self.window == 0 {
            return range("window of the NIS", 0.0, "give one measurement or more");
        }
        if self.band.iter().any(|b| b.is_nan()) || self.band[0] >= self.band[1] {
            return range("band of the NIS", self.band[0], "give a lower and a higher number");
        }
        if self.tolerance.is_nan() || self.tolerance <= 0.0 {
            return range("tolerance", self.tolerance, "give a positive number");
        }
        if !(self.floor > 0.0 && self.floor < 1.0) {
            return range("floor", self.floor, "give a weight between 0 and 1");
        }
        Ok(())
    }
}

/// A member that was replaced.
#[derive(Debug, Clone, PartialEq)]
pub struct Move {
    /// Measurement after which it was, from 1.
    pub step: u64,
    /// The member.
    pub member: usize,
    /// `theta_hat` that the new one was built at.
    pub theta: Vec<f64>,
    /// Mean NIS of the best member before.
    pub nis: f64,
}

/// A bank with an adaptive observer beside it.
///
/// ```
/// use std::sync::Arc;
/// use mmae::adaptive::{self, Adaptive, FnRegressor, Prior, Structure, Tuning, Unknown};
/// use mmae::bank::{Members, Settings};
/// use mmae::engine::{Recentre, Recentred, Weighting};
/// use mmae::model::{Plant, Time};
/// use mmae::observer::ObserverKind;
/// use mmae::weight::Law;
/// use mmae::{Mat, mat};
/// // x' = -a x + u: models of a = 1 and 2, and a plant of a = 4
/// let plant = |a: f64| Plant {
///     time: Time::Continuous,
///     A: mat![[-a]], B: mat![[1.0]], G: mat![[1.0]], C: mat![[1.0]],
///     Q: mat![[1e-4]], R: mat![[1e-6]],
/// };
/// let members = Members::new(ObserverKind::KalmanBucy, vec![plant(1.0), plant(2.0)]);
/// let settings = Settings { dt: Some(0.01), ..Settings::default() };
/// let weighting = Weighting { law: Law::Likelihood, ..Weighting::default() };
/// let input = FnRegressor::new(0, |_, u, _, _, known| known[0] = u[0]);
/// let structure = Structure {
///     states: vec!["x".into()], outputs: vec!["x".into()], inputs: 1,
///     unknown: vec![Unknown::entry("-a", 0, 0)], regressor: Arc::new(input),
/// };
/// let prior = Prior::uniform(1e6, 1);
/// let tuning = Tuning::new(mat![[0.0]], mat![[1.0]], mat![[3.0]], vec![-1.0], prior);
/// let beside = adaptive::Settings { window: 200, ..adaptive::Settings::new(0.01) };
/// let beside = Adaptive::new(structure, beside, vec![tuning])?;
/// let rule = Recentre {
///     window: 100, band: [0.6, 1.4], tolerance: 0.02, floor: 1e-3, most: 1,
///     build: Arc::new(move |theta| Ok(plant(-theta[0]))),
/// };
/// let mut both = Recentred::new(members, settings, &weighting, &[1.0, 1.0], beside, rule)?;
/// let (mut x, mut before) = (0.0, 0.0);
/// for k in 0..2000 {
///     let u = (0.01 * f64::from(k)).sin();
///     both.step(&[u], &[x], &[0.5 * (before + u)])?;
///     x = u / 4.0 + (x - u / 4.0) * (-0.04_f64).exp(); // u is held
///     before = u;
/// }
/// let moved = &both.moves()[0];
/// assert!((moved.theta[0] + 4.0).abs() < 0.05);
/// assert_eq!(both.mmae().estimate().best, Some(moved.member));
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Recentred {
    mmae: Mmae,
    adaptive: Adaptive,
    members: Members,
    settings: Settings,
    rule: Recentre,
    /// NIS of every model, the last `window` measurements.
    nis: VecDeque<Vec<f64>>,
    moves: Vec<Move>,
}

impl Recentred {
    /// A bank as [`Mmae::new`] makes it, and an adaptive observer of one item.
    ///
    /// # Errors
    /// As [`Mmae::new`]; `Range` for a rule that cannot be; `Shape` for another number of
    /// outputs, or a batch of several observers; `Conflict` for a law that remembers more
    /// of a member than its weight (only Bayes's and Dunn's likelihood do not).
    pub fn new(
        members: Members,
        settings: Settings,
        weighting: &Weighting,
        prior: &[f64],
        adaptive: Adaptive,
        rule: Recentre,
    ) -> Result<Self> {
        rule.check()?;
        if !matches!(weighting.law, Law::Bayes | Law::Likelihood) {
            return Err(Error::Conflict {
                problem: format!("re-centring under the law {}", weighting.law.name()),
                remedy: "use bayes, or dunn as a likelihood".into(),
            });
        }
        let mmae = Mmae::new(&members, &settings, weighting, prior)?;
        let [_, _, q] = mmae.bank().sizes();
        let outputs = adaptive.structure().outputs.len();
        if outputs != q || adaptive.len() != 1 {
            let (want, got) = ([1, q], [adaptive.len(), outputs]);
            return Err(Error::Shape { what: "adaptive observer".into(), want, got });
        }
        // one initial value a model, so that one can change alone
        let mut members = members;
        if members.initial.len() == 1 {
            members.initial = vec![members.initial[0].clone(); members.plants.len()];
        }
        Ok(Self { mmae, adaptive, members, settings, rule, nis: VecDeque::new(), moves: vec![] })
    }

    /// One measurement of both: `u` and `y` as [`Mmae::step`] takes them, `u_now` the
    /// input at the time of `y` for the adaptive observer.
    ///
    /// # Errors
    /// As [`Mmae::step`] and [`Adaptive::step`]; those of the model that is built at
    /// `theta_hat` are no errors, the bank then stays as it is.
    pub fn step(&mut self, u: &[f64], y: &[f64], u_now: &[f64]) -> Result<&Estimate> {
        self.mmae.bank().check(u, y)?;
        self.adaptive.step(u_now, y)?;
        self.mmae.step(u, y)?;
        if y.iter().any(|v| !v.is_nan()) {
            self.nis.push_back(self.mmae.estimate().nis.clone());
        }
        if self.nis.len() > self.rule.window {
            self.nis.pop_front();
        }
        if let Some((theta, nis)) = self.wanted() {
            self.recentre(theta, nis);
        }
        Ok(self.mmae.estimate())
    }

    /// `theta_hat` and the mean NIS that speaks for a move.
    fn wanted(&self) -> Option<(Vec<f64>, f64)> {
        if self.nis.len() < self.rule.window || self.moves.len() >= self.rule.most {
            return None;
        }
        let best = self.mmae.estimate().best?;
        let mean = self.nis.iter().map(|row| row[best]).sum::<f64>() / self.nis.len() as f64;
        let [low, high] = self.rule.band;
        if (low..=high).contains(&mean) {
            return None;
        }
        let now = self.adaptive.estimate(0);
        now.is_settled(self.rule.tolerance).then_some((now.theta, mean))
    }

    /// Replaces the member of lowest weight by one at `theta`.
    fn recentre(&mut self, theta: Vec<f64>, nis: f64) {
        let p = &self.mmae.estimate().p;
        let best = self.mmae.estimate().best;
        let lowest =
            (0..p.len()).filter(|i| Some(*i) != best).min_by(|&i, &j| p[i].total_cmp(&p[j]));
        // a bank of one member is replaced as a whole
        let member = lowest.unwrap_or(0);
        self.nis.clear();
        let Ok(plant) = (self.rule.build)(&theta) else { return };
        let mut members = self.members.clone();
        members.plants[member] = plant;
        let done = self.mmae.replace(&members, &self.settings, member, self.rule.floor);
        if done.is_ok() {
            self.members = members;
            let step = self.mmae.estimate().step;
            self.moves.push(Move { step, member, theta, nis });
        }
    }

    /// The bank.
    pub fn mmae(&self) -> &Mmae {
        &self.mmae
    }

    /// The adaptive observer.
    pub fn adaptive(&self) -> &Adaptive {
        &self.adaptive
    }

    /// The members that were replaced, in their order.
    pub fn moves(&self) -> &[Move] {
        &self.moves
    }

    /// The models as they are now.
    pub fn plants(&self) -> &[Plant] {
        &self.members.plants
    }
}
