//! The statistical shape atlas of cars, in metres and in the car frame (Li et al., *Car Pose in Context*, §3.1).
//!
//! The keypoints of a car are `X = X̄ + Σ_j λ_j V_j`. X̄ is the mean car, V_j is shape mode j, and λ_j is its
//! coefficient.

use nalgebra::{SMatrix, SVector, Vector3};
use serde::Deserialize;
use thiserror::Error;

use crate::KEYPOINTS;

/// Number of shape modes. Each mode is one direction in which the shapes of cars vary.
pub const MODES: usize = 6;

/// Number of fine modes: additional shape modes after the first [`MODES`] modes.
pub const FINE_MODES: usize = 6;

/// Number of all modes: the first modes and the fine modes.
pub const ALL_MODES: usize = MODES + FINE_MODES;

/// Shape coefficients λ of the first [`MODES`] modes, each in units of its standard deviation over all cars.
///
/// Their prior is N(0, I).
pub type Shape = SVector<f64, MODES>;

/// Shape coefficients λ of all modes, each in units of its standard deviation over all cars.
///
/// The coefficients of the fine modes come last.
pub type FullShape = SVector<f64, ALL_MODES>;

/// Schema id of the atlas files that this code reads.
pub const ATLAS_SCHEMA: &str = "roadplane.atlas/3";

/// An error in an atlas file.
#[derive(Debug, Error)]
pub enum AtlasError {
    /// The file is not JSON of the expected form.
    #[error("shape atlas: {0}")]
    Malformed(#[from] serde_json::Error),
    /// The file has another schema, a wrong number of entries or an impossible value.
    #[error("shape atlas: {what}")]
    Unsuitable {
        /// Description of the problem, for the user.
        what: String,
    },
}

/// A body type, such as sedan or van, with the normal distribution of its shape coefficients.
///
/// Traffic is a mixture of body types. Cars of one body type vary less than all cars together.
#[derive(Clone, Debug)]
pub struct BodyType {
    /// Name of the body type.
    pub name: String,
    /// Share of this body type among all cars in traffic, above 0.
    pub share: f64,
    /// Mean of the shape coefficients.
    pub mean: FullShape,
    /// Covariance of the shape coefficients, positive definite.
    pub covariance: SMatrix<f64, ALL_MODES, ALL_MODES>,
}

/// The mean car and its modes of variation, in the car frame and in metres.
#[derive(Clone, Debug)]
pub struct ShapeAtlas {
    /// Version of the atlas data.
    pub version: String,
    /// Keypoints of the mean car, m.
    pub mean: [Vector3<f64>; KEYPOINTS],
    /// Change of each keypoint with each mode, m per standard deviation.
    pub modes: [[Vector3<f64>; KEYPOINTS]; MODES],
    /// Lowest and highest coefficient of each mode among real cars.
    pub bounds: [[f64; 2]; MODES],
    /// Length, width (without mirrors) and height of the mean car, m.
    pub dims_mean: Vector3<f64>,
    /// Change of length, width and height with each mode, m per standard deviation.
    pub dims_modes: [Vector3<f64>; MODES],
    /// Sd of the deviation of real cars from the first [`MODES`] modes, per keypoint and axis, m.
    pub residual_sd_m: [Vector3<f64>; KEYPOINTS],
    /// Change of each keypoint with each fine mode, m per standard deviation.
    ///
    /// The fine modes explain most of the deviation whose sd is `residual_sd_m`.
    pub fine_modes: [[Vector3<f64>; KEYPOINTS]; FINE_MODES],
    /// Sd of the deviation of real cars from all modes together, per keypoint and axis, m.
    pub fine_residual_sd_m: [Vector3<f64>; KEYPOINTS],
    /// Body types in traffic, each with its share.
    pub body_types: Vec<BodyType>,
}

#[derive(Deserialize)]
struct BodyTypeInFile {
    name: String,
    share: f64,
    mean: Vec<f64>,
    covariance: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct AtlasFile {
    schema: String,
    version: serde_json::Value,
    mean: Vec<[f64; 3]>,
    modes: Vec<Vec<[f64; 3]>>,
    bounds: Vec<[f64; 2]>,
    dims_mean: [f64; 3],
    dims_modes: Vec<[f64; 3]>,
    residual_sd_m: Vec<[f64; 3]>,
    fine_modes: Vec<Vec<[f64; 3]>>,
    fine_residual_sd_m: Vec<[f64; 3]>,
    body_types: Vec<BodyTypeInFile>,
}

impl ShapeAtlas {
    /// Returns the atlas that the project ships.
    ///
    /// # Errors
    /// Returns an error only if the file in the repository is broken. A test checks this file.
    pub fn shipped() -> Result<Self, AtlasError> {
        Self::from_json(include_str!("../../../models/atlas.json"))
    }

