//! Validates keypoints, fitted cars and tracks.
//!
//! Nets find keypoints in any object, and the solver fits a car to them.

use nalgebra::{Isometry3, Point3};
use roadplane_base::{Camera, KEYPOINTS, KeypointSet, Shape, ShapeAtlas, VehicleClass, bbox_iou};
use roadplane_track::{Looks, SURE_SCORE, Track, TrackState};

use crate::Config;

/// Returns the keypoints whose score is at least `solve.min_keypoint_score`.
#[must_use]
pub fn usable(keypoints: &KeypointSet, config: &Config) -> KeypointSet {
    keypoints.map(|point| point.filter(|point| point.score >= config.solve.min_keypoint_score))
}

/// Returns the box around the projected keypoints of a car, px; `None` if a part of it is not in front of the camera.
#[must_use]
pub fn projected_box(
    atlas: &ShapeAtlas,
    camera: &Camera,
    camera_from_car: &Isometry3<f64>,
    shape: &Shape,
) -> Option<[f64; 4]> {
    let mut bbox = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for index in 0..KEYPOINTS {
        let point = Point3::from(atlas.keypoint_in_car(index, shape));
        let pixel = camera.pixel_from_camera(&(camera_from_car * point).coords)?;
        bbox = [bbox[0].min(pixel.x), bbox[1].min(pixel.y), bbox[2].max(pixel.x), bbox[3].max(pixel.y)];
    }
    Some(bbox)
}

/// Returns whether a fit is valid.
///
/// A fit is valid if its keypoints are near their projections, and its projected box agrees with the detected one. Only
/// the part of the box inside the picture, `picture_px`, counts.
#[must_use]
pub fn is_believable(
    projected_px: Option<[f64; 4]>,
    bbox_px: &[f64; 4],
    reprojection_rms_px: f64,
    picture_px: &[f64; 4],
    config: &Config,
) -> bool {
    let Some(projected_px) = projected_px else { return false };
    let side_px = (bbox_px[2] - bbox_px[0]).max(bbox_px[3] - bbox_px[1]);
    overlap_inside(&projected_px, bbox_px, picture_px) >= config.solve.min_box_overlap
        && reprojection_rms_px <= config.solve.max_rms_share * side_px
}

/// Returns the overlap (intersection over union) of a projected box with a detected one.
///
/// Only the part of the projected box inside the picture counts.
#[must_use]
pub fn overlap_inside(
    [x0, y0, x1, y1]: &[f64; 4],
    bbox_px: &[f64; 4],
    [left, top, right, bottom]: &[f64; 4],
) -> f64 {
    bbox_iou(&[x0.max(*left), y0.max(*top), x1.min(*right), y1.min(*bottom)], bbox_px)
}

/// Least displacement of a moving vehicle while it is observed, m.
const DRIVEN_M: f64 = 3.0;
/// Largest overlap (intersection over union) of a moving vehicle's last box with its first one. Far away, positions can
/// jitter by [`DRIVEN_M`] while the box stays.
const LEFT_OVERLAP: f64 = 0.5;
/// Largest time between two detections between which motion counts as observed, s.
const SEEN_MOVING_S: f64 = 1.0;
/// Least height of a doubtful stationary vehicle, m; few cars are lower.
const MIN_HEIGHT_M: f64 = 1.3;
/// Least duration of a doubtful stationary vehicle, s.
const MIN_SEEN_S: f64 = 2.0;
/// Least duration of a doubtful stationary vehicle in a short clip, as a share of the clip.
const MIN_CLIP_SHARE: f64 = 0.75;
/// Least share of inference frames in which a doubtful vehicle is detected. Frames in which it is carried over do not
/// count.
const MIN_SEEN_SHARE: f64 = 0.5;
/// Least duration of a stationary vehicle, s, if only a part of its track has this share. It is longer, because one of
/// many parts may have the share by chance.
const MIN_PART_S: f64 = 5.0;
/// Largest difference between two times of one frame, s; time stamps are rounded.
const SAME_TIME_S: f64 = 1e-6;

