//! `camera.json`: the camera and the ground plane, with their uncertainties.

use std::path::Path;

use nalgebra::{Matrix4, Vector2, Vector3};
use roadplane_base::{
    Camera, CameraEstimate, CameraParams, CameraStatus, Ground, GroundPart, GroundPlane, Homography,
    ImageSize, Lens, PictureMotion, SecondPlane,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::digits::{METRES, PIXELS, RADIANS, SECONDS, decimals, significant};
use crate::{WriteError, jsonl::write_json};

/// Schema id of `camera.json`.
pub const CAMERA_SCHEMA: &str = "roadplane.camera/1";

/// Number of significant digits of standard deviations.
const SD_DIGITS: i32 = 4;
/// Number of decimals in the components of a unit normal. The step is 1e-8 rad, so a plane hardly changes when it is
/// written and read again.
const NORMAL: i32 = 8;
/// Number of decimals of distortion coefficients.
const LENS: i32 = 6;

/// Names and units of the rows and columns of [`CameraSegment::covariance`], in order.
pub const COVARIANCE_ORDER: [&str; 4] = ["log focal_px", "tilt_rad", "roll_rad", "log height_m"];

/// The camera and the ground plane of a clip: the values of the longest segment, and a list of all segments. A segment
/// is an interval in which the camera shows one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "camera: one object per clip")]
pub struct CameraFile {
    /// Id of the schema: `roadplane.camera/1`.
    #[schemars(extend("const" = CAMERA_SCHEMA))]
    pub schema: String,
    /// The longest segment. Its fields are keys at the top level of the file.
    #[serde(flatten)]
    pub camera: CameraSegment,
    /// Names of the rows and columns of `covariance`: log focal_px, tilt_rad, roll_rad, log height_m.
    #[serde(default)]
    pub covariance_order: Vec<String>,
    /// All segments in the order of time. Files of older versions lack the list if they have only one segment.
    #[serde(default)]
    pub segments: Vec<CameraSegment>,
    /// Motion of the camera: one entry per frame whose picture is displaced. The camera of a segment is that of its world
    /// picture. Absent if the camera was at rest.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motion: Vec<FrameMotion>,
}

/// Motion of the camera in one frame: the displacement of the picture against the world picture of its segment.
///
/// A point with the undistorted pixel (x, y) of the segment's camera has the undistorted pixel (u / w, v / w) in the
/// frame. Here (u, v, w) is the matrix times (x, y, 1). The lens is that of the segment, centred on the middle of the
/// picture. Without a lens, undistorted pixels are those of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameMotion {
    /// Index of the frame, from 0.
    pub frame: u64,
    /// Presentation time of the frame, s.
    pub time_s: f64,
    /// The first eight numbers of the matrix, row by row. The ninth is 1.
    pub picture_from_world: [f64; 8],
}

impl FrameMotion {
    /// Creates the entry of a frame, with rounded numbers.
    #[must_use]
    pub fn new(frame: u64, time_s: f64, picture_from_world: &Homography) -> Self {
        Self {
            frame,
            time_s: decimals(time_s, SECONDS),
            picture_from_world: picture_from_world.rounded_numbers(),
        }
    }

    /// Returns the homography from undistorted pixels of the world picture to undistorted pixels of the frame; `None` if
    /// the matrix has no inverse.
    #[must_use]
    pub fn homography(&self) -> Option<Homography> {
        Homography::from_numbers(self.picture_from_world)
    }
}

