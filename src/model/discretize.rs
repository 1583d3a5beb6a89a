//! Sampling with the input held (zero-order hold) and actuator delays.

use faer::{Mat, MatRef};

use crate::error::{Error, Result};
use crate::model::close::{add_product, product};
use crate::model::{Controller, Plant, Shaping, Time};
use crate::small::{Dyn, expm, expm_work};

/// States that hold past commands (or approximate the delay), between the
/// command `u` and the plant.
///
/// ```text
/// x' = .. + Bx x_d + B0 u,   x_d' = A x_d + B u
/// ```
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct DelayLine {
    /// State matrix of the line.
    pub A: Mat<f64>,
    /// From the command.
    pub B: Mat<f64>,
    /// To the plant.
    pub Bx: Mat<f64>,
    /// From the command straight to the plant.
    pub B0: Mat<f64>,
}

impl DelayLine {
    /// No delay: the command acts at once.
    pub fn none(plant: &Plant) -> Self {
        let (nx, nu) = (plant.nx(), plant.nu());
        Self {
            A: Mat::zeros(0, 0),
            B: Mat::zeros(0, nu),
            Bx: Mat::zeros(nx, 0),
            B0: plant.B.clone(),
        }
    }

    /// The command does not reach the plant at all.
    pub(crate) fn cut(plant: &Plant) -> Self {
        Self { B0: Mat::zeros(plant.nx(), plant.nu()), ..Self::none(plant) }
    }

    /// A delay of a whole number of samples of a discrete plant.
    pub(crate) fn whole_samples(plant: &Plant, delay: f64, dt: f64) -> Result<Self> {
        Ok(Taps::whole_samples(plant, delay, dt)?.line())
    }

    /// `B0` acts on the command `steps` samples ago, `B1` on the one before.
    fn chain(b0: MatRef<'_, f64>, b1: Option<MatRef<'_, f64>>, steps: usize) -> Self {
        let (nx, nu) = (b0.nrows(), b0.ncols());
        let depth = steps + usize::from(b1.is_some());
        let nd = depth * nu;
        let mut line = Self {
            A: Mat::zeros(nd, nd),
            B: Mat::zeros(nd, nu),
            Bx: Mat::zeros(nx, nd),
            B0: Mat::zeros(nx, nu),
        };
        for j in 0..nu.min(nd) {
            line.B[(j, j)] = 1.0;
        }
        for i in nu..nd {
            line.A[(i, i - nu)] = 1.0;
        }
        // slot s of the chain holds the command s + 1 samples ago
        let mut act = |ago: usize, b: MatRef<'_, f64>| {
            if ago == 0 {
                line.B0 += b;
            } else {
                let mut slot = line.Bx.submatrix_mut(0, (ago - 1) * nu, nx, nu);
                slot += b;
            }
        };
        act(steps, b0);
        if let Some(b1) = b1 {
            act(steps + 1, b1);
        }
        line
    }
}

/// Where a delayed command acts on a sampled plant.
///
/// ```text
/// x(k+1) = .. + B0 u(k - steps) + B1 u(k - steps - 1)
/// ```
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(crate) struct Taps {
    /// Whole samples of the delay.
    pub(crate) steps: usize,
    /// Of the later command.
    pub(crate) B0: Mat<f64>,
    /// Of the earlier one; `None` for a delay of whole samples.
    pub(crate) B1: Option<Mat<f64>>,
}

impl Taps {
    /// A delay of a whole number of samples of a discrete plant.
    pub(crate) fn whole_samples(plant: &Plant, delay: f64, dt: f64) -> Result<Self> {
        let steps = delay / dt;
        let whole = steps.round();
        if !((steps - whole).abs() <= 1e-9 * whole.max(1.0) && (0.0..=1e4).contains(&whole)) {
            return Err(Error::Range {
                what: "actuator delay".into(),
                value: delay,
                remedy: format!(
                    "a discrete plant takes a whole number of samples (dt = {dt} s), up to 10000"
                ),
            });
        }
        // 0 <= whole <= 1e4 was checked above
        Ok(Self { steps: whole as usize, B0: plant.B.clone(), B1: None })
    }

    /// As states.
    fn line(&self) -> DelayLine {
        DelayLine::chain(self.B0.as_ref(), self.B1.as_ref().map(Mat::as_ref), self.steps)
    }
}

