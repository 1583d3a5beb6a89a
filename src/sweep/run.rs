//! One shard: its blocks computed one after the other, each written at once.

use std::fs;
use std::ops::Range;
use std::path::Path;

use crate::eip::{Block, Blocks};
use crate::par::RunControl;
use crate::report::write::{self, Written, io_error};
use crate::sweep::directory::Directory;
use crate::sweep::part::{self, Named, Part, TABLES};
use crate::sweep::{Error, Manifest, Plan, Shard, Summary, tables};

/// What to do about parts that are there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Refuse to begin.
    New,
    /// Check them, keep those that are sound, compute the rest.
    Resume,
    /// Remove them.
    Replace,
}

/// What a run has done.
#[derive(Debug, Clone, PartialEq)]
pub struct Done {
    /// What the directory holds.
    pub manifest: Manifest,
    /// The manifest as a file: its digest stands for all parts.
    pub written: Written,
    /// Blocks computed.
    pub computed: usize,
    /// Blocks of the shard that were there.
    pub kept: usize,
}

/// Computes the blocks of `shard` into directory `dir`.
///
/// A block is two files (see the guide, page "results"), each whole under its
/// name or absent. After a kill at any moment, `Mode::Resume` computes what is
/// missing: at most the block that was being computed is done twice. Memory is
/// that of a block. The directory is locked: two runs at once are told apart.
/// Blocks of other shards that `dir` holds are kept in its manifest.
///
/// Progress counts the plants of the blocks that are to be computed. `note` is
/// told what is odd but no error: damaged parts, unusable models.
///
/// # Errors
/// `Engine` for a mistake in the study; `Present`, `Foreign` for what stands in
/// the directory; `Files`: parts written before are intact and a later run
/// continues; `Stopped` if the caller asked for it.
pub fn run(
    plan: &Plan,
    shard: Shard,
    dir: impl AsRef<Path>,
    mode: Mode,
    control: &RunControl<'_>,
    note: &mut dyn FnMut(&str),
) -> Result<Done, Error> {
    let wanted = shard.blocks(plan.blocks());
    let dir = dir.as_ref();
    let directory = Directory::open(dir)?;
    directory.check_manifest(mode != Mode::New)?;
    let mut parts = match mode {
        Mode::Resume => present(plan, &directory, &wanted, note)?,
        _ => {
            clear(&directory, mode)?;
            Vec::new()
        }
    };
    let there = |parts: &[Part], block: usize| {
        parts.iter().filter(|part| part.named.block == block).count() == TABLES.len()
    };
    let todo: Vec<usize> = wanted.clone().filter(|&block| !there(&parts, block)).collect();
    let kept = wanted.len() - todo.len();
    if !todo.is_empty() {
        let identity = plan.identity();
        let setup = plan.study.prepare_blocks(identity.block)?;
        for (i, model) in setup.models().iter().enumerate() {
            if let Some(failure) = &model.failure {
                note(&format!("model {} is unusable: {failure}", i + 1));
            }
        }
        let mut blocks = setup.blocks(identity.block, identity.refine)?;
        let plants: usize = todo.iter().map(|&k| blocks.plants(k).len()).sum();
        let silent = RunControl { progress: None, ..*control };
        let mut done = 0;
        for (n, &k) in todo.iter().enumerate() {
            let block = blocks.run(k, &silent).map_err(|e| match e {
                crate::Error::Cancelled => Error::Stopped { done: kept + n, of: wanted.len() },
                e => Error::Engine(e),
            })?;
            parts.extend(store(plan, &directory, &blocks, k, &block)?);
            done += block.plants.len();
            if let Some(progress) = control.progress {
                progress(done as u64, plants as u64);
            }
        }
    }
    parts.sort_by_key(|part| (part.named.table, part.named.block));
    let manifest = Manifest::new(plan.identity(), &parts);
    let written = directory.finish(&manifest)?;
    Ok(Done { manifest, written, computed: todo.len(), kept })
}

/// Writes the two files of a block.
fn store(
    plan: &Plan,
    directory: &Directory,
    blocks: &Blocks<'_>,
    k: usize,
    block: &Block,
) -> Result<Vec<Part>, Error> {
    let (identity, models) = (plan.identity(), blocks.models());
    let summary = Summary::of(block, models.len());
    let (study, number, counts) = (part::json(identity), k.to_string(), part::json(&summary));
    let about = [
        ("mmae.version", identity.version.as_str()),
        (part::STUDY, &study),
        (part::BLOCK, &number),
        (part::SUMMARY, &counts),
    ];
    let grid = &plan.study.grid;
    let mut stored = Vec::new();
    for (table, fill) in [tables::plants, tables::pairs].into_iter().enumerate() {
        let failed = |e| io_error("write", Path::new(TABLES[table]), std::io::Error::other(e));
        let bytes = fill(block, grid, models, &about).map_err(failed)?;
        let (written, path) = directory.put(table, k, &bytes)?;
        stored.push(Part {
            named: Named::new(path, table, k, &written),
            written,
            summary: summary.clone(),
        });
    }
    Ok(stored)
}

/// The sound parts of the directory; damaged ones of the shard are removed.
fn present(
    plan: &Plan,
    directory: &Directory,
    wanted: &Range<usize>,
    note: &mut dyn FnMut(&str),
) -> Result<Vec<Part>, Error> {
    let mut parts: Vec<Part> = Vec::new();
    for named in directory.named()? {
        let (path, block) = (named.path.clone(), named.block);
        match named.open()? {
            Ok(found) => {
                if let Some(difference) = plan.identity().difference(&found.identity) {
                    return Err(Error::Foreign { path, difference });
                }
                parts.push(found.part);
            }
            Err(problem) if wanted.contains(&block) => {
                note(&format!("{}: {problem}: computed again", path.display()));
                remove(&path)?;
            }
            Err(problem) => {
                note(&format!("{}: {problem}: not of this shard, left alone", path.display()));
            }
        }
    }
    // a block with one file of the two was being written when the run ended
    let whole: Vec<usize> =
        parts.iter().filter(|p| p.named.table == 0).map(|p| p.named.block).collect();
    let both: Vec<usize> = parts
        .iter()
        .filter(|p| p.named.table == 1 && whole.binary_search(&p.named.block).is_ok())
        .map(|p| p.named.block)
        .collect();
    parts.retain(|part| both.binary_search(&part.named.block).is_ok());
    Ok(parts)
}

/// Fails if parts are there, or removes them.
fn clear(directory: &Directory, mode: Mode) -> Result<(), Error> {
    for named in directory.named()? {
        if mode == Mode::New {
            return Err(Error::Present { path: named.path });
        }
        remove(&named.path)?;
    }
    Ok(())
}

fn remove(path: &Path) -> Result<(), write::Error> {
    fs::remove_file(path).map_err(|e| io_error("remove", path, e))
}
