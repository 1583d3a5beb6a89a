//! Why a part could not be computed or joined.

use std::path::PathBuf;

use crate::report::write;

/// Why a shard or a merge did not come to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The study, or a limit.
    #[error(transparent)]
    Engine(#[from] crate::Error),
    /// A file or directory.
    #[error(transparent)]
    Files(#[from] write::Error),
    /// A shard that there is not.
    #[error("'{text}' is no shard: write i/n with 1 <= i <= n, as in 2/7")]
    Shard {
        /// What was asked for.
        text: String,
    },
    /// A result stands where parts belong.
    #[error("{} is there already: --resume continues, --force starts anew", path.display())]
    Present {
        /// The file.
        path: PathBuf,
    },
    /// A part of another study.
    #[error("{} is of another study: {difference}; give parts of one study, or choose another directory", path.display())]
    Foreign {
        /// The part.
        path: PathBuf,
        /// In what it differs.
        difference: String,
    },
    /// Parts are missing: one message a cause.
    #[error("{}", problems.join("\n"))]
    Incomplete {
        /// What is missing or damaged, and the remedy.
        problems: Vec<String>,
    },
    /// The caller asked to stop.
    #[error("stopped: {done} of {of} blocks are there, --resume continues")]
    Stopped {
        /// Blocks of the shard that are complete.
        done: usize,
        /// Blocks of the shard.
        of: usize,
    },
}
