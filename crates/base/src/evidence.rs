//! What one clip said of its camera: the record that remembered cameras are made of.

use nalgebra::{Matrix4, Matrix4x5, Vector4};
use serde::{Deserialize, Deserializer, Serialize};

use crate::{CameraParams, ImageSize, JointInformation, KEYPOINTS, Lens, RecordError, SHARED_ERRORS};

/// Schema of an evidence file.
pub const EVIDENCE_SCHEMA: &str = "roadplane.evidence/1";

/// What a clip, or its last camera position, said of the camera. Nothing in it rests on a prior or on other clips, so that any
/// set of these can be joined, in any order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraEvidence {
    /// [`EVIDENCE_SCHEMA`].
    pub schema: String,
    /// Which camera.
    pub camera: String,
    /// Which clip.
    pub clip: ClipIdentity,
    /// Names and sha256 of the nets that saw the vehicles.
    pub models: Vec<String>,
    /// Size of the pictures.
    pub image_size_px: ImageSize,
    /// First and last presentation time, s.
    pub span_s: [f64; 2],
    /// Frames that went in.
    pub frames: usize,
    /// (log focal, tilt, roll, log height) that the vehicles' keypoints alone lead to.
    pub params: [f64; 4],
    /// Their information (inverse covariance); singular where the clip says nothing. The size of the place's cars, which all
    /// clips share, is not in it.
    pub information: [[f64; 4]; 4],
    /// Its cross part with the errors that the vehicles of a place share ([`JointInformation::cross`]); absent from older files, or
    /// the first of them alone.
    #[serde(default, deserialize_with = "shared_errors")]
    pub shared: [[f64; SHARED_ERRORS]; 4],
    /// How the lens bends lines, and the sd of that, both 1/px²; absent where the picture did not show it.
    #[serde(default)]
    pub lens: Option<(Lens, f64)>,
    /// Vehicles that stood, which may stand there another night.
    pub parked: Vec<ParkedCar>,
    /// Vehicles that moved.
    pub moving: usize,
    /// The empty place, grey: a PNG in base64.
    pub place: Option<String>,
}

/// A clip, whatever it is called.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ClipIdentity {
    /// When it was recorded, `2026-01-31T23:59:59`: from its name, else the file's time of modification (UTC).
    pub recorded: String,
    /// sha256 of its content.
    pub sha256: String,
    /// Its name, without extension.
    pub name: String,
}

/// A vehicle that stood in a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParkedCar {
    /// Its box, px.
    pub bbox_px: [f64; 4],
    /// Its keypoints, px; `None` where not seen.
    pub keypoints_px: Vec<Option<[f64; 2]>>,
}

/// Rows of as many errors as the file's version knew.
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
    /// The numbers of the camera.
    #[must_use]
    pub fn camera_params(&self) -> CameraParams {
        CameraParams::from_vector(&Vector4::from(self.params))
    }

    /// What the vehicles say, of the errors that they share, too.
    #[must_use]
    pub fn joint(&self) -> JointInformation {
        let information = Matrix4::from_fn(|r, c| self.information[r][c]);
        let cross = Matrix4x5::from_fn(|r, c| self.shared[r][c]);
        JointInformation { cross, ..JointInformation::of_camera(&information, &Vector4::from(self.params)) }
    }

    /// Refuses what is not of this form.
    ///
    /// # Errors
    /// [`RecordError::Unsuitable`] naming what cannot be.
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
            return unsuitable("the information is no symmetric matrix of a positive diagonal".to_owned());
        }
        if self.parked.iter().any(|car| car.keypoints_px.len() != KEYPOINTS) {
            return unsuitable(format!("a parked car has not {KEYPOINTS} keypoints"));
        }
        Ok(())
    }
}
