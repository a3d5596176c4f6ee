//! What the user knows of the camera.

use std::path::PathBuf;

use clap::Args;
use roadplane_pipeline::{CameraConstraints, ConstraintOptions, Measured, PipelineError};

/// What is known of the camera. Each counts with its sd, `V±S` or `V±P%` (`+-` does as well); contradictions are told.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "What is known of the camera (V, V±S or V±P%)")]
pub struct ConstraintArgs {
    /// Focal length, px; without an sd it is taken as it is.
    #[arg(long, value_name = "F", allow_hyphen_values = true)]
    pub focal_px: Option<Measured>,
    /// Optical axis below the horizontal, °; without an sd to 2°.
    #[arg(long, value_name = "T", allow_hyphen_values = true)]
    pub tilt_deg: Option<Measured>,
    /// Clockwise turn of the scene's horizon, °; without an sd to 2°.
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    pub roll_deg: Option<Measured>,
    /// Height of the camera above the ground, m; without an sd to 5 %.
    #[arg(long, value_name = "H", allow_hyphen_values = true)]
    pub height_m: Option<Measured>,
    /// Camera that was calibrated before: camera.json of a run, OpenCV's or ROS' camera_matrix (.yml), MEVA's .krtd.
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// How the lens bends lines: OpenCV's k1 and k2; needs a focal length.
    #[arg(long, value_name = "K1[,K2]", allow_hyphen_values = true, value_parser = k1_k2)]
    pub lens: Option<[f64; 2]>,
    /// Lengths between pixels on the ground: CSV with x1,y1,x2,y2,length_m,sd_m[,pixel_sd][,name], or JSON (`schemas known`).
    #[arg(long, value_name = "FILE")]
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
    /// All of it; files are read.
    ///
    /// # Errors
    /// As [`CameraConstraints::new`].
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

    /// The same, `remembering` a camera beside it.
    ///
    /// # Errors
    /// As [`CameraConstraints::new`]; [`PipelineError::Usage`] for a focal length without an sd beside a remembered camera: cars before one that is
    /// taken as it is say nothing that could be remembered of another.
    pub fn read_beside(&self, remembering: bool) -> Result<CameraConstraints, PipelineError> {
        let known = self.read()?;
        if remembering && known.focal_px().is_some() {
            let what = "--cameras remembers what cars say of the focal length: give it an sd, e.g. --focal-px 1500±2%";
            return Err(PipelineError::usage(what));
        }
        Ok(known)
    }
}
