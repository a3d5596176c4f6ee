//! Baselines for measured runs: the cost of decoding alone, and the peak of memory of one run.

use std::path::Path;
use std::time::Instant;

use roadplane_decode::{DecodeOptions, open};

use crate::stream::cpu::process_cpu_s;
use crate::{Cancel, Config, PipelineError};

/// Cost of decoding an input without any further work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodeCost {
    /// Number of frames decoded, each with its pixels.
    pub frames: u64,
    /// Processor time with that of the decoder's own threads, s.
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

/// Decodes all frames of an input with their pixels, whatever the configured stride, and measures the cost. Nothing
/// else may run in this process.
///
/// # Errors
/// [`PipelineError`] when the input cannot be used, or after a stop.
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

/// Resets the process's peak of memory to its present use. Returns false where the system does not allow it; the peak
/// then includes all earlier work.
pub fn forget_peak_memory() -> bool {
    // 5: reset the peak resident set size (proc(5)).
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}
