//! A stop request that reaches every stage.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Shared between the signal handler, the stages and their channels. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Cancel {
    // 0 while running, otherwise the number of the signal.
    signal: Arc<AtomicUsize>,
    // Set by the first signal: the next one ends the process.
    armed: Arc<AtomicBool>,
}

impl Cancel {
    /// Asks all stages to stop as if a signal with this number (2 or 15) had come.
    pub fn stop(&self, signal: usize) {
        self.signal.store(signal, Ordering::SeqCst);
    }

    /// The signal's number, once a stop was asked for.
    #[must_use]
    pub fn signal(&self) -> Option<usize> {
        match self.signal.load(Ordering::SeqCst) {
            0 => None,
            signal => Some(signal),
        }
    }

    /// Whether a stop was asked for.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.signal().is_some()
    }

    /// Where a signal handler stores the signal's number.
    #[must_use]
    pub fn flag(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.signal)
    }

    /// What a signal handler sets at the first signal and asks at the second.
    #[must_use]
    pub fn armed(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.armed)
    }
}
