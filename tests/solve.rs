//! Solvers against reference solutions, properties, and each other.

mod common;

#[path = "solve/batch.rs"]
mod batch;
#[path = "solve/faults.rs"]
mod faults;
#[path = "solve/ode.rs"]
mod ode;
#[path = "solve/properties.rs"]
mod properties;
#[path = "solve/reasons.rs"]
mod reasons;
#[path = "solve/reference.rs"]
mod reference;
