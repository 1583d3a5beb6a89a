//! The weights of a bank and one step of their law.

use super::dwsg;
use super::law::{DwsgScheme, Law, Modifiers};
use super::log::{largest, normalise, raise};
use super::markov::Transition;
use super::ode::{self, OdeNodes};
use super::zhang::Energies;
use crate::error::{Error, Result};
use crate::real::{Mask, Real};

/// What one step says of each model.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a, T> {
    /// Log-likelihood of the measurement, `ln N(r_i; 0, S_i)`, or its increment;
    /// NaN for a member that failed.
    pub log_lik: &'a [T],
    /// Increment of the continuous-time log-likelihood, for
    /// [`Law::Likelihood`].
    pub increment: &'a [T],
    /// `|r_i|^2` in a norm common to all models.
    pub energy: &'a [T],
    /// Length of the step in seconds (1 with discrete observers).
    pub dt: f64,
    /// Signals along the interval, for [`Law::Ode`].
    pub nodes: Option<OdeNodes<'a, T>>,
}

/// Log weights of N models, in every lane, and the memory of their law.
#[derive(Debug, Clone)]
pub struct Weights<T: Real> {
    law: Law,
    modifiers: Modifiers,
    transition: Option<Transition>,
    prior: Vec<f64>,
    log_p: Vec<T>,
    energies: Energies<T>,
    /// Log-likelihoods at the start of the step, for the trapezoid.
    last: Vec<T>,
    has_last: bool,
    work: Vec<T>,
    before: Vec<T>,
}

/// Normalised logarithms of prior probabilities; zeros stay zero.
///
/// ```
/// use mmae::weight::check_prior;
/// let log_p = check_prior(&[2.0, 0.0, 6.0])?;
/// assert_eq!(log_p[1], f64::NEG_INFINITY);
/// assert!((log_p[2].exp() - 0.75).abs() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
///
/// # Errors
/// `Empty`; `Range` for a negative or non-finite entry, and if all are zero.
pub fn check_prior(prior: &[f64]) -> Result<Vec<f64>> {
    if prior.is_empty() {
        return Err(Error::Empty { what: "prior".into() });
    }
    for (i, &p) in prior.iter().enumerate() {
        if !(p >= 0.0 && p.is_finite()) {
            return Err(Error::Range {
                what: format!("prior[{i}]"),
                value: p,
                remedy: "give a probability, zero or more".into(),
            });
        }
    }
    let mut log_p: Vec<f64> = prior.iter().map(|&p| libm::log(p)).collect();
    if !normalise(&mut log_p) {
        return Err(Error::Range {
            what: "sum of the prior".into(),
            value: 0.0,
            remedy: "give at least one model a probability above zero".into(),
        });
    }
    Ok(log_p)
}

impl<T: Real> Weights<T> {
    /// Weights at `prior`, which is normalised.
    ///
    /// # Errors
    /// Of [`check_prior`], [`Law::check`], [`Modifiers::check`]; `Shape` for a
    /// transition of another number of models.
    pub fn new(
        law: Law,
        modifiers: Modifiers,
        transition: Option<Transition>,
        prior: &[f64],
    ) -> Result<Self> {
        let prior = check_prior(prior)?;
        let n = prior.len();
        law.check()?;
        modifiers.check(n)?;
        if let Some(t) = &transition
            && t.models() != n
        {
            let got = [t.models(), t.models()];
            return Err(Error::Shape { what: "Pi".into(), want: [n, n], got });
        }
        Ok(Self {
            law,
            energies: Energies::new(n, modifiers.window),
            modifiers,
            transition,
            log_p: prior.iter().map(|&l| T::splat(l)).collect(),
            prior,
            last: vec![T::zero(); n],
            has_last: false,
            work: vec![T::zero(); 3 * n],
            before: vec![T::zero(); n],
        })
    }

    /// The same weights at the prior, for other lanes.
    pub(crate) fn fresh<U: Real>(&self) -> Weights<U> {
        let n = self.prior.len();
        Weights {
            law: self.law,
            energies: Energies::new(n, self.modifiers.window),
            modifiers: self.modifiers.clone(),
            transition: self.transition.clone(),
            log_p: self.prior.iter().map(|&l| U::splat(l)).collect(),
            prior: self.prior.clone(),
            last: vec![U::zero(); n],
            has_last: false,
            work: vec![U::zero(); 3 * n],
            before: vec![U::zero(); n],
        }
    }

    /// Back to the prior.
    pub fn reset(&mut self) {
        for i in 0..self.prior.len() {
            self.log_p[i] = T::splat(self.prior[i]);
        }
        self.energies.reset();
        self.has_last = false;
    }

    /// `ln p`, normalised.
    #[inline(always)]
    pub fn log_p(&self) -> &[T] {
        &self.log_p
    }

