//! A progress bar for runs that take longer than a second.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shorter runs show nothing.
const PATIENCE: Duration = Duration::from_secs(1);

/// Bar with rate and remaining time on the standard error, if that is a
/// terminal; otherwise nothing at all.
pub(super) struct Progress {
    started: Instant,
    terminal: bool,
    bar: Mutex<Option<ProgressBar>>,
}

impl Progress {
    pub(super) fn new() -> Self {
        Self {
            started: Instant::now(),
            terminal: std::io::stderr().is_terminal(),
            bar: Mutex::new(None),
        }
    }

    /// Shows that `done` of `total` parts are done.
    pub(super) fn update(&self, done: u64, total: u64) {
        if !self.terminal || self.started.elapsed() < PATIENCE {
            return;
        }
        // a poisoned lock only means that a bar is not drawn
        let Ok(mut slot) = self.bar.lock() else { return };
        let bar = slot.get_or_insert_with(|| {
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr())
                .with_style(style())
                .with_elapsed(self.started.elapsed());
            bar.set_position(done);
            bar
        });
        if done < bar.position() {
            bar.reset(); // the next stage of the run
        }
        bar.set_length(total);
        bar.set_position(done);
    }

    /// Removes the bar.
    pub(super) fn finish(&self) {
        if let Ok(mut slot) = self.bar.lock()
            && let Some(bar) = slot.take()
        {
            bar.finish_and_clear();
        }
    }
}

fn style() -> ProgressStyle {
    let template = "{percent:>3} % [{bar:36}] {per_sec}, {eta} left";
    ProgressStyle::with_template(template)
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("=> ")
}
