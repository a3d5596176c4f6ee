//! Weak boxes, of which the detector is uncertain.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Vector2, Vector3};
use roadplane_base::{FrameStamp, GroundPose, VehicleClass};
use roadplane_measure::{GroundContact, Knowledge};
use roadplane_track::{Detection, FrameMeasurements, Scene, Track, TrackOptions, Tracker};

use crate::world::{Path, Seeing, World, box_of, camera, parked, pose, straight, times};

/// A scene in which a vehicle is one metre behind the centre of its box's lower edge.
struct OnTheGround;

impl Scene for OnTheGround {
    fn place(&self, _: &FrameStamp, seen: &Detection, vehicle: &Knowledge) -> Option<GroundContact> {
        let (camera, plane) = camera();
        let [x0, _, x1, y1] = seen.bbox_px;
        let foot = plane.world_from_pixel(&camera, &Vector2::new((x0 + x1) / 2.0, y1))?;
        let middle = foot * (1.0 + 1.0 / foot.norm());
        let (heading_rad, sd_rad) = match vehicle {
            Knowledge::Label(_) => (0.0, FRAC_PI_2),
            Knowledge::Track { heading_rad, heading_sd_rad, .. } => (*heading_rad, *heading_sd_rad),
        };
        let covariance = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sd_rad.powi(2)));
        let dims_m = [Vector3::new(4.5, 1.8, 1.5), Vector3::repeat(0.3)];
        Some(GroundContact { pose: pose(middle.x, middle.y, heading_rad), covariance, dims_m })
    }
}

/// Returns a box of the detector. A certain box has the index `car` in the frame's list.
fn seen(bbox_px: [f64; 4], car: Option<usize>) -> Detection {
    let score = if car.is_some() { 0.6 } else { 0.4 };
    Detection { car, ..Detection::uncut(bbox_px, score, VehicleClass::Car) }
}

/// Returns the frames of a world in which the detector is certain of the cars only from 2 s to 4 s. One false box stays
/// in its position and one jumps.
fn unsure(cars: Vec<Path>) -> Vec<FrameMeasurements> {
    let mut frames = World::new(cars, Seeing::perfect(), times(6.0, 10.0), 3).see().frames;
    for (i, frame) in frames.iter_mut().enumerate() {
        let weak = |bbox_px| seen(bbox_px, None);
        if !(20..40).contains(&i) {
            frame.boxes = frame.cars.drain(..).map(|car| weak(car.detection.bbox_px)).collect();
        }
        let jump = 130.0 * (4 * i % 11) as f64;
        frame.boxes.push(weak([100.0 + jump, 700.0, 220.0 + jump, 780.0]));
        frame.boxes.push(weak([1500.0, 300.0, 1580.0, 350.0]));
    }
    frames
}

/// Returns the tracks of these frames.
fn follow(frames: &[FrameMeasurements], scene: &impl Scene) -> Vec<Track> {
    let mut tracker = Tracker::new(TrackOptions::default());
    frames.iter().for_each(|frame| tracker.push(frame));
    tracker.finish(scene).tracks
}

#[test]
fn weak_boxes_lengthen_tracks_at_both_ends_and_begin_none() {
    let drive = || straight(pose(-8.0, 26.0, 0.1), 3.0);
    let frames = unsure(vec![drive(), parked(4.0, 22.0, 1.2)]);
    let alone = follow(&frames, &());
    assert_eq!(alone.iter().map(|track| track.states.len()).collect::<Vec<_>>(), [20, 20]);
    let tracks = follow(&frames, &OnTheGround);
    assert_eq!(tracks.len(), 2);
    for track in &tracks {
        assert_eq!(track.states.len(), 60);
        for (i, state) in track.states.iter().enumerate() {
            assert!(state.bbox_px.is_some() && state.car.is_some() == (20..40).contains(&i), "frame {i}");
            let at = |path: Path| path(0.1 * i as f64).unwrap();
            let off = |pose: GroundPose| (state.pose.x_m - pose.x_m).hypot(state.pose.y_m - pose.y_m);
            let off_m = off(at(drive())).min(off(pose(4.0, 22.0, 1.2)));
            assert!(off_m < 1.5, "frame {i}: {off_m} m");
        }
    }
}

