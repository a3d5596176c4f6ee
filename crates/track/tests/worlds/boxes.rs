//! Vehicles that only boxes show.

use nalgebra::{Matrix3, Vector2, Vector3};
use roadplane_base::{FrameStamp, GroundPose, Shape, VehicleClass};
use roadplane_measure::{Body, GroundContact, Knowledge};
use roadplane_synth::Rng;
use roadplane_track::{CarMeasurement, Detection, FrameMeasurements, Scene, Track, TrackOptions, Tracker};

use crate::world::{Path, body_box, camera, pose, straight, times};

/// Length, width and height of the lorry, m.
const LORRY_M: Vector3<f64> = Vector3::new(9.5, 2.5, 3.4);

/// A scene in which bodies are cuboids, and trucks have about the size of real ones.
struct Bodies;

impl Scene for Bodies {
    fn body(&self, class: VehicleClass, _: &Shape) -> Body {
        let (dims_m, sd) = match class {
            VehicleClass::Car => (Vector3::new(4.5, 1.8, 1.5), Vector3::repeat(0.3)),
            _ => (Vector3::new(7.5, 2.4, 3.0), Vector3::new(2.5, 0.2, 0.6)),
        };
        Body { class, dims_m, covariance: Matrix3::from_diagonal(&sd.component_mul(&sd)) }
    }

    fn body_px(
        &self,
        _: &FrameStamp,
        pose: &GroundPose,
        _: VehicleClass,
        dims_m: &Vector3<f64>,
    ) -> Option<[f64; 4]> {
        body_box(pose, dims_m)
    }

    fn place(&self, _: &FrameStamp, _: &Detection, _: &Knowledge) -> Option<GroundContact> {
        None
    }
}

/// Returns a measurement from one box: the vehicle is somewhere behind the centre of the lower edge.
fn measurement(class: VehicleClass, bbox_px: [f64; 4], axis_rad: f64) -> CarMeasurement {
    let (camera, plane) = camera();
    let [x0, _, x1, y1] = bbox_px;
    let foot = plane.world_from_pixel(&camera, &Vector2::new((x0 + x1) / 2.0, y1)).unwrap();
    let middle = foot * (1.0 + 2.0 / foot.norm());
    let covariance = Matrix3::from_diagonal(&Vector3::new(1.0, 4.0, 1.0));
    let seen = Detection { car: Some(0), ..Detection::uncut(bbox_px, 0.7, class) };
    CarMeasurement {
        dims_m: Some([Vector3::new(7.5, 2.4, 3.0), Vector3::new(2.5, 0.2, 0.6)]),
        ..CarMeasurement::by_box(pose(middle.x, middle.y, axis_rad), covariance, seen)
    }
}

/// Returns the path of a lorry that drives away at an angle and brakes. It is stationary from 5 s to 8 s and then
/// drives on.
fn lorry() -> Path {
    let (sin, cos) = 1.1f64.sin_cos();
    Box::new(move |t| {
        let (brakes, starts) = ((t - 2.0).clamp(0.0, 3.0), (t - 8.0).max(0.0));
        let metres = 6.0 * t.min(2.0) + 6.0 * brakes - brakes * brakes + starts * starts;
        Some(pose(-12.0 + metres * cos, 20.0 + metres * sin, 1.1))
    })
}

/// Tracks the boxes of a path. Their edges jitter by 2 px (sd), and `hide` changes them.
fn follow(path: &Path, hide: impl Fn(f64, &mut [f64; 4])) -> Vec<Track> {
    let mut random = Rng::new(5);
    let mut tracker = Tracker::new(TrackOptions::default());
    for (index, time_s) in times(11.0, 8.0).into_iter().enumerate() {
        let mut bbox_px = body_box(&path(time_s).unwrap(), &LORRY_M).unwrap();
        hide(time_s, &mut bbox_px);
        let bbox_px = bbox_px.map(|edge| edge + 2.0 * random.normal());
        let stamp = FrameStamp { index: index as u64, pts_nanos: (time_s * 1e9).round() as i64 };
        let axis_rad = 1.1 + 0.5 * random.normal();
        tracker
            .push(&FrameMeasurements::seen(stamp, vec![measurement(VehicleClass::Truck, bbox_px, axis_rad)]));
    }
    tracker.finish(&Bodies).tracks
}

