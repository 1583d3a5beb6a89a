//! The standard output, and writers that stop at a signal.

use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

use super::failure::Failure;
use super::signals::Signals;

/// The text of a scenario that was read already, for a report.
pub(super) fn scenario(file: &Path) -> String {
    // a file that went away meanwhile shows nothing; the manifest fails then
    String::from_utf8_lossy(&std::fs::read(file).unwrap_or_default()).into_owned()
}

/// Writes to the standard output; a reader that went away (`| head -1`) is no
/// failure.
pub(super) fn print(
    signals: Option<&Signals>,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Failure> {
    let mut out = Watch { out: BufWriter::new(io::stdout().lock()), signals };
    let done = fill(&mut out).and_then(|()| out.flush());
    match done {
        Ok(()) => Ok(()),
        Err(_) if signals.is_some_and(Signals::raised) => Err(Failure::Cancelled),
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(e) => Err(Failure::Output(e)),
    }
}

/// Fails once a signal came, so that a long file ends early.
pub(super) struct Watch<'a, W> {
    pub(super) out: W,
    pub(super) signals: Option<&'a Signals>,
}

impl<W: Write> Write for Watch<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.signals.is_some_and(Signals::raised) {
            // not `Interrupted`, which writers take for "try again"
            return Err(io::Error::other("stopped by a signal"));
        }
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
