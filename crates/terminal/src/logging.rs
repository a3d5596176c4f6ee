//! The log on stderr: lines per clip at level INFO, per stage at DEBUG, and per frame at TRACE.

use std::io::{IsTerminal as _, Write, stderr};

use tracing_subscriber::{EnvFilter, fmt, prelude::*};

use crate::LogFormat;
use crate::progress::between_bars;

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
            registry.with(fmt::layer().json().with_current_span(false).with_writer(Lines::default)).init()
        }
        LogFormat::Text => {
            let colour = stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
            registry
                .with(fmt::layer().with_target(false).with_ansi(colour).with_writer(Lines::default))
                .init();
        }
    }
}

/// Writer of one log line. It writes the line to stderr as a whole, while no progress bar is on the terminal.
#[derive(Default)]
struct Lines(Vec<u8>);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let line = std::mem::take(&mut self.0);
        if line.is_empty() { Ok(()) } else { between_bars(|| stderr().lock().write_all(&line)) }
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        // Without stderr, nobody can read about the failure.
        let _unwritten = self.flush();
    }
}
