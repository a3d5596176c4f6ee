//! The records that stages hand on, in the form that the files have (see `ARCHITECTURE.md`).

use nalgebra::{Isometry3, Matrix2, Matrix4, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use thiserror::Error;

use crate::{
    Camera, CameraParams, GroundPose, ImageSize, KEYPOINTS, Keypoint, KeypointSet, Lens, MODES, SceneCurve,
    SceneLine,
};

/// What is wrong with a line of a record file.
#[derive(Debug, Error)]
pub enum RecordError {
    /// Not JSON of the documented form.
    #[error("{0}")]
    Malformed(#[from] serde_json::Error),
    /// A number that cannot be.
    #[error("{what}")]
    Unsuitable {
        /// What is unsuitable.
        what: String,
    },
}

/// What kind of vehicle a detector says it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VehicleClass {
    /// Cars, vans, pickups, SUVs: what the atlas covers.
    #[default]
    Car,
    /// Lorries.
    Truck,
    /// Buses.
    Bus,
}

/// One line of a frames file: what is known of one frame so far. Fields that we do not know are kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameRecord {
    /// Index of the frame in its input.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Width and height, px.
    pub image_size_px: ImageSize,
    /// What the picture says of the camera and of change; absent before that stage and from other tools.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watch: Option<WatchRecord>,
    /// Straight edges of the place that may be vertical, `[x0, y0, x1, y1, sd]` each, as they are known from this frame on until
    /// the camera is moved; absent where nobody looked for them anew.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_lines: Option<Vec<SceneLine>>,
    /// Long edges that show how the lens bends lines, `[x0, y0, x1, y1, x2, y2, sd]` each: ends and middle; told with `scene_lines`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_curves: Option<Vec<SceneCurve>>,
    /// Vehicles found.
    pub cars: Vec<CarRecord>,
    /// Fields of other tools.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// One vehicle in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "CarFields", into = "CarFields")]
pub struct CarRecord {
    /// Box: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Detector's score, 0–1.
    pub score: f64,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Keypoints; absent before that stage and where the pose is held.
    pub keypoints: Option<Box<KeypointSet>>,
    /// The box is held: nothing changed there since the detector saw it in this frame.
    pub held_since: Option<u64>,
    /// The pose is held: the keypoints of this look still hold, as the car has not moved since.
    pub pose_from: Option<CarRef>,
    /// It is only seen here: this look measured it so shortly before that another would tell nothing new.
    pub seen_after: Option<CarRef>,
    /// Fields of other tools.
    pub extra: Map<String, Value>,
}

/// A car in a frame: index of the frame, place in its list of cars.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(from = "(u64, usize)", into = "(u64, usize)")]
pub struct CarRef {
    /// Index of the frame.
    pub frame: u64,
    /// Place in that frame's list of cars.
    pub car: usize,
}

impl From<(u64, usize)> for CarRef {
    fn from((frame, car): (u64, usize)) -> Self {
        Self { frame, car }
    }
}

impl From<CarRef> for (u64, usize) {
    fn from(look: CarRef) -> Self {
        (look.frame, look.car)
    }
}

/// What a picture shows, as far as the camera is concerned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureVerdict {
    /// The camera is where it was, up to the shake that the offset tells.
    Rest,
    /// It is being turned or zoomed, or the pictures change from one to the next.
    Moving,
    /// Not as before; whether it is a move shows later.
    Unsettled,
    /// Nothing but black.
    Black,
    /// Nothing but white.
    White,
    /// Something lies over the lens: no structure left.
    Covered,
    /// The same picture again and again, where there was noise before.
    Frozen,
    /// Too little structure to tell.
    #[default]
    Unknown,
}

impl PictureVerdict {
    /// Nothing can be seen in the picture.
    #[must_use]
    pub fn is_blind(self) -> bool {
        matches!(self, Self::Black | Self::White | Self::Covered)
    }
}