/// Returns the only track, its largest position error (m), and its speeds (m/s) between 5.5 s and 7.5 s.
fn one(tracks: &[Track], path: &Path) -> (Track, f64, Vec<f64>) {
    assert_eq!(tracks.len(), 1, "{tracks:?}");
    let track = tracks[0].clone();
    let off = |state: &roadplane_track::TrackState| {
        let there = path(state.stamp.time_s()).unwrap();
        (state.pose.x_m - there.x_m).hypot(state.pose.y_m - there.y_m)
    };
    let worst = track.states.iter().map(off).fold(0.0, f64::max);
    let resting = track.states.iter().filter(|state| (5.5..7.5).contains(&state.stamp.time_s()));
    let speeds = resting.map(|state| state.speed_mps).collect();
    (track, worst, speeds)
}

#[test]
fn boxes_of_a_whole_path_show_where_a_lorry_is_and_how_long() {
    let (track, worst, speeds) = one(&follow(&lorry(), |_, _| {}), &lorry());
    let (dims_m, covariance) = (track.dims_m.unwrap(), track.dims_covariance.unwrap());
    println!("{worst:.2} m, {dims_m:?} ± {:.2} m", covariance[(0, 0)].sqrt());
    assert!(worst < 1.0);
    assert!(
        (dims_m.x - LORRY_M.x).abs() < 3.0 * covariance[(0, 0)].sqrt() && (dims_m.x - LORRY_M.x).abs() < 1.0
    );
    assert!(speeds.iter().all(|speed| *speed == 0.0), "{speeds:?}");
    for state in &track.states {
        assert!((state.pose.heading_rad - 1.1).abs() < 0.1, "{state:?}");
    }
}

#[test]
fn a_mast_before_a_lorry_moves_it_nowhere() {
    // Half of the lorry is hidden for a while, and again while it is stationary. No flag reports this.
    let hide = |time_s: f64, [x0, _, x1, _]: &mut [f64; 4]| {
        if (1.0..1.6).contains(&time_s) || (5.5..7.5).contains(&time_s) {
            *x0 += 0.5 * (*x1 - *x0);
        }
    };
    let (_, worst, speeds) = one(&follow(&lorry(), hide), &lorry());
    println!("{worst:.2} m");
    assert!(worst < 1.0);
    assert!(speeds.iter().all(|speed| *speed == 0.0), "{speeds:?}");
}

#[test]
fn a_bus_with_two_boxes_for_a_moment_is_one_vehicle() {
    let path = straight(pose(-9.0, 30.0, 0.0), 5.0);
    let mut tracker = Tracker::new(TrackOptions::default());
    for (index, time_s) in times(4.0, 10.0).into_iter().enumerate() {
        let [x0, y0, x1, y1] = body_box(&path(time_s).unwrap(), &LORRY_M).unwrap();
        let rear = [x0, y0, x0 + 0.6 * (x1 - x0), y1];
        let front = [x0 + 0.4 * (x1 - x0), y0, x1, y1];
        // An object hides the middle for a moment, and then the rear.
        let boxes = match index {
            0..20 => vec![[x0, y0, x1, y1]],
            20..22 => vec![rear, front],
            _ => vec![front],
        };
        let cars = boxes.into_iter().map(|bbox_px| measurement(VehicleClass::Bus, bbox_px, 0.0)).collect();
        let stamp = FrameStamp { index: index as u64, pts_nanos: (time_s * 1e9).round() as i64 };
        tracker.push(&FrameMeasurements::seen(stamp, cars));
    }
    let tracks = tracker.finish(&Bodies).tracks;
    assert_eq!(tracks.iter().map(|track| track.states.len()).collect::<Vec<_>>(), [40]);
}
