//! The request to stop a run, which all stages read.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A stop request that the signal handler and all stages share. Clones share the same request, and cloning is cheap.
#[derive(Clone, Debug, Default)]
pub struct Cancel {
    // 0 while the run continues, otherwise the number of the signal.
    signal: Arc<AtomicUsize>,
    // Whether a first signal has arrived. The next signal then ends the process.
    armed: Arc<AtomicBool>,
}

impl Cancel {
    /// Asks all stages to stop. `signal` is the number of the signal: 2 (Ctrl-C) or 15 (SIGTERM).
    pub fn stop(&self, signal: usize) {
        self.signal.store(signal, Ordering::SeqCst);
    }

    /// Returns the number of the signal that requested the stop; `None` if no stop is requested.
    #[must_use]
    pub fn signal(&self) -> Option<usize> {
        match self.signal.load(Ordering::SeqCst) {
            0 => None,
            signal => Some(signal),
        }
    }

    /// Whether a stop is requested.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.signal().is_some()
    }

    /// Returns the shared variable in which a signal handler stores the number of the signal.
    #[must_use]
    pub fn flag(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.signal)
    }

    /// Returns the shared flag that a signal handler sets at the first signal. If the flag is set, the next signal ends
    /// the process.
    #[must_use]
    pub fn armed(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.armed)
    }
}
