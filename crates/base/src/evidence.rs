//! Evidence of one clip on its camera: the record from which the camera database is built.

use nalgebra::{Matrix4, Matrix4x5, Vector4};
use serde::{Deserialize, Deserializer, Serialize};

use crate::{CameraParams, ImageSize, JointInformation, KEYPOINTS, Lens, RecordError, SHARED_ERRORS};

/// Schema id of an evidence file.
pub const EVIDENCE_SCHEMA: &str = "roadplane.evidence/1";

/// Evidence of a clip, or of its last camera position, on the camera.
///
/// It contains no prior and no other clip's evidence. So any set of these records can be joined, in any order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraEvidence {
    /// Schema id, [`EVIDENCE_SCHEMA`].
    pub schema: String,
    /// Name of the camera.
    pub camera: String,
    /// The clip that gave the evidence.
    pub clip: ClipIdentity,
    /// Names and sha256 of the nets that found the vehicles and keypoints.
    pub models: Vec<String>,
    /// Width and height of the frames, px.
    pub image_size_px: ImageSize,
    /// First and last presentation time, s.
    pub span_s: [f64; 2],
    /// Number of frames used.
    pub frames: usize,
    /// Estimate of (log focal, tilt, roll, log height) from the vehicles' keypoints alone.
    pub params: [f64; 4],
    /// Information (inverse covariance) on `params`; singular where the clip determines nothing.
    ///
    /// The scene's mean car size, which all clips share, is not counted as an error here.
    pub information: [[f64; 4]; 4],
    /// Cross information of `params` and the errors that all vehicles of a scene share ([`JointInformation::cross`]).
    ///
    /// Older files lack it, or have only the first of these errors.
    #[serde(default, deserialize_with = "shared_errors")]
    pub shared: [[f64; SHARED_ERRORS]; 4],
    /// Radial distortion and its sd, both 1/px²; absent if the picture did not show it.
    #[serde(default)]
    pub lens: Option<(Lens, f64)>,
    /// Stationary vehicles, which may be there another night as well.
    pub parked: Vec<ParkedCar>,
    /// Number of moving vehicles.
    pub moving: usize,
    /// Background image of the scene, grey, as a PNG in base64.
    pub place: Option<String>,
}

/// Identity of a clip: its content and time of recording count, not its path.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ClipIdentity {
    /// Time of recording, `2026-01-31T23:59:59`: from the file's name, else its time of modification (UTC).
    pub recorded: String,
    /// sha256 of the file's content.
    pub sha256: String,
    /// Name of the file, without extension.
    pub name: String,
}

/// A stationary vehicle of a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParkedCar {
    /// Box: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Keypoints, px; `None` if not visible.
    pub keypoints_px: Vec<Option<[f64; 2]>>,
}

/// Reads the rows of `shared`. Files of older versions have fewer errors per row; the missing ones become 0.
fn shared_errors<'de, D: Deserializer<'de>>(file: D) -> Result<[[f64; SHARED_ERRORS]; 4], D::Error> {
    let rows = <[Vec<f64>; 4]>::deserialize(file)?;
    if rows.iter().any(|row| row.len() > SHARED_ERRORS) {
        return Err(serde::de::Error::custom(format!(
            "\"shared\" has rows of more than {SHARED_ERRORS} errors"
        )));
    }
    Ok(rows.map(|row| std::array::from_fn(|i| row.get(i).copied().unwrap_or(0.0))))
}

impl CameraEvidence {
    /// Returns the estimated camera parameters.
    #[must_use]
    pub fn camera_params(&self) -> CameraParams {
        CameraParams::from_vector(&Vector4::from(self.params))
    }

    /// Returns the vehicles' information on the camera and on the errors that they share.
    #[must_use]
    pub fn joint(&self) -> JointInformation {
        let information = Matrix4::from_fn(|r, c| self.information[r][c]);
        let cross = Matrix4x5::from_fn(|r, c| self.shared[r][c]);
        JointInformation { cross, ..JointInformation::of_camera(&information, &Vector4::from(self.params)) }
    }

    /// Checks that the schema, the sizes and the numbers are valid.
    ///
    /// # Errors
    /// Returns [`RecordError::Unsuitable`], which names the invalid field or number.
    pub fn check(&self) -> Result<(), RecordError> {
        let unsuitable = |what: String| Err(RecordError::Unsuitable { what });
        if self.schema != EVIDENCE_SCHEMA {
            return unsuitable(format!("schema is {:?}, expected {EVIDENCE_SCHEMA:?}", self.schema));
        }
        let matrices = self.information.as_flattened().iter().chain(self.shared.as_flattened());
        let lens = self.lens.iter().flat_map(|(lens, sd)| [&lens.per_px2, sd]);
        let numbers = self.params.iter().chain(matrices).chain(&self.span_s).chain(lens);
        let parked = self.parked.iter().flat_map(|car| {
            car.bbox_px.iter().chain(car.keypoints_px.iter().flatten().flat_map(|pixel| pixel.iter()))
        });
        if !numbers.chain(parked).all(|number| number.is_finite()) {
            return unsuitable("a number is not finite".to_owned());
        }
        let information = self.joint().information;
        let asymmetry = (information - information.transpose()).amax();
        if information.diagonal().min() < 0.0 || asymmetry > 1e-6 * information.amax() {
            return unsuitable(
                "the information is not a symmetric matrix with a positive diagonal".to_owned(),
            );
        }
        if self.parked.iter().any(|car| car.keypoints_px.len() != KEYPOINTS) {
            return unsuitable(format!("a parked car does not have {KEYPOINTS} keypoints"));
        }
        Ok(())
    }
}
