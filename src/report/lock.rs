//! One writer a directory: an advisory lock that dies with its process.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use crate::report::write::{Error, io_error};

/// Name of the lock file inside the directory.
pub const NAME: &str = ".mmae.lock";

/// Holds a directory until dropped.
///
/// The operating system releases the lock of a dead process, so a lock file
/// left by a crash is taken over; the process number inside serves messages
/// only.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    /// Open as long as the lock is held.
    _file: File,
}

impl Lock {
    /// Locks `dir`, which must exist.
    ///
    /// # Errors
    /// `Locked` if a live process holds it, `Symlink` or `Io` for a lock file
    /// that cannot be made.
    pub fn acquire(dir: &Path) -> Result<Self, Error> {
        let path = dir.join(NAME);
        // the holder removes the file when done: then the one just opened is no
        // longer the one in the directory, and the next round makes a new one
        for _ in 0..100 {
            let mut file = open(&path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::Locked { dir: dir.into(), pid: holder(&mut file) });
                }
                // a file system without locks: go on unprotected
                Err(TryLockError::Error(e)) if e.kind() == io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(e)) => return Err(io_error("lock", &path, e)),
            }
            if !same_file(&file, &path) {
                continue;
            }
            let written = file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id()));
            if let Err(e) = written {
                // do not leave an empty lock file behind
                let _ = std::fs::remove_file(&path);
                return Err(io_error("write", &path, e));
            }
            return Ok(Self { path, _file: file });
        }
        Err(Error::Locked { dir: dir.into(), pid: None })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // before the lock itself goes, so that nobody holds a removed file
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Opens the lock file without following a link.
fn open(path: &Path) -> Result<File, Error> {
    let mut options = OpenOptions::new();
    options.read(true).write(true);
    // `create_new` never follows a link
    match options.clone().create_new(true).open(path) {
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
        other => return other.map_err(|e| io_error("create", path, e)),
    }
    match path.symlink_metadata() {
        Ok(meta) if meta.is_file() => {}
        Ok(_) => return Err(Error::NotRegular { path: path.into() }),
        // removed in between: make it again
        Err(_) => {
            return options.create_new(true).open(path).map_err(|e| io_error("create", path, e));
        }
    }
    match options.open(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            options.create_new(true).open(path).map_err(|e| io_error("create", path, e))
        }
        other => other.map_err(|e| io_error("open", path, e)),
    }
}

/// The process number in a lock file that somebody else holds.
fn holder(file: &mut File) -> Option<u32> {
    let mut text = String::new();
    file.take(32).read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// Whether `path` still names the open `file`, itself and not through a link.
#[cfg(unix)]
fn same_file(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), path.symlink_metadata()) {
        (Ok(a), Ok(b)) => a.dev() == b.dev() && a.ino() == b.ino(),
        _ => false,
    }
}

/// An open file cannot be removed here.
#[cfg(not(unix))]
fn same_file(_file: &File, path: &Path) -> bool {
    path.exists()
}