/// The camera and the ground plane of one segment. A segment is an interval in which the camera shows one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraSegment {
    /// Presentation times of the first and the last frame of the segment, s.
    pub span_s: [f64; 2],
    /// Width and height of the frames, px.
    pub image_size_px: ImageSize,
    /// Focal length, px. It is the same for both axes.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub focal_px: f64,
    /// Standard deviation of `focal_px`, px; null if it is not finite.
    #[schemars(range(min = 0))]
    pub focal_sd_px: Option<f64>,
    /// Principal point, px: x to the right, y down. The position (0, 0) is the centre of the top left pixel.
    pub principal_point_px: [f64; 2],
    /// Radial distortion of the lens; null if the distortion was not measured and is assumed to be zero. Files of older
    /// versions lack this key.
    #[serde(default)]
    pub lens: Option<LensFile>,
    /// Height of the camera above the ground plane, m.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub height_m: f64,
    /// Standard deviation of `height_m`, m; null if it is not finite. It includes the uncertainty of the mean size of
    /// the cars in the scene.
    #[schemars(range(min = 0))]
    pub height_sd_m: Option<f64>,
    /// Angle of the optical axis below the horizontal, rad.
    pub tilt_rad: f64,
    /// Standard deviation of `tilt_rad`, rad; null if it is not finite.
    #[schemars(range(min = 0))]
    pub tilt_sd_rad: Option<f64>,
    /// Clockwise rotation of the horizon in the picture, rad.
    pub roll_rad: f64,
    /// Standard deviation of `roll_rad`, rad; null if it is not finite.
    #[schemars(range(min = 0))]
    pub roll_sd_rad: Option<f64>,
    /// Ground plane in the camera frame: x to the right, y down, z along the optical axis.
    pub plane_in_camera: PlaneInCamera,
    /// Covariance matrix of log focal length, tilt (rad), roll (rad) and log height, with natural logarithms. The
    /// standard deviations in the segment are computed from this matrix. An entry that is not finite is null.
    pub covariance: [[Option<f64>; 4]; 4],
    /// Source of the focal length and the ground plane.
    pub status: CameraStatus,
    /// Number of different cars that the estimate uses.
    pub cars_used: usize,
    /// Number of frames that the estimate uses.
    pub frames_used: usize,
    /// Planes of the ground, if there are several. The first one is that of the segment, with the world frame. The second
    /// one begins at the line in which the planes meet. Absent if the ground is one plane.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ground: Vec<GroundPlaneFile>,
}

/// A plane of the ground. The numbers are as in the segment, but relative to this plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GroundPlaneFile {
    /// Part of the picture that shows the plane: a polygon of pixels without lens distortion.
    pub outline_px: Vec<[f64; 2]>,
    /// Angle between this plane and the first one, rad: positive if the ground rises where the plane begins, negative if
    /// it falls.
    pub slope_rad: f64,
    /// Height of the camera above the plane, m.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub height_m: f64,
    /// Angle of the optical axis below the plane's horizontal, rad.
    pub tilt_rad: f64,
    /// Clockwise rotation of the plane's horizon in the picture, rad.
    pub roll_rad: f64,
    /// The plane in the camera frame.
    pub plane_in_camera: PlaneInCamera,
    /// Covariance matrix of log focal length, tilt (rad), roll (rad) and log height, as in the segment.
    pub covariance: [[Option<f64>; 4]; 4],
}

impl GroundPlaneFile {
    fn new(estimate: &CameraEstimate, part: &GroundPart) -> Self {
        let ground = estimate.ground();
        let camera = estimate.above(part);
        let params = camera.params;
        let slope_rad = estimate.slope_rad().filter(|_| part.index > 0).unwrap_or(0.0);
        Self {
            outline_px: outline_px(estimate, &ground, part.index),
            slope_rad: decimals(slope_rad, RADIANS + 1),
            height_m: decimals(params.log_height.exp(), METRES),
            tilt_rad: decimals(params.tilt, RADIANS + 1),
            roll_rad: decimals(params.roll, RADIANS + 1),
            plane_in_camera: PlaneInCamera::new(&part.plane),
            covariance: covariance_in_file(&camera.covariance),
        }
    }
}

/// Returns the part of the picture that shows a plane of the ground: the picture, cut along the line where the planes
/// meet.
fn outline_px(estimate: &CameraEstimate, ground: &Ground, index: usize) -> Vec<[f64; 2]> {
    let ImageSize { width, height } = estimate.image_size_px;
    let (right, bottom) = (f64::from(width) - 0.5, f64::from(height) - 0.5);
    let straight = Camera { lens: Lens::STRAIGHT, ..estimate.camera() };
    // Positive on the second plane.
    let beyond = |at: &Vector2<f64>| ground.beyond(&straight.ray_from_pixel(at));
    let sign = if index == 0 { -1.0 } else { 1.0 };
    let corners = [[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]].map(Vector2::from);
    let mut outline = Vec::new();
    for i in 0..4 {
        let (from, to) = (corners[i], corners[(i + 1) % 4]);
        let (a, b) = (sign * beyond(&from), sign * beyond(&to));
        if a >= 0.0 {
            outline.push(from);
        }
        if (a >= 0.0) != (b >= 0.0) {
            outline.push(from + (to - from) * (a / (a - b)));
        }
    }
    outline.into_iter().map(|at| [decimals(at.x, PIXELS), decimals(at.y, PIXELS)]).collect()
}

