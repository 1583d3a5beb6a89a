//! The files of a block: names that hold a digest, and what is inside.

use std::fs;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use parquet::file::reader::{FileReader, SerializedFileReader};

use crate::report::write::{self, Written, io_error};
use crate::sweep::{Identity, Summary};

/// Folders of a directory of parts, one a table.
pub(crate) const TABLES: [&str; 2] = ["plants", "upsilon"];
/// Digits of the digest in a name.
const DIGITS: usize = 16;
/// Keys of what is stored beside a table.
pub(crate) const STUDY: &str = "mmae.study";
pub(crate) const BLOCK: &str = "mmae.block";
pub(crate) const SUMMARY: &str = "mmae.summary";

/// `plants/000012-0f3a9c....parquet`: the file of `block` with these contents.
pub(crate) fn name(table: &str, block: usize, sha256: &str) -> String {
    format!("{table}/{block:06}-{}.parquet", &sha256[..DIGITS])
}

/// A file with the name of a part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Named {
    pub(crate) path: PathBuf,
    /// Index in [`TABLES`].
    pub(crate) table: usize,
    pub(crate) block: usize,
    digest: String,
}

/// A part with its study and its bytes.
pub(crate) struct Opened {
    pub(crate) part: Part,
    pub(crate) identity: Identity,
    pub(crate) bytes: Bytes,
}

/// A part whose contents were looked at.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    pub(crate) named: Named,
    pub(crate) written: Written,
    pub(crate) summary: Vec<Summary>,
}

/// The parts in `dir` by their names, in the order of tables and blocks.
///
/// # Errors
/// `Io` for a directory that cannot be read.
pub(crate) fn named(dir: &Path) -> Result<Vec<Named>, write::Error> {
    let mut all = Vec::new();
    for (table, folder) in TABLES.iter().enumerate() {
        let folder = dir.join(folder);
        let entries = match fs::read_dir(&folder) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => continue,
            entries => entries.map_err(|e| io_error("read", &folder, e))?,
        };
        for entry in entries {
            let path = entry.map_err(|e| io_error("read", &folder, e))?.path();
            let file = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
            let Some((block, digest)) =
                file.strip_suffix(".parquet").and_then(|stem| stem.split_once('-'))
            else {
                continue;
            };
            let hexadecimal = |c: char| c.is_ascii_digit() || ('a'..='f').contains(&c);
            let Ok(block) = block.parse() else { continue };
            if digest.len() == DIGITS && digest.chars().all(hexadecimal) {
                let digest = digest.into();
                all.push(Named { path, table, block, digest });
            }
        }
    }
    all.sort_by(|a, b| (a.table, a.block, &a.path).cmp(&(b.table, b.block, &b.path)));
    Ok(all)
}

/// As JSON on one line.
pub(crate) fn json(value: &impl serde::Serialize) -> String {
    // plain numbers, texts and lists cannot fail
    serde_json::to_string(value).unwrap_or_default()
}

impl Named {
    /// A part that was just written.
    pub(crate) fn new(path: PathBuf, table: usize, block: usize, written: &Written) -> Self {
        Self { path, table, block, digest: written.sha256[..DIGITS].into() }
    }

    /// Reads the part and checks it against its name; the inner error says what is
    /// wrong with it.
    ///
    /// # Errors
    /// `Io` for a file that cannot be read.
    pub(crate) fn open(self) -> Result<Result<Opened, String>, write::Error> {
        let path = &self.path;
        // neither links nor devices
        let meta = path.symlink_metadata().map_err(|e| io_error("look at", path, e))?;
        if !meta.is_file() {
            return Err(write::Error::NotRegular { path: path.clone() });
        }
        let bytes = fs::read(path).map_err(|e| io_error("read", path, e))?;
        let sha256 = write::sha256(&bytes);
        if !sha256.starts_with(&self.digest) {
            let problem =
                format!("its SHA-256 begins with {}, not as its name says", &sha256[..DIGITS]);
            return Ok(Err(problem));
        }
        let bytes = Bytes::from(bytes);
        let about = match about(&bytes) {
            Ok(about) => about,
            Err(problem) => return Ok(Err(problem)),
        };
        if about.block != self.block {
            return Ok(Err(format!("it is block {}, not as its name says", about.block)));
        }
        let name = name(TABLES[self.table], self.block, &sha256);
        let written = Written { name, bytes: bytes.len() as u64, sha256 };
        let part = Part { named: self, written, summary: about.summary };
        Ok(Ok(Opened { part, identity: about.identity, bytes }))
    }
}

struct About {
    identity: Identity,
    block: usize,
    summary: Vec<Summary>,
}

/// What is stored beside a table.
fn about(bytes: &Bytes) -> Result<About, String> {
    let reader = SerializedFileReader::new(bytes.clone())
        .map_err(|e| format!("it is no Parquet file: {e}"))?;
    let stored = reader.metadata().file_metadata().key_value_metadata();
    let get = |key: &str| {
        let entry = stored.and_then(|all| all.iter().find(|entry| entry.key == key));
        let value = entry.and_then(|entry| entry.value.as_deref());
        value.ok_or_else(|| format!("it has no '{key}', so it is no part"))
    };
    let wrong = |e: serde_json::Error| format!("what it says of its study cannot be read: {e}");
    Ok(About {
        identity: serde_json::from_str(get(STUDY)?).map_err(wrong)?,
        block: serde_json::from_str(get(BLOCK)?).map_err(wrong)?,
        summary: serde_json::from_str(get(SUMMARY)?).map_err(wrong)?,
    })
}
