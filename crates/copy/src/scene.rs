//! The scene: the camera, and every vehicle with its trajectory, dimensions, mesh and colour.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use roadplane_base::{GroundPose, KEYPOINTS, MODES, Shape, ShapeAtlas, TrackRow, VehicleClass};
use roadplane_export::{Run, RunSegment, Track};
use roadplane_write::CameraSegment;
use serde::Serialize;

use crate::mesh::CarMesh;
use crate::thin::{Body, Vertex, thinned};
use crate::wheels::Wheels;

/// Schema of `scene.json`.
pub const SCENE_SCHEMA: &str = "roadplane.scene/1";

/// Grey of vehicles whose colour was not measured.
const UNSEEN: [u8; 3] = [128, 128, 128];
/// Longest gap between observations that is not marked as filled in, s. Observations come about every 0.1 s.
const INVENTED_S: f64 = 0.5;
/// Steps per second, metre and radian to which the files round: five decimals.
const DIGITS: f64 = 1e5;

/// Mean colours of tracks in the picture, RGB.
pub type Colours = BTreeMap<u64, [u8; 3]>;

/// The scene of a run, as in `scene.json`.
#[derive(Debug, Serialize)]
pub struct Scene {
    /// Name of the schema: [`SCENE_SCHEMA`].
    pub schema: String,
    /// Name of the run.
    pub name: String,
    /// First and last time, s. The times of vehicles count from the first.
    pub span_s: [f64; 2],
    /// Frames per second of the run.
    pub frames_per_s: f64,
    /// The camera in this segment of the run.
    pub camera: CameraSegment,
    /// Vehicles, by track.
    pub vehicles: Vec<Vehicle>,
}

/// A vehicle of a scene.
#[derive(Debug, Serialize)]
pub struct Vehicle {
    /// Name in the scene: `car_` and the track's number.
    pub name: String,
    /// Number of its track in the run.
    pub track: u64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Length, width, height, m.
    pub dims_m: [f64; 3],
    /// Distance from the origin forward to the centre of the body, m.
    pub centre_m: f64,
    /// Its wheels.
    pub wheels: Wheels,
    /// Shape coefficients, each in units of its sd over all cars. Trucks and buses have those of a van, which is scaled
    /// to their dimensions.
    pub shape: [f64; 6],
    /// Colour of the paint, RGB.
    pub colour: [u8; 3],
    /// First and last time of the vehicle, s from the start of the scene.
    pub span_s: [f64; 2],
    /// Highest speed, m/s.
    pub fastest_mps: f64,
    /// Its trajectory; a single vertex if it is stationary all the time.
    pub trajectory: Vec<Vertex>,
    /// Intervals without an observation, s from the start of the scene. Its trajectory is filled in there.
    pub invented_s: Vec<[f64; 2]>,
    /// Its body, without wheels.
    #[serde(skip)]
    pub mesh: CarMesh,
}

impl Scene {
    /// Returns the scene of the longest segment of a run between moves of the camera.
    ///
    /// `None` if that segment has no vehicle.
    #[must_use]
    pub fn of(run: &Run, colours: &Colours, atlas: &ShapeAtlas) -> Option<Self> {
        let length = |segment: &RunSegment| segment.camera.span_s[1] - segment.camera.span_s[0];
        let longest = run.segments.iter().rev().max_by(|a, b| length(a).total_cmp(&length(b)))?;
        let here = |track: &'_ Track| -> Vec<TrackRow> {
            track.rows.iter().filter(|row| longest.contains(row)).cloned().collect()
        };
        let of_tracks: Vec<(&Track, Vec<TrackRow>)> = run
            .tracks
            .iter()
            .map(|track| (track, here(track)))
            .filter(|(_, rows)| !rows.is_empty())
            .collect();
        let times = || of_tracks.iter().flat_map(|(_, rows)| rows).map(|row| row.time_s);
        let span_s = [times().reduce(f64::min)?, times().reduce(f64::max)?];
        let vehicle = |(track, rows): &(&Track, Vec<TrackRow>)| {
            Vehicle::new(track, rows, span_s[0], colours.get(&track.id).copied(), atlas)
        };
        Some(Self {
            schema: SCENE_SCHEMA.to_owned(),
            name: longest.name.clone(),
            span_s,
            frames_per_s: run.frames_per_s,
            camera: longest.camera.clone(),
            vehicles: of_tracks.iter().map(vehicle).collect(),
        })
    }

    /// Returns the length of the scene, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.span_s[1] - self.span_s[0]
    }
}