fn covariance_in_file(covariance: &Matrix4<f64>) -> [[Option<f64>; 4]; 4] {
    let entry = |value: f64| value.is_finite().then(|| significant(value, SD_DIGITS + 2));
    std::array::from_fn(|r| std::array::from_fn(|c| entry(covariance[(r, c)])))
}

fn covariance_of_file(entries: &[[Option<f64>; 4]; 4]) -> Matrix4<f64> {
    Matrix4::from_fn(|r, c| entries[r][c].unwrap_or(if r == c { f64::INFINITY } else { 0.0 }))
}

/// Radial distortion by the division model (Fitzgibbon, CVPR 2001).
///
/// Let p be the position of a scene point in the picture relative to the principal point, px. A lens without distortion
/// would show the same point at `p / (1 + bend · |p|² / (width / 2)²)`. Here `width` is the width of the picture, px.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LensFile {
    /// Model of the distortion: `division`.
    #[schemars(extend("const" = "division"))]
    pub model: String,
    /// Coefficient `bend` of the division model, without unit. It is negative for barrel distortion.
    pub bend: f64,
    /// Standard deviation of `bend`, without unit.
    #[schemars(range(min = 0))]
    pub bend_sd: f64,
    /// Coefficient k1 of OpenCV's distortion model, for the focal length of the segment. Together, `k1` and `k2` give
    /// the distortion that is most similar to the division model.
    pub k1: f64,
    /// Standard deviation of `k1`. It includes the uncertainty of the focal length.
    #[schemars(range(min = 0))]
    pub k1_sd: f64,
    /// Coefficient k2 of OpenCV's distortion model, for the focal length of the segment.
    pub k2: f64,
}

impl LensFile {
    const MODEL: &str = "division";

    fn new(estimate: &CameraEstimate) -> Option<Self> {
        let bend_sd = estimate.distortion_sd?;
        let (focal_px, size) = (estimate.params.focal_px(), estimate.image_size_px);
        let bend = estimate.lens.distortion(size);
        let [k1, k2] = estimate.lens.opencv(focal_px, size);
        let from_distortion = Lens::with_distortion(bend_sd, size).per_px2 * focal_px * focal_px;
        let from_focal = 2.0 * k1 * estimate.covariance[(0, 0)].max(0.0).sqrt();
        Some(Self {
            model: Self::MODEL.to_owned(),
            bend: decimals(bend, LENS),
            bend_sd: significant(bend_sd, SD_DIGITS),
            k1: decimals(k1, LENS),
            k1_sd: significant(from_distortion.hypot(from_focal), SD_DIGITS),
            k2: decimals(k2, LENS),
        })
    }
}

/// The ground plane in the camera frame: all points X, m, with `normal · X + offset_m = 0`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlaneInCamera {
    /// Unit normal of the plane in the camera frame, pointing up.
    pub normal: [f64; 3],
    /// Height of the camera's centre above the plane, m.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub offset_m: f64,
}

impl PlaneInCamera {
    fn new(plane: &GroundPlane) -> Self {
        Self {
            normal: [0, 1, 2].map(|i| decimals(plane.normal_in_camera[i], NORMAL)),
            offset_m: decimals(plane.height_m, METRES),
        }
    }
}

impl CameraSegment {
    /// Returns the mapping from pixels of this camera to pixels of a frame; `None` if the matrix has no inverse.
    #[must_use]
    pub fn picture_from_world(&self, motion: &FrameMotion) -> Option<PictureMotion> {
        let bend = self.lens.as_ref().map_or(0.0, |lens| lens.bend);
        let lens = Lens::with_distortion(bend, self.image_size_px);
        Some(PictureMotion::new(motion.homography()?, lens, self.image_size_px))
    }

