//! One plant at one parameter value, and the controller around it.

use faer::Mat;

use crate::error::{Error, Result};
use crate::model::check::{check_covariance, check_finite, check_shape};

/// Whether `x'` is a derivative or the next sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Time {
    /// `dx/dt`; `Q` and `R` are intensities (units squared per hertz).
    Continuous,
    /// `x(k+1)`; `Q` and `R` are covariances.
    Discrete {
        /// Sampling interval in seconds.
        dt: f64,
    },
}

impl Time {
    /// True for continuous time.
    pub fn is_continuous(self) -> bool {
        self == Time::Continuous
    }
}

/// Names of the channels, used by every message, table and plot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Names {
    /// One name a state, `nx` of them.
    pub states: Vec<String>,
    /// One name a control input, `nu` of them.
    pub inputs: Vec<String>,
    /// One name a disturbance, `nw` of them.
    pub disturbances: Vec<String>,
    /// One name an output, `ny` of them.
    pub outputs: Vec<String>,
}

impl Names {
    /// Names by number: `x1`, `u1`, `w1`, `y1` and so on.
    pub fn numbered(nx: usize, nu: usize, nw: usize, ny: usize) -> Self {
        let list = |letter: &str, n: usize| (1..=n).map(|i| format!("{letter}{i}")).collect();
        Self {
            states: list("x", nx),
            inputs: list("u", nu),
            disturbances: list("w", nw),
            outputs: list("y", ny),
        }
    }
}

/// A linear plant at one parameter value.
///
/// ```text
/// x' = A x + B u + G w,   y = C x + v,   E[w w'] = Q,  E[v v'] = R
/// ```
///
/// `A` nx by nx, `B` nx by nu, `G` nx by nw, `C` ny by nx, `Q` nw by nw, `R` ny
/// by ny. `nu` and `nw` may be zero.
///
/// # Source
/// Hassani, Aguiar, Pascoal, Athans (2009), eq. (1).
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Plant {
    /// Continuous or discrete.
    pub time: Time,
    /// State matrix.
    pub A: Mat<f64>,
    /// Control input matrix.
    pub B: Mat<f64>,
    /// Disturbance input matrix.
    pub G: Mat<f64>,
    /// Output matrix.
    pub C: Mat<f64>,
    /// Intensity (covariance) of the disturbance, positive semidefinite.
    pub Q: Mat<f64>,
    /// Intensity (covariance) of the measurement noise, positive definite.
    pub R: Mat<f64>,
}

impl Plant {
    /// Number of states.
    pub fn nx(&self) -> usize {
        self.A.nrows()
    }

    /// Number of control inputs.
    pub fn nu(&self) -> usize {
        self.B.ncols()
    }

    /// Number of disturbances.
    pub fn nw(&self) -> usize {
        self.G.ncols()
    }

    /// Number of outputs.
    pub fn ny(&self) -> usize {
        self.C.nrows()
    }

    /// Checks shapes, finiteness, symmetry and definiteness.
    ///
    /// # Errors
    /// `Empty`, `Shape`, `NonFinite`, `NotSymmetric`, `NotPsd`,
    /// `NotPositiveDefinite` (`R` in continuous time), `InvalidDt`: each names
    /// the matrix.
    pub fn check(&self) -> Result<()> {
        self.check_matrices()?;
        check_covariance("Q", self.Q.as_ref(), false)?;
        check_covariance("R", self.R.as_ref(), self.time.is_continuous())
    }

    /// As [`Plant::check`] without the definiteness of `Q` and `R`.
    pub(crate) fn check_matrices(&self) -> Result<()> {
        let (nx, nu, nw, ny) = (self.nx(), self.nu(), self.nw(), self.ny());
        if let Time::Discrete { dt } = self.time
            && !(dt > 0.0 && dt.is_finite())
        {
            return Err(Error::InvalidDt { dt });
        }
        for (what, n) in [("A", nx), ("C", ny)] {
            if n == 0 {
                return Err(Error::Empty { what: what.into() });
            }
        }
        for (what, m, want) in [
            ("A", &self.A, [nx, nx]),
            ("B", &self.B, [nx, nu]),
            ("G", &self.G, [nx, nw]),
            ("C", &self.C, [ny, nx]),
            ("Q", &self.Q, [nw, nw]),
            ("R", &self.R, [ny, ny]),
        ] {
            check_shape(what, m.as_ref(), want)?;
            check_finite(what, m.as_ref())?;
        }
        Ok(())
    }
}

/// A linear controller `u = K(s) y` (or `K(z)`) in state space.
///
/// ```text
/// x_K' = A x_K + B y,   u = C x_K + D y
/// ```
///
/// The sign of the feedback is part of `K`. `A` nk by nk, `B` nk by ny, `C` nu
/// by nk, `D` nu by ny; `nk` may be zero (a static gain).
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Controller {
    /// State matrix.
    pub A: Mat<f64>,
    /// From the measured output.
    pub B: Mat<f64>,
    /// To the control input.
    pub C: Mat<f64>,
    /// Direct term.
    pub D: Mat<f64>,
}

impl Controller {
    /// Checks shapes and finiteness against a plant with `nu` inputs and `ny`
    /// outputs.
    ///
    /// # Errors
    /// `Shape`, `NonFinite`, naming the matrix as `controller.A` and so on.
    pub fn check(&self, nu: usize, ny: usize) -> Result<()> {
        let nk = self.A.nrows();
        for (what, m, want) in [
            ("controller.A", &self.A, [nk, nk]),
            ("controller.B", &self.B, [nk, ny]),
            ("controller.C", &self.C, [nu, nk]),
            ("controller.D", &self.D, [nu, ny]),
        ] {
            check_shape(what, m.as_ref(), want)?;
            check_finite(what, m.as_ref())?;
        }
        Ok(())
    }
}
