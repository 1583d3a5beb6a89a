//! What is observed, and with what: plant, gain and tuning.

use std::fmt;
use std::sync::Arc;

use faer::Mat;

use super::regressor::{Column, Regressor, Unknown};
use crate::error::{Error, Result};
use crate::model::{check_finite, check_shape};

/// What all observers of a batch share: names, sizes and what is unknown.
///
/// ```text
/// x' = (A + sum_i theta_i E_row E_col') x + Gamma(y, u, t) theta + f(y, u, t),   y = C x
/// ```
#[derive(Clone)]
pub struct Structure {
    /// Names of the states.
    pub states: Vec<String>,
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Number of inputs.
    pub inputs: usize,
    /// The parameters, in the order of `theta`.
    pub unknown: Vec<Unknown>,
    /// The given columns and the known term.
    pub regressor: Arc<dyn Regressor>,
}

impl fmt::Debug for Structure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Structure")
            .field("states", &self.states)
            .field("outputs", &self.outputs)
            .field("inputs", &self.inputs)
            .field("unknown", &self.unknown)
            .finish_non_exhaustive()
    }
}

impl Structure {
    /// States, inputs, outputs and parameters.
    pub fn sizes(&self) -> [usize; 4] {
        [self.states.len(), self.inputs, self.outputs.len(), self.unknown.len()]
    }

    /// Checks sizes and entries.
    ///
    /// # Errors
    /// `Empty` without states, outputs or parameters; `Conflict` for another number of
    /// given columns than the regressor has, and for an entry that is none of `A` or is
    /// named twice.
    pub fn check(&self) -> Result<()> {
        let [n, _, q, p] = self.sizes();
        for (what, len) in [("the list of states", n), ("the list of outputs", q)] {
            if len == 0 {
                return Err(Error::Empty { what: what.into() });
            }
        }
        if p == 0 {
            return Err(Error::Empty { what: "the list of unknown parameters".into() });
        }
        let given = self.unknown.iter().filter(|u| u.column == Column::Given).count();
        if given != self.regressor.columns() {
            return Err(Error::Conflict {
                problem: format!(
                    "{given} parameters of given columns, but the regressor has {}",
                    self.regressor.columns()
                ),
                remedy: "name one parameter a column".into(),
            });
        }
        for (i, unknown) in self.unknown.iter().enumerate() {
            let Column::Entry { row, col } = unknown.column else { continue };
            let name = &unknown.name;
            if row >= n || col >= n {
                return Err(Error::Conflict {
                    problem: format!("{name} is entry ({row}, {col}) of a {n}x{n} matrix A"),
                    remedy: "rows and columns count from 0".into(),
                });
            }
            if self.unknown[..i].iter().any(|u| u.column == unknown.column) {
                return Err(Error::Conflict {
                    problem: format!("{name} is an entry of A that is unknown already"),
                    remedy: "keep one parameter an entry".into(),
                });
            }
        }
        Ok(())
    }
}

/// How `theta_hat` corrects the state, and by which error it is led.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reading {
    /// `e = y - C (Psi theta_hat + psi_0)` and `x_hat = Psi theta_hat + psi_0`: the state
    /// follows every correction of `theta_hat`. The consistent one.
    #[default]
    Zhang,
    /// `e = y - C x_hat`, as printed by Liu and Peng.
    Obs,
    /// `e = y - C (Psi theta_hat + psi_0)`, which their proof uses, beside an `x_hat` that
    /// does not jump with `theta_hat`.
    Reg,
}

impl Reading {
    /// Every reading with the name that scenarios use.
    pub const NAMES: [(&'static str, Reading); 3] =
        [("zhang", Reading::Zhang), ("obs", Reading::Obs), ("reg", Reading::Reg)];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, r)| *r == self).map_or("", |(name, _)| name)
    }
}