    /// Creates a segment from an estimate. Its numbers are rounded to the digits that the file has.
    ///
    /// The estimate contains the logarithms of the focal length and of the height. Let u be such a logarithm, and sd(u)
    /// its standard deviation. The standard deviation of the focal length or height follows from the delta method:
    /// `sd(exp u) = exp(u) · sd(u)`.
    #[must_use]
    pub fn new(estimate: &CameraEstimate) -> Self {
        let params = &estimate.params;
        let (focal_px, height_m) = (params.focal_px(), params.log_height.exp());
        let sd = |i: usize, scale: f64| {
            let sd = estimate.covariance[(i, i)].sqrt() * scale;
            sd.is_finite().then(|| significant(sd, SD_DIGITS))
        };
        let plane = params.plane();
        Self {
            span_s: estimate.span_s.map(|t| decimals(t, SECONDS)),
            image_size_px: estimate.image_size_px,
            focal_px: decimals(focal_px, 3),
            focal_sd_px: sd(0, focal_px),
            principal_point_px: [estimate.principal_point_px.x, estimate.principal_point_px.y]
                .map(|v| decimals(v, 3)),
            lens: LensFile::new(estimate),
            height_m: decimals(height_m, METRES),
            height_sd_m: sd(3, height_m),
            tilt_rad: decimals(params.tilt, RADIANS + 1),
            tilt_sd_rad: sd(1, 1.0),
            roll_rad: decimals(params.roll, RADIANS + 1),
            roll_sd_rad: sd(2, 1.0),
            plane_in_camera: PlaneInCamera::new(&plane),
            covariance: covariance_in_file(&estimate.covariance),
            status: estimate.status,
            cars_used: estimate.cars_used,
            frames_used: estimate.frames_used,
            ground: match estimate.second_plane {
                Some(_) => {
                    estimate.ground().parts().map(|part| GroundPlaneFile::new(estimate, &part)).collect()
                }
                None => Vec::new(),
            },
        }
    }

    /// Returns the camera of the segment, without the ground plane and without uncertainties.
    #[must_use]
    pub fn camera(&self) -> Camera {
        self.estimate().camera()
    }

    /// Returns the ground plane of the segment in the camera frame.
    #[must_use]
    pub fn plane(&self) -> GroundPlane {
        GroundPlane {
            // The program writes a unit vector. If a user edited the vector to zero, it is replaced by the normal for a
            // level camera.
            normal_in_camera: Vector3::from(self.plane_in_camera.normal)
                .try_normalize(f64::MIN_POSITIVE)
                .unwrap_or(-Vector3::y()),
            height_m: self.plane_in_camera.offset_m,
        }
    }

    /// Returns the estimate of the camera and the ground plane, with the rounded numbers of the file.
    #[must_use]
    pub fn estimate(&self) -> CameraEstimate {
        CameraEstimate {
            span_s: self.span_s,
            image_size_px: self.image_size_px,
            principal_point_px: Vector2::from(self.principal_point_px),
            lens: self
                .lens
                .as_ref()
                .map_or(Lens::STRAIGHT, |lens| Lens::with_distortion(lens.bend, self.image_size_px)),
            distortion_sd: self.lens.as_ref().map(|lens| lens.bend_sd),
            params: CameraParams {
                log_focal: self.focal_px.ln(),
                tilt: self.tilt_rad,
                roll: self.roll_rad,
                log_height: self.height_m.ln(),
            },
            covariance: covariance_of_file(&self.covariance),
            status: self.status,
            cars_used: self.cars_used,
            frames_used: self.frames_used,
            second_plane: self.second_plane(),
        }
    }

    fn second_plane(&self) -> Option<SecondPlane> {
        let second = self.ground.get(1)?;
        Some(SecondPlane {
            params: CameraParams {
                log_focal: self.focal_px.ln(),
                tilt: second.tilt_rad,
                roll: second.roll_rad,
                log_height: second.height_m.ln(),
            },
            covariance: covariance_of_file(&second.covariance),
            rises: second.slope_rad > 0.0,
        })
    }

