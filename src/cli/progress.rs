//! A progress bar for runs that take longer than a second.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::failure::say;
use crate::report::significant;

/// Between two lines of a run that reports in lines.
const MINUTE: Duration = Duration::from_secs(60);
/// Shorter runs show nothing.
const PATIENCE: Duration = Duration::from_secs(1);

/// Bar with rate and remaining time on the standard error, if that is a
/// terminal; otherwise nothing at all, or a line a minute.
pub(super) struct Progress {
    started: Instant,
    terminal: bool,
    what: &'static str,
    bar: Mutex<Option<ProgressBar>>,
    /// When the last line was written, where there are lines.
    line: Option<Mutex<Instant>>,
}

impl Progress {
    pub(super) fn new() -> Self {
        Self::of("plants")
    }

    /// Of a run over the items called `what`.
    pub(super) fn of(what: &'static str) -> Self {
        Self {
            started: Instant::now(),
            terminal: std::io::stderr().is_terminal(),
            what,
            bar: Mutex::new(None),
            line: None,
        }
    }

    /// Of a run over the items called `what` that may take hours: a line a
    /// minute where there is no terminal.
    pub(super) fn in_lines(what: &'static str) -> Self {
        let this = Self::of(what);
        Self { line: Some(Mutex::new(this.started)), ..this }
    }

    /// Shows that `done` of `total` items are done.
    pub(super) fn update(&self, done: u64, total: u64) {
        let elapsed = self.started.elapsed();
        if let Some(Ok(mut last)) = self.line.as_ref().map(|line| line.lock())
            && !self.terminal
            && last.elapsed() >= MINUTE
        {
            *last = Instant::now();
            let percent = 100 * done / total.max(1);
            say("note", &format!("{percent} %, {}", pace(self.what, done, total, elapsed)));
        }
        if !self.terminal || elapsed < PATIENCE {
            return;
        }
        // a poisoned lock only means that a bar is not drawn
        let Ok(mut slot) = self.bar.lock() else { return };
        let bar = slot.get_or_insert_with(|| {
            ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr())
                .with_style(style())
        });
        bar.set_message(pace(self.what, done, total, elapsed));
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

/// Rate and remaining time, both from the mean since the start: chunks of work
/// are alike, and a mean does not flicker.
fn pace(what: &str, done: u64, total: u64, elapsed: Duration) -> String {
    let rate = done as f64 / elapsed.as_secs_f64().max(1e-9);
    if rate <= 0.0 {
        return String::new();
    }
    let left = (total.saturating_sub(done) as f64 / rate).ceil();
    let left = match left {
        s if s < 100.0 => format!("{s} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    };
    format!("{} {what}/s, {left} left", significant(rate, 3))
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{percent:>3} % [{bar:32}] {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("=> ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pace_is_the_mean_since_the_start() {
        let two = Duration::from_secs(2);
        assert_eq!(pace("plants", 0, 1000, two), "");
        assert_eq!(pace("plants", 500, 1000, two), "250 plants/s, 2 s left");
        assert_eq!(pace("plants", 1000, 1000, two), "500 plants/s, 0 s left");
        assert_eq!(pace("plants", 2, 2000, two), "1 plants/s, 33 min left");
        assert_eq!(pace("plants", 2, 20_002, two), "1 plants/s, 5.6 h left");
    }
}