/// How the observers of a batch are run.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Seconds between measurements.
    pub dt: f64,
    /// The time of the first measurement, in seconds.
    pub t0: f64,
    /// The reading of the error.
    pub reading: Reading,
    /// Estimates `x(0) - x_hat(0)` along with `theta`, by regressors `e^{A_k t} E_i`.
    pub initial_state: bool,
    /// Measurements of a window: excitation, residuals and drift are judged over it.
    pub window: u64,
    /// Runs the rank test of identifiability when the batch is built.
    pub rank_test: bool,
}

impl Settings {
    /// Measurements every `dt` seconds from 0 on, the default reading, windows of 10 s.
    pub fn new(dt: f64) -> Self {
        let window = (10.0 / dt).round().clamp(1.0, 1e9) as u64;
        Self { dt, t0: 0.0, reading: Reading::Zhang, initial_state: false, window, rank_test: true }
    }

    /// Checks interval and window.
    pub(super) fn check(&self) -> Result<()> {
        if !(self.dt > 0.0 && self.dt.is_finite()) {
            return Err(Error::InvalidDt { dt: self.dt });
        }
        if !self.t0.is_finite() {
            let remedy = "give the time of the first measurement".into();
            return Err(Error::Range { what: "t0".into(), value: self.t0, remedy });
        }
        if self.window == 0 {
            let remedy = "give one measurement or more".into();
            return Err(Error::Range { what: "window".into(), value: 0.0, remedy });
        }
        if self.initial_state && self.reading == Reading::Obs {
            return Err(Error::Conflict {
                problem: "an unknown x(0) under the reading obs, which never corrects x_hat".into(),
                remedy: "use the reading zhang or reg".into(),
            });
        }
        Ok(())
    }
}

/// What is known of `theta` before the first measurement.
#[derive(Debug, Clone, PartialEq)]
pub enum Prior {
    /// The matrix `P(0)` of the least squares, its diagonal.
    P0(Vec<f64>),
    /// Standard deviations of the parameters and of the noise of a sample (in units of
    /// `sqrt(R)`): `P0 = sigma_theta^2 / (sigma_y^2 dt)`.
    Sigma {
        /// Of the parameters.
        theta: Vec<f64>,
        /// Of a measurement.
        noise: f64,
    },
}

impl Prior {
    /// `P0` for all `p` parameters.
    pub fn uniform(p0: f64, p: usize) -> Self {
        Prior::P0(vec![p0; p])
    }

    /// The diagonal of `P(0)` for samples every `dt` seconds.
    pub fn p0(&self, dt: f64) -> Vec<f64> {
        match self {
            Prior::P0(p0) => p0.clone(),
            Prior::Sigma { theta, noise } => {
                theta.iter().map(|s| s * s / (noise * noise * dt)).collect()
            }
        }
    }
}

/// One observer of a batch: a plant, its gain, and how it adapts.
#[derive(Debug, Clone)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Tuning {
    /// Nominal `A`, n by n.
    pub A: Mat<f64>,
    /// `C`, q by n.
    pub C: Mat<f64>,
    /// Observer gain, n by q: `x_hat' = .. + K (y - C x_hat)`.
    pub K: Mat<f64>,
    /// Weights of the outputs in the least squares, as variances: `sum e_j^2 / R_j`.
    pub R: Vec<f64>,
    /// Forgetting rate in 1/s, 0 for none.
    pub lambda: f64,
    /// `theta_hat(0)`.
    pub theta: Vec<f64>,
    /// `P(0)`, or what it follows from.
    pub prior: Prior,
    /// Diagonal of `P(0)` of the unknown `x(0)`, n numbers where it is estimated.
    pub initial_P0: Vec<f64>,
    /// `x_hat(0)`.
    pub x_hat: Vec<f64>,
    /// Lowest and highest value of each parameter.
    pub bounds: Vec<[f64; 2]>,
    /// No forgetting while the trace of `P` is above it.
    pub trace_cap: f64,
    /// Times in seconds at which `P` goes back to `P(0)`, rising.
    pub resets: Vec<f64>,
    /// `P` also goes back to `P(0)` when the mean square of the residuals of a window
    /// is over so many times that of the window before; infinite for never.
    pub reset_growth: f64,
}