    fn is_usable(&self) -> bool {
        let normal = Vector3::from(self.plane_in_camera.normal).norm();
        let lens = self.lens.as_ref();
        lens.is_none_or(|lens| lens.model == LensFile::MODEL && lens.bend.is_finite())
            && self.focal_px > 0.0
            && self.height_m > 0.0
            && self.ground.iter().all(|plane| plane.height_m > 0.0 && plane.tilt_rad.is_finite())
            && self.plane_in_camera.offset_m > 0.0
            && (normal - 1.0).abs() < 1e-3
            && self.image_size_px.width > 0
            && self.image_size_px.height > 0
    }
}

impl CameraFile {
    /// Returns the mapping from pixels of the segment's camera to pixels of a frame; `None` if the matrix has no inverse.
    #[must_use]
    pub fn picture_from_world(&self, motion: &FrameMotion) -> Option<PictureMotion> {
        let begun = self.all().iter().take_while(|segment| segment.span_s[0] <= motion.time_s);
        begun.last().unwrap_or(&self.camera).picture_from_world(motion)
    }

    /// Returns all segments in the order of time. The list is never empty.
    #[must_use]
    pub fn all(&self) -> &[CameraSegment] {
        if self.segments.is_empty() { std::slice::from_ref(&self.camera) } else { &self.segments }
    }
}

/// Writes `camera.json`. `estimates` has one entry per segment, in the order of time. `motion` has one entry per frame
/// whose picture is displaced.
///
/// # Errors
/// [`WriteError::Malformed`] if `estimates` is empty or contains a number that is not finite; [`WriteError::Io`],
/// [`WriteError::DiskFull`].
pub fn write_camera(
    path: &Path,
    estimates: &[CameraEstimate],
    motion: Vec<FrameMotion>,
) -> Result<(), WriteError> {
    let segments: Vec<CameraSegment> = estimates.iter().map(CameraSegment::new).collect();
    let span = |s: &CameraSegment| s.span_s[1] - s.span_s[0];
    // If several segments are equally long, the first of them is used.
    let longest = segments.iter().rev().max_by(|a, b| span(a).total_cmp(&span(b)));
    let camera = longest.ok_or_else(|| WriteError::malformed(path, "no camera to write"))?.clone();
    if !segments.iter().all(CameraSegment::is_usable) {
        return Err(WriteError::malformed(path, "a camera without a finite focal length or plane"));
    }
    let covariance_order = COVARIANCE_ORDER.map(str::to_owned).to_vec();
    let schema = CAMERA_SCHEMA.to_owned();
    write_json(path, &CameraFile { schema, camera, covariance_order, segments, motion })
}

