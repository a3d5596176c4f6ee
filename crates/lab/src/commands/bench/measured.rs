//! What a run costs, beside decoding alone.

use roadplane_pipeline::DecodeCost;
use roadplane_write::Speed;

/// What was measured of a configuration.
pub struct Measured {
    /// Name of the configuration.
    pub name: &'static str,
    /// Costs as `summary.json` has them.
    pub speed: Speed,
    /// Most memory held, bytes.
    pub peak_memory_bytes: Option<u64>,
}

/// Total over what decoding alone costs.
pub fn over_decoding(run: &Measured, decoding: &DecodeCost) -> f64 {
    run.speed.cpu_ms_per_frame.total / decoding.cpu_ms_per_frame().max(1e-9)
}

/// Share of the total that the left half costs beyond decoding and nets.
pub fn rest_share(run: &Measured) -> f64 {
    let ms = &run.speed.cpu_ms_per_frame;
    ms.left_half_rest() / ms.total.max(1e-9)
}
