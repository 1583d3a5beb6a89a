//! Studies too large for one file or one machine: computed in parts, joined later.
//!
//! A [`Plan`] cuts the grid of a study into blocks. [`run`] computes the blocks
//! of one [`Shard`] and writes each as two Parquet files under names that hold
//! their digest; a killed run continues where it was. [`merge`] joins the
//! directories of shards. A block has the same bytes whoever computes it, so
//! that the merged directory is the same for any number of shards, threads,
//! machines and interruptions, its `manifest.json` included.
//!
//! The files are described in the guide, page "results".
//!
//! ```
//! use mmae::par::RunControl;
//! use mmae::scenario::{Scenario, Template, template};
//! use mmae::sweep::{self, Mode, Options, Plan, Shard};
//!
//! let text = template(Template::Pendulum).replace("points = 401", "points = 31");
//! let study = Scenario::parse("pendulum.toml", &text)?.study()?;
//! let plan = Plan::new(study, text.as_bytes(), None, Options { block: Some(8), refine: false })?;
//! let dir = tempfile::tempdir()?;
//! let control = RunControl::default();
//! let mut shards = Vec::new();
//! for shard in Shard::all(3) {
//!     shards.push(dir.path().join(format!("shard-{}", shard.index())));
//!     sweep::run(&plan, shard, shards.last().unwrap(), Mode::Resume, &control, &mut |_| {})?;
//! }
//! assert!(sweep::look(&shards)?.missing.is_empty());
//! let merged = sweep::merge(&shards, &dir.path().join("all"), false, &mut |_| {})?;
//! assert_eq!(merged.manifest.summary[0].winners.iter().sum::<usize>(), 31);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod directory;
mod error;
mod identity;
mod manifest;
mod merge;
mod part;
mod plan;
mod run;
mod summary;
mod tables;

pub use error::Error;
pub use identity::Identity;
pub use manifest::{Manifest, SCHEMA};
pub use merge::{Inventory, Merged, look, merge};
pub use plan::{Options, Plan, Shard};
pub use run::{Done, Mode, run};
pub use summary::Summary;
