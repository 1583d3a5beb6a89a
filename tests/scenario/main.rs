//! Scenario files: every key, every error with its place, hostile input.
#![cfg(feature = "scenario")]

mod faults;
mod hostile;
mod keys;
