//! User constraints on the camera.

use std::path::PathBuf;

use clap::Args;
use roadplane_pipeline::{CameraConstraints, ConstraintOptions, Measured, PipelineError};

/// Heading of the constraints in the help.
const HEADING: &str = "Constraints on the camera (value V, or with a standard deviation: V±S, V±P%)";

/// User constraints on the camera. The standard deviation of a constraint, `V±S` or `V±P%` (or `+-`), sets its weight.
/// Contradictions are reported.
#[derive(Clone, Debug, Args)]
pub struct ConstraintArgs {
    /// Focal length, px; exact without a standard deviation.
    #[arg(long, help_heading = HEADING, value_name = "F", allow_hyphen_values = true)]
    pub focal_px: Option<Measured>,
    /// Angle of the optical axis below the horizontal, °; default standard deviation: 2°.
    #[arg(long, help_heading = HEADING, value_name = "T", allow_hyphen_values = true)]
    pub tilt_deg: Option<Measured>,
    /// Clockwise rotation of the scene's horizon, °; default standard deviation: 2°.
    #[arg(long, help_heading = HEADING, value_name = "R", allow_hyphen_values = true)]
    pub roll_deg: Option<Measured>,
    /// Height of the camera above the ground, m; default standard deviation: 5 %.
    #[arg(long, help_heading = HEADING, value_name = "H", allow_hyphen_values = true)]
    pub height_m: Option<Measured>,
    /// Calibrated camera: camera.json of a run, camera_matrix of OpenCV or ROS (.yml), or MEVA's .krtd.
    #[arg(long, help_heading = HEADING, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Lens distortion, OpenCV's k1 and k2; needs a focal length.
    #[arg(long, help_heading = HEADING, value_name = "K1[,K2]", allow_hyphen_values = true, value_parser = k1_k2)]
    pub lens: Option<[f64; 2]>,
    /// Lengths between ground pixels: CSV with x1,y1,x2,y2,length_m,sd_m[,pixel_sd][,frame][,name], or JSON (see
    /// `roadplane schemas known`). If the camera moves, the pixels are those of the frame, or of the first picture.
    #[arg(long, help_heading = HEADING, value_name = "FILE")]
    pub known: Option<PathBuf>,
}

fn k1_k2(text: &str) -> Result<[f64; 2], String> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|k| k.abs() < 10.0);
    let (k1, k2) = text.split_once(',').unwrap_or((text, "0"));
    number(k1)
        .zip(number(k2))
        .map(|(k1, k2)| [k1, k2])
        .ok_or_else(|| "must be one or two numbers, K1 or K1,K2".to_owned())
}

impl ConstraintArgs {
    /// Reads the constraints and the files that they name.
    ///
    /// # Errors
    /// Returns the errors of [`CameraConstraints::new`].
    pub fn read(&self) -> Result<CameraConstraints, PipelineError> {
        CameraConstraints::new(&ConstraintOptions {
            focal_px: self.focal_px,
            tilt_deg: self.tilt_deg,
            roll_deg: self.roll_deg,
            height_m: self.height_m,
            camera: self.camera.as_deref(),
            lengths: self.known.as_deref(),
            lens: self.lens,
        })
    }

    /// Reads the constraints for a command that may store its camera in a database.
    ///
    /// # Errors
    /// Returns the errors of [`CameraConstraints::new`]. Also returns [`PipelineError::Usage`] if the camera is stored
    /// and the focal length is exact. With an exact focal length, cars give no information on it that the database
    /// could store.
    pub fn read_for_database(&self, is_stored: bool) -> Result<CameraConstraints, PipelineError> {
        let known = self.read()?;
        if is_stored && known.focal_px().is_some() {
            let what = "--cameras needs a focal length with a standard deviation, for example --focal-px 1500±2%: with an exact one, \
                        cars add no evidence that could be stored";
            return Err(PipelineError::usage(what));
        }
        Ok(known)
    }
}
