//! A stop request that reaches every stage.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A stop request that the signal handler and all stages share. It is cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Cancel {
    // 0 while the run continues, otherwise the number of the signal.
    signal: Arc<AtomicUsize>,
    // Set by the first signal; the next one ends the process.
    armed: Arc<AtomicBool>,
}

impl Cancel {
    /// Asks all stages to stop, as a signal with this number (2 or 15) does.
    pub fn stop(&self, signal: usize) {
        self.signal.store(signal, Ordering::SeqCst);
    }

    /// Returns the number of the signal; `None` if no stop is requested.
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

    /// Returns the value in which a signal handler stores the number of the signal.
    #[must_use]
    pub fn flag(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.signal)
    }

    /// Returns the flag that a signal handler sets at the first signal and reads at the second.
    #[must_use]
    pub fn armed(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.armed)
    }
}
