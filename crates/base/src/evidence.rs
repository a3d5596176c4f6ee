//! Information that one clip gives on its camera. The camera database consists of such records.

use nalgebra::{Matrix4, Matrix4x5, Vector4};
use serde::{Deserialize, Deserializer, Serialize};

use crate::{CameraParams, ImageSize, JointInformation, KEYPOINTS, Lens, RecordError, SHARED_ERRORS};

/// Schema id of an evidence file.
pub const EVIDENCE_SCHEMA: &str = "roadplane.evidence/1";

/// Information that one clip gives on its camera.
///
/// If the camera was moved during the clip, the record describes the camera that takes the picture `place`, at the end
/// of the clip. Pixels are those of this picture. The record contains no prior and no information from other clips.
/// Therefore the records of several clips can be combined in any order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraEvidence {
    /// Schema id, which must be [`EVIDENCE_SCHEMA`].
    pub schema: String,
    /// Name of the camera.
    pub camera: String,
    /// Clip from which the information comes.
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
    /// Information matrix (inverse covariance) of `params`. It is singular if the clip leaves some parameters
    /// undetermined.
    ///
    /// The matrix does not include the error of the scene's mean car size, because all clips share that error.
    pub information: [[f64; 4]; 4],
    /// Cross information between `params` and the errors that all vehicles of a scene share
    /// ([`JointInformation::cross`]).
    ///
    /// Older files lack this field, or their rows are shorter. The missing entries are 0.
    #[serde(default, deserialize_with = "shared_errors")]
    pub shared: [[f64; SHARED_ERRORS]; 4],
    /// Radial distortion and its sd, both 1/px². Absent if the picture did not show the distortion.
    #[serde(default)]
    pub lens: Option<(Lens, f64)>,
    /// Stationary vehicles. They may be in the same position in other clips.
    pub parked: Vec<ParkedCar>,
    /// Number of moving vehicles.
    pub moving: usize,
    /// Grey background image of the scene: a PNG file in base64.
    pub place: Option<String>,
}

/// Identity of a clip: recording time, content and name, but not the folder.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ClipIdentity {
    /// Time of recording, such as `2026-01-31T23:59:59`. It comes from the file's name, otherwise from the file's
    /// modification time (UTC).
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
    /// Keypoints, px. An entry is `None` if the keypoint is not visible.
    pub keypoints_px: Vec<Option<[f64; 2]>>,
}

/// Reads the rows of `shared`. Files of older versions have fewer errors per row. The missing errors become 0.
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

    /// Returns the information on the camera parameters and on the errors that all vehicles share.
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