/// Returns the existence interval of a track, s: the time in which it is a vehicle. `None` if it never is.
///
/// Hedges, road markings and waiting motorcycles are detected as cars again and again at one position. Such tracks have
/// low scores, are short, are detected in few inference frames, lack keypoints, or have sizes that no car has. A
/// vehicle that drives need not exist for long. Vehicles far away, or hidden by others, are detected in few frames.
/// Such a vehicle exists while most inference frames detect it.
///
/// `looked_s` contains the times of the inference frames, in order, s.
#[must_use]
pub fn vehicle_s(track: &Track, height_m: f64, looked_s: &[f64]) -> Option<[f64; 2]> {
    let seen: Vec<&TrackState> = track.states.iter().filter(|state| state.observed).collect();
    let (first, last) = seen.first().zip(seen.last())?;
    let life_s = [first.stamp.time_s(), last.stamp.time_s()];
    let score = seen.iter().map(|state| state.score).sum::<f64>() / seen.len() as f64;
    if score >= SURE_SCORE {
        return Some(life_s);
    }
    let looks = looks_at(&seen, life_s, looked_s);
    let share = looks.iter().filter(|look| look.is_seen).count() as f64 / looks.len().max(1) as f64;
    let is_whole = share >= MIN_SEEN_SHARE;
    let [from_s, to_s] = if is_whole { life_s } else { mostly_seen_s(&looks) };
    let seen: Vec<&TrackState> =
        seen.into_iter().filter(|state| (from_s..=to_s).contains(&state.stamp.time_s())).collect();
    let near = |a: &&TrackState, b: &&TrackState| b.stamp.time_s() - a.stamp.time_s() <= SEEN_MOVING_S;
    let clip_s = looked_s.last().zip(looked_s.first()).map_or(0.0, |(last, first)| last - first);
    let least_s = if is_whole { MIN_SEEN_S.min(MIN_CLIP_SHARE * clip_s) } else { MIN_PART_S };
    // Keypoints distinguish a car from similar objects. Nothing but motion distinguishes a bus from a shelter, if the
    // clip is long enough to show it.
    let is_determined = match track.class {
        VehicleClass::Car => {
            let looks = || seen.iter().filter(|state| !state.held);
            2 * looks().filter(|state| state.lacks_keypoints).count() <= looks().count()
        }
        _ => clip_s < MIN_PART_S,
    };
    let stands = is_determined && height_m >= MIN_HEIGHT_M && to_s - from_s >= least_s;
    (stands || seen.chunk_by(near).any(drives)).then_some([from_s, to_s])
}

/// An inference frame, or several in quick succession, and whether the vehicle was detected.
struct LookAt {
    /// Time of the first frame, s.
    from_s: f64,
    /// Time of the last frame, s.
    to_s: f64,
    /// Whether the vehicle was detected.
    is_seen: bool,
}

/// Returns the inference frames during a vehicle's life, without those in which it was carried over.
fn looks_at(seen: &[&TrackState], [from_s, to_s]: [f64; 2], looked_s: &[f64]) -> Vec<LookAt> {
    let mut states = seen.iter().peekable();
    let mut apart = Looks::default();
    let mut looks: Vec<LookAt> = Vec::new();
    for &time_s in
        looked_s.iter().filter(|time_s| (from_s - SAME_TIME_S..=to_s + SAME_TIME_S).contains(*time_s))
    {
        while states.next_if(|state| state.stamp.time_s() < time_s - SAME_TIME_S).is_some() {}
        let then = states.peek().filter(|state| state.stamp.time_s() < time_s + SAME_TIME_S);
        if then.is_some_and(|state| state.held) {
            continue;
        }
        let is_seen = then.is_some();
        match looks.last_mut().filter(|_| !apart.add(time_s)) {
            Some(look) => *look = LookAt { to_s: time_s, is_seen: look.is_seen || is_seen, ..*look },
            None => looks.push(LookAt { from_s: time_s, to_s: time_s, is_seen }),
        }
    }
    looks
}

/// Returns the interval in which most inference frames detect a vehicle, s.
///
/// This is the interval with the largest surplus of frames with a detection over frames without one (Kadane's maximum
/// subarray).
fn mostly_seen_s(looks: &[LookAt]) -> [f64; 2] {
    let (mut best, mut best_s, mut sum, mut since_s) =
        (0_i64, [f64::INFINITY, f64::NEG_INFINITY], 0_i64, 0.0);
    for look in looks {
        if sum <= 0 {
            (sum, since_s) = (0, look.from_s);
        }
        sum += if look.is_seen { 1 } else { -1 };
        if sum > best {
            (best, best_s) = (sum, [since_s - SAME_TIME_S, look.to_s + SAME_TIME_S]);
        }
    }
    best_s
}