    /// `ln p`, to overwrite (it is not normalised again before the next step).
    pub fn log_p_mut(&mut self) -> &mut [T] {
        &mut self.log_p
    }

    /// Takes the weight of the models marked by `out` for good; where nothing is
    /// left nothing sums to one.
    #[inline(always)]
    pub fn leave_out(&mut self, out: &[bool]) {
        if !out.contains(&true) {
            return;
        }
        for (l, &out) in self.log_p.iter_mut().zip(out) {
            if out {
                *l = T::splat(f64::NEG_INFINITY);
            }
        }
        self.renormalise();
    }

    /// Makes the weights sum to one again after [`Weights::log_p_mut`]; lanes
    /// without any stay as they are.
    #[inline(always)]
    pub fn renormalise(&mut self) {
        let _ = normalise(&mut self.log_p);
    }

    /// Writes `p`.
    #[inline(always)]
    pub fn p_into(&self, p: &mut [T]) {
        let p = &mut p[..self.log_p.len()];
        p.copy_from_slice(&self.log_p);
        T::exp_each(p);
    }

    /// Time goes on by a step: models may change, if a transition was given.
    #[inline(always)]
    pub fn predict(&mut self) {
        if let Some(transition) = &self.transition {
            transition.apply(&mut self.log_p, &mut self.work);
        }
    }

    /// A measurement: forgetting, the law, the floor.
    ///
    /// Returns the lanes where some model explained the measurement; where none
    /// did (all log-likelihoods are minus infinity or NaN) the weights are as
    /// before the step.
    #[inline(always)]
    pub fn step(&mut self, evidence: &Evidence<'_, T>) -> T::Mask {
        let n = self.log_p.len();
        self.before.copy_from_slice(&self.log_p);
        if self.modifiers.forgetting < 1.0 {
            for i in 0..n {
                self.log_p[i] = self.log_p[i] * T::splat(self.modifiers.forgetting);
            }
            let _ = normalise(&mut self.log_p);
        }
        let good = self.law(evidence);
        if self.modifiers.floor > 0.0 {
            raise(&mut self.log_p, libm::log(self.modifiers.floor));
        }
        for i in 0..n {
            self.log_p[i] = T::select(good, self.log_p[i], self.before[i]);
        }
        good
    }

    #[inline(always)]
    fn law(&mut self, evidence: &Evidence<'_, T>) -> T::Mask {
        let n = self.log_p.len();
        match self.law {
            Law::Zhang { n_max } => self.energies.step(evidence.energy, n_max, &mut self.log_p),
            Law::Ode { substeps } => match &evidence.nodes {
                Some(nodes) => ode::step(nodes, substeps, &mut self.log_p, &mut self.work),
                None => T::Mask::splat(false),
            },
            Law::Bayes | Law::Likelihood => {
                let (lik, _) = self.work.split_at_mut(n);
                let log_lik =
                    if self.law == Law::Bayes { evidence.log_lik } else { evidence.increment };
                clipped(log_lik, &self.log_p, 1.0, self.modifiers.clip, lik);
                for i in 0..n {
                    self.log_p[i] = self.log_p[i] + lik[i];
                }
                normalise(&mut self.log_p)
            }
            Law::Dwsg { lambda, tempering, scheme } => {
                let (lik, work) = self.work.split_at_mut(n);
                clipped(evidence.log_lik, &self.log_p, tempering, self.modifiers.clip, lik);
                if scheme == DwsgScheme::Trapezoid {
                    for i in 0..n {
                        let now = lik[i];
                        if self.has_last {
                            lik[i] = (now + self.last[i]) * T::splat(0.5);
                        }
                        self.last[i] = now;
                    }
                    // the first call only opens the interval
                    if !std::mem::replace(&mut self.has_last, true) {
                        return T::Mask::splat(true);
                    }
                }
                dwsg::step(scheme, lambda * evidence.dt, lik, &mut self.log_p, work)
            }
        }
    }
}

/// Log-likelihoods times `factor`, relative to the best and no lower than
/// `-clip`; minus infinity in place of NaN and for models without weight, which
/// are no measure for the others.
#[inline(always)]
fn clipped<T: Real>(log_lik: &[T], log_p: &[T], factor: f64, clip: f64, out: &mut [T]) {
    let worst = T::splat(f64::NEG_INFINITY);
    for i in 0..log_lik.len() {
        let counts = log_p[i].gt(worst) & log_lik[i].eq(log_lik[i]);
        out[i] = T::select(counts, log_lik[i], worst);
    }
    let top = largest(&out[..log_lik.len()]);
    let shift = T::select(top.is_finite(), top, T::zero());
    for i in 0..log_lik.len() {
        let counts = log_p[i].gt(worst) & log_lik[i].eq(log_lik[i]) & top.is_finite();
        let relative = (out[i] - shift) * T::splat(factor);
        out[i] = T::select(counts, relative.max(T::splat(-clip)), worst);
    }
}