    /// Reads an atlas from the text of its file (`models/atlas.json`).
    ///
    /// # Errors
    /// Returns [`AtlasError`] if the text is not an atlas of schema [`ATLAS_SCHEMA`] with finite numbers.
    pub fn from_json(text: &str) -> Result<Self, AtlasError> {
        let file: AtlasFile = serde_json::from_str(text)?;
        if file.schema != ATLAS_SCHEMA {
            return Err(unsuitable(format!("schema is {:?}, expected {ATLAS_SCHEMA:?}", file.schema)));
        }
        let version = file.version.as_str().map_or_else(|| file.version.to_string(), str::to_owned);
        let atlas = Self {
            version,
            mean: points("mean", &file.mean)?,
            modes: modes("modes", &file.modes)?,
            bounds: sized("bounds", file.bounds)?,
            dims_mean: file.dims_mean.into(),
            dims_modes: sized("dims_modes", file.dims_modes.into_iter().map(Vector3::from).collect())?,
            residual_sd_m: points("residual_sd_m", &file.residual_sd_m)?,
            fine_modes: modes("fine_modes", &file.fine_modes)?,
            fine_residual_sd_m: points("fine_residual_sd_m", &file.fine_residual_sd_m)?,
            body_types: file.body_types.into_iter().map(body_type).collect::<Result<_, _>>()?,
        };
        let shapes = atlas.modes.iter().chain(&atlas.fine_modes).flatten().chain(&atlas.mean);
        let numbers = shapes.chain(&atlas.residual_sd_m).chain(&atlas.fine_residual_sd_m);
        if numbers.flat_map(|v| v.iter()).any(|x| !x.is_finite()) {
            return Err(unsuitable("a number is not finite".to_owned()));
        }
        if atlas.bounds.iter().any(|[lo, hi]| !(*lo < 0.0 && *hi > 0.0)) {
            return Err(unsuitable("bounds must enclose 0".to_owned()));
        }
        Ok(atlas)
    }

    /// Returns the position of one keypoint for the given shape, in the car frame, m.
    #[must_use]
    pub fn keypoint_in_car(&self, index: usize, shape: &Shape) -> Vector3<f64> {
        let mut point = self.mean[index];
        for (mode, coefficient) in self.modes.iter().zip(shape.iter()) {
            point += mode[index] * *coefficient;
        }
        point
    }

    /// Returns the positions of all keypoints for the given shape, in the car frame, m.
    #[must_use]
    pub fn keypoints_in_car(&self, shape: &Shape) -> [Vector3<f64>; KEYPOINTS] {
        std::array::from_fn(|i| self.keypoint_in_car(i, shape))
    }

    /// Returns the distance from the car's origin forward to the middle of its body, m. The origin is midway between the
    /// axles.
    #[must_use]
    pub fn body_middle_m(&self, shape: &Shape) -> f64 {
        let forward = self.keypoints_in_car(shape).map(|point| point.x);
        let foremost = forward.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let rearmost = forward.iter().copied().fold(f64::INFINITY, f64::min);
        (foremost + rearmost) / 2.0
    }

    /// Returns the position of one keypoint for the given coefficients of all modes, in the car frame, m.
    #[must_use]
    pub fn keypoint_of_all_modes(&self, index: usize, shape: &FullShape) -> Vector3<f64> {
        let modes = self.modes.iter().chain(&self.fine_modes);
        modes.zip(shape.iter()).fold(self.mean[index], |point, (mode, c)| point + mode[index] * *c)
    }

    /// Returns the length, width (without mirrors) and height of a car with the given shape, m.
    #[must_use]
    pub fn dims_m(&self, shape: &Shape) -> Vector3<f64> {
        self.dims_modes.iter().zip(shape.iter()).fold(self.dims_mean, |dims, (mode, c)| dims + mode * *c)
    }

