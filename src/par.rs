//! Work split over threads: the only home of rayon.
//!
//! Work is cut into parts whose bounds depend on the problem alone, each part
//! is computed by one thread from its own inputs, and results are returned in
//! the order of the parts. Nothing is ever summed across threads. So results
//! have the same bits for any number of threads and any schedule.

use crate::error::{Error, Result};
use rayon::prelude::*;
use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// More threads than this are never started.
const MAX_THREADS: usize = 1024;

/// How a long computation runs, and how it talks to the caller meanwhile.
///
/// # Examples
/// ```
/// use mmae::par::{RunControl, map_chunks};
/// let ctl = RunControl::default().threads(2);
/// let squares = map_chunks(&ctl, 10, 4, |items| items.map(|i| i * i).collect::<Vec<_>>())?;
/// assert_eq!(squares.concat()[9], 81);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Clone, Copy, Default)]
pub struct RunControl<'a> {
    /// Threads to use; `None` and `Some(0)` mean one per CPU.
    pub threads: Option<usize>,
    /// Set it to stop: checked between parts of work, after which the call
    /// returns [`Error::Cancelled`].
    pub cancel: Option<&'a AtomicBool>,
    /// Called after each part with the items done so far and their total, never
    /// from two threads at once, `done` always rising. Keep it short.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
}

impl<'a> RunControl<'a> {
    /// Uses `n` threads, or one per CPU if `n` is 0.
    #[must_use]
    pub fn threads(self, n: usize) -> Self {
        RunControl { threads: Some(n), ..self }
    }

    /// Stops when `flag` becomes true.
    #[must_use]
    pub fn cancel(self, flag: &'a AtomicBool) -> Self {
        RunControl { cancel: Some(flag), ..self }
    }

    /// Reports to `callback`.
    #[must_use]
    pub fn progress(self, callback: &'a (dyn Fn(u64, u64) + Sync)) -> Self {
        RunControl { progress: Some(callback), ..self }
    }

    /// True once the caller asked to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}

impl fmt::Debug for RunControl<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RunControl")
            .field("threads", &self.threads)
            .field("cancel", &self.cancel)
            .field("progress", &self.progress.is_some())
            .finish()
    }
}

/// `f` of `0..n_items` in chunks of `chunk` items (the last may be shorter), in
/// order.
///
/// Choose `chunk` from the problem, never from the number of threads: about a
/// millisecond of work keeps threads busy and cancelling prompt. Panics unless
/// `chunk > 0`; a panic in `f` is passed on.
///
/// # Errors
/// [`Error::Cancelled`] if the caller asked to stop before the last chunk began.
#[track_caller]
pub fn map_chunks<R: Send>(
    ctl: &RunControl<'_>,
    n_items: usize,
    chunk: usize,
    f: impl Fn(Range<usize>) -> R + Sync,
) -> Result<Vec<R>> {
    assert!(chunk > 0, "map_chunks: chunk must be positive");
    let starts = (0..n_items).step_by(chunk);
    let parts: Vec<_> = starts.map(|a| a..n_items.min(a + chunk)).collect();
    map_parts(ctl, parts, Range::len, |_, range| f(range))
}

/// As [`map_chunks`] for an `f` that can fail: returns the error of the first
/// chunk that has one, the same one for any number of threads.
///
/// # Errors
/// What `f` returned, or [`Error::Cancelled`].
#[track_caller]
pub fn try_map_chunks<R: Send>(
    ctl: &RunControl<'_>,
    n_items: usize,
    chunk: usize,
    f: impl Fn(Range<usize>) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    assert!(chunk > 0, "try_map_chunks: chunk must be positive");
    let starts = (0..n_items).step_by(chunk);
    let parts: Vec<_> = starts.map(|a| a..n_items.min(a + chunk)).collect();
    try_map_parts(ctl, parts, Range::len, f)
}

/// As [`map_parts`] for an `f` that can fail: returns the error of the first
/// part that has one, the same one for any number of threads.
///
/// # Errors
/// What `f` returned, or [`Error::Cancelled`].
pub fn try_map_parts<P: Send, R: Send>(
    ctl: &RunControl<'_>,
    parts: Vec<P>,
    size: impl Fn(&P) -> usize,
    f: impl Fn(P) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    // Parts after a failed one are skipped, parts before it never: the first
    // error in order is always found.
    let failed = AtomicUsize::new(usize::MAX);
    let out = map_parts(ctl, parts, size, |index, part| {
        if failed.load(Ordering::Relaxed) < index {
            return Err(Error::Cancelled);
        }
        f(part).inspect_err(|_| {
            failed.fetch_min(index, Ordering::Relaxed);
        })
    })?;
    out.into_iter().collect()
}

/// `f(start, chunk)` for consecutive chunks of `chunk` elements of `data` (the
/// last may be shorter), `start` the index of the first element.
///
/// Panics unless `chunk > 0`; a panic in `f` is passed on.
///
/// # Errors
/// [`Error::Cancelled`]: `data` is then partly written.
#[track_caller]
pub fn for_chunks_mut<D: Send>(
    ctl: &RunControl<'_>,
    data: &mut [D],
    chunk: usize,
    f: impl Fn(usize, &mut [D]) + Sync,
) -> Result<()> {
    assert!(chunk > 0, "for_chunks_mut: chunk must be positive");
    let parts: Vec<_> = data.chunks_mut(chunk).collect();
    map_parts(ctl, parts, |part| part.len(), |i, part| f(i * chunk, part))?;
    Ok(())
}

