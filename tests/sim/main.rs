//! Simulation: random numbers, Monte-Carlo tables, the same bits everywhere.

mod closed;
#[path = "../common/mod.rs"]
mod common;
mod laws;
mod random;
mod setup;
mod statistics;
mod tables;
mod trials;
