#![doc = include_str!("../README.md")]

pub mod error;
pub mod real;

pub mod par;
pub mod simd;

pub mod small;

pub mod model;
pub mod solve;

pub mod observer;

pub mod adaptive;
pub mod bank;
pub mod eip;
pub mod weight;

pub mod engine;

pub mod sim;

#[cfg(feature = "scenario")]
pub mod scenario;

#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "cli")]
pub mod report;
#[cfg(feature = "cli")]
pub mod sweep;

pub mod guide;

pub use error::{Error, Result};
pub use faer::{Mat, MatRef, mat};
