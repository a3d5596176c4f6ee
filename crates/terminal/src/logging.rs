//! The log on stderr: lines per clip at level INFO, per stage at DEBUG, and per frame at TRACE.

use std::io::{IsTerminal as _, stderr};

use tracing_subscriber::{EnvFilter, fmt, prelude::*};

use crate::LogFormat;

/// Starts the log. The environment variable `ROADPLANE_LOG` (syntax of [`EnvFilter`]) overrides `verbose`.
pub fn start(format: LogFormat, verbose: u8) {
    let level = match verbose {
        0 => "info",
        1 => "debug",
        _ => "trace",
    };
    // The text format omits the ids of runs and inputs (target `roadplane_ids`).
    let ids = if format == LogFormat::Json { "" } else { ",roadplane_ids=off" };
    let filter = EnvFilter::try_from_env("ROADPLANE_LOG")
        .unwrap_or_else(|_unset| EnvFilter::new(format!("warn,roadplane={level}{ids}")));
    let registry = tracing_subscriber::registry().with(filter);
    match format {
        LogFormat::Json => {
            registry.with(fmt::layer().json().with_current_span(false).with_writer(stderr)).init()
        }
        LogFormat::Text => {
            let colour = stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
            registry.with(fmt::layer().with_target(false).with_ansi(colour).with_writer(stderr)).init();
        }
    }
}
