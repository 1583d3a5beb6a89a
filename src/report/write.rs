//! Result directories: every file whole or absent, never half-written.
//!
//! Files are written under temporary names in the directory itself, flushed to
//! the disk, then renamed; `manifest.json` comes last, so a directory without
//! one is not a complete result.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

use crate::report::lock::Lock;

/// The file that completes a directory.
pub const MANIFEST: &str = "manifest.json";
/// The result for people, in one file.
pub const REPORT: &str = "report.html";
/// Temporary names start so, and end in `.tmp`.
const TEMPORARY: &str = ".mmae-";

/// Why a result directory could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The name cannot be a directory anyone wants.
    #[error("{path:?} is no name for a directory: leave out control characters")]
    Name {
        /// The directory asked for.
        path: PathBuf,
    },
    /// The target is there, and not a directory.
    #[error("{} is not a directory: choose another name", path.display())]
    NotDirectory {
        /// The directory asked for.
        path: PathBuf,
    },
    /// A result would be replaced.
    #[error("{} exists: choose another place, or pass --force to replace it", path.display())]
    Exists {
        /// The file in the way.
        path: PathBuf,
    },
    /// A link or a special file stands where a result belongs.
    #[error("{} is not a regular file and will not be followed or replaced: remove it", path.display())]
    NotRegular {
        /// The file in the way.
        path: PathBuf,
    },
    /// Another process writes there.
    #[error(
        "{} is locked by {}: wait until it ends, or choose another directory",
        dir.display(),
        pid.map_or("another process".into(), |pid| format!("process {pid}"))
    )]
    Locked {
        /// The directory.
        dir: PathBuf,
        /// The process, if it said so.
        pid: Option<u32>,
    },
    /// The operating system refused.
    #[error("cannot {action} {}: {source}: check the path, its permissions and the free space", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// With which file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
}

pub(crate) fn io_error(action: &'static str, path: &Path, source: io::Error) -> Error {
    Error::Io { action, path: path.into(), source }
}

/// A file that was written, as the manifest lists it.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Written {
    /// Name inside the directory.
    pub name: String,
    /// Its length.
    pub bytes: u64,
    /// SHA-256 of its contents, in hexadecimal.
    pub sha256: String,
}

/// A result directory that is being written.
///
/// Dropped before [`Output::commit`] it leaves nothing behind: temporary files
/// go, and so do directories that [`Output::open`] made.
#[derive(Debug)]
pub struct Output {
    dir: PathBuf,
    force: bool,
    /// Removed on drop, innermost first.
    made: Vec<PathBuf>,
    pending: Vec<(Written, NamedTempFile)>,
    /// Released (and its file removed) before `made` is.
    lock: Option<Lock>,
}

impl Output {
    /// Makes and locks `dir`, and checks that none of the files `names` is in
    /// the way.
    ///
    /// # Errors
    /// `Name`, `NotDirectory`, `Locked`, `Exists` (unless `force`),
    /// `NotRegular`, `Io`.
    pub fn open(dir: &Path, names: &[&str], force: bool) -> Result<Self, Error> {
        let text = dir.as_os_str().to_string_lossy();
        if text.is_empty() || text.chars().any(char::is_control) {
            return Err(Error::Name { path: dir.into() });
        }
        let made = make(dir)?;
        let mut output = Self { dir: dir.into(), force, made, pending: Vec::new(), lock: None };
        output.lock = Some(Lock::acquire(dir)?);
        for name in names {
            check_free(&dir.join(name), force)?;
        }
        sweep(dir);
        Ok(output)
    }

    /// The directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Writes file `name` under a temporary name and flushes it to the disk.
    ///
    /// # Errors
    /// `Io`, from `fill` or from the file.
    pub fn add(
        &mut self,
        name: &str,
        fill: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
    ) -> Result<(), Error> {
        let path = self.dir.join(name);
        let failed = |e| io_error("write", &path, e);
        let file = temporary(&self.dir).map_err(failed)?;
        let mut sink = Hashing { out: BufWriter::new(file), hash: Sha256::new(), bytes: 0 };
        fill(&mut sink).map_err(failed)?;
        sink.flush().map_err(failed)?;
        let Hashing { out, hash, bytes } = sink;
        let file = out.into_inner().map_err(|e| failed(e.into_error()))?;
        file.as_file().sync_all().map_err(failed)?;
        let sha256 = hex(hash.finalize().as_slice());
        self.pending.push((Written { name: name.into(), bytes, sha256 }, file));
        Ok(())
    }

    /// What was added so far, in order.
    pub fn written(&self) -> Vec<Written> {
        self.pending.iter().map(|(written, _)| written.clone()).collect()
    }

