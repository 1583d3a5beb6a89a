//! Sampling: to be filled.
