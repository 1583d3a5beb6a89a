//! Riccati, Lyapunov and Sylvester equations, one at a time and in batches.

pub mod backend;
