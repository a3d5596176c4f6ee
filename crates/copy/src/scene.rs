//! The scene: the camera, and every vehicle with its trajectory, dimensions, mesh and colour.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use roadplane_base::{GroundPose, KEYPOINTS, MODES, Shape, ShapeAtlas, TrackRow, VehicleClass};
use roadplane_export::{Run, RunSegment, Track};
use roadplane_write::{CameraSegment, FrameMotion};
use serde::Serialize;

use crate::mesh::CarMesh;
use crate::thin::{Body, Vertex, thinned};
use crate::wheels::Wheels;

/// Schema id of `scene.json`.
pub const SCENE_SCHEMA: &str = "roadplane.scene/1";

/// Colour of vehicles without a measured colour: grey, RGB.
const UNSEEN: [u8; 3] = [128, 128, 128];
/// Time between two detections above which the trajectory is marked as filled in, s. Usually a vehicle is detected
/// about every 0.1 s.
const INVENTED_S: f64 = 0.5;
/// Number of rounding steps per unit (second, metre or radian). The files have five decimals.
const DIGITS: f64 = 1e5;

/// Mean colour of each track's vehicle in the pictures, RGB, by track number.
pub type Colours = BTreeMap<u64, [u8; 3]>;

/// The scene of a run, as in `scene.json`.
#[derive(Debug, Serialize)]
pub struct Scene {
    /// Schema id: [`SCENE_SCHEMA`].
    pub schema: String,
    /// Name of the run. If the run has several segments, the number of the segment is added.
    pub name: String,
    /// First and last time of the scene, s from the start of the input. The times of vehicles are measured from the
    /// first time.
    pub span_s: [f64; 2],
    /// Frame rate of the run, frames per second.
    pub frames_per_s: f64,
    /// Camera and ground plane in the segment of the run that the scene shows.
    pub camera: CameraSegment,
    /// Motion of the camera, as in `camera.json` of the run. Absent if the camera was at rest.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub motion: Vec<FrameMotion>,
    /// Vehicles, sorted by track number.
    pub vehicles: Vec<Vehicle>,
}

/// A vehicle of a scene.
#[derive(Debug, Serialize)]
pub struct Vehicle {
    /// Name in the scene: `car_` followed by the track number.
    pub name: String,
    /// Number of the vehicle's track in the run.
    pub track: u64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Length, width and height of the vehicle, m.
    pub dims_m: [f64; 3],
    /// Distance from the vehicle's origin forward to the centre of its body, m.
    pub centre_m: f64,
    /// Positions and size of the wheels.
    pub wheels: Wheels,
    /// Shape coefficients. Each coefficient is in units of its standard deviation over all cars. A truck or bus has the
    /// coefficients of the mean van. The mesh of a truck or bus is the mesh of this van, scaled to `dims_m`.
    pub shape: [f64; 6],
    /// Colour of the paint, RGB.
    pub colour: [u8; 3],
    /// First and last time of the vehicle, s from the start of the scene.
    pub span_s: [f64; 2],
    /// Highest speed of the vehicle, m/s.
    pub fastest_mps: f64,
    /// Trajectory of the vehicle. It has a single vertex if the vehicle is stationary during the whole scene.
    pub trajectory: Vec<Vertex>,
    /// Intervals without a detection, s from the start of the scene. In these intervals the trajectory is filled in.
    pub invented_s: Vec<[f64; 2]>,
    /// Mesh of the body, without wheels.
    #[serde(skip)]
    pub mesh: CarMesh,
}

impl Scene {
    /// Whether vehicles of a second plane of the ground are on the first one here.
    #[must_use]
    pub fn is_flattened(&self) -> bool {
        self.camera.ground.len() > 1
    }

    /// Returns the scene of a run. If the camera was moved, it is the scene of the longest segment between camera
    /// moves.
    ///
    /// Returns `None` if the segment contains no vehicle.
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
        let is_here = |row: &&FrameMotion| span_s[0] <= row.time_s && row.time_s <= span_s[1];
        let motion = run.motion.values().filter(is_here).copied().collect();
        Some(Self {
            schema: SCENE_SCHEMA.to_owned(),
            name: longest.name.clone(),
            span_s,
            frames_per_s: run.frames_per_s,
            camera: longest.camera.clone(),
            motion,
            vehicles: of_tracks.iter().map(vehicle).collect(),
        })
    }

    /// Returns the duration of the scene, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.span_s[1] - self.span_s[0]
    }
}

/// Rounds a number to five decimals, as in the files.
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
            VehicleClass::Truck | VehicleClass::Bus | VehicleClass::Motorcycle => scaled_van(atlas, dims_m),
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

    /// Whether the vehicle is stationary during the whole scene.
    #[must_use]
    pub fn is_stationary(&self) -> bool {
        self.trajectory.len() < 2
    }
}

/// Returns the shape of the mean van, and the van's keypoints scaled to `dims_m`. The middle of the scaled body is at
/// the origin.
///
/// The van represents trucks and buses, which have no fitted shape.
fn scaled_van(atlas: &ShapeAtlas, dims_m: [f64; 3]) -> (Shape, [Vector3<f64>; KEYPOINTS]) {
    let van = atlas.body_types.iter().find(|body| body.name == "van");
    let shape =
        van.map_or_else(Shape::zeros, |van| atlas.clamped(&van.mean.fixed_rows::<MODES>(0).into_owned()));
    let points = atlas.keypoints_in_car(&shape);
    let middle = Vector3::new(atlas.body_middle_m(&shape), 0.0, 0.0);
    let scale = Vector3::from(dims_m).component_div(&atlas.dims_m(&shape));
    (shape, points.map(|point| (point - middle).component_mul(&scale)))
}

fn vertex(row: &TrackRow, start_s: f64) -> Vertex {
    let pose = row.pose();
    Vertex { time_s: row.time_s - start_s, pose }
}

/// Returns the intervals between detections that are longer than [`INVENTED_S`], s from the start of the scene.
fn invented(rows: &[TrackRow], start_s: f64) -> Vec<[f64; 2]> {
    let ends = [rows.first(), rows.last()].map(|end| end.map_or(0.0, |row| row.time_s));
    let mut observed_s = vec![ends[0]];
    observed_s.extend(rows.iter().filter(|row| row.observed).map(|row| row.time_s));
    observed_s.push(ends[1]);
    let gaps = observed_s.windows(2).filter(|pair| pair[1] - pair[0] > INVENTED_S);
    gaps.map(|pair| [digits(pair[0] - start_s), digits(pair[1] - start_s)]).collect()
}
