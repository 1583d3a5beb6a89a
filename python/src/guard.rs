//! Engine work on behalf of Python: without the interpreter lock, answering
//! signals, and with panics turned into exceptions.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use mmae::par::RunControl;
use pyo3::prelude::*;

use crate::errors::internal;

/// How often signals and progress are looked at.
const BEAT: Duration = Duration::from_millis(50);
/// Stack of a thread that works while the caller waits for signals.
const STACK: usize = 16 << 20;

/// Threads of a call, and who is told how far it is.
#[derive(Default)]
pub(crate) struct Call<'py> {
    pub(crate) threads: Option<usize>,
    pub(crate) progress: Option<Bound<'py, PyAny>>,
}

/// Work that is over before anybody presses Ctrl-C: on this thread.
pub(crate) fn short<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    work: impl FnOnce(&RunControl<'_>) -> T + Send,
) -> PyResult<T> {
    let control = RunControl::default().threads(allowed(threads));
    py.detach(|| catch(|| work(&control))).map_err(|panic| internal(py, &panic))
}

/// Work of any length: on a thread of its own, while this one answers signals
/// and tells of progress. An exception from either cancels the work.
pub(crate) fn long<T: Send>(
    py: Python<'_>,
    call: &Call<'_>,
    work: impl FnOnce(&RunControl<'_>) -> T + Send,
) -> PyResult<T> {
    let threads = allowed(call.threads);
    let (cancel, done, total) = (AtomicBool::new(false), AtomicU64::new(0), AtomicU64::new(0));
    let report = |d: u64, t: u64| {
        total.store(t, Ordering::Relaxed);
        done.store(d, Ordering::Relaxed);
    };
    let progress = call.progress.clone().map(Bound::unbind);
    let tell = |py: Python<'_>, last: &mut u64| -> PyResult<()> {
        let (d, t) = (done.load(Ordering::Relaxed), total.load(Ordering::Relaxed));
        match &progress {
            Some(callback) if d != *last => {
                *last = d;
                callback.call1(py, (d, t)).map(|_| ())
            }
            _ => Ok(()),
        }
    };
    let mut last = 0;
    let mut raised: Option<PyErr> = None;
    let result = py.detach(|| {
        std::thread::scope(|scope| {
            let control = RunControl::default().threads(threads).cancel(&cancel).progress(&report);
            let (send, receive) = sync_channel(1);
            let run = move || {
                // nobody waits if the scope is gone, which cannot be
                let _ = send.send(catch(|| work(&control)));
            };
            let thread = std::thread::Builder::new().stack_size(STACK);
            if let Err(error) = thread.spawn_scoped(scope, run) {
                return Err(format!("no thread can be started: {error}"));
            }
            loop {
                match receive.recv_timeout(BEAT) {
                    Ok(result) => return result,
                    Err(RecvTimeoutError::Disconnected) => return Err("no result".into()),
                    Err(RecvTimeoutError::Timeout) if raised.is_none() => {
                        let look =
                            |py: Python<'_>| py.check_signals().and_then(|()| tell(py, &mut last));
                        if let Err(error) = Python::attach(look) {
                            cancel.store(true, Ordering::Relaxed);
                            raised = Some(error);
                        }
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        })
    });
    if let Some(error) = raised {
        return Err(error);
    }
    let result = result.map_err(|panic| internal(py, &panic))?;
    tell(py, &mut last)?;
    Ok(result)
}

/// `work`, or the message of its panic.
fn catch<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| message(payload.as_ref()))
}

fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|s| (*s).to_string());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default()
}

/// The threads a call may use: a process that was forked off after the pool of
/// threads was started has none of them, and works on its own thread.
fn allowed(threads: Option<usize>) -> usize {
    static OWNER: AtomicU32 = AtomicU32::new(0);
    let wanted = threads.unwrap_or(0);
    let me = std::process::id();
    let owner = match wanted {
        1 => me,
        _ => OWNER
            .compare_exchange(0, me, Ordering::Relaxed, Ordering::Relaxed)
            .unwrap_or_else(|o| o),
    };
    if owner == me || owner == 0 { wanted } else { 1 }
}

/// Panics, for the test that no panic leaves the module as one.
#[pyfunction]
#[pyo3(name = "_panic")]
pub(crate) fn panic(py: Python<'_>, apart: bool) -> PyResult<()> {
    let boom = |_: &RunControl<'_>| -> () { std::panic::panic_any("on purpose".to_string()) };
    match apart {
        true => long(py, &Call::default(), boom),
        false => short(py, Some(1), boom),
    }
}

/// Waits so many seconds as engine work does, for the tests of signals.
#[pyfunction]
#[pyo3(name = "_wait", signature = (seconds, progress=None))]
pub(crate) fn wait(
    py: Python<'_>,
    seconds: f64,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<()> {
    let steps = (seconds.clamp(0.0, 1e6) * 100.0) as u64;
    let call = Call { threads: Some(1), progress };
    long(py, &call, |control| {
        for k in 0..steps {
            if control.is_cancelled() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
            if let Some(report) = control.progress {
                report(k + 1, steps);
            }
        }
    })
}