/// Rounds to the decimals of the files.
fn digits(value: f64) -> f64 {
    (value * DIGITS).round() / DIGITS + 0.0
}

impl Vehicle {
    fn new(
        track: &Track,
        rows: &[TrackRow],
        start_s: f64,
        colour: Option<[u8; 3]>,
        atlas: &ShapeAtlas,
    ) -> Self {
        let dims_m = track.dims_m();
        let (shape, points) = match track.class {
            VehicleClass::Car => (track.shape, atlas.keypoints_in_car(&track.shape)),
            VehicleClass::Truck | VehicleClass::Bus => scaled_van(atlas, dims_m),
        };
        let wheels = Wheels::of(&points);
        let ends_m = [-0.5, 0.5].map(|share| track.centre_m + share * dims_m[0]);
        let body = Body { rear_axle_m: -wheels.half_wheelbase_m, ends_m };
        let vertices: Vec<Vertex> = rows.iter().map(|row| vertex(row, start_s)).collect();
        let trajectory = thinned(&vertices, &body)
            .into_iter()
            .map(|Vertex { time_s, pose: p }| Vertex {
                time_s: digits(time_s),
                pose: GroundPose {
                    x_m: digits(p.x_m),
                    y_m: digits(p.y_m),
                    heading_rad: digits(p.heading_rad),
                },
            })
            .collect();
        Self {
            name: format!("car_{}", track.id),
            track: track.id,
            class: track.class,
            dims_m,
            centre_m: digits(track.centre_m),
            wheels,
            shape: shape.into(),
            colour: colour.unwrap_or(UNSEEN),
            span_s: [vertices.first(), vertices.last()]
                .map(|end| end.map_or(0.0, |vertex| digits(vertex.time_s))),
            fastest_mps: digits(rows.iter().map(|row| row.speed_mps.abs()).fold(0.0, f64::max)),
            trajectory,
            invented_s: invented(rows, start_s),
            mesh: CarMesh::new(&points, dims_m, track.centre_m),
        }
    }

    /// Whether it is stationary all the time.
    #[must_use]
    pub fn is_stationary(&self) -> bool {
        self.trajectory.len() < 2
    }
}

/// Returns the shape and keypoints of the mean van, scaled to these dimensions, with the middle of its body at the
/// origin.
///
/// Trucks and buses have no fitted shape.
fn scaled_van(atlas: &ShapeAtlas, dims_m: [f64; 3]) -> (Shape, [Vector3<f64>; KEYPOINTS]) {
    let van = atlas.body_types.iter().find(|body| body.name == "van");
    let shape =
        van.map_or_else(Shape::zeros, |van| atlas.clamped(&van.mean.fixed_rows::<MODES>(0).into_owned()));
    let points = atlas.keypoints_in_car(&shape);
    let [foremost, rearmost] =
        [f64::max, f64::min].map(|pick| points.iter().map(|p| p.x).reduce(pick).unwrap_or(0.0));
    let middle = Vector3::new(f64::midpoint(foremost, rearmost), 0.0, 0.0);
    let scale = Vector3::from(dims_m).component_div(&atlas.dims_m(&shape));
    (shape, points.map(|point| (point - middle).component_mul(&scale)))
}

fn vertex(row: &TrackRow, start_s: f64) -> Vertex {
    let pose = row.pose();
    Vertex { time_s: row.time_s - start_s, pose }
}

/// Returns the gaps between observations that are longer than [`INVENTED_S`], s from the start of the scene.
fn invented(rows: &[TrackRow], start_s: f64) -> Vec<[f64; 2]> {
    let ends = [rows.first(), rows.last()].map(|end| end.map_or(0.0, |row| row.time_s));
    let mut observed_s = vec![ends[0]];
    observed_s.extend(rows.iter().filter(|row| row.observed).map(|row| row.time_s));
    observed_s.push(ends[1]);
    let gaps = observed_s.windows(2).filter(|pair| pair[1] - pair[0] > INVENTED_S);
    gaps.map(|pair| [digits(pair[0] - start_s), digits(pair[1] - start_s)]).collect()
}
