//! `manifest.json` of a directory of parts: the same bytes for the same parts.

use std::io::{self, Write};

use serde::{Deserialize, Serialize};

use crate::report::write::Written;
use crate::sweep::part::Part;
use crate::sweep::{Identity, Summary};

/// Name and version of the layout.
pub const SCHEMA: &str = "mmae.parts/1";

/// What a directory of parts holds.
///
/// Neither times nor machines: whoever computed the parts, it is the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`SCHEMA`].
    pub schema: String,
    /// What the parts are parts of.
    pub study: Identity,
    /// Whether all blocks of the study are there.
    pub complete: bool,
    /// Blocks that are there, as `[first, last]`.
    pub present: Vec<[usize; 2]>,
    /// Counts over them, one entry a delay.
    pub summary: Vec<Summary>,
    /// The files.
    pub files: Vec<Written>,
}

impl Manifest {
    /// Of `parts`, of `identity` all of them, by table and block.
    pub(crate) fn new(identity: &Identity, parts: &[Part]) -> Self {
        let mut blocks: Vec<usize> = parts.iter().map(|part| part.named.block).collect();
        blocks.sort_unstable();
        blocks.dedup();
        let mut summary: Vec<Summary> = Vec::new();
        for part in parts.iter().filter(|part| part.named.table == 0) {
            if summary.is_empty() {
                summary = part.summary.clone();
            } else {
                summary.iter_mut().zip(&part.summary).for_each(|(sum, one)| sum.add(one));
            }
        }
        Self {
            schema: SCHEMA.into(),
            study: identity.clone(),
            complete: blocks.len() == identity.blocks,
            present: ranges(&blocks),
            summary,
            files: parts.iter().map(|part| part.written.clone()).collect(),
        }
    }

    /// Writes the manifest as indented JSON.
    ///
    /// # Errors
    /// Whatever `out` reports.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        serde_json::to_writer_pretty(&mut out, self)?;
        out.write_all(b"\n")
    }
}

/// Increasing numbers as ranges `[first, last]`.
pub(crate) fn ranges(numbers: &[usize]) -> Vec<[usize; 2]> {
    let mut ranges: Vec<[usize; 2]> = Vec::new();
    for &n in numbers {
        match ranges.last_mut() {
            Some(last) if last[1] + 1 == n => last[1] = n,
            _ => ranges.push([n, n]),
        }
    }
    ranges
}
