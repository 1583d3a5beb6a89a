//! A batch of adaptive observers, eight to a block.

use std::sync::Arc;

use faer::Mat;

use super::check;
use super::estimate::{Estimate, Window};
use super::group::{Group, Shared};
use super::layout::{Layout, kinds};
use super::plant::{Prior, Settings, Structure, Tuning};
use super::scheme::Scheme;
use super::ud;
use crate::error::{Error, Result};
use crate::par::{self, RunControl};
use crate::simd::LANES;

/// Observers of states and parameters, one an item: trials, plants, gains, forgetting
/// factors.
///
/// ```text
/// x_hat' = A x_hat + sum_i theta_hat_i g_i + f + K (y - C x_hat)
/// theta_hat = arg min sum_k e^{-lambda (t - t_k)} |y_k - C (Psi_k theta + psi_0k)|^2
/// ```
/// The filters are sampled with linearly interpolated inputs; see
/// [`adaptive`](super) for the scheme.
///
/// ```
/// use std::sync::Arc;
/// use mmae::adaptive::{Adaptive, FnRegressor, Prior, Settings, Structure, Tuning, Unknown};
/// use mmae::mat;
/// // x' = -a x + b u, a and b unknown, x measured
/// let input = FnRegressor::new(1, |_, u, _, gamma, _| gamma[0] = u[0]);
/// let structure = Structure {
///     states: vec!["x".into()],
///     outputs: vec!["x".into()],
///     inputs: 1,
///     unknown: vec![Unknown::entry("-a", 0, 0), Unknown::given("b")],
///     regressor: Arc::new(input),
/// };
/// let (zero, one, gain) = (mat![[0.0]], mat![[1.0]], mat![[2.0]]);
/// let tuning = Tuning::new(zero, one, gain, vec![0.0; 2], Prior::uniform(1e8, 2));
/// let mut observer = Adaptive::new(structure, Settings::new(0.01), vec![tuning])?;
/// // a = 1, b = 2, u = sin t
/// let (a, b) = (1.0, 2.0);
/// for k in 0..2000 {
///     let t = 0.01 * f64::from(k);
///     let x = b / (a * a + 1.0) * (a * t.sin() - t.cos() + (-a * t).exp());
///     observer.step(&[t.sin()], &[x])?;
/// }
/// let theta = observer.theta(0);
/// assert!((theta[0] + a).abs() < 1e-3 && (theta[1] - b).abs() < 1e-3, "{theta:?}");
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Adaptive {
    shared: Arc<Shared>,
    groups: Vec<Group>,
    step: u64,
}

impl Adaptive {
    /// Observers of the plants that `tunings` describe, at their start.
    ///
    /// An item that cannot be used is flagged in [`Adaptive::failures`]; its place is
    /// taken by the first that can, and its estimates are NaN.
    ///
    /// # Errors
    /// `Empty`, `Conflict`, `InvalidDt`, `Range` for a structure or settings that do not
    /// fit; `AllFailed` if no item can be used. Of an item: `Shape`, `NonFinite`, `Range`;
    /// `NotObservable`; `ObserverUnstable`; `NotIdentifiable`; `Conflict` for outputs
    /// that measure other states than those of the first item.
    pub fn new(structure: Structure, settings: Settings, tunings: Vec<Tuning>) -> Result<Self> {
        structure.check()?;
        settings.check()?;
        if tunings.is_empty() {
            return Err(Error::Empty { what: "the batch of observers".into() });
        }
        let failures = check::all(&structure, &settings, &tunings);
        let Some(good) = failures.iter().position(Option::is_none) else {
            let first = failures.into_iter().flatten().next();
            return Err(Error::AllFailed {
                what: "observers",
                count: tunings.len(),
                source: Box::new(first.unwrap_or(Error::Cancelled)),
            });
        };
        let layout = Layout::new(&structure, &settings, kinds(&structure, &tunings[good]));
        let used = |i: usize| {
            let i = i.min(tunings.len() - 1);
            &tunings[if failures[i].is_none() { i } else { good }]
        };
        let groups = (0..tunings.len().div_ceil(LANES))
            .map(|b| {
                let eight: Vec<&Tuning> = (0..LANES).map(|l| used(b * LANES + l)).collect();
                Group::new(b * LANES, &layout, &settings, &eight)
            })
            .collect::<Result<Vec<_>>>()?;
        let noise = tunings.iter().map(|t| match t.prior {
            Prior::Sigma { noise, .. } => Some(noise),
            Prior::P0(_) => None,
        });
        let shared = Shared {
            noise: noise.collect(),
            len: tunings.len(),
            structure,
            settings,
            layout,
            failures,
            tunings,
        };
        Ok(Self { shared: Arc::new(shared), groups, step: 0 })
    }

    /// Number of observers.
    pub fn len(&self) -> usize {
        self.shared.len
    }

    /// Never: a batch has an observer at least.
    pub fn is_empty(&self) -> bool {
        self.shared.len == 0
    }

    /// What the observers share.
    pub fn structure(&self) -> &Structure {
        &self.shared.structure
    }

    /// How they are run.
    pub fn settings(&self) -> &Settings {
        &self.shared.settings
    }