    /// Renames everything into place, in the order of [`Output::add`], and
    /// flushes the directory. Afterwards the result is complete.
    ///
    /// # Errors
    /// `Exists` if a file appeared in the meantime, `NotRegular`, `Io`.
    pub fn commit(mut self) -> Result<(), Error> {
        for (written, _) in &self.pending {
            check_free(&self.dir.join(&written.name), self.force)?;
        }
        if self.force {
            // from here until the new manifest the directory is not complete
            let manifest = self.dir.join(MANIFEST);
            match fs::remove_file(&manifest) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => {
                    return Err(io_error("replace", &manifest, e));
                }
                _ => {}
            }
        }
        let mut placed = Vec::new();
        for (written, file) in std::mem::take(&mut self.pending) {
            let path = self.dir.join(&written.name);
            if let Err(e) = place(file, &path, self.force) {
                if !self.force {
                    // nothing of this run may stay alone
                    for path in placed {
                        let _ = fs::remove_file(path);
                    }
                }
                return Err(e);
            }
            placed.push(path);
        }
        sync_dir(&self.dir)?;
        self.made.clear();
        Ok(())
    }
}

/// Removes temporary files that a killed process left in `dir`; a lock says that
/// nobody is using them.
pub(crate) fn sweep(dir: &Path) {
    for entry in fs::read_dir(dir).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(TEMPORARY) && name.ends_with(".tmp") {
            let _ = fs::remove_file(entry.path());
        }
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        self.pending.clear();
        self.lock = None;
        for dir in self.made.iter().rev() {
            // fails, as it should, when somebody else put something there
            let _ = fs::remove_dir(dir);
        }
    }
}

/// Fails if `path` exists and may not be replaced.
fn check_free(path: &Path, force: bool) -> Result<(), Error> {
    match path.symlink_metadata() {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(io_error("look at", path, e)),
        Ok(meta) if !meta.is_file() => Err(Error::NotRegular { path: path.into() }),
        Ok(_) if force => Ok(()),
        Ok(_) => Err(Error::Exists { path: path.into() }),
    }
}

/// A temporary file in `dir`, which disappears unless it is placed.
fn temporary(dir: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY).suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // results are for sharing: the umask decides, as for any file
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(dir)
}

/// Renames a temporary file; without `force` never over another file.
fn place(file: NamedTempFile, path: &Path, force: bool) -> Result<(), Error> {
    let moved = if force { file.persist(path) } else { file.persist_noclobber(path) };
    match moved {
        Ok(_) => Ok(()),
        Err(e) if e.error.kind() == io::ErrorKind::AlreadyExists => {
            Err(Error::Exists { path: path.into() })
        }
        Err(e) => Err(io_error("write", path, e.error)),
    }
}

/// Writes one file, whole or not at all, outside a result directory.
///
/// # Errors
/// `Name`, `Exists` (unless `force`), `NotRegular`, `Io`.
pub fn file(path: &Path, content: &[u8], force: bool) -> Result<(), Error> {
    let text = path.as_os_str().to_string_lossy();
    if text.is_empty() || text.chars().any(char::is_control) {
        return Err(Error::Name { path: path.into() });
    }
    check_free(path, force)?;
    let dir = match path.parent() {
        Some(dir) if !dir.as_os_str().is_empty() => dir,
        _ => Path::new("."),
    };
    let failed = |e| io_error("write", path, e);
    let mut file = temporary(dir).map_err(failed)?;
    file.write_all(content).map_err(failed)?;
    file.as_file().sync_all().map_err(failed)?;
    place(file, path, force)?;
    sync_dir(dir)
}

/// Makes `dir` and its parents; returns those that were missing, outermost first.
fn make(dir: &Path) -> Result<Vec<PathBuf>, Error> {
    let missing: Vec<PathBuf> = dir
        .ancestors()
        .take_while(|d| !d.as_os_str().is_empty() && d.symlink_metadata().is_err())
        .map(Path::to_path_buf)
        .collect();
    if missing.is_empty() {
        return match dir.metadata() {
            Ok(meta) if meta.is_dir() => Ok(missing),
            Ok(_) => Err(Error::NotDirectory { path: dir.into() }),
            Err(e) => Err(io_error("open", dir, e)),
        };
    }
    let mut made = Vec::new();
    for d in missing.iter().rev() {
        match fs::create_dir(d) {
            Ok(()) => made.push(d.clone()),
            // another process was quicker, or the path goes through `..`
            Err(_) if d.is_dir() => {}
            Err(e) => {
                for d in made.iter().rev() {
                    let _ = fs::remove_dir(d);
                }
                return Err(io_error("create", d, e));
            }
        }
    }
    Ok(made)
}

/// Makes the renames durable.
fn sync_dir(dir: &Path) -> Result<(), Error> {
    #[cfg(unix)]
    match fs::File::open(dir).and_then(|d| d.sync_all()) {
        // some file systems cannot flush a directory: nothing more to do there
        Err(e) if !matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => {
            return Err(io_error("flush", dir, e));
        }
        _ => {}
    }
    #[cfg(not(unix))]
    let _ = dir;
    Ok(())
}

/// Counts and hashes what passes.
struct Hashing<W> {
    out: W,
    hash: Sha256,
    bytes: u64,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.out.write(bytes)?;
        self.hash.update(&bytes[..n]);
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// SHA-256 of `bytes`, in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    hex(Sha256::digest(bytes).as_slice())
}

fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::new(), |mut text, byte| {
        // writing to a String cannot fail
        let _ = write!(text, "{byte:02x}");
        text
    })
}
