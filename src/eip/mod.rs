//! Sets of equivalently identified plants (EIP): which model of a bank each
//! plant of a parameter grid would be identified as.

mod result;
mod study;

pub use result::{
    Boundary, Case, Convention, EipSets, Interval, Method, Model, Undecidable, Unstable,
};
pub use study::{Bank, Cost, Study, Verify};