/// The delay `e^{-s tau}` of every input as a Pade approximation of order
/// `order` (numerator and denominator).
///
/// ```text
/// e^{-z} ~ N(z)/D(z),  D = sum c_k z^k,  N = sum c_k (-z)^k,
/// c_k = (2n - k)! n! / ((2n)! k! (n - k)!)
/// ```
///
/// States are scaled by `tau` and by the size of the poles, so that the
/// entries of the line are of order `n / tau`.
pub fn pade_delay(plant: &Plant, tau: f64, order: usize) -> DelayLine {
    let n = order.max(1);
    // c_k / c_n
    let mut c = vec![1.0; n + 1];
    for k in (0..n).rev() {
        // c_k / c_{k+1} = (2n - k) (k + 1) / (n - k)
        c[k] = c[k + 1] * ((2 * n - k) * (k + 1)) as f64 / (n - k) as f64;
    }
    let size = c[0].powf(1.0 / n as f64); // geometric mean of the poles
    let even = if n.is_multiple_of(2) { 1.0 } else { -1.0 };
    let nu = plant.nu();
    let nd = n * nu;
    let mut line = DelayLine {
        A: Mat::zeros(nd, nd),
        B: Mat::zeros(nd, nu),
        Bx: Mat::zeros(plant.nx(), nd),
        B0: &plant.B * faer::Scale(even),
    };
    // controllable canonical form in z = s tau, state k scaled by size^k
    for j in 0..nu {
        let at = j * n;
        for k in 0..n - 1 {
            line.A[(at + k, at + k + 1)] = size / tau;
        }
        for k in 0..n {
            line.A[(at + n - 1, at + k)] = -c[k] * size.powi(k as i32 - (n as i32 - 1)) / tau;
            // N - even D, over D
            let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let gain = (sign - even) * c[k] * size.powi(k as i32 - (n as i32 - 1));
            for i in 0..plant.nx() {
                line.Bx[(i, at + k)] = plant.B[(i, j)] * gain;
            }
        }
        line.B[(at + n - 1, j)] = 1.0 / tau;
    }
    line
}

/// State matrix, input matrix and noise covariance of one sampling step.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Sampled {
    /// `e^{A dt}`.
    pub A: Mat<f64>,
    /// `int_0^dt e^{A s} ds B`.
    pub B: Mat<f64>,
    /// `int_0^dt e^{A s} W e^{A' s} ds`.
    pub Q: Mat<f64>,
}

/// Exact sampling of `dx = A x dt + B u dt + dw`, `u` held, `w` of intensity
/// `W`.
///
/// Van Loan's block exponential over a fraction `h = dt / 2^s` of the step,
/// short enough that nothing grows, then `s` doublings
///
/// ```text
/// Q <- Q + A Q A',   B <- B + A B,   A <- A A
/// ```
///
/// which keep `Q` positive semidefinite for any `dt` (the block exponential
/// over the whole step overflows for fast stable modes).
///
/// # Source
/// van Loan (1978), Computing integrals involving the matrix exponential.
///
/// # Errors
/// `InvalidDt`.
///
/// ```
/// use mmae::{mat, model::van_loan};
/// // one integrator: A = 1, B = dt, Q = q dt
/// let s = van_loan(mat![[0.0]].as_ref(), mat![[1.0]].as_ref(), mat![[3.0]].as_ref(), 0.5)?;
/// assert_eq!((s.A[(0, 0)], s.B[(0, 0)], s.Q[(0, 0)]), (1.0, 0.5, 1.5));
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn van_loan(
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
    w: MatRef<'_, f64>,
    dt: f64,
) -> Result<Sampled> {
    if !(dt > 0.0 && dt.is_finite()) {
        return Err(Error::InvalidDt { dt });
    }
    let (n, nu) = (a.nrows(), b.ncols());
    let norm = a.norm_l2() * dt;
    let doublings = if norm > 0.5 { (norm / 0.5).log2().ceil() } else { 0.0 };
    if doublings.is_nan() || doublings > 60.0 {
        return Err(Error::Range {
            what: "dt".into(),
            value: dt,
            remedy: "the step is too long for the fastest mode".into(),
        });
    }
    let h = dt / doublings.exp2();
    // [[-A, W], [0, A']] h and [[A, B], [0, 0]] h
    let noise = Mat::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
        (true, true) => -a[(i, j)] * h,
        (true, false) => w[(i, j - n)] * h,
        (false, true) => 0.0,
        (false, false) => a[(j - n, i - n)] * h,
    });
    let held = Mat::from_fn(n + nu, n + nu, |i, j| match (i < n, j < n) {
        (true, true) => a[(i, j)] * h,
        (true, false) => b[(i, j - n)] * h,
        _ => 0.0,
    });
    let (noise, held) = (exponential(noise.as_ref()), exponential(held.as_ref()));
    let mut step = Sampled {
        A: held.submatrix(0, 0, n, n).to_owned(),
        B: held.submatrix(0, n, n, nu).to_owned(),
        Q: product(noise.submatrix(n, n, n, n).transpose(), noise.submatrix(0, n, n, n)),
    };
    // doublings is a whole number of at most 60
    for _ in 0..doublings as u32 {
        let a = step.A.as_ref();
        let moved = product(a, step.Q.as_ref());
        add_product(&mut step.Q, 0, 0, moved.as_ref(), a.transpose());
        let moved = product(a, step.B.as_ref());
        step.B += moved;
        step.A = product(a, a);
    }
    step.Q = Mat::from_fn(n, n, |i, j| 0.5 * (step.Q[(i, j)] + step.Q[(j, i)]));
    Ok(step)
}

