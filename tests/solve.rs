//! Solvers against reference solutions, properties, and each other.

mod common;

#[path = "solve/reference.rs"]
mod reference;