/// What the picture itself says, before any vehicle is looked for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchRecord {
    /// Whether this frame's picture was looked at; otherwise verdict and offset are those of the last one that was, and only
    /// vehicles that are held are listed.
    pub looked: bool,
    /// What it shows.
    pub verdict: PictureVerdict,
    /// Where the picture of the place lies against its place at rest, px: right, down. What is seen at `p` would be at
    /// `p − offset` without the shake.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset_px: [f64; 2],
    /// In this frame it became known that the camera was moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<CameraMove>,
    /// Share of the picture that is not as it was when the detector last looked there, 0–1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changed: Option<f64>,
    /// Share of the picture that the detector looked at in this frame, 0–1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<f64>,
}

fn is_zero(offset_px: &[f64; 2]) -> bool {
    offset_px.iter().all(|v| v.abs() < f64::EPSILON)
}

/// How the camera came to another position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MoveKind {
    /// It was turned: the picture is shifted.
    Turned,
    /// It was zoomed.
    Zoomed,
    /// Another picture altogether: nothing of the camera before holds.
    Cut,
    /// It began to move and has not come to rest.
    Moving,
}

/// A change of the camera's position. It is told when it is known, which is later than it happened.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraMove {
    /// How.
    pub kind: MoveKind,
    /// First frame of the new position.
    pub since_frame: u64,
    /// Its time, s.
    pub since_s: f64,
    /// Shift of the picture, px, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift_px: Option<[f64; 2]>,
    /// Logarithm of the picture's growth, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_scale: Option<f64>,
}

impl VehicleClass {
    /// Its name, as files have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Truck => "truck",
            Self::Bus => "bus",
        }
    }
}

impl CarRecord {
    /// A car of which only the box is known.
    #[must_use]
    pub fn boxed(bbox_px: [f64; 4]) -> Self {
        Self {
            bbox_px,
            score: 1.0,
            class: VehicleClass::Car,
            keypoints: None,
            held_since: None,
            pose_from: None,
            seen_after: None,
            extra: Map::new(),
        }
    }

    /// Longer side of the box, px.
    #[must_use]
    pub fn longer_side_px(&self) -> f64 {
        let [x0, y0, x1, y1] = self.bbox_px;
        (x1 - x0).max(y1 - y0)
    }
}

impl WatchRecord {
    /// Shake of the picture, px: see [`Self::offset_px`].
    #[must_use]
    pub fn offset(&self) -> Vector2<f64> {
        Vector2::from(self.offset_px)
    }
}

impl FrameRecord {
    /// A frame of which nothing is known yet.
    #[must_use]
    pub fn empty(frame: u64, time_s: f64, image_size_px: ImageSize) -> Self {
        Self {
            frame,
            time_s,
            image_size_px,
            watch: None,
            scene_lines: None,
            scene_curves: None,
            cars: Vec::new(),
            extra: Map::new(),
        }
    }

    /// Reads one line and checks its numbers: finite, boxes with an area, sd above zero.
    ///
    /// # Errors
    /// [`RecordError`] that says which field is wrong.
    pub fn from_json(line: &str) -> Result<Self, RecordError> {
        let record: Self = serde_json::from_str(line)?;
        let fail = |what: String| Err(RecordError::Unsuitable { what });
        if !record.time_s.is_finite() {
            return fail("time_s is not finite".to_owned());
        }
        if record.image_size_px.width == 0 || record.image_size_px.height == 0 {
            return fail("image_size_px must be positive".to_owned());
        }
        for (i, line) in record.scene_lines.iter().flatten().enumerate() {
            if !line.is_sound() {
                return fail(format!("scene_lines[{i}] is not finite, has no length or no positive sd"));
            }
        }
        for (i, car) in record.cars.iter().enumerate() {
            let [x0, y0, x1, y1] = car.bbox_px;
            if !(car.bbox_px.iter().all(|v| v.is_finite()) && x1 > x0 && y1 > y0) {
                return fail(format!("cars[{i}].bbox_px {:?} is no box", car.bbox_px));
            }
            if !car.score.is_finite() {
                return fail(format!("cars[{i}].score is not finite"));
            }
            let points = car.keypoints.iter().flat_map(|set| set.iter().flatten());
            for point in points {
                let numbers = [point.pixel.x, point.pixel.y, point.score];
                let covariance = &point.covariance_px2;
                if !numbers.iter().chain(covariance.iter()).all(|v| v.is_finite())
                    || covariance.cholesky().is_none()
                {
                    return fail(format!(
                        "cars[{i}] has a keypoint that is not finite or has no positive sd"
                    ));
                }
            }
        }
        Ok(record)
    }
}

