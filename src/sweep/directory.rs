//! A directory of parts that is being written.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::report::write::{self, MANIFEST, Output, Written, io_error};
use crate::sweep::manifest::Manifest;
use crate::sweep::part::{self, Named, TABLES};
use crate::sweep::{Error, SCHEMA};

/// Locked as long as it lives; parts that were put into it stay.
pub(crate) struct Directory {
    path: PathBuf,
    /// Present until the manifest is written.
    output: Option<Output>,
}

impl Directory {
    /// Makes and locks `path`, and removes what a killed process left half-done.
    pub(crate) fn open(path: &Path) -> Result<Self, write::Error> {
        let output = Some(Output::open(path, &[], true)?);
        let directory = Self { path: path.into(), output };
        for table in TABLES {
            let folder = path.join(table);
            match folder.symlink_metadata() {
                Ok(meta) if meta.is_dir() => write::sweep(&folder),
                Ok(_) => return Err(write::Error::NotDirectory { path: folder }),
                Err(e) if e.kind() == io::ErrorKind::NotFound => {}
                Err(e) => return Err(io_error("look at", &folder, e)),
            }
        }
        Ok(directory)
    }

    /// The parts in it, by their names.
    pub(crate) fn named(&self) -> Result<Vec<Named>, write::Error> {
        part::named(&self.path)
    }

    /// Fails if a manifest is in the way: any without `again`, with it that of
    /// another kind of result.
    pub(crate) fn check_manifest(&self, again: bool) -> Result<(), Error> {
        let path = self.path.join(MANIFEST);
        let Ok(text) = fs::read(&path) else { return Ok(()) };
        let kind = serde_json::from_slice::<serde_json::Value>(&text).ok();
        let schema = kind.as_ref().and_then(|kind| kind.get("schema")?.as_str());
        let ours = schema.is_none_or(|schema| schema == SCHEMA);
        if again && ours { Ok(()) } else { Err(Error::Present { path }) }
    }

    /// Writes a part: whole under its name, or not at all.
    pub(crate) fn put(
        &self,
        table: usize,
        block: usize,
        bytes: &[u8],
    ) -> Result<(Written, PathBuf), write::Error> {
        let folder = self.path.join(TABLES[table]);
        match fs::create_dir(&folder) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => {
                return Err(io_error("create", &folder, e));
            }
            _ => {}
        }
        let sha256 = write::sha256(bytes);
        let name = part::name(TABLES[table], block, &sha256);
        let path = self.path.join(&name);
        write::file(&path, bytes, true)?;
        Ok((Written { name, bytes: bytes.len() as u64, sha256 }, path))
    }

    /// Writes the manifest, which ends the run.
    pub(crate) fn finish(mut self, manifest: &Manifest) -> Result<Written, write::Error> {
        let Some(mut output) = self.output.take() else {
            return Err(write::Error::Name { path: self.path.clone() });
        };
        output.add(MANIFEST, |out| manifest.write(out))?;
        let written = output.written().pop();
        output.commit()?;
        written.ok_or_else(|| write::Error::Name { path: self.path.clone() })
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        if self.output.is_some() {
            for table in TABLES {
                // fails, as it should, where there are parts
                let _ = fs::remove_dir(self.path.join(table));
            }
        }
    }
}
