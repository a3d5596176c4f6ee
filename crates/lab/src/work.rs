//! Small steps that several evaluations share.

use std::path::Path;

use roadplane_base::Frame;
use roadplane_pipeline::{Cancel, Config, PipelineError, open_input};

use crate::LabError;

/// Returns an error if the user stopped the work.
pub(crate) fn stopped(cancel: &Cancel) -> Result<(), LabError> {
    cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }.into()))
}

/// Returns the configuration for simulated keypoints. Their elevation has no mean error, unlike that of the net on real
/// cars.
pub(crate) fn of_simulated_keypoints(config: &Config) -> Config {
    let mut config = config.clone();
    config.solve.mean_elevation_error_deg = 0.0;
    config
}

/// Returns the first frame of an input.
///
/// # Errors
/// [`LabError`] if the input cannot be read, or if it holds no picture.
pub(crate) fn read_picture(path: &Path, config: &Config) -> Result<Frame, LabError> {
    let frame = open_input(path, config)?.next_frame().map_err(PipelineError::from)?;
    frame.ok_or_else(|| LabError::malformed(path, "holds no picture"))
}