/// [`CarRecord`] as the file has it: `[x, y, score, sd_px]` a keypoint, and where the sd differs by direction the
/// covariances `[xx, xy, yy]` (px²) in a field of their own.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Car")]
struct CarFields {
    /// Box: left, top, right, bottom, px.
    bbox_px: [f64; 4],
    /// Detector's score, 0–1.
    score: f64,
    /// Kind of vehicle.
    class: VehicleClass,
    /// 36 keypoints `[x px, y px, score 0–1, sd px]`, null where there is none. The sd counts where
    /// `keypoint_covariances_px2` is absent or null.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    keypoints: Option<Vec<Option<[f64; 4]>>>,
    /// Their covariances `[xx, xy, yy]`, px², where the sd differs by direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    keypoint_covariances_px2: Option<Vec<Option<[f64; 3]>>>,
    /// The box is held: nothing changed there since the detector saw it in this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    held_since: Option<u64>,
    /// The pose is held: the keypoints of this look (frame, place in its list) still hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pose_from: Option<CarRef>,
    /// It is only seen here: this look (frame, place in its list) measured it shortly before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seen_after: Option<CarRef>,
    #[serde(flatten)]
    extra: Map<String, Value>,
}

/// Sub-pixel digits that a file keeps: far below any keypoint's sd.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

impl From<CarRecord> for CarFields {
    fn from(car: CarRecord) -> Self {
        let row = |p: &Keypoint| [p.pixel.x, p.pixel.y, p.score, p.sd_px()].map(rounded);
        let covariance = |p: &Keypoint| {
            let c = &p.covariance_px2;
            [c[(0, 0)], c[(0, 1)], c[(1, 1)]].map(rounded)
        };
        let isotropic = |p: &Keypoint| {
            let c = &p.covariance_px2;
            c[(0, 0)].to_bits() == c[(1, 1)].to_bits() && c[(0, 1)].abs() < f64::EPSILON
        };
        let set = car.keypoints.as_deref();
        let directed = set.filter(|set| !set.iter().flatten().all(isotropic));
        Self {
            bbox_px: car.bbox_px,
            score: car.score,
            class: car.class,
            keypoints: set.map(|set| set.iter().map(|p| p.as_ref().map(row)).collect()),
            keypoint_covariances_px2: directed
                .map(|set| set.iter().map(|p| p.as_ref().map(covariance)).collect()),
            held_since: car.held_since,
            pose_from: car.pose_from,
            seen_after: car.seen_after,
            extra: car.extra,
        }
    }
}

impl TryFrom<CarFields> for CarRecord {
    type Error = RecordError;

    fn try_from(fields: CarFields) -> Result<Self, RecordError> {
        let of_36 = |what: &str, found: usize| {
            (found == KEYPOINTS).then_some(()).ok_or_else(|| RecordError::Unsuitable {
                what: format!("{what} has {found} entries, expected {KEYPOINTS}"),
            })
        };
        let mut keypoints = None;
        if let Some(rows) = fields.keypoints {
            of_36("keypoints", rows.len())?;
            let isotropic = |row: Option<[f64; 4]>| {
                row.map(|[x, y, score, sd_px]| Keypoint::isotropic(Vector2::new(x, y), score, sd_px))
            };
            let mut set: Box<KeypointSet> = Box::new(std::array::from_fn(|i| isotropic(rows[i])));
            if let Some(covariances) = fields.keypoint_covariances_px2 {
                of_36("keypoint_covariances_px2", covariances.len())?;
                for (point, covariance) in set.iter_mut().zip(covariances) {
                    if let (Some(point), Some([xx, xy, yy])) = (point, covariance) {
                        point.covariance_px2 = Matrix2::new(xx, xy, xy, yy);
                    }
                }
            }
            keypoints = Some(set);
        }
        let CarFields { bbox_px, score, class, held_since, pose_from, seen_after, extra, .. } = fields;
        Ok(Self { bbox_px, score, class, keypoints, held_since, pose_from, seen_after, extra })
    }
}