    /// Returns the shape with every coefficient limited to the range in `bounds`.
    #[must_use]
    pub fn clamped(&self, shape: &Shape) -> Shape {
        Shape::from_fn(|j, _| shape[j].clamp(self.bounds[j][0], self.bounds[j][1]))
    }
}

fn unsuitable(what: String) -> AtlasError {
    AtlasError::Unsuitable { what }
}

fn sized<T, const N: usize>(what: &str, items: Vec<T>) -> Result<[T; N], AtlasError> {
    items
        .try_into()
        .map_err(|items: Vec<T>| unsuitable(format!("{what} has {} entries, expected {N}", items.len())))
}

fn points(what: &str, rows: &[[f64; 3]]) -> Result<[Vector3<f64>; KEYPOINTS], AtlasError> {
    sized(what, rows.iter().map(|row| Vector3::from(*row)).collect())
}

fn modes<const N: usize>(
    what: &str,
    rows: &[Vec<[f64; 3]>],
) -> Result<[[Vector3<f64>; KEYPOINTS]; N], AtlasError> {
    sized(what, rows.iter().map(|mode| points(what, mode)).collect::<Result<_, _>>()?)
}

fn body_type(file: BodyTypeInFile) -> Result<BodyType, AtlasError> {
    let BodyTypeInFile { name, share, mean, covariance } = file;
    let rows: Vec<[f64; ALL_MODES]> =
        covariance.into_iter().map(|row| sized("a row of covariance", row)).collect::<Result<_, _>>()?;
    let rows: [_; ALL_MODES] = sized("covariance", rows)?;
    let covariance = SMatrix::<f64, ALL_MODES, ALL_MODES>::from_fn(|i, j| rows[i][j]);
    let symmetric = (covariance - covariance.transpose()).amax() < 1e-9;
    if !(share > 0.0 && share.is_finite() && symmetric && covariance.cholesky().is_some()) {
        return Err(unsuitable(format!("body type {name:?}: share or covariance is not positive")));
    }
    Ok(BodyType { name, share, mean: sized::<_, ALL_MODES>("mean", mean)?.into(), covariance })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mirror_index;

    #[test]
    fn the_shipped_atlas_is_a_symmetric_car() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let flip = |v: Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
        for i in 0..KEYPOINTS {
            assert!((flip(atlas.mean[i]) - atlas.mean[mirror_index(i)]).norm() < 1e-6);
            for mode in atlas.modes.iter().chain(&atlas.fine_modes) {
                assert!((flip(mode[i]) - mode[mirror_index(i)]).norm() < 1e-6);
            }
        }
        let dims = atlas.dims_m(&Shape::zeros());
        assert!((3.8..5.2).contains(&dims.x) && (1.6..2.0).contains(&dims.y) && (1.3..1.9).contains(&dims.z));
        assert!(atlas.mean[0].x > 0.0 && atlas.mean[0].y > 0.0, "left front wheel is ahead and to the left");
    }

    #[test]
    fn wrong_files_are_rejected_with_the_reason() {
        assert!(matches!(ShapeAtlas::from_json("{"), Err(AtlasError::Malformed(_))));
        let shipped = include_str!("../../../models/atlas.json");
        let text = shipped.replace(ATLAS_SCHEMA, "other/9");
        assert!(ShapeAtlas::from_json(&text).unwrap_err().to_string().contains("other/9"));
        let mut file: serde_json::Value = serde_json::from_str(shipped).unwrap();
        let mut rejected = |change: &dyn Fn(&mut serde_json::Value)| {
            let kept = file.clone();
            change(&mut file["body_types"][0]);
            let error = ShapeAtlas::from_json(&file.to_string()).unwrap_err().to_string();
            file = kept;
            error
        };
        assert!(rejected(&|body| body["share"] = 0.0.into()).contains("coupe"));
        assert!(rejected(&|body| body["covariance"][0][0] = (-1.0).into()).contains("coupe"));
        assert!(rejected(&|body| body["covariance"][0][1] = 9.0.into()).contains("coupe"));
        assert!(rejected(&|body| body["mean"] = vec![0.0; 6].into()).contains("mean has 6 entries"));
    }
}
