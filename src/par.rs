//! Threads. (Replaced soon.)

/// How a run is controlled from outside.
#[derive(Default)]
pub struct RunControl<'a> {
    /// Threads; `None` for all.
    pub threads: Option<usize>,
    /// Set to stop.
    pub cancel: Option<&'a std::sync::atomic::AtomicBool>,
    /// Called with the work done and the total.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
}
