//! SIGINT and SIGTERM set a flag; a second one ends the process at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit code after SIGINT.
const INTERRUPTED: u8 = 130;
/// Exit code after SIGTERM.
const TERMINATED: u8 = 143;

/// The flags that the handlers set.
#[derive(Debug)]
pub(super) struct Signals {
    cancel: Arc<AtomicBool>,
    number: Arc<AtomicUsize>,
}

impl Signals {
    /// Installs the handlers; where that fails the system's own stay.
    pub(super) fn install() -> Self {
        let signals = Self {
            cancel: Arc::new(AtomicBool::new(false)),
            number: Arc::new(AtomicUsize::new(0)),
        };
        for (signal, code) in [(SIGINT, INTERRUPTED), (SIGTERM, TERMINATED)] {
            // first, so that it sees the flag of an earlier signal only
            let _ = flag::register_conditional_shutdown(
                signal,
                code.into(),
                Arc::clone(&signals.cancel),
            );
            let _ = flag::register_usize(signal, Arc::clone(&signals.number), code.into());
            let _ = flag::register(signal, Arc::clone(&signals.cancel));
        }
        // without a handler a file over the size limit would kill the process;
        // with one the write fails, and is reported and cleaned up
        #[cfg(unix)]
        let _ = flag::register(signal_hook::consts::SIGXFSZ, Arc::new(AtomicBool::new(false)));
        signals
    }

    /// Set once a signal came.
    pub(super) fn cancel(&self) -> &AtomicBool {
        &self.cancel
    }

    /// Whether a signal came.
    pub(super) fn raised(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// The exit code of the signal that came.
    pub(super) fn code(&self) -> u8 {
        u8::try_from(self.number.load(Ordering::Relaxed))
            .ok()
            .filter(|c| *c > 0)
            .unwrap_or(INTERRUPTED)
    }
}
