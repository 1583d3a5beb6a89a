//! Buffers that wait for the next call: it may be of a few plants, and would take as long to
//! have them made. What they held before leaves no trace in it.

use std::any::Any;
use std::sync::{Mutex, PoisonError};

/// Buffers of whatever types the calls use, one a thread at most.
#[derive(Default)]
pub(crate) struct Spare(Mutex<Vec<Box<dyn Any + Send>>>);

impl Spare {
    /// A buffer of type `S` that `fits`, or a new one.
    pub(crate) fn take<S: Any>(
        &self,
        fits: impl Fn(&S) -> bool,
        make: impl FnOnce() -> S,
    ) -> Box<S> {
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = waiting.iter().rposition(|buffer| buffer.downcast_ref().is_some_and(&fits));
        let found = found.and_then(|k| waiting.swap_remove(k).downcast().ok());
        drop(waiting);
        found.unwrap_or_else(|| Box::new(make()))
    }

    /// Leaves a buffer for the next call.
    pub(crate) fn put<S: Any + Send>(&self, buffer: Box<S>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_comes_back_where_it_fits() {
        let spare = Spare::default();
        spare.put(Box::new(vec![0.0; 3]));
        spare.put(Box::new(7_u8));
        assert_eq!(spare.take(|v: &Vec<f64>| v.len() == 2, || vec![1.0; 2]).len(), 2);
        assert_eq!(*spare.take(|v: &Vec<f64>| v.len() == 3, Vec::new), [0.0; 3]);
        assert_eq!(*spare.take(|v: &Vec<f64>| v.len() == 3, Vec::new), [0.0; 0]);
        assert_eq!(*spare.take(|_: &u8| true, || 8), 7);
    }
}