/// How a camera's numbers came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraStatus {
    /// Focal length and plane both estimated from the cars.
    Estimated,
    /// The focal length was given, the plane is estimated.
    FocalGiven,
    /// The cars say too little of the focal length: it rests on the stated prior; the plane is estimated.
    FocalFromPrior,
    /// No camera could be estimated; numbers are the priors, with their wide sd.
    Unobservable,
}

/// A camera over a stretch of time, with uncertainty.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraEstimate {
    /// First and last presentation time that this holds for, s.
    pub span_s: [f64; 2],
    /// Size of the pictures.
    pub image_size_px: ImageSize,
    /// Principal point, px.
    pub principal_point_px: Vector2<f64>,
    /// How the lens bends lines.
    pub lens: Lens,
    /// sd of its bend ([`Lens::bend`]); `None` where the picture did not show it and it is taken for straight. What it does to the
    /// other numbers is in their covariance.
    pub bend_sd: Option<f64>,
    /// Focal length, tilt, roll, height.
    pub params: CameraParams,
    /// Covariance of (log focal, tilt, roll, log height).
    pub covariance: Matrix4<f64>,
    /// How the numbers came about.
    pub status: CameraStatus,
    /// Different cars that were used.
    pub cars_used: usize,
    /// Frames that were used.
    pub frames_used: usize,
}

impl CameraEstimate {
    /// The camera itself.
    #[must_use]
    pub fn camera(&self) -> Camera {
        Camera {
            focal_px: self.params.focal_px(),
            principal_point_px: self.principal_point_px,
            lens: self.lens,
        }
    }
}

/// The full solve of one car in one frame: a line of `poses.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseRecord {
    /// Index of the frame.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Position of the car in its frame's list.
    pub car: usize,
    /// Track that it belongs to, if any.
    #[serde(default)]
    pub track: Option<u64>,
    /// Box, px.
    pub bbox_px: [f64; 4],
    /// Detector's score.
    pub score: f64,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// 4 × 4 rigid motion, rows.
    pub world_from_car: [[f64; 4]; 4],
    /// 4 × 4 rigid motion, rows.
    pub camera_from_car: [[f64; 4]; 4],
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: [f64; MODES],
    /// Length, width, height, m.
    pub dims_m: [f64; 3],
    /// sd of world x, y (m) and heading (rad); infinite ones are null.
    pub pose_sd: [Option<f64>; 3],
    /// Per keypoint x, y, score, sd as measured.
    pub keypoints_px: Vec<Option<[f64; 4]>>,
    /// Root mean square of the used keypoints' residuals, px.
    pub reprojection_rms_px: f64,
    /// Whether the pose is good enough to be tracked.
    pub used: bool,
    /// The pose is held: it is that of this look, whose line has the keypoints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_from: Option<CarRef>,
}

/// 4 × 4 rows of a rigid motion.
#[must_use]
pub fn rows_from_isometry(motion: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let m = motion.to_homogeneous();
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}

/// One car in one frame of the result: a row of `tracks.*`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrackRow {
    /// Index of the frame.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Track's number, from 1.
    pub track: u64,
    /// World x of the car's origin, m.
    pub x_m: f64,
    /// World y of the car's origin, m.
    pub y_m: f64,
    /// 0 along +x, counter-clockwise, rad, (−π, π].
    pub heading_rad: f64,
    /// Speed over ground, m/s; negative when reversing.
    pub speed_mps: f64,
    /// sd of `x_m`, m: the car's own error and what all cars share, which is the camera's (`camera.json`).
    pub x_sd_m: f64,
    /// sd of `y_m`, m, likewise.
    pub y_sd_m: f64,
    /// sd of `heading_rad`, rad, likewise.
    pub heading_sd_rad: f64,
    /// Length of the vehicle, m, one per track.
    pub length_m: f64,
    /// Width without mirrors, m, one per track.
    pub width_m: f64,
    /// Height of the vehicle, m, one per track.
    pub height_m: f64,
    /// Box, px: measured, or projected where not observed.
    pub bbox_px: [f64; 4],
    /// Detector's score; 0 where not observed.
    pub score: f64,
    /// Seen in this frame, or filled in.
    pub observed: bool,
    /// Kind of vehicle, one per track.
    #[serde(default)]
    pub class: VehicleClass,
    /// Which of the `segments` of `camera.json` the coordinates belong to, from 0.
    #[serde(default)]
    pub segment: usize,
    /// sd of `speed_mps`, m/s, likewise; 0 in files of older versions.
    #[serde(default)]
    pub speed_sd_mps: f64,
    /// Activity, where asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activity: Option<String>,
    /// Its probability.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activity_p: Option<f64>,
    /// Where it is on the map, where the camera's place was given; each field is a column.
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    pub on_map: Option<OnMap>,
}

