//! Shaping filters: coloured disturbances and inputs of a given spectrum.

use faer::Mat;

use crate::error::{Error, Result};
use crate::model::Time;
use crate::model::check::{check_count, check_covariance, check_finite, check_shape};
use crate::solve::least_stable_mode;

/// A linear filter that colours white noise.
///
/// ```text
/// x_f' = A x_f + B xi,   out = C x_f,   E[xi xi'] = Q
/// ```
///
/// `A` nf by nf (stable), `B` nf by nxi, `C` nout by nf, `Q` nxi by nxi. In
/// discrete time `x_f'` is the next sample. The spectrum of `out` is
/// `C (jw - A)^-1 B Q B' (jw - A)^-H C'`: `A = -1, B = C = Q = 1` gives
/// `1 / (1 + w^2)`.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Shaping {
    /// State matrix.
    pub A: Mat<f64>,
    /// From the white noise.
    pub B: Mat<f64>,
    /// To the coloured signal.
    pub C: Mat<f64>,
    /// Intensity (covariance) of the white noise.
    pub Q: Mat<f64>,
    /// One name a filter state.
    pub states: Vec<String>,
}

impl Shaping {
    /// Number of filter states.
    pub fn nf(&self) -> usize {
        self.A.nrows()
    }

    /// Checks shapes, finiteness and `Q`, for a filter with `n_out` outputs
    /// called `name` in messages.
    ///
    /// # Errors
    /// `Empty`, `Shape`, `NonFinite`, `NotSymmetric`, `NotPsd`, with `what` as
    /// `name.A` and so on; `Conflict` unless every state has its name.
    pub fn check(&self, name: &str, n_out: usize) -> Result<()> {
        let (nf, nxi) = (self.nf(), self.B.ncols());
        if nf == 0 {
            return Err(Error::Empty { what: format!("{name}.A") });
        }
        for (letter, m, want) in [
            ("A", &self.A, [nf, nf]),
            ("B", &self.B, [nf, nxi]),
            ("C", &self.C, [n_out, nf]),
            ("Q", &self.Q, [nxi, nxi]),
        ] {
            let what = format!("{name}.{letter}");
            check_shape(&what, m.as_ref(), want)?;
            check_finite(&what, m.as_ref())?;
        }
        check_count(&format!("states of {name}"), &self.states, nf)?;
        check_covariance(&format!("{name}.Q"), self.Q.as_ref(), false)
    }

    /// Fails unless every mode of the filter called `name` decays: its output
    /// would have no stationary spectrum.
    ///
    /// # Errors
    /// `Conflict`.
    pub fn check_stable(&self, name: &str, time: Time) -> Result<()> {
        let mode = least_stable_mode(self.A.as_ref(), time.is_continuous())?;
        let (value, states) = (mode.eigenvalue, mode.states(Some(&self.states)));
        let decays =
            if time.is_continuous() { value.re < 0.0 } else { value.re.hypot(value.im) < 1.0 };
        if decays {
            return Ok(());
        }
        Err(Error::Conflict {
            problem: format!("the filter {name} has a mode {value} ({states}) that does not decay"),
            remedy: format!("make {name}.A stable: its output needs a stationary spectrum"),
        })
    }
}