/// Reads `camera.json`.
///
/// # Errors
/// [`WriteError::Malformed`] if the file is not a valid `camera.json`; [`WriteError::Io`].
pub fn read_camera(path: &Path) -> Result<CameraFile, WriteError> {
    let text = std::fs::read(path).map_err(WriteError::io("read", path))?;
    let file: CameraFile = serde_json::from_slice(&text).map_err(|e| WriteError::malformed(path, e))?;
    if file.schema != CAMERA_SCHEMA {
        let what = format!("the schema is {:?}, expected {CAMERA_SCHEMA:?}", file.schema);
        return Err(WriteError::malformed(path, what));
    }
    if !file.all().iter().all(CameraSegment::is_usable) {
        return Err(WriteError::malformed(path, "a camera without a usable focal length or plane"));
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(span_s: [f64; 2]) -> CameraEstimate {
        let size = ImageSize { width: 1920, height: 1080 };
        CameraEstimate {
            span_s,
            image_size_px: size,
            principal_point_px: size.centre_px(),
            lens: Lens::STRAIGHT,
            distortion_sd: None,
            params: CameraParams {
                log_focal: 1653f64.ln(),
                tilt: 0.42,
                roll: -0.013,
                log_height: 10.7f64.ln(),
            },
            covariance: Matrix4::from_diagonal(&nalgebra::Vector4::new(0.0025, 1e-4, 4e-6, 0.0016)),
            status: CameraStatus::Estimated,
            cars_used: 9,
            frames_used: 50,
            second_plane: None,
        }
    }

    #[test]
    fn two_planes_survive() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("camera.json");
        for (tilt, height_m, rises) in [(0.47f64, 12.1f64, true), (0.37, 9.4, false)] {
            let one = estimate([0.0, 1.5]);
            let params = CameraParams { tilt, log_height: height_m.ln(), ..one.params };
            let covariance = one.covariance * 2.0;
            let second_plane = Some(SecondPlane { params, covariance, rises });
            let written = CameraEstimate { second_plane, ..one };
            write_camera(&path, std::slice::from_ref(&written), Vec::new()).unwrap();
            let camera = read_camera(&path).unwrap().camera;
            let back = camera.estimate().second_plane.unwrap();
            assert!((back.params.to_vector() - params.to_vector()).norm() < 1e-5 && back.rises == rises);
            assert!((back.covariance - covariance).norm() < 1e-9);
            let [first, second] = &camera.ground[..] else { panic!("{}", camera.ground.len()) };
            assert_eq!((first.slope_rad, second.slope_rad > 0.0), (0.0, rises));
            assert!((second.slope_rad.abs() - 0.05).abs() < 1e-3);
            // The outlines share the picture: the first plane is below the second one.
            let area = |outline: &[[f64; 2]]| {
                let next = outline.iter().cycle().skip(1);
                outline.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
            };
            let areas = [area(&first.outline_px), area(&second.outline_px)];
            assert!((areas[0] + areas[1] - 1920.0 * 1080.0).abs() < 100.0 && areas[0].min(areas[1]) > 1e5);
            let lowest = |outline: &[[f64; 2]]| outline.iter().map(|at| at[1]).fold(0.0, f64::max);
            assert!(lowest(&first.outline_px) > lowest(&second.outline_px));
        }
        let one = CameraSegment::new(&estimate([0.0, 1.5]));
        assert!(one.ground.is_empty() && one.estimate().second_plane.is_none());
    }

    #[test]
    fn sds_follow_the_delta_method_and_the_plane_survives() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("camera.json");
        let written = estimate([0.0, 1.5]);
        write_camera(&path, std::slice::from_ref(&written), Vec::new()).unwrap();
        let file = read_camera(&path).unwrap();
        assert_eq!((file.segments.len(), file.covariance_order.len()), (1, 4));
        let camera = &file.camera;
        assert!((camera.focal_sd_px.unwrap() - 1653.0 * 0.05).abs() < 0.01);
        assert!((camera.height_sd_m.unwrap() - 10.7 * 0.04).abs() < 1e-4);
        assert!((camera.tilt_sd_rad.unwrap() - 0.01).abs() < 1e-9);
        assert!((camera.plane().normal_in_camera - written.params.plane().normal_in_camera).norm() < 2e-8);
        let back = camera.estimate();
        assert!((back.params.to_vector() - written.params.to_vector()).norm() < 1e-5);
        assert!((back.covariance - written.covariance).norm() < 1e-9);
    }

    #[test]
    fn a_moved_camera_gives_segments_and_the_longest_on_top() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("camera.json");
        write_camera(&path, &[estimate([0.0, 1.0]), estimate([1.0, 9.0]), estimate([9.0, 10.0])], Vec::new())
            .unwrap();
        let file = read_camera(&path).unwrap();
        assert_eq!(file.all().len(), 3);
        assert_eq!(file.camera.span_s, [1.0, 9.0]);
    }

    #[test]
    fn an_invalid_camera_is_rejected() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("camera.json");
        assert!(matches!(write_camera(&path, &[], Vec::new()), Err(WriteError::Malformed { .. })));
        let mut broken = estimate([0.0, 1.0]);
        broken.params.log_focal = f64::NAN;
        assert!(matches!(write_camera(&path, &[broken], Vec::new()), Err(WriteError::Malformed { .. })));
        assert!(!path.exists());
        std::fs::write(&path, r#"{"schema": "other/1"}"#).unwrap();
        assert!(matches!(read_camera(&path), Err(WriteError::Malformed { .. })));
    }

    #[test]
    fn unknown_sds_are_null() {
        let mut wide = estimate([0.0, 1.0]);
        wide.covariance[(2, 2)] = f64::INFINITY;
        let segment = CameraSegment::new(&wide);
        assert_eq!(segment.roll_sd_rad, None);
        assert!(segment.estimate().covariance[(2, 2)].is_infinite());
    }
}