    /// The observer at `item` as it was described.
    pub fn tuning(&self, item: usize) -> &Tuning {
        &self.shared.tunings[item]
    }

    /// Why an item cannot be used.
    pub fn failures(&self) -> &[Option<Error>] {
        &self.shared.failures
    }

    /// Measurements taken in.
    pub fn steps(&self) -> u64 {
        self.step
    }

    /// Seconds of the last measurement (of the first one before it came).
    pub fn time(&self) -> f64 {
        self.shared.time(self.step.saturating_sub(1))
    }

    /// Back to the start.
    pub fn reset(&mut self) {
        self.step = 0;
        for group in &mut self.groups {
            group.restart(&self.shared.layout);
        }
    }

    /// One measurement of every observer: `u` (items by inputs) and `y` (items by
    /// outputs, NaN for one that is missing) at the time of this sample.
    ///
    /// An output that is missing takes no part in the least squares; the filters go on
    /// with the one that `x_hat` had at the sample before.
    ///
    /// # Errors
    /// `Shape`; `NonFinite` for an infinite output or an input that is no number. The
    /// observers are then as before.
    pub fn step(&mut self, u: &[f64], y: &[f64]) -> Result<()> {
        let [_, m, q, _] = self.shared.structure.sizes();
        let len = self.len();
        check_sample("u", u, len * m, |v| !v.is_finite())?;
        check_sample("y", y, len * q, |v| v.is_infinite())?;
        for (b, group) in self.groups.iter_mut().enumerate() {
            let from = b * LANES;
            let count = (len - from).min(LANES);
            group.take(m, q, count, &u[from * m..], &y[from * q..]);
            group.advance(&self.shared, self.step);
        }
        self.step += 1;
        Ok(())
    }

    /// As [`Adaptive::step`], for a measurement `intervals` sampling intervals after the one
    /// before: those between are missing, and inputs run straight from `before` to `u`.
    ///
    /// # Errors
    /// As [`Adaptive::step`]; the observers are then somewhere along the gap.
    pub fn step_after(
        &mut self,
        intervals: u64,
        before: &[f64],
        u: &[f64],
        y: &[f64],
    ) -> Result<()> {
        if intervals > 1 {
            let missing = vec![f64::NAN; y.len()];
            for gap in 1..intervals {
                let share = gap as f64 / intervals as f64;
                let between: Vec<f64> =
                    before.iter().zip(u).map(|(a, b)| a + share * (b - a)).collect();
                self.step(&between, &missing)?;
            }
        }
        self.step(u, y)
    }

    /// Many measurements: whole records, the observers spread over threads.
    ///
    /// `u` and `y` hold a row of inputs (outputs) a measurement, one record for all
    /// observers or, where they are that much longer, one each. Returns `theta_hat` of
    /// every observer after every `every`-th measurement (none for 0), shape (item,
    /// report, parameter).
    ///
    /// # Errors
    /// As [`Adaptive::step`], and `Cancelled`; the observers are then somewhere along
    /// the record.
    pub fn record(
        &mut self,
        control: &RunControl<'_>,
        steps: usize,
        u: &[f64],
        y: &[f64],
        every: usize,
    ) -> Result<Vec<f64>> {
        let [_, m, q, p] = self.shared.structure.sizes();
        let len = self.len();
        let own_y = y.len() != steps * q;
        let own_u = u.len() != steps * m;
        check_sample("u", u, steps * m * if own_u { len } else { 1 }, |v| !v.is_finite())?;
        check_sample("y", y, steps * q * if own_y { len } else { 1 }, |v| v.is_infinite())?;
        let reports = steps.checked_div(every).unwrap_or(0);
        let (shared, before) = (&self.shared, self.step);
        let mut work: Vec<(&mut Group, Vec<f64>)> =
            self.groups.iter_mut().map(|g| (g, Vec::new())).collect();
        par::for_chunks_mut(control, &mut work, 1, |b, part| {
            for (offset, (group, out)) in part.iter_mut().enumerate() {
                let from = (b + offset) * LANES;
                let count = (len - from).min(LANES);
                out.resize(count * reports * p, f64::NAN);
                for k in 0..steps {
                    for l in 0..count {
                        let row = |own: bool| if own { (from + l) * steps + k } else { k };
                        group.u[l * m..][..m].copy_from_slice(&u[row(own_u) * m..][..m]);
                        group.y[l * q..][..q].copy_from_slice(&y[row(own_y) * q..][..q]);
                    }
                    group.pad(m, q, count);
                    group.advance(shared, before + k as u64);
                    if every > 0 && (k + 1) % every == 0 {
                        for l in (0..count).filter(|l| shared.failures[from + l].is_none()) {
                            let report = (l * reports + k / every) * p;
                            group.theta(&shared.layout, l, &mut out[report..][..p]);
                        }
                    }
                }
            }
        })?;
        let out = work.into_iter().flat_map(|(_, out)| out).collect();
        self.step += steps as u64;
        Ok(out)
    }

