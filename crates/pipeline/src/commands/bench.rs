//! Measures the cost of decoding alone, and resets the peak memory before a measured run.

use std::path::Path;
use std::time::Instant;

use roadplane_decode::{DecodeOptions, open};

use crate::stream::cpu::process_cpu_s;
use crate::{Cancel, Config, PipelineError};

/// Cost of decoding an input without any further work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodeCost {
    /// Number of frames whose pixels were decoded.
    pub frames: u64,
    /// Processor time, including that of the decoder's own threads, s.
    pub cpu_s: f64,
    /// Wall-clock time, s.
    pub wall_s: f64,
}

impl DecodeCost {
    /// Returns the processor time per frame, ms.
    #[must_use]
    pub fn cpu_ms_per_frame(&self) -> f64 {
        1e3 * self.cpu_s / self.frames.max(1) as f64
    }

    /// Returns the frames per second of wall-clock time.
    #[must_use]
    pub fn frames_per_s(&self) -> f64 {
        self.frames as f64 / self.wall_s.max(1e-9)
    }
}

/// Decodes the pixels of all frames of an input and measures the cost. The configured stride is ignored. The process
/// must do no other work meanwhile, because the cost of that work would be counted too.
///
/// # Errors
/// Returns a [`PipelineError`] if the input cannot be used, or after a request to stop.
pub fn measure_decoding(path: &Path, config: &Config, cancel: &Cancel) -> Result<DecodeCost, PipelineError> {
    let (started, cpu_from_s) = (Instant::now(), process_cpu_s());
    let mut input = open(path, &DecodeOptions { stride: 1, ..config.decode.clone() })?;
    while input.next_frame()?.is_some() {
        if let Some(signal) = cancel.signal() {
            return Err(PipelineError::Stopped { signal });
        }
    }
    let frames = input.report().decoded;
    drop(input);
    let cpu_s = process_cpu_s() - cpu_from_s;
    Ok(DecodeCost { frames, cpu_s, wall_s: started.elapsed().as_secs_f64() })
}

/// Resets the peak memory of this process to the memory that it uses now. Returns false if the system does not allow
/// this. The peak then still includes all earlier work.
pub fn forget_peak_memory() -> bool {
    // Writing "5" resets the peak resident set size (manual page proc(5)).
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}
