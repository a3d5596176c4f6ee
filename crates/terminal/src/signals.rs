//! Ctrl-C and SIGTERM: the first signal asks all stages to stop, the second ends the process at once.

use roadplane_pipeline::Cancel;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Registers the signal handlers and returns the stop request that they raise.
pub fn watch() -> Cancel {
    let cancel = Cancel::default();
    for signal in [SIGINT, SIGTERM] {
        // The order matters: a signal ends the process if the flag is set already.
        let registered = flag::register_conditional_shutdown(signal, 128 + signal, cancel.armed())
            .and_then(|_id| flag::register_usize(signal, cancel.flag(), signal as usize))
            .and_then(|_id| flag::register(signal, cancel.armed()));
        if let Err(error) = registered {
            tracing::warn!("signal {signal} cannot be handled and will end the run at once: {error}");
        }
    }
    cancel
}
