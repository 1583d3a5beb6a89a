//! The plant with everything around it, as one linear system.

use crate::model::{Controller, Shaping};

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