#[test]
fn a_weak_box_elsewhere_or_of_another_size_is_nobody() {
    let mut frames = unsure(vec![straight(pose(-8.0, 26.0, 0.1), 3.0)]);
    let true_box = |i: usize| box_of(&straight(pose(-8.0, 26.0, 0.1), 3.0)(0.1 * i as f64).unwrap()).unwrap();
    for (i, frame) in frames.iter_mut().enumerate().filter(|(i, _)| !(20..40).contains(i)) {
        let [x0, y0, x1, y1] = true_box(i);
        let (width, height) = (x1 - x0, y1 - y0);
        // The box is twice as wide and high, or it lies one box's width to the side.
        frame.boxes[0].bbox_px = if i < 20 {
            [x0 - width / 2.0, y0 - height, x1 + width / 2.0, y1]
        } else {
            [x0 + width, y0, x1 + width, y1]
        };
    }
    let tracks = follow(&frames, &OnTheGround);
    assert_eq!(tracks.iter().map(|track| track.states.len()).collect::<Vec<_>>(), [20]);
}

#[test]
fn a_chain_goes_on_after_a_gap_if_the_vehicle_hardly_moved() {
    // There are no boxes from 4 s to 4.8 s.
    let begins_and_ends = |speed_mps: f64| {
        let mut frames = unsure(vec![straight(pose(-3.0, 26.0, 0.1), speed_mps)]);
        for frame in &mut frames[40..48] {
            frame.boxes.remove(0);
        }
        let tracks = follow(&frames, &OnTheGround);
        assert_eq!(tracks.len(), 1);
        (tracks[0].states[0].stamp.index, tracks[0].states.last().unwrap().stamp.index)
    };
    assert_eq!((begins_and_ends(0.8), begins_and_ends(2.5)), ((0, 59), (0, 39)));
}

#[test]
fn a_car_that_drives_past_is_not_in_a_stationary_weak_box() {
    let drive = || straight(pose(-14.0, 30.0, 0.0), 6.0);
    let mut frames = unsure(vec![drive()]);
    let passed = box_of(&drive()(1.8).unwrap()).unwrap();
    // The car passed this position just before the detector was certain of it. There is always a weak box there, and
    // the car has no box of its own.
    frames.iter_mut().for_each(|frame| frame.boxes[0].bbox_px = passed);
    let begins = |frames: &[FrameMeasurements]| {
        let tracks = follow(frames, &OnTheGround);
        assert_eq!(tracks.len(), 1);
        tracks[0].states[0].stamp.index
    };
    assert_eq!(begins(&frames), 20);
    for (_, frame) in frames.iter_mut().enumerate().filter(|(i, _)| *i != 18) {
        frame.boxes.remove(0);
    }
    assert_eq!(begins(&frames), 18);
}

#[test]
fn a_car_that_shows_no_keypoints_at_first_is_the_one_that_does_later() {
    let world = World::new(vec![parked(4.0, 22.0, 1.2)], Seeing::perfect(), times(6.0, 10.0), 3);
    let mut frames = world.see().frames;
    for frame in &mut frames[..20] {
        let car = &mut frame.cars[0];
        car.from_box = true;
        frame.boxes.push(seen(car.detection.bbox_px, car.detection.car));
    }
    assert_eq!(follow(&frames, &())[0].states.len(), 40);
    let tracks = follow(&frames, &OnTheGround);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks[0].states.len(), 60);
    assert!(tracks[0].states.iter().all(|state| state.bbox_px.is_some() && state.car.is_some()));
}

/// Returns the frames of a car of which the detector is certain in every `nth` frame.
fn sure_now_and_then(car: Path, nth: usize) -> Vec<FrameMeasurements> {
    let mut frames = World::new(vec![car], Seeing::perfect(), times(6.0, 10.0), 3).see().frames;
    for (i, frame) in frames.iter_mut().enumerate() {
        let is_sure = i % nth == 0;
        frame.boxes = frame
            .cars
            .iter()
            .map(|car| seen(car.detection.bbox_px, car.detection.car.filter(|_| is_sure)))
            .collect();
        frame.cars.retain(|_| is_sure);
    }
    frames
}