impl Tuning {
    /// An observer that starts at zero, forgets nothing and knows no bounds.
    #[expect(non_snake_case, reason = "capital letters are matrices")]
    pub fn new(A: Mat<f64>, C: Mat<f64>, K: Mat<f64>, theta: Vec<f64>, prior: Prior) -> Self {
        let (n, q, p) = (A.nrows(), C.nrows(), theta.len());
        Self {
            A,
            C,
            K,
            R: vec![1.0; q],
            lambda: 0.0,
            theta,
            prior,
            initial_P0: vec![0.0; n],
            x_hat: vec![0.0; n],
            bounds: vec![[f64::NEG_INFINITY, f64::INFINITY]; p],
            trace_cap: f64::INFINITY,
            resets: Vec::new(),
            reset_growth: f64::INFINITY,
        }
    }

    /// Checks shapes and ranges.
    pub(super) fn check(&self, structure: &Structure, settings: &Settings) -> Result<()> {
        let [n, _, q, p] = structure.sizes();
        for (what, m, want) in
            [("A", &self.A, [n, n]), ("C", &self.C, [q, n]), ("K", &self.K, [n, q])]
        {
            check_shape(what, m.as_ref(), want)?;
            check_finite(what, m.as_ref())?;
        }
        let p0 = self.prior.p0(settings.dt);
        let vectors = [
            ("R", &self.R, q),
            ("theta(0)", &self.theta, p),
            ("P(0)", &p0, p),
            ("P(0) of x(0)", &self.initial_P0, n),
            ("x_hat(0)", &self.x_hat, n),
            ("resets", &self.resets, self.resets.len()),
        ];
        for (what, list, want) in vectors {
            if list.len() != want {
                let got = [list.len(), 1];
                return Err(Error::Shape { what: what.into(), want: [want, 1], got });
            }
            if let Some(row) = list.iter().position(|v| !v.is_finite()) {
                return Err(Error::NonFinite { what: what.into(), row, col: 0 });
            }
        }
        let range = |what: &str, value: f64, remedy: &str| {
            Err(Error::Range { what: what.into(), value, remedy: remedy.into() })
        };
        if let Some(&v) = self.R.iter().find(|v| **v <= 0.0) {
            return range("R", v, "give positive variances");
        }
        if let Some(&v) = p0.iter().find(|v| **v <= 0.0) {
            return range("P(0)", v, "give positive numbers, the larger the less is known");
        }
        if let Some(&v) = self.initial_P0.iter().find(|v| **v < 0.0) {
            return range("P(0) of x(0)", v, "give zero or more");
        }
        if !(self.lambda >= 0.0 && self.lambda * settings.dt < 700.0) {
            return range("lambda", self.lambda, "give a rate in 1/s, zero or more");
        }
        if self.trace_cap.is_nan() || self.trace_cap <= 0.0 {
            return range("trace_cap", self.trace_cap, "give a positive number");
        }
        if self.reset_growth.is_nan() || self.reset_growth <= 1.0 {
            return range("reset_growth", self.reset_growth, "give a factor above 1");
        }
        if let Some(w) = self.resets.windows(2).find(|w| w[0] >= w[1]) {
            return range("resets", w[1], "let the times rise");
        }
        if self.bounds.len() != p {
            let got = [self.bounds.len(), 1];
            return Err(Error::Shape { what: "bounds".into(), want: [p, 1], got });
        }
        for (i, ([low, high], theta)) in self.bounds.iter().zip(&self.theta).enumerate() {
            if !(low <= theta && theta <= high) {
                let name = &structure.unknown[i].name;
                let what = format!("{name} at the start");
                return range(&what, *theta, &format!("start inside the bounds {low} to {high}"));
            }
        }
        Ok(())
    }
}
