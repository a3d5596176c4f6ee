//! Ctrl-C and SIGTERM: the first asks all stages to stop in order, the second ends the process at once.

use roadplane_pipeline::Cancel;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Registers the handlers and returns the stop request that they raise.
pub fn watch() -> Cancel {
    let cancel = Cancel::default();
    for signal in [SIGINT, SIGTERM] {
        // Order matters: a signal that arrives when the flag is already set ends the process.
        let registered = flag::register_conditional_shutdown(signal, 128 + signal, cancel.armed())
            .and_then(|_id| flag::register_usize(signal, cancel.flag(), signal as usize))
            .and_then(|_id| flag::register(signal, cancel.armed()));
        if let Err(error) = registered {
            tracing::warn!("signal {signal} cannot be handled, it will end the run at once: {error}");
        }
    }
    cancel
}
