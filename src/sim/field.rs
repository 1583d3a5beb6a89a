//! A plant given by its differential equation, simulated to a stated accuracy.

use std::fmt;
use std::sync::Arc;

use super::signal::{Signal, Wave};
use crate::error::{Error, Result};
use crate::par::RunControl;

/// A function of time, inputs and state that writes a vector.
pub type FieldFn = Arc<dyn Fn(f64, &[f64], &[f64], &mut [f64]) + Send + Sync>;

/// Change of the trajectory, relative to its largest value, at which halving the
/// steps ends.
const TOLERANCE: f64 = 1e-11;
/// Steps of an interval at most.
const MOST: u32 = 1 << 12;
/// How far before its end a step reads its inputs, as a share of it: an edge that
/// falls on the end belongs to the next.
const BEFORE: f64 = 1e-12;

/// `x' = F(t, u, x)`, `y = H(t, u, x)`.
#[derive(Clone)]
pub struct Field {
    /// Number of states.
    pub states: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// `F`.
    pub derivative: FieldFn,
    /// `H`.
    pub output: FieldFn,
}

impl fmt::Debug for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Field");
        shown.field("states", &self.states).field("outputs", &self.outputs);
        shown.finish_non_exhaustive()
    }
}

/// A trajectory at the samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// Inputs, shape (sample, input).
    pub u: Vec<f64>,
    /// States, shape (sample, state).
    pub x: Vec<f64>,
    /// Outputs, shape (sample, output).
    pub y: Vec<f64>,
    /// Runge-Kutta steps of an interval.
    pub parts: u32,
    /// Largest change of a state when the steps were halved for the last time, relative
    /// to its largest value: the error is about a fifteenth of it.
    pub error: f64,
}

impl Field {
    /// The trajectory from `x0` at the times `k dt`, `k = 0 .. samples - 1`, by the
    /// classical Runge-Kutta method with steps that are halved until the trajectory
    /// changes by less than 1e-11 of its size, or until there are 4096 an interval.
    /// Edges of the inputs are met where they fall on a step.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mmae::par::RunControl;
    /// use mmae::sim::{Field, Signal};
    /// let field = Field {
    ///     states: 1,
    ///     outputs: 1,
    ///     derivative: Arc::new(|_, u, x, out| out[0] = u[0] - x[0]),
    ///     output: Arc::new(|_, _, x, out| out[0] = x[0]),
    /// };
    /// let control = RunControl::default();
    /// let path = field.path(&[0.0], &[Signal::constant(1.0)], 0.1, 11, &control)?;
    /// assert!((path.y[10] - (1.0 - (-1.0_f64).exp())).abs() < 1e-11 && path.error < 1e-11);
    /// # Ok::<(), mmae::Error>(())
    /// ```
    ///
    /// # Errors
    /// `Shape` for another number of states; what [`Signal::check`] finds; `Conflict` for
    /// an input of white noise; `Range` if the plant runs away; `Cancelled`.
    pub fn path(
        &self,
        x0: &[f64],
        inputs: &[Signal],
        dt: f64,
        samples: usize,
        control: &RunControl<'_>,
    ) -> Result<Path> {
        if x0.len() != self.states {
            let (want, got) = ([self.states, 1], [x0.len(), 1]);
            return Err(Error::Shape { what: "x(0)".into(), want, got });
        }
        if let Some(row) = x0.iter().position(|v| !v.is_finite()) {
            return Err(Error::NonFinite { what: "x(0)".into(), row, col: 0 });
        }
        if !(dt > 0.0 && dt.is_finite()) {
            return Err(Error::InvalidDt { dt });
        }
        for (j, input) in inputs.iter().enumerate() {
            input.check(&format!("input {j}"))?;
            if input.terms.iter().any(|t| matches!(t.wave, Wave::White { .. })) {
                return Err(Error::Conflict {
                    problem: format!("input {j} is white noise"),
                    remedy: "give a known function of time, and the noise of its measurement"
                        .into(),
                });
            }
        }
        let mut parts = 1;
        let mut path = self.walk(x0, inputs, dt, samples, parts, control)?;
        while parts < MOST {
            parts *= 2;
            let finer = self.walk(x0, inputs, dt, samples, parts, control)?;
            let mut change = 0.0_f64;
            for i in 0..self.states {
                let (mut size, mut moved) = (f64::MIN_POSITIVE, 0.0_f64);
                for k in 0..samples {
                    let (a, b) = (path.x[k * self.states + i], finer.x[k * self.states + i]);
                    size = size.max(b.abs());
                    moved = moved.max((a - b).abs());
                }
                change = change.max(moved / size);
            }
            path = Path { error: change, ..finer };
            if change < TOLERANCE {
                break;
            }
        }
        Ok(path)
    }

    fn walk(
        &self,
        x0: &[f64],
        inputs: &[Signal],
        dt: f64,
        samples: usize,
        parts: u32,
        control: &RunControl<'_>,
    ) -> Result<Path> {
        let n = self.states;
        let mut path =
            Path { u: Vec::new(), x: Vec::new(), y: Vec::new(), parts, error: f64::INFINITY };
        let mut x = x0.to_vec();
        let (mut slopes, mut at) = ([(); 4].map(|()| vec![0.0; n]), vec![0.0; n]);
        let mut y = vec![0.0; self.outputs];
        let mut u = vec![0.0; inputs.len()];
        let known = |t: f64, u: &mut [f64]| {
            u.iter_mut().zip(inputs).for_each(|(u, signal)| *u = signal.at(t));
        };
        for k in 0..samples {
            if control.is_cancelled() {
                return Err(Error::Cancelled);
            }
            if k > 0 {
                let h = dt / f64::from(parts);
                for part in 0..parts {
                    let t = (k - 1) as f64 * dt + f64::from(part) * h;
                    for (stage, share) in [0.0, 0.5, 0.5, 1.0].into_iter().enumerate() {
                        at.copy_from_slice(&x);
                        if stage > 0 {
                            let slope = &slopes[stage - 1];
                            at.iter_mut().zip(slope).for_each(|(x, s)| *x += share * h * s);
                        }
                        known(t + share * (1.0 - BEFORE) * h, &mut u);
                        (self.derivative)(t + share * h, &u, &at, &mut slopes[stage]);
                    }
                    let [a, b, c, d] = &slopes;
                    for i in 0..n {
                        x[i] += h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
                    }
                }
            }
            let t = k as f64 * dt;
            known(t, &mut u);
            (self.output)(t, &u, &x, &mut y);
            if !x.iter().chain(&y).all(|v| v.is_finite()) {
                return Err(Error::Range {
                    what: "the state of the true plant".into(),
                    value: f64::NAN,
                    remedy: format!("it runs away at t = {t} s: check derivative, or stop before"),
                });
            }
            path.u.extend(&u);
            path.x.extend(&x);
            path.y.extend(&y);
        }
        Ok(path)
    }
}