/// `f(index, part)` for every part, results in the order of the parts.
///
/// Parts are whatever can be sent: ranges, disjoint `&mut` slices of several
/// outputs zipped together. `size` of a part counts towards progress. A panic
/// in `f` is passed on.
///
/// # Errors
/// [`Error::Cancelled`] if the caller asked to stop before the last part began.
pub fn map_parts<P: Send, R: Send>(
    ctl: &RunControl<'_>,
    parts: Vec<P>,
    size: impl Fn(&P) -> usize,
    f: impl Fn(usize, P) -> R + Sync,
) -> Result<Vec<R>> {
    let sized: Vec<(usize, P)> = parts.into_iter().map(|p| (size(&p), p)).collect();
    let total: usize = sized.iter().map(|(n, _)| n).sum();
    let done = Mutex::new(0_usize);
    let one = |(index, (n, part)): (usize, (usize, P))| -> Option<R> {
        if ctl.is_cancelled() {
            return None;
        }
        let result = f(index, part);
        if let Some(progress) = ctl.progress {
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += n;
            progress(*done as u64, total as u64);
        }
        Some(result)
    };
    let all = match Pool::get(ctl.threads, sized.len()) {
        Pool::Caller => sized.into_iter().enumerate().map(one).collect(),
        Pool::Global => run(sized, &one),
        Pool::Own(pool) => pool.install(|| run(sized, &one)),
    };
    let all: Option<Vec<R>> = all;
    all.ok_or(Error::Cancelled)
}

/// Every part on the current pool, one at a time per thread.
fn run<P: Send, R: Send>(
    parts: Vec<(usize, P)>,
    one: &(impl Fn((usize, (usize, P))) -> Option<R> + Sync),
) -> Option<Vec<R>> {
    let parts = parts.into_par_iter().enumerate().with_max_len(1);
    parts.map(one).collect()
}

/// Where the parts run.
enum Pool {
    /// On the calling thread.
    Caller,
    /// On rayon's pool of one thread per CPU.
    Global,
    /// On a pool of the size asked for.
    Own(Arc<rayon::ThreadPool>),
}

impl Pool {
    /// The pool for `threads`, kept for the next call: starting one takes longer
    /// than many a batch. If threads cannot be had the caller does the work.
    fn get(threads: Option<usize>, n_parts: usize) -> Pool {
        static POOLS: Mutex<Vec<Arc<rayon::ThreadPool>>> = Mutex::new(Vec::new());
        let threads = threads.unwrap_or(0).min(MAX_THREADS);
        if threads == 1 || n_parts <= 1 {
            return Pool::Caller;
        }
        if threads == 0 {
            return Pool::Global;
        }
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pool) = pools.iter().find(|p| p.current_num_threads() == threads) {
            return Pool::Own(Arc::clone(pool));
        }
        match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => {
                let pool = Arc::new(pool);
                pools.push(Arc::clone(&pool));
                Pool::Own(pool)
            }
            Err(_) => Pool::Caller,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[test]
    fn order_does_not_depend_on_threads() {
        let run = |threads| {
            let ctl = RunControl::default().threads(threads);
            map_chunks(&ctl, 1003, 7, |r| r.map(|i| (i as f64).sqrt()).sum::<f64>()).unwrap()
        };
        let one = run(1);
        assert_eq!(one.len(), 144);
        for threads in [0, 2, 3, 8] {
            assert_eq!(run(threads), one);
        }
    }

    #[test]
    fn disjoint_slices_are_written() {
        let mut data = vec![0_usize; 101];
        let ctl = RunControl::default().threads(2);
        for_chunks_mut(&ctl, &mut data, 8, |start, part| {
            for (i, x) in part.iter_mut().enumerate() {
                *x = start + i;
            }
        })
        .unwrap();
        assert!(data.iter().enumerate().all(|(i, &x)| i == x));
        assert!(map_chunks(&ctl, 0, 8, |_| ()).unwrap().is_empty());
    }

    #[test]
    fn progress_rises_to_the_total() {
        for threads in [1, 2] {
            let seen = Mutex::new(Vec::new());
            let report = |done: u64, total: u64| seen.lock().unwrap().push((done, total));
            let ctl = RunControl::default().threads(threads).progress(&report);
            map_chunks(&ctl, 100, 9, |_| ()).unwrap();
            let seen = seen.into_inner().unwrap();
            assert_eq!(seen.len(), 12);
            assert!(seen.windows(2).all(|w| w[0].0 < w[1].0));
            assert_eq!(seen.last(), Some(&(100, 100)));
        }
    }

    #[test]
    fn cancelling_is_prompt() {
        for threads in [1, 2] {
            let flag = AtomicBool::new(false);
            let ctl = RunControl::default().threads(threads).cancel(&flag);
            let start = Instant::now();
            let result = map_chunks(&ctl, 100_000, 1, |r| {
                if r.start == 3 {
                    flag.store(true, Ordering::Relaxed);
                }
                std::thread::sleep(Duration::from_millis(1));
            });
            assert_eq!(result, Err(Error::Cancelled));
            assert!(start.elapsed() < Duration::from_secs(5));
        }
    }

    #[test]
    fn the_first_error_in_order_is_returned() {
        for threads in [1, 2, 4] {
            let ctl = RunControl::default().threads(threads);
            let result: Result<Vec<()>> = try_map_chunks(&ctl, 500, 1, |r| match r.start {
                i if i >= 40 => Err(Error::InvalidDt { dt: i as f64 }),
                _ => Ok(()),
            });
            assert_eq!(result, Err(Error::InvalidDt { dt: 40.0 }));
        }
    }

    #[test]
    fn a_panic_is_passed_on() {
        for threads in [1, 2] {
            let ctl = RunControl::default().threads(threads);
            let work = || map_chunks(&ctl, 10, 1, |r| assert!(r.start != 5, "five"));
            assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).is_err());
        }
    }
}
