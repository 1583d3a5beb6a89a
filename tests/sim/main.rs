//! Simulation: random numbers, Monte-Carlo tables, the same bits everywhere.

mod closed;
#[path = "../common/mod.rs"]
mod common;
mod joint;
#[allow(dead_code, reason = "every test binary uses a part")]
#[path = "../common/json.rs"]
mod json;
mod laws;
mod pendulum;
mod random;
mod setup;
mod statistics;
mod tables;
mod trials;
