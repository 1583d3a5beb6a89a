//! The plant with everything around it, as one linear system.

use faer::{Mat, MatRef};

use crate::error::{Error, Result};
use crate::model::discretize::{DelayLine, pade_delay};
use crate::model::{Controller, Plant, Shaping, Time};

/// Default order of the Pade approximation of an actuator delay.
const PADE_ORDER: usize = 4;
/// Largest order whose state space is well scaled.
const MAX_PADE: usize = 10;

/// What surrounds the plant of a study; the same for every parameter value.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surroundings {
    /// Feedback `u = K y` (plus the exogenous input, if any).
    pub controller: Option<Controller>,
    /// Filter that colours the disturbance `w` of the plant.
    pub disturbance: Option<Shaping>,
    /// Filter whose output is the exogenous input, seen by plant and
    /// observers: `u`, or the reference added to `K y`.
    pub input: Option<Shaping>,
    /// Order of the Pade approximation of the actuator delay in state space
    /// (continuous time; 0 means the default, 4).
    pub pade_order: usize,
}

impl Surroundings {
    /// Checks everything against a plant.
    ///
    /// # Errors
    /// What the checks of [`Controller`] and [`Shaping`] return.
    pub fn check(&self, plant: &Plant) -> Result<()> {
        if self.pade_order > MAX_PADE {
            return Err(Error::Range {
                what: "Pade order".into(),
                value: self.pade_order as f64,
                remedy: format!("give at most {MAX_PADE}: higher orders lose digits"),
            });
        }
        if let Some(k) = &self.controller {
            k.check(plant.nu(), plant.ny())?;
        }
        for (filter, name, outputs) in
            [(&self.disturbance, "disturbance", plant.nw()), (&self.input, "input", plant.nu())]
        {
            if let Some(f) = filter {
                f.check(name, outputs)?;
                f.check_stable(name, plant.time)?;
            }
        }
        Ok(())
    }

    /// Order of the Pade approximation in force.
    pub fn pade(&self) -> usize {
        if self.pade_order == 0 { PADE_ORDER } else { self.pade_order }
    }
}

impl Plant {
    /// The plant with the disturbance filter's state appended, `[x; x_f]`,
    /// driven by the white noise of the filter; without a filter, a copy.
    ///
    /// ```text
    /// A = [A  G C_f]   B = [B]   G = [ 0 ]   C = [C  0]   Q = Q_f
    ///     [0   A_f ]       [0]       [B_f]
    /// ```
    pub fn with_disturbance(&self, filter: Option<&Shaping>) -> Plant {
        let Some(f) = filter else { return self.clone() };
        let (nx, nf) = (self.nx(), f.nf());
        let n = nx + nf;
        let mut plant = Plant {
            time: self.time,
            A: Mat::zeros(n, n),
            B: Mat::zeros(n, self.nu()),
            G: Mat::zeros(n, f.B.ncols()),
            C: Mat::zeros(self.ny(), n),
            Q: f.Q.clone(),
            R: self.R.clone(),
        };
        put(&mut plant.A, 0, 0, self.A.as_ref());
        put(&mut plant.A, 0, nx, times(self.G.as_ref(), f.C.as_ref()).as_ref());
        put(&mut plant.A, nx, nx, f.A.as_ref());
        put(&mut plant.B, 0, 0, self.B.as_ref());
        put(&mut plant.G, nx, 0, f.B.as_ref());
        put(&mut plant.C, 0, 0, self.C.as_ref());
        plant
    }
}

/// A plant in its loop, driven by white noise of unit intensity (covariance).
///
/// ```text
/// x_p' = A x_p + B w,   y = C_y x_p + D_y w,   u = C_u x_p + D_u w
/// ```
///
/// `x_p = [plant; disturbance filter; delay; controller; input filter]`, `w =
/// [disturbance; input noise; measurement noise]`. `y` is what the observers
/// measure, `u` what they are told was applied: the command before the delay.
///
/// # Source
/// Hassani et al. (2009), corollary 1, with the plant's own matrices in the
/// plant block and the loop closed.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct LoopBlock {
    /// Continuous or discrete.
    pub time: Time,
    /// State matrix, `np` by `np`.
    pub A: Mat<f64>,
    /// From the noise, `np` by `nw`.
    pub B: Mat<f64>,
    /// To the measurement.
    pub Cy: Mat<f64>,
    /// Measurement noise in the measurement.
    pub Dy: Mat<f64>,
    /// To the command.
    pub Cu: Mat<f64>,
    /// Measurement noise in the command (a static gain's).
    pub Du: Mat<f64>,
    /// The part of `A` that acts after the delay, for an exact delay: then
    /// `x_p'(t) = A x_p(t) + A_delayed x_p(t - tau) + B w(t) + B_delayed w(t -
    /// tau)`.
    pub delayed: Option<Delayed>,
}