/// The continuous plant sampled every `dt`, with its actuator delay as a line
/// of past commands (exact, also for a fraction of a sample).
///
/// ```text
/// x(k+1) = A_d x(k) + B0 u(k-d) + B1 u(k-d-1) + w(k),   R_d = R / dt
/// ```
///
/// The plant returned has `G = I` and `Q` the covariance of `w(k)`; its `B` is
/// the delay-free one (what an observer that does not know the delay uses).
///
/// # Errors
/// `InvalidDt`, `Range` for the delay, `Conflict` for a discrete plant.
pub fn sample(plant: &Plant, dt: f64, delay: f64) -> Result<(Plant, DelayLine)> {
    let (sampled, taps) = sample_taps(plant, dt, delay)?;
    Ok((sampled, taps.line()))
}

/// As [`sample`], with the delay as the commands that act.
pub(crate) fn sample_taps(plant: &Plant, dt: f64, delay: f64) -> Result<(Plant, Taps)> {
    if !plant.time.is_continuous() {
        return Err(Error::Conflict {
            problem: "a discrete plant cannot be sampled again".into(),
            remedy: "sample the continuous plant".into(),
        });
    }
    let nx = plant.nx();
    let w = product(plant.G.as_ref(), plant.Q.as_ref());
    let w = product(w.as_ref(), plant.G.transpose());
    let whole = van_loan(plant.A.as_ref(), plant.B.as_ref(), w.as_ref(), dt)?;
    let sampled = Plant {
        time: Time::Discrete { dt },
        A: whole.A,
        B: whole.B,
        G: Mat::identity(nx, nx),
        C: plant.C.clone(),
        Q: whole.Q,
        R: &plant.R * faer::Scale(1.0 / dt),
    };
    if !(delay >= 0.0 && delay / dt <= 1e4) {
        return Err(Error::Range {
            what: "actuator delay".into(),
            value: delay,
            remedy: format!("give seconds, zero or more, at most 10000 samples of {dt} s"),
        });
    }
    let mut steps = (delay / dt).floor();
    let mut rest = delay - steps * dt;
    if rest > dt * (1.0 - 1e-9) {
        steps += 1.0;
        rest = 0.0;
    }
    // at most 1e4, checked above
    let steps = steps as usize;
    let taps = if rest <= 1e-9 * dt {
        Taps { steps, B0: sampled.B.clone(), B1: None }
    } else {
        let early = van_loan(plant.A.as_ref(), plant.B.as_ref(), w.as_ref(), dt - rest)?;
        let late = van_loan(plant.A.as_ref(), plant.B.as_ref(), w.as_ref(), rest)?;
        let b1 = product(early.A.as_ref(), late.B.as_ref());
        Taps { steps, B0: early.B, B1: Some(b1) }
    };
    Ok((sampled, taps))
}

impl Controller {
    /// The controller sampled every `dt`, its input held.
    ///
    /// # Errors
    /// `InvalidDt`.
    pub fn sample(&self, dt: f64) -> Result<Controller> {
        let nk = self.A.nrows();
        let s = van_loan(self.A.as_ref(), self.B.as_ref(), Mat::zeros(nk, nk).as_ref(), dt)?;
        Ok(Controller { A: s.A, B: s.B, C: self.C.clone(), D: self.D.clone() })
    }
}

impl Shaping {
    /// The filter sampled every `dt`: same covariance and correlation at the
    /// samples.
    ///
    /// # Errors
    /// `InvalidDt`.
    pub fn sample(&self, dt: f64) -> Result<Shaping> {
        let nf = self.nf();
        let w = product(self.B.as_ref(), self.Q.as_ref());
        let w = product(w.as_ref(), self.B.transpose());
        let s = van_loan(self.A.as_ref(), Mat::zeros(nf, 0).as_ref(), w.as_ref(), dt)?;
        Ok(Shaping {
            A: s.A,
            B: Mat::identity(nf, nf),
            C: self.C.clone(),
            Q: s.Q,
            states: self.states.clone(),
        })
    }
}

/// `e^A`, for a finite `A` small enough that nothing overflows.
fn exponential(a: MatRef<'_, f64>) -> Mat<f64> {
    let n = a.nrows();
    let flat: Vec<f64> = (0..n * n).map(|k| a[(k / n, k % n)]).collect();
    let (mut e, mut work) = (vec![0.0; n * n], vec![0.0; expm_work(n)]);
    let finite = expm(Dyn(n), &flat, &mut e, &mut work);
    debug_assert!(finite, "the step was chosen short enough");
    Mat::from_fn(n, n, |i, j| e[i * n + j])
}
