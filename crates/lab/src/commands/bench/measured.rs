//! The measured cost of a run, and comparisons with the cost of decoding alone.

use roadplane_pipeline::DecodeCost;
use roadplane_write::Speed;

/// The measured cost of one configuration.
pub struct Measured {
    /// Name of the configuration.
    pub name: &'static str,
    /// The costs, as in `summary.json`.
    pub speed: Speed,
    /// Peak memory, bytes.
    pub peak_memory_bytes: Option<u64>,
}

/// Returns the total CPU time of a run divided by the CPU time of decoding alone.
pub fn over_decoding(run: &Measured, decoding: &DecodeCost) -> f64 {
    run.speed.cpu_ms_per_frame.total / decoding.cpu_ms_per_frame().max(1e-9)
}

/// Returns the share of the total CPU time that perception uses for work other than decoding and nets.
pub fn rest_share(run: &Measured) -> f64 {
    let ms = &run.speed.cpu_ms_per_frame;
    ms.perception_rest() / ms.total.max(1e-9)
}