/// The delayed part of a [`LoopBlock`] with an exact actuator delay.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Delayed {
    /// The delay in seconds.
    pub tau: f64,
    /// State matrix at the delayed time.
    pub A: Mat<f64>,
    /// Noise matrix at the delayed time.
    pub B: Mat<f64>,
}

/// How the actuator delay enters the block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DelayForm {
    /// As states: Pade of the given order in continuous time, a chain of past
    /// commands in discrete time.
    States {
        /// Order of the approximation; discrete time ignores it.
        pade: usize,
    },
    /// As [`Delayed`] matrices, exact in the frequency domain (continuous
    /// time; discrete time takes states, which are exact there).
    Exact,
}

impl LoopBlock {
    /// Closes the loop around `plant`, which carries its disturbance filter
    /// already ([`Plant::with_disturbance`]).
    ///
    /// # Errors
    /// `Range` for a negative or non-finite delay and, in discrete time, one
    /// that is not a whole number of samples.
    pub fn new(
        plant: &Plant,
        controller: Option<&Controller>,
        input: Option<&Shaping>,
        delay: f64,
        form: DelayForm,
    ) -> Result<Self> {
        if !(delay >= 0.0 && delay.is_finite()) {
            return Err(Error::Range {
                what: "actuator delay".into(),
                value: delay,
                remedy: "give seconds, zero or more".into(),
            });
        }
        let line = if delay == 0.0 || plant.nu() == 0 {
            DelayLine::none(plant)
        } else {
            match (plant.time, form) {
                (Time::Continuous, DelayForm::States { pade }) => pade_delay(plant, delay, pade),
                (Time::Continuous, DelayForm::Exact) => {
                    let mut block = close(plant, controller, input, &DelayLine::cut(plant));
                    let full = close(plant, controller, input, &DelayLine::none(plant));
                    block.delayed =
                        Some(Delayed { tau: delay, A: &full.A - &block.A, B: &full.B - &block.B });
                    return Ok(block);
                }
                (Time::Discrete { dt }, _) => DelayLine::whole_samples(plant, delay, dt)?,
            }
        };
        Ok(close(plant, controller, input, &line))
    }

    /// Closes the loop around a sampled plant whose delay line was made by
    /// [`crate::model::sample`].
    pub fn sampled(
        plant: &Plant,
        controller: Option<&Controller>,
        input: Option<&Shaping>,
        line: &DelayLine,
    ) -> Self {
        close(plant, controller, input, line)
    }

    /// Number of states.
    pub fn np(&self) -> usize {
        self.A.nrows()
    }

    /// Number of noise inputs.
    pub fn nw(&self) -> usize {
        self.B.ncols()
    }
}

/// Names of the states of the block that [`LoopBlock::new`] builds.
pub fn block_states(plant: &[String], surroundings: &Surroundings, np: usize) -> Vec<String> {
    let mut names = plant.to_vec();
    if let Some(f) = &surroundings.disturbance {
        names.extend(f.states.iter().cloned());
    }
    let tail_k = surroundings.controller.as_ref().map_or(0, |k| k.A.nrows());
    let tail_r = surroundings.input.as_ref().map_or(0, Shaping::nf);
    let delay = np.saturating_sub(names.len() + tail_k + tail_r);
    names.extend((1..=delay).map(|i| format!("delay {i}")));
    names.extend((1..=tail_k).map(|i| format!("controller {i}")));
    if let Some(f) = &surroundings.input {
        names.extend(f.states.iter().cloned());
    }
    names
}

