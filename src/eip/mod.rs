//! Sets of equivalently identified plants (EIP): which model of a bank each
//! plant of a parameter grid would be identified as.

mod assembly;
mod batch;
mod cost;
mod delay;
mod doubling;
mod engine;
mod frequency;
mod modal;
mod place;
mod quadrature;
mod refine;
mod result;
mod root;
mod run;
mod sets;
mod setup;
mod study;

pub use crate::observer::ModelSet as Bank;
pub use place::{Cells, Placement};
pub use result::{
    Boundary, Case, Convention, Doubt, EipSets, Failed, Interval, Method, Model, Undecidable,
    Undecided, Unstable,
};
pub use setup::Setup;
pub use study::{Cost, Study, Verify};
