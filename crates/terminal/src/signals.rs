//! Ctrl-C and SIGTERM: the first signal asks all stages to stop, the second ends the process at once.

use roadplane_pipeline::Cancel;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Registers the signal handlers. Returns the flag by which a signal asks the program to stop.
pub fn watch() -> Cancel {
    let cancel = Cancel::default();
    for signal in [SIGINT, SIGTERM] {
        // The order matters: the handler that ends the process must see whether an earlier signal has set the flag.
        let registered = flag::register_conditional_shutdown(signal, 128 + signal, cancel.armed())
            .and_then(|_id| flag::register_usize(signal, cancel.flag(), signal as usize))
            .and_then(|_id| flag::register(signal, cancel.armed()));
        if let Err(error) = registered {
            tracing::warn!("signal {signal} cannot be handled and will end the run at once: {error}");
        }
    }
    cancel
}