/// The interconnection
///
/// ```text
/// x'   = A x + Bx x_d + B0 u + G Q^1/2 w1      plant and disturbance filter
/// x_d' = Ad x_d + Bd u                         delay line
/// x_K' = A_K x_K + B_K y                       controller
/// x_r' = A_r x_r + B_r Q_r^1/2 w2              input filter
/// y = C x + R^1/2 w3,   u = C_K x_K + D_K y + C_r x_r
/// ```
fn close(
    plant: &Plant,
    controller: Option<&Controller>,
    input: Option<&Shaping>,
    line: &DelayLine,
) -> LoopBlock {
    let (nx, nu, ny) = (plant.nx(), plant.nu(), plant.ny());
    let nd = line.A.nrows();
    let nk = controller.map_or(0, |k| k.A.nrows());
    let nr = input.map_or(0, Shaping::nf);
    let np = nx + nd + nk + nr;
    let (at_d, at_k, at_r) = (nx, nx + nd, nx + nd + nk);

    let w1 = times(plant.G.as_ref(), psd_factor(plant.Q.as_ref()).as_ref());
    let w2 = input.map_or_else(
        || Mat::zeros(0, 0),
        |f| times(f.B.as_ref(), psd_factor(f.Q.as_ref()).as_ref()),
    );
    let w3 = psd_factor(plant.R.as_ref());
    let (n1, n2, n3) = (w1.ncols(), w2.ncols(), w3.ncols());
    let nw = n1 + n2 + n3;

    let mut block = LoopBlock {
        time: plant.time,
        A: Mat::zeros(np, np),
        B: Mat::zeros(np, nw),
        Cy: Mat::zeros(ny, np),
        Dy: Mat::zeros(ny, nw),
        Cu: Mat::zeros(nu, np),
        Du: Mat::zeros(nu, nw),
        delayed: None,
    };
    put(&mut block.Cy, 0, 0, plant.C.as_ref());
    put(&mut block.Dy, 0, n1 + n2, w3.as_ref());
    if let Some(k) = controller {
        put(&mut block.Cu, 0, 0, times(k.D.as_ref(), plant.C.as_ref()).as_ref());
        put(&mut block.Cu, 0, at_k, k.C.as_ref());
        put(&mut block.Du, 0, n1 + n2, times(k.D.as_ref(), w3.as_ref()).as_ref());
    }
    if let Some(f) = input {
        put(&mut block.Cu, 0, at_r, f.C.as_ref());
    }

    // what does not pass through u
    put(&mut block.A, 0, 0, plant.A.as_ref());
    put(&mut block.A, 0, at_d, line.Bx.as_ref());
    put(&mut block.A, at_d, at_d, line.A.as_ref());
    put(&mut block.B, 0, 0, w1.as_ref());
    if let Some(k) = controller {
        put(&mut block.A, at_k, at_k, k.A.as_ref());
        put(&mut block.A, at_k, 0, times(k.B.as_ref(), plant.C.as_ref()).as_ref());
        put(&mut block.B, at_k, n1 + n2, times(k.B.as_ref(), w3.as_ref()).as_ref());
    }
    if let Some(f) = input {
        put(&mut block.A, at_r, at_r, f.A.as_ref());
        put(&mut block.B, at_r, n1, w2.as_ref());
    }
    // what does
    let mut from_u = Mat::zeros(np, nu);
    put(&mut from_u, 0, 0, line.B0.as_ref());
    put(&mut from_u, at_d, 0, line.B.as_ref());
    block.A += times(from_u.as_ref(), block.Cu.as_ref());
    block.B += times(from_u.as_ref(), block.Du.as_ref());
    block
}

/// `A B` by plain loops: an order of magnitude faster than the general product
/// on matrices this small, and one plant of a grid takes a dozen of them.
pub(crate) fn times(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut c = Mat::zeros(a.nrows(), b.ncols());
    for j in 0..b.ncols() {
        for k in 0..a.ncols() {
            let factor = b[(k, j)];
            if factor != 0.0 {
                for i in 0..a.nrows() {
                    c[(i, j)] = factor.mul_add(a[(i, k)], c[(i, j)]);
                }
            }
        }
    }
    c
}

fn put(into: &mut Mat<f64>, row: usize, col: usize, from: MatRef<'_, f64>) {
    into.submatrix_mut(row, col, from.nrows(), from.ncols()).copy_from(from);
}

/// `L` with `L L' = Q` for a positive semidefinite `Q`: Cholesky with diagonal
/// pivoting that stops at the numerical rank.
pub(crate) fn psd_factor(q: MatRef<'_, f64>) -> Mat<f64> {
    let n = q.nrows();
    let mut rest = Mat::from_fn(n, n, |i, j| 0.5 * (q[(i, j)] + q[(j, i)]));
    let mut factor = Mat::<f64>::zeros(n, n);
    let diagonal: Vec<f64> = (0..n).map(|i| rest[(i, i)]).collect();
    // pivots are judged against their own diagonal: channels may differ in
    // units by any factor
    let share = |rest: &Mat<f64>, i: usize| {
        if diagonal[i] > 0.0 { rest[(i, i)] / diagonal[i] } else { 0.0 }
    };
    let mut taken = vec![false; n];
    for k in 0..n {
        let Some(p) = (0..n)
            .filter(|&i| !taken[i])
            .max_by(|&i, &j| share(&rest, i).total_cmp(&share(&rest, j)))
        else {
            break;
        };
        if share(&rest, p) <= 8.0 * f64::EPSILON * n as f64 {
            break;
        }
        let pivot = rest[(p, p)];
        taken[p] = true;
        let root = pivot.sqrt();
        for i in 0..n {
            factor[(i, k)] = if i == p {
                root
            } else if taken[i] {
                0.0
            } else {
                rest[(i, p)] / root
            };
        }
        for i in 0..n {
            for j in 0..n {
                rest[(i, j)] -= factor[(i, k)] * factor[(j, k)];
            }
        }
    }
    factor
}
