//! Sets of equivalently identified plants (EIP): which model of a bank each
//! plant of a parameter grid would be identified as.

mod assembly;
mod batch;
mod blocks;
mod collect;
mod cost;
mod delay;
mod dips;
mod doubling;
mod engine;
mod frequency;
mod identify;
mod judge;
mod modal;
mod penalty;
mod place;
mod quadrature;
mod rates;
mod refine;
mod result;
mod robust;
mod root;
mod run;
mod scatter;
mod sets;
mod setup;
mod slabs;
mod spare;
mod sparse;
mod stability;
mod study;
mod sweep;

pub use crate::observer::ModelSet as Bank;
pub use blocks::{Block, Blocks};
pub use identify::{Band, Identification, Lemma, Outcome, OutcomeKind, Stretch, WeightLaw};
pub use place::{Cells, Placement};
pub use result::{
    Boundary, Case, Convention, Doubt, EipSets, Failed, Interval, Method, Model, Undecidable,
    Undecided, Unstable,
};
pub use robust::{Found, Inner, Peak, Robust, Uncertain};
pub use scatter::Scatter;
pub use setup::Setup;
pub use study::{Cost, Study, Verify};
pub use sweep::DelaySweep;
