//! The plant with everything around it, as one linear system.

use faer::Mat;

use crate::error::{Error, Result};
use crate::model::close::{Around, Closing, add_product, blank, put};
use crate::model::discretize::DelayLine;
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
        let mut full = self.clone();
        if let Some(f) = filter {
            self.with_disturbance_into(f, &mut full);
        }
        full
    }

    /// As [`Plant::with_disturbance`], into the buffers of `full`.
    pub(crate) fn with_disturbance_into(&self, f: &Shaping, full: &mut Plant) {
        let (nx, nf) = (self.nx(), f.nf());
        let n = nx + nf;
        full.time = self.time;
        blank(&mut full.A, n, n);
        blank(&mut full.B, n, self.nu());
        blank(&mut full.G, n, f.B.ncols());
        blank(&mut full.C, self.ny(), n);
        full.Q.clone_from(&f.Q);
        full.R.clone_from(&self.R);
        put(&mut full.A, 0, 0, self.A.as_ref());
        add_product(&mut full.A, 0, nx, self.G.as_ref(), f.C.as_ref());
        put(&mut full.A, nx, nx, f.A.as_ref());
        put(&mut full.B, 0, 0, self.B.as_ref());
        put(&mut full.G, nx, 0, f.B.as_ref());
        put(&mut full.C, 0, 0, self.C.as_ref());
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
        let mut block = LoopBlock::empty(plant.time);
        let surroundings = Around { controller, input };
        Closing::new().loop_of(plant, surroundings, delay, form, &mut block)?;
        Ok(block)
    }

    /// Closes the loop around a sampled plant whose delay line was made by
    /// [`crate::model::sample`].
    pub fn sampled(
        plant: &Plant,
        controller: Option<&Controller>,
        input: Option<&Shaping>,
        line: &DelayLine,
    ) -> Self {
        let mut block = LoopBlock::empty(plant.time);
        Closing::new().close(plant, Around { controller, input }, Some(line), &mut block);
        block
    }

    /// A block of no size, to be filled.
    pub(crate) fn empty(time: Time) -> Self {
        let none = Mat::new;
        Self {
            time,
            A: none(),
            B: none(),
            Cy: none(),
            Dy: none(),
            Cu: none(),
            Du: none(),
            delayed: None,
        }
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