    /// `theta_hat` of an item; NaN for one that cannot be used.
    pub fn theta(&self, item: usize) -> Vec<f64> {
        let mut theta = vec![f64::NAN; self.shared.layout.p];
        self.theta_into(item, &mut theta);
        theta
    }

    /// As [`Adaptive::theta`], without an allocation.
    ///
    /// # Panics
    /// Unless `item < len` and `theta` has a number a parameter.
    pub fn theta_into(&self, item: usize, theta: &mut [f64]) {
        if self.shared.failures[item].is_some() {
            theta.fill(f64::NAN);
            return;
        }
        self.groups[item / LANES].theta(&self.shared.layout, item % LANES, theta);
    }

    /// `x_hat` of an item, at the time of the last measurement.
    pub fn x_hat(&self, item: usize) -> Vec<f64> {
        if self.shared.failures[item].is_some() {
            return vec![f64::NAN; self.shared.layout.n];
        }
        self.read(item, self.shared.layout.x_hat.clone())
    }

    /// Residuals `y - C (Psi theta_hat + psi_0)` of the last sample with the `theta_hat`
    /// before it; 0 for an output that was missing.
    pub fn residuals(&self, item: usize) -> Vec<f64> {
        self.read(item, self.shared.layout.e.clone())
    }

    /// `Psi`, column by column of the parameters, and `psi_0`.
    pub fn filters(&self, item: usize) -> (Vec<f64>, Vec<f64>) {
        let l = &self.shared.layout;
        let psi = self.read(item, l.psi.start + l.x0 * l.n..l.psi.end);
        (psi, self.read(item, l.psi_0.clone()))
    }

    /// The matrix `P` of the least squares over the parameters, p by p.
    pub fn p(&self, item: usize) -> Mat<f64> {
        let l = &self.shared.layout;
        let rows = ud::covariance(l.all(), l.x0, &self.read(item, l.ud.clone()));
        Mat::from_fn(l.p, l.p, |i, j| rows[i * l.p + j])
    }

    /// What the last complete window says.
    pub fn window(&self, item: usize) -> &Window {
        &self.groups[item / LANES].items[item % LANES].window
    }

    /// False for an item that cannot be used, or whose estimates ran away.
    pub fn is_sound(&self, item: usize) -> bool {
        self.shared.failures[item].is_none()
            && self.theta(item).iter().chain(&self.x_hat(item)).all(|v| v.is_finite())
    }

    /// Estimate, standard deviations and correlation of an item.
    ///
    /// ```text
    /// cov(theta_hat) = sigma^2 w P,   cov(x_hat) = sigma^2 w Psi P Psi',   w = (1 - mu) / lambda
    /// ```
    /// for white noise of variance `sigma^2 R_j` on the samples, an upper bound where the
    /// past is forgotten. `sigma` is that of the prior, else the root mean square of the
    /// residuals of the last window; NaN before there is one.
    pub fn estimate(&self, item: usize) -> Estimate {
        let l = &self.shared.layout;
        let p = self.p(item);
        let window = self.window(item).clone();
        let sigma = self.shared.noise[item].unwrap_or(window.residual);
        let tuning = &self.shared.tunings[item];
        let weight = Scheme::weight(tuning.lambda, self.shared.settings.dt);
        let scale = sigma * sigma * weight;
        let all = ud::covariance(l.all(), 0, &self.read(item, l.ud.clone()));
        let psi = self.read(item, l.psi.clone());
        let spread = |row: usize| {
            let column = |i: usize| psi[i * l.n + row];
            let pairs = (0..l.all()).flat_map(|i| (0..l.all()).map(move |j| (i, j)));
            pairs.map(|(i, j)| column(i) * all[i * l.all() + j] * column(j)).sum::<f64>()
        };
        let theta = self.theta(item);
        let at_bound =
            theta.iter().zip(&tuning.bounds).map(|(v, [low, high])| v <= low || v >= high);
        let std: Vec<f64> = (0..l.p).map(|i| (scale * p[(i, i)]).sqrt()).collect();
        let correlation = Mat::from_fn(l.p, l.p, |i, j| p[(i, j)] / (p[(i, i)] * p[(j, j)]).sqrt());
        Estimate {
            at_bound: at_bound.collect(),
            theta,
            std,
            correlation,
            x_hat: self.x_hat(item),
            x_std: (0..l.n).map(|i| (scale * spread(i).max(0.0)).sqrt()).collect(),
            window,
            sound: self.is_sound(item),
        }
    }

    /// The numbers of an item.
    fn read(&self, item: usize, range: std::ops::Range<usize>) -> Vec<f64> {
        assert!(item < self.len(), "item {item} of {}", self.len());
        let state = &self.groups[item / LANES].state;
        state[range].iter().map(|block| block.0[item % LANES]).collect()
    }
}

fn check_sample(what: &str, list: &[f64], want: usize, bad: impl Fn(f64) -> bool) -> Result<()> {
    if list.len() != want {
        let (want, got) = ([want, 1], [list.len(), 1]);
        return Err(Error::Shape { what: what.into(), want, got });
    }
    match list.iter().position(|v| bad(*v)) {
        Some(row) => Err(Error::NonFinite { what: what.into(), row, col: 0 }),
        None => Ok(()),
    }
}
