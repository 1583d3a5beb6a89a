//! A bound on what the actuator does beyond the model.

use faer::Mat;

use crate::error::{Error, Result};
use crate::model::check::{check_finite, check_shape};
use crate::small::{Cx, Dyn, cx_solve};
use crate::solve::least_stable_mode;

/// The size of the unmodelled dynamics of a single actuator, a stable filter.
///
/// ```text
/// u_plant = (1 + Delta(s)) u,   |Delta(jw)| <= |W(jw)|,   W(s) = C (s I - A)^-1 B + D
/// ```
///
/// `Delta` is any stable transfer function within the bound. `A` n by n (stable),
/// `B` n by 1, `C` 1 by n, `D` 1 by 1; `n` may be 0.
///
/// ```
/// use mmae::model::ActuatorBound;
/// let bound = ActuatorBound::from_polynomials(&[2.1, 0.0], &[1.0, 50.0])?; // 2.1 s / (s + 50)
/// assert!((bound.size(50.0) - 2.1 / 2.0_f64.sqrt()).abs() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct ActuatorBound {
    /// State matrix.
    pub A: Mat<f64>,
    /// From the input.
    pub B: Mat<f64>,
    /// To the output.
    pub C: Mat<f64>,
    /// Direct term.
    pub D: Mat<f64>,
}

impl ActuatorBound {
    /// `W(s) = numerator / denominator`, coefficients of falling powers of `s`.
    ///
    /// # Errors
    /// `Empty`, `NonFinite`; `Range` for a leading zero of the denominator;
    /// `Conflict` for more zeros than poles; those of [`ActuatorBound::check`].
    pub fn from_polynomials(numerator: &[f64], denominator: &[f64]) -> Result<Self> {
        let [what_n, what_d] = ["numerator of W", "denominator of W"];
        for (what, list) in [(what_n, numerator), (what_d, denominator)] {
            if list.is_empty() {
                return Err(Error::Empty { what: what.into() });
            }
            if let Some(col) = list.iter().position(|v| !v.is_finite()) {
                return Err(Error::NonFinite { what: what.into(), row: 0, col });
            }
        }
        let lead = denominator[0];
        if lead == 0.0 {
            let remedy = "start with the highest power, whose coefficient is not zero".into();
            return Err(Error::Range { what: what_d.into(), value: lead, remedy });
        }
        let zeros = numerator.iter().take_while(|v| **v == 0.0).count();
        let numerator = &numerator[zeros.min(numerator.len() - 1)..];
        let n = denominator.len() - 1;
        if numerator.len() > n + 1 {
            return Err(Error::Conflict {
                problem: "W grows without bound with the frequency".into(),
                remedy: "give a denominator of at least the degree of the numerator".into(),
            });
        }
        // controllable form of the strictly proper rest
        let pad = n + 1 - numerator.len();
        let num = |k: usize| if k < pad { 0.0 } else { numerator[k - pad] / lead };
        let den = |k: usize| denominator[k] / lead;
        let direct = num(0);
        let bound = Self {
            A: Mat::from_fn(n, n, |i, j| {
                if i + 1 < n { f64::from(u8::from(j == i + 1)) } else { -den(n - j) }
            }),
            B: Mat::from_fn(n, 1, |i, _| f64::from(u8::from(i + 1 == n))),
            C: Mat::from_fn(1, n, |_, j| num(n - j) - direct * den(n - j)),
            D: Mat::from_fn(1, 1, |_, _| direct),
        };
        bound.check()?;
        Ok(bound)
    }

    /// Checks shapes, finiteness and stability.
    ///
    /// # Errors
    /// `Shape`, `NonFinite`; `Conflict` for a mode that does not decay.
    pub fn check(&self) -> Result<()> {
        let n = self.A.nrows();
        let all = [("W.A", &self.A, [n, n]), ("W.B", &self.B, [n, 1]), ("W.C", &self.C, [1, n])];
        for (what, m, want) in all.into_iter().chain([("W.D", &self.D, [1, 1])]) {
            check_shape(what, m.as_ref(), want)?;
            check_finite(what, m.as_ref())?;
        }
        if n == 0 {
            return Ok(());
        }
        let mode = least_stable_mode(self.A.as_ref(), true)?.eigenvalue;
        if mode.re < 0.0 {
            return Ok(());
        }
        Err(Error::Conflict {
            problem: format!("W has a mode {mode} that does not decay"),
            remedy: "give a stable W: only its size on the imaginary axis matters".into(),
        })
    }

    /// `W(jw)`, as real and imaginary part.
    pub fn response(&self, omega: f64) -> [f64; 2] {
        let n = self.A.nrows();
        let mut m = Vec::with_capacity(n * n);
        for i in 0..n {
            for j in 0..n {
                let w = if i == j { omega } else { 0.0 };
                m.push(Cx::new(-self.A[(i, j)], w));
            }
        }
        let mut x: Vec<Cx<f64>> = (0..n).map(|i| Cx::real(self.B[(i, 0)])).collect();
        // a stable W has no pole on the axis
        let _ = cx_solve(Dyn(n), Dyn(1), &mut m, &mut x);
        let out = x
            .iter()
            .enumerate()
            .fold(Cx::real(self.D[(0, 0)]), |sum, (j, x)| sum + x.scale(self.C[(0, j)]));
        [out.re, out.im]
    }

    /// `|W(jw)|`.
    pub fn size(&self, omega: f64) -> f64 {
        let [re, im] = self.response(omega);
        re.hypot(im)
    }

    /// The longest delay `h` with `|e^{-jw h} - 1| <= |W(jw)|` at all frequencies,
    /// as seen at 4000 of them over eight decades around `scale` rad/s; infinite for
    /// a bound of two or more everywhere.
    ///
    /// ```
    /// use mmae::model::ActuatorBound;
    /// let bound = ActuatorBound::from_polynomials(&[2.1, 0.0], &[1.0, 50.0])?;
    /// let h = bound.covered_delay(10.0);
    /// assert!(h > 0.019 && h < 0.020);
    /// # Ok::<(), mmae::Error>(())
    /// ```
    pub fn covered_delay(&self, scale: f64) -> f64 {
        const SAMPLES: usize = 4000;
        let mut longest = f64::INFINITY;
        for k in 0..=SAMPLES {
            let omega = scale * libm::pow(10.0, 8.0 * k as f64 / SAMPLES as f64 - 4.0);
            let size = self.size(omega);
            // every delay up to h: 2 sin(w h / 2) rises up to w h = pi
            if size < 2.0 {
                longest = longest.min(2.0 * libm::asin(0.5 * size) / omega);
            }
        }
        longest
    }
}