/// Where a car's origin is on the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OnMap {
    /// Degrees, WGS 84.
    pub latitude: f64,
    /// Degrees, WGS 84.
    pub longitude: f64,
    /// UTM zone of the next four, such as `33N`; one a file.
    pub utm_zone: String,
    /// East in the zone, m.
    pub east_m: f64,
    /// North in the zone, m.
    pub north_m: f64,
    /// sd of `east_m`, m: the car's own error, the camera's and that of the camera's place.
    pub east_sd_m: f64,
    /// sd of `north_m`, m, likewise.
    pub north_sd_m: f64,
    /// Where the vehicle points, degrees clockwise from the zone's north.
    pub bearing_deg: f64,
}

impl TrackRow {
    /// Where it stands and how it is turned, world frame.
    #[must_use]
    pub fn pose(&self) -> GroundPose {
        GroundPose { x_m: self.x_m, y_m: self.y_m, heading_rad: self.heading_rad }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(keypoint: &str) -> String {
        let nulls = vec!["null"; KEYPOINTS - 1].join(",");
        format!(
            r#"{{"frame":3,"time_s":0.1,"image_size_px":[640,480],"note":"kept","cars":[{{"bbox_px":[1,2,30,40],"score":0.9,"class":"car","keypoints":[{keypoint},{nulls}],"id":7}}]}}"#
        )
    }

    #[test]
    fn a_line_survives_with_unknown_fields() {
        let record = FrameRecord::from_json(&line("[10.5,20.25,0.75,1.5]")).unwrap();
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(FrameRecord::from_json(&text).unwrap(), record);
        assert!(text.contains(r#""note":"kept""#) && text.contains(r#""id":7"#));
        assert!(text.contains("[10.5,20.25,0.75,1.5]"), "{text}");
    }

    #[test]
    fn a_covariance_survives() {
        let mut record = FrameRecord::from_json(&line("[10.5,20.25,0.75,1.5]")).unwrap();
        if let Some(point) = record.cars[0].keypoints.as_mut().and_then(|set| set[0].as_mut()) {
            point.covariance_px2 = Matrix2::new(3.0, 0.5, 0.5, 1.5);
        }
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(FrameRecord::from_json(&text).unwrap(), record);
    }

    #[test]
    fn impossible_numbers_are_refused() {
        assert!(FrameRecord::from_json(&line("[10.5,20.25,0.75,0.0]")).is_err());
        assert!(FrameRecord::from_json(&line("[10.5,20.25,0.75]")).is_err());
        assert!(FrameRecord::from_json(&line("null").replace("[1,2,30,40]", "[30,2,1,40]")).is_err());
        assert!(FrameRecord::from_json("").is_err());
        let lines =
            |lines: &str| line("null").replace(r#""note""#, &format!(r#""scene_lines":{lines},"note""#));
        assert!(FrameRecord::from_json(&lines("[[1.0,2.0,1.5,40.0,0.01]]")).is_ok());
        assert!(FrameRecord::from_json(&lines("[[1.0,2.0,1.0,2.0,0.01]]")).is_err());
        assert!(FrameRecord::from_json(&lines("[[1.0,2.0,1.5,40.0,0.0]]")).is_err());
    }
}