/// Returns whether a vehicle moved to another position while it was observed.
fn drives(seen: &[&TrackState]) -> bool {
    let (Some(first), Some(last)) = (seen.first(), seen.last()) else { return false };
    let way = (last.pose.x_m - first.pose.x_m).hypot(last.pose.y_m - first.pose.y_m);
    let left = first.bbox_px.zip(last.bbox_px).is_none_or(|(a, b)| bbox_iou(&a, &b) < LEFT_OVERLAP);
    way >= DRIVEN_M && left
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{FrameStamp, GroundPose, ImageSize};
    use roadplane_track::ShapeBelief;

    /// Size of the test pictures, px.
    const SIZE: ImageSize = ImageSize { width: 640, height: 480 };

    /// Returns whether a track is a vehicle at any time.
    fn is_vehicle(track: &Track, height_m: f64, looked_s: &[f64]) -> bool {
        vehicle_s(track, height_m, looked_s).is_some()
    }

    /// Returns a track of `count` detections, 0.1 s apart, from x = 0 to `to_m`.
    fn track(count: u64, score: f64, to_m: f64) -> Track {
        let way = |i: u64| to_m * i as f64 / count as f64;
        let state = |i: u64| TrackState {
            stamp: FrameStamp { index: i, pts_nanos: i as i64 * 100_000_000 },
            observed: true,
            held: false,
            pose: GroundPose { x_m: way(i), y_m: 30.0, heading_rad: 0.0 },
            pose_sd: nalgebra::Vector3::repeat(0.1),
            speed_mps: 0.0,
            speed_sd_mps: 0.1,
            bbox_px: Some([10.0 * way(i), 0.0, 40.0 + 10.0 * way(i), 30.0]),
            score,
            car: Some(0),
            lacks_keypoints: false,
        };
        Track {
            id: 1,
            class: VehicleClass::Car,
            dims_m: None,
            dims_covariance: None,
            states: (0..count).map(state).collect(),
            shape: ShapeBelief::default(),
        }
    }

    #[test]
    fn what_hardly_shows_and_stands_is_no_vehicle() {
        let looked_s: Vec<f64> = (0..100).map(|i| 0.1 * f64::from(i)).collect();
        let is = |count, score, to_m, height_m| is_vehicle(&track(count, score, to_m), height_m, &looked_s);
        assert!(is(40, 0.4, 0.0, 1.5) && is(10, 0.6, 0.0, 1.5) && is(10, 0.4, 9.0, 1.5));
        // Not a vehicle: one that exists briefly, one lower than any car, one detected in every third inference frame.
        assert!(!is(10, 0.4, 0.0, 1.5) && !is(40, 0.4, 0.0, 1.0));
        let mut seldom = track(100, 0.4, 0.0);
        seldom.states = seldom.states.into_iter().step_by(3).collect();
        assert!(!is_vehicle(&seldom, 1.5, &looked_s));
        // Not a vehicle: one whose positions drift while its box stays, and one found here and, after a while, there.
        let mut wanders = track(10, 0.4, 9.0);
        wanders.states.iter_mut().for_each(|state| state.bbox_px = Some([0.0, 0.0, 40.0, 30.0]));
        assert!(!is_vehicle(&wanders, 1.5, &looked_s));
        let mut jumps = track(10, 0.4, 9.0);
        for state in &mut jumps.states[5..] {
            state.stamp.pts_nanos += 950_000_000;
        }
        for (i, state) in jumps.states.iter_mut().enumerate() {
            state.pose.x_m = if i < 5 { 0.0 } else { 9.0 };
        }
        assert!(!is_vehicle(&jumps, 1.5, &looked_s));
        // Carried over between a few of many inference frames that detected it.
        let mut held = track(100, 0.4, 0.0);
        for state in &mut held.states[10..80] {
            state.held = true;
        }
        assert!(is_vehicle(&held, 1.5, &looked_s));
        held.states.retain(|state| state.held || state.stamp.index.is_multiple_of(3));
        assert!(!is_vehicle(&held, 1.5, &looked_s));
        // Rarely detected at first, then for long enough. If it moves in that part, the part need not be long.
        let long_s: Vec<f64> = (0..200).map(|i| 0.1 * f64::from(i)).collect();
        let of_part = |last: u64, to_m: f64| {
            let mut later = track(200, 0.4, to_m);
            later.states.retain(|s| s.stamp.index >= 200 - last || s.stamp.index.is_multiple_of(5));
            vehicle_s(&later, 1.5, &long_s).map(|[from_s, to_s]| (from_s.round(), to_s.round()))
        };
        assert_eq!((of_part(60, 0.0), of_part(40, 0.0)), (Some((14.0, 20.0)), None));
        assert_eq!((of_part(40, 20.0), of_part(40, 8.0)), (Some((16.0, 20.0)), None));
        // Inference frames in quick succession count as one.
        let often: Vec<f64> = (0..300).map(|i| f64::from(i) / 30.0).collect();
        assert!(is_vehicle(&track(40, 0.4, 0.0), 1.5, &often));
        // A vehicle that appears late in a short clip. A still picture has no time to show more.
        let short: Vec<f64> = (0..16).map(|i| 0.1 * f64::from(i)).collect();
        assert!(
            !is_vehicle(&track(9, 0.35, 0.0), 1.5, &short) && is_vehicle(&track(14, 0.35, 0.0), 1.5, &short)
        );
        assert!(is_vehicle(&track(1, 0.4, 0.0), 1.5, &[0.0]));
    }

    #[test]
    fn a_doubtful_car_that_stands_must_have_the_keypoints_of_one() {
        let looked_s: Vec<f64> = (0..100).map(|i| 0.1 * f64::from(i)).collect();
        let lacking = |count: usize, score, to_m| {
            let mut track = track(40, score, to_m);
            track.states.iter_mut().take(count).for_each(|state| state.lacks_keypoints = true);
            track
        };
        let is = |count, score, to_m| is_vehicle(&lacking(count, score, to_m), 1.5, &looked_s);
        assert!(is(20, 0.4, 0.0) && !is(21, 0.4, 0.0));
        assert!(is(40, 0.6, 0.0) && is(40, 0.4, 9.0), "sure of it; seen to drive");
        // Carried over from its tenth detection on, which has no keypoints, or a car's keypoints.
        let held = |last_lacks: bool| {
            let mut track = lacking(0, 0.4, 0.0);
            for (i, state) in track.states.iter_mut().enumerate() {
                (state.held, state.lacks_keypoints) = (i > 9, (i >= 9) == last_lacks);
            }
            is_vehicle(&track, 1.5, &looked_s)
        };
        assert!(held(true) && !held(false));
    }

    #[test]
    fn a_doubtful_bus_must_drive_unless_the_clip_is_too_short_for_it() {
        let looked_s = |frames: u32| -> Vec<f64> { (0..frames).map(|i| 0.1 * f64::from(i)).collect() };
        let bus = |score, to_m| Track { class: VehicleClass::Bus, ..track(40, score, to_m) };
        assert!(!is_vehicle(&bus(0.4, 0.0), 3.0, &looked_s(100)));
        assert!(
            is_vehicle(&bus(0.4, 9.0), 3.0, &looked_s(100))
                && is_vehicle(&bus(0.6, 0.0), 3.0, &looked_s(100))
        );
        assert!(is_vehicle(&bus(0.4, 0.0), 3.0, &looked_s(40)));
    }

    #[test]
    fn a_fit_must_fill_its_box_as_far_as_it_is_in_the_picture() {
        let config = Config::default();
        let believable = |projected, bbox: [f64; 4], rms| {
            is_believable(projected, &bbox, rms, &SIZE.picture_px(), &config)
        };
        let whole = [100.0, 100.0, 200.0, 160.0];
        assert!(believable(Some(whole), whole, 2.0));
        assert!(!believable(Some(whole), whole, 20.0));
        assert!(!believable(Some([100.0, 100.0, 140.0, 130.0]), whole, 2.0));
        assert!(!believable(None, whole, 2.0));
        // The left edge of the picture cuts off half of the car.
        assert!(believable(Some([-100.0, 100.0, 100.0, 200.0]), [0.0, 100.0, 100.0, 200.0], 2.0));
    }
}