#[test]
fn what_drives_and_is_sure_now_and_then_is_a_vehicle() {
    let drive = || straight(pose(-8.0, 26.0, 0.1), 3.0);
    let frames = sure_now_and_then(drive(), 6);
    assert!(follow(&frames, &()).is_empty());
    let tracks = follow(&frames, &OnTheGround);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks[0].states.len(), 60);
    for (i, state) in tracks[0].states.iter().enumerate() {
        let at = drive()(0.1 * i as f64).unwrap();
        let off_m = (state.pose.x_m - at.x_m).hypot(state.pose.y_m - at.y_m);
        assert!(state.bbox_px.is_some() && off_m < 1.5, "frame {i}: {off_m} m");
        // The path gives the heading, as boxes have no front.
        assert!((state.pose.heading_rad - at.heading_rad).abs() < 0.2 && (state.speed_mps - 3.0).abs() < 0.6);
    }
    // Without a certain box there is no track.
    assert!(follow(&sure_now_and_then(drive(), 100), &OnTheGround).is_empty());
}

#[test]
fn a_stationary_car_with_high_scores_needs_no_keypoints() {
    let bbox_px = box_of(&pose(4.0, 22.0, 1.2)).unwrap();
    let tracks = |score: f64, found: fn(u64) -> bool, carried: fn(u64) -> bool| {
        let stamp = |i: u64| FrameStamp { index: i, pts_nanos: i as i64 * 100_000_000 };
        // The boxes jitter, which is no driving.
        let jitter = |i: u64| 3.0 * ((i * 7 % 5) as f64 - 2.0);
        let jittered = |i| bbox_px.map(|px| px + jitter(i));
        let detection = |i| Detection { score, carried_over: carried(i), ..seen(jittered(i), Some(0)) };
        let boxes = |i| Vec::from_iter(found(i).then(|| detection(i)));
        let frame = |i| FrameMeasurements {
            boxes: boxes(i),
            is_inferred: !carried(i),
            ..FrameMeasurements::seen(stamp(i), vec![])
        };
        follow(&(0..60).map(frame).collect::<Vec<_>>(), &OnTheGround)
    };
    let found = tracks(0.7, |_| true, |_| false);
    assert_eq!((found.len(), found[0].states.len()), (1, 60));
    let at = found[0].states[30].pose;
    assert!((at.x_m - 4.0).hypot(at.y_m - 22.0) < 2.0 && found[0].states[30].speed_mps == 0.0);
    assert!(found[0].states.iter().all(|state| state.pose_sd.z > 0.5), "its heading is unknown");
    // None of these makes a track: a doubtful box, and one that is carried over from the start.
    assert!(tracks(0.1, |_| true, |_| false).is_empty() && tracks(0.7, |_| true, |i| i > 0).is_empty());
    assert_eq!(tracks(0.7, |_| true, |i| i > 5).len(), 1);
}

#[test]
fn a_part_of_a_vehicle_that_goes_along_with_it_is_no_vehicle() {
    let drive = || straight(pose(-8.0, 26.0, 0.1), 3.0);
    let mut frames = World::new(vec![drive()], Seeing::perfect(), times(6.0, 10.0), 3).see().frames;
    let behind = |frames: &mut [FrameMeasurements], gap_px: f64| {
        for (i, frame) in frames.iter_mut().enumerate() {
            let [x0, y0, x1, y1] = frame.cars[0].detection.bbox_px;
            let part = [2.0 * x0 - x1 - gap_px, y0, x0 - gap_px, y1];
            let sure = (i % 6 == 0).then_some(1);
            frame.boxes = vec![seen([x0, y0, x1, y1], frame.cars[0].detection.car), seen(part, sure)];
        }
    };
    behind(&mut frames, -5.0);
    assert_eq!(follow(&frames, &OnTheGround).len(), 1);
    behind(&mut frames, 20.0);
    assert_eq!(follow(&frames, &OnTheGround).len(), 2);
}
