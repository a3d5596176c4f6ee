//! What is copied: the camera, and every vehicle with its trajectory, dimensions, mesh and colour.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use roadplane_base::{GroundPose, KEYPOINTS, MODES, Shape, ShapeAtlas, TrackRow, VehicleClass};
use roadplane_export::{Run, Stretch, Track};
use roadplane_write::CameraSegment;
use serde::Serialize;

use crate::mesh::CarMesh;
use crate::thin::{Body, Vertex, thinned};
use crate::wheels::Wheels;

/// Schema of `scene.json`.
pub const SCENE_SCHEMA: &str = "roadplane.scene/1";

/// Grey of cars whose colour nobody saw.
const UNSEEN: [u8; 3] = [128, 128, 128];
/// A car that is not looked at for longer than this was filled in, s; looks come every 0.1 s or so.
const INVENTED_S: f64 = 0.5;
/// Digits of times, metres and radians in the files.
const DIGITS: f64 = 1e5;

/// Mean colours of tracks in the picture, RGB.
pub type Colours = BTreeMap<u64, [u8; 3]>;

/// A scene.
#[derive(Debug, Serialize)]
pub struct Scene {
    /// [`SCENE_SCHEMA`].
    pub schema: String,
    /// Name of the run.
    pub name: String,
    /// First and last time, s; times of vehicles count from the first.
    pub span_s: [f64; 2],
    /// Frames a second of the run.
    pub frames_per_s: f64,
    /// The camera as it stood.
    pub camera: CameraSegment,
    /// Vehicles by track.
    pub vehicles: Vec<Vehicle>,
}

/// A vehicle.
#[derive(Debug, Serialize)]
pub struct Vehicle {
    /// Name in the scene: `car_` and the track's number.
    pub name: String,
    /// Track of the run.
    pub track: u64,
    /// Kind.
    pub class: VehicleClass,
    /// Length, width, height, m.
    pub dims_m: [f64; 3],
    /// Centre of the body forward of the origin, m.
    pub centre_m: f64,
    /// Its wheels.
    pub wheels: Wheels,
    /// Shape coefficients, each in units of its sd over all cars; those of a van for trucks and buses, which is stretched to their
    /// dimensions.
    pub shape: [f64; 6],
    /// Paint, RGB.
    pub colour: [u8; 3],
    /// When it is there, s from the scene's start.
    pub span_s: [f64; 2],
    /// Fastest, m/s.
    pub fastest_mps: f64,
    /// Its way; a single vertex where it stands all the time.
    pub trajectory: Vec<Vertex>,
    /// Stretches of time in which nobody looked at it: there its way is filled in.
    pub invented_s: Vec<[f64; 2]>,
    /// What it looks like.
    #[serde(skip)]
    pub mesh: CarMesh,
}

impl Scene {
    /// The longest stretch of a run between moves of the camera.
    ///
    /// `None` where the run has no vehicle in it.
    #[must_use]
    pub fn of(run: &Run, colours: &Colours, atlas: &ShapeAtlas) -> Option<Self> {
        let length = |stretch: &Stretch| stretch.camera.span_s[1] - stretch.camera.span_s[0];
        let longest = run.stretches.iter().rev().max_by(|a, b| length(a).total_cmp(&length(b)))?;
        let here = |track: &'_ Track| -> Vec<TrackRow> {
            track.rows.iter().filter(|row| longest.holds(row)).cloned().collect()
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

    /// Length, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.span_s[1] - self.span_s[0]
    }
}

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
            VehicleClass::Truck | VehicleClass::Bus => stretched_van(atlas, dims_m),
        };
        let wheels = Wheels::of(&points);
        let ends_m = [-0.5, 0.5].map(|share| track.centre_m + share * dims_m[0]);
        let body = Body { rear_axle_m: -wheels.half_wheelbase_m, ends_m };
        let way: Vec<Vertex> = rows.iter().map(|row| vertex(row, start_s)).collect();
        let trajectory = thinned(&way, &body)
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
            span_s: [way.first(), way.last()].map(|end| end.map_or(0.0, |vertex| digits(vertex.time_s))),
            fastest_mps: digits(rows.iter().map(|row| row.speed_mps.abs()).fold(0.0, f64::max)),
            trajectory,
            invented_s: invented(rows, start_s),
            mesh: CarMesh::new(&points, dims_m, track.centre_m),
        }
    }

    /// It stands all the time.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.trajectory.len() < 2
    }
}

/// Trucks and buses have no fitted shape: a mean van's, with their dimensions, the middle of its body at the origin.
fn stretched_van(atlas: &ShapeAtlas, dims_m: [f64; 3]) -> (Shape, [Vector3<f64>; KEYPOINTS]) {
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

/// Gaps between looks that are too long to count as seen.
fn invented(rows: &[TrackRow], start_s: f64) -> Vec<[f64; 2]> {
    let ends = [rows.first(), rows.last()].map(|end| end.map_or(0.0, |row| row.time_s));
    let mut looks = vec![ends[0]];
    looks.extend(rows.iter().filter(|row| row.observed).map(|row| row.time_s));
    looks.push(ends[1]);
    let gaps = looks.windows(2).filter(|pair| pair[1] - pair[0] > INVENTED_S);
    gaps.map(|pair| [digits(pair[0] - start_s), digits(pair[1] - start_s)]).collect()
}
