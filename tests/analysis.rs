//! Analyses of identification: undecidable sets, placement, which model wins.

#[path = "analysis/identify.rs"]
mod identify;
#[path = "analysis/placement.rs"]
mod placement;
#[path = "analysis/robust.rs"]
mod robust;
