//! Simulation: random numbers, Monte-Carlo tables, the same bits everywhere.

mod laws;
mod random;
mod setup;
mod statistics;
mod tables;
mod trials;
