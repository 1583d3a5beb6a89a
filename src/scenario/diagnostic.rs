//! What can be wrong with a scenario, and where.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// One thing that is wrong (or odd) in a scenario file, with its place.
///
/// Displayed on one line: `file:line:column: key: message: remedy`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// The file, as it was named by the caller.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// The key as a dotted path (`plant.A[2][0]`); empty for the whole file.
    pub key: String,
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        one_line(f, &self.file)?;
        write!(f, ":{}:{}: ", self.line, self.column)?;
        if !self.key.is_empty() {
            one_line(f, &self.key)?;
            f.write_str(": ")?;
        }
        one_line(f, &self.message)?;
        f.write_str(": ")?;
        one_line(f, &self.remedy)
    }
}

/// Writes `text` with control characters escaped, so that a name with a line
/// feed or a terminal escape in it cannot forge a second line.
fn one_line(f: &mut fmt::Formatter<'_>, text: &str) -> fmt::Result {
    for c in text.chars() {
        if c.is_control() {
            write!(f, "{}", c.escape_default())?;
        } else {
            write!(f, "{c}")?;
        }
    }
    Ok(())
}

/// Why a scenario could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is larger than a scenario may be; it was not read.
    #[error(
        "{}: {bytes} bytes, over the limit of {limit}: pass matrices of this size through the library instead",
        path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The largest size that is read.
        limit: u64,
    },
    /// The text is not a scenario; at least one diagnostic, in file order.
    #[error("{}", lines(.0))]
    Invalid(Vec<Diagnostic>),
    /// The text is a scenario that the engine refuses.
    #[error("{at}")]
    Engine {
        /// The key that is responsible; its message is that of `source`.
        at: Box<Diagnostic>,
        /// What the engine said.
        source: crate::Error,
    },
}

impl Error {
    /// The diagnostics, if the file could be read at all.
    pub fn diagnostics(&self) -> &[Diagnostic] {
        match self {
            Error::Invalid(all) => all,
            Error::Engine { at, .. } => std::slice::from_ref(at),
            Error::Read { .. } | Error::TooLarge { .. } => &[],
        }
    }
}

fn lines(all: &[Diagnostic]) -> String {
    all.iter().map(Diagnostic::to_string).collect::<Vec<_>>().join("\n")
}
