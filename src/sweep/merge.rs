//! Parts of several directories joined to one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::report::write::{MANIFEST, Written, io_error};
use crate::sweep::directory::Directory;
use crate::sweep::manifest::ranges;
use crate::sweep::part::{self, Opened, Part, TABLES};
use crate::sweep::{Error, Identity, Manifest};

/// What some directories of parts hold, every file read and checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Inventory {
    /// The study, as the first sound part tells it.
    pub study: Option<Identity>,
    /// Blocks that are in no directory, or not whole.
    pub missing: Vec<usize>,
    /// Files that are damaged or lost, and what is wrong.
    pub damaged: Vec<(PathBuf, String)>,
    /// Parts of another study, and in what it differs.
    pub foreign: Vec<(PathBuf, String)>,
    /// One part a table and block.
    parts: BTreeMap<(usize, usize), Part>,
}

/// What a merge has done.
#[derive(Debug, Clone, PartialEq)]
pub struct Merged {
    /// What the directory holds.
    pub manifest: Manifest,
    /// The manifest as a file: its digest stands for all parts.
    pub written: Written,
}

/// Reads all parts in `dirs` and says what is missing, damaged or of another
/// study. Changes nothing; directories of killed and of running shards may be
/// among them.
///
/// # Errors
/// `Files` for a directory or file that cannot be read.
pub fn look(dirs: &[impl AsRef<Path>]) -> Result<Inventory, Error> {
    let mut found = Inventory::default();
    for dir in dirs {
        let dir = dir.as_ref();
        std::fs::read_dir(dir).map_err(|e| io_error("read", dir, e))?;
        let mut names = Vec::new();
        for named in part::named(dir)? {
            let path = named.path.clone();
            match named.open()? {
                Ok(opened) => {
                    names.push(opened.part.written.name.clone());
                    found.take(path, opened);
                }
                Err(problem) => found.damaged.push((path, problem)),
            }
        }
        // a manifest that cannot be read lists nothing: parts speak for themselves
        let listed = std::fs::read(dir.join(MANIFEST)).unwrap_or_default();
        if let Ok(manifest) = serde_json::from_slice::<Manifest>(&listed) {
            for file in manifest.files.iter().filter(|file| !names.contains(&file.name)) {
                let path = dir.join(&file.name);
                if found.damaged.iter().all(|(other, _)| *other != path) {
                    found
                        .damaged
                        .push((path, "it is listed in the manifest, and not there".into()));
                }
            }
        }
    }
    if let Some(study) = &found.study {
        let whole = |block: usize| (0..TABLES.len()).all(|t| found.parts.contains_key(&(t, block)));
        found.missing = (0..study.blocks).filter(|&block| !whole(block)).collect();
    }
    Ok(found)
}

impl Inventory {
    fn take(&mut self, path: PathBuf, Opened { part, identity, .. }: Opened) {
        let study = self.study.get_or_insert_with(|| identity.clone());
        if let Some(difference) = study.difference(&identity) {
            self.foreign.push((path, difference));
            return;
        }
        let key = (part.named.table, part.named.block);
        match self.parts.get(&key) {
            None => {
                self.parts.insert(key, part);
            }
            Some(first) if first.written == part.written => {}
            Some(first) => {
                let other = first.named.path.display();
                self.damaged.push((path, format!("it is not the same as {other}")));
            }
        }
    }

    /// What keeps the parts from being joined, one message a cause; empty if
    /// nothing does.
    pub fn problems(&self) -> Vec<String> {
        let mut problems: Vec<String> = Vec::new();
        let Some(study) = &self.study else {
            problems.extend(self.damage());
            problems.push("there are no parts: give the directories of mmae eip --shard".into());
            return problems;
        };
        for (path, difference) in &self.foreign {
            problems.push(format!(
                "{} is of another study: {difference}: give parts of one study",
                path.display()
            ));
        }
        if !self.missing.is_empty() {
            problems.extend(self.damage());
            let list: Vec<String> = ranges(&self.missing)
                .into_iter()
                .map(|[a, b]| if a == b { a.to_string() } else { format!("{a} to {b}") })
                .collect();
            problems.push(format!(
                "{} of {} blocks are missing: {}: run their shards with --resume",
                self.missing.len(),
                study.blocks,
                list.join(", ")
            ));
        }
        problems
    }

    fn damage(&self) -> impl Iterator<Item = String> {
        self.damaged.iter().map(|(path, problem)| format!("{}: {problem}", path.display()))
    }
}

/// Joins the parts in `dirs` in directory `out`: the same bytes however they
/// were dealt out.
///
/// Every part is checked before the first is copied, and again on the way. A
/// damaged part is no loss where another directory has it whole: `note` is told.
/// An interrupted merge continues where it was.
///
/// # Errors
/// `Incomplete` if a block is missing or a part is of another study: then
/// nothing is written. `Present` for a result in `out` (unless `force`),
/// `Foreign` for parts of another study there, `Files`.
pub fn merge(
    dirs: &[impl AsRef<Path>],
    out: &Path,
    force: bool,
    note: &mut dyn FnMut(&str),
) -> Result<Merged, Error> {
    let found = look(dirs)?;
    let problems = found.problems();
    if !problems.is_empty() {
        return Err(Error::Incomplete { problems });
    }
    let Some(study) = &found.study else { return Err(Error::Incomplete { problems }) };
    found.damage().for_each(|message| note(&format!("{message}: another copy is taken")));
    let directory = Directory::open(out)?;
    directory.check_manifest(force)?;
    let mut there = Vec::new();
    for named in directory.named()? {
        let path = named.path.clone();
        match named.open()? {
            Ok(opened) => {
                if let Some(difference) = study.difference(&opened.identity) {
                    return Err(Error::Foreign { path, difference });
                }
                there.push(opened.part.written);
            }
            Err(_) => std::fs::remove_file(&path).map_err(|e| io_error("remove", &path, e))?,
        }
    }
    let parts: Vec<Part> = found.parts.into_values().collect();
    for part in &parts {
        if there.contains(&part.written) {
            continue;
        }
        let path = &part.named.path;
        match part.named.clone().open()? {
            Ok(again) if again.part.written == part.written => {
                directory.put(part.named.table, part.named.block, &again.bytes)?;
            }
            _ => {
                let problems = vec![format!("{} changed meanwhile: merge again", path.display())];
                return Err(Error::Incomplete { problems });
            }
        }
    }
    let manifest = Manifest::new(study, &parts);
    let written = directory.finish(&manifest)?;
    Ok(Merged { manifest, written })
}
