//! Estimation: computes the camera over time, the poses of cars and smoothed tracks from the records of all frames.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::{
    CameraEstimate, CameraStatus, CarRef, PoseRecord, Registration, Shape, ShapeAtlas, TrackRow,
};
use roadplane_geo::{NotPlaced, Place, Site};
use roadplane_measure::any_car;
use roadplane_track::{ClockReader, Evidence, Join, Track, TrackStep};
use roadplane_write::{FrameReader, PoseLines, RunStatus, read_jsonl};

use crate::cameras::camera_track::CameraTrack;
use crate::cameras::database::CameraHistory;
use crate::cameras::estimate::{CameraInputs, optics_of};
use crate::cameras::known::{contradiction, in_first_picture, not_compared_in_words};
use crate::not_followed::{FollowCount, NotFollowed};
use crate::tracks::known::tracked_cars;
use crate::tracks::pass::{Pass, Tally};
use crate::tracks::poses::move_to_picture;
use crate::tracks::views::Views;
use crate::tracks::{Load, MOST_ROWS, Numbers, Replay, TimeChunk};
use crate::{CameraConstraints, Cancel, Config, PipelineError};

/// Result of estimation for a clip: the camera, the tracks and their statistics.
#[derive(Debug)]
pub struct ClipSolution {
    /// The camera over the clip, with one estimate for each interval in which the camera is constant.
    pub cameras: CameraTrack,
    /// Position and direction of the camera on the map. `None` if the user gave no site or the camera cannot be put on
    /// the map.
    pub place: Option<Place>,
    /// Whether the user's surveyed points contradict the camera, so that they were not used.
    pub has_refused_points: bool,
    /// Shape of each tracked vehicle, by the number of its track.
    pub shapes: BTreeMap<u64, Shape>,
    /// All that shows whether a track is a vehicle, by the number of the track.
    pub evidence: BTreeMap<u64, Evidence>,
    /// Joins of each track over gaps, by the number of the track.
    pub joins: BTreeMap<u64, Vec<Join>>,
    /// Rows of the track files that are kept for drawing, sorted by frame and then by track.
    pub rows: Vec<TrackRow>,
    /// Number of rows in the track files, including rows that are not in `rows`.
    pub row_count: u64,
    /// Root mean square reprojection error of each measured pose that belongs to a track, px.
    pub reprojection_rms_px: Vec<f64>,
    /// Number of car poses that estimation used. A car has one pose in each frame.
    pub poses_used: u64,
    /// Counts of detected and rejected cars.
    pub tally: Tally,
    /// Sd of the time from the time stamp of a frame to its picture, s; zero if the time stamps are right.
    pub time_sd_s: f64,
    /// Frames in which vehicles were not followed, because the camera moved.
    pub not_followed: NotFollowed,
    /// Motion of the camera.
    pub views: Views,
    /// Warnings about the result, for the user.
    pub warnings: Vec<String>,
}

impl ClipSolution {
    /// Returns a text for the log about the clip's first camera: focal length, height and tilt, with their sds.
    #[must_use]
    pub fn camera_in_words(&self) -> String {
        let Some(first) = self.cameras.estimates.first() else { return "no camera".to_owned() };
        let focal_px = first.params.focal_px();
        let sd = |i: usize| first.covariance[(i, i)].max(0.0).sqrt();
        let height_m = first.params.log_height.exp();
        format!(
            "focal {focal_px:.0} ± {:.0} px, height {height_m:.1} ± {:.1} m, tilt {:.1} ± {:.1}° ({})",
            focal_px * sd(0),
            height_m * sd(3),
            first.params.tilt.to_degrees(),
            sd(1).to_degrees(),
            match first.status {
                CameraStatus::Estimated => "estimated",
                CameraStatus::FocalGiven => "focal given",
                CameraStatus::FocalFromPrior => "focal from prior",
                CameraStatus::Unobservable => "unobservable",
            },
        )
    }
}

impl ClipSolution {
    /// Returns the status of the run.
    pub(crate) fn status(&self, is_damaged: bool) -> RunStatus {
        match self.not_followed.status(is_damaged) {
            RunStatus::Complete if self.has_refused_points => RunStatus::PointsNotUsed,
            status => status,
        }
    }
}

/// Receives the track rows of a clip, one time chunk after another.
pub(crate) trait RowSink {
    /// Receives the track rows of one time chunk, sorted by frame and then by track.
    ///
    /// `rows` also has rows shortly before and after the chunk. Only rows inside the chunk are stored: the neighbouring
    /// chunk has more accurate rows for the other times. Returns the number of rows inside the chunk.
    fn take(
        &mut self,
        rows: Vec<TrackRow>,
        chunk: TimeChunk,
        place: Option<&Place>,
    ) -> Result<u64, PipelineError>;
}

impl RowSink for Vec<TrackRow> {
    fn take(
        &mut self,
        rows: Vec<TrackRow>,
        chunk: TimeChunk,
        _place: Option<&Place>,
    ) -> Result<u64, PipelineError> {
        let before = self.len();
        self.extend(rows.into_iter().filter(|row| chunk.holds(row.time_s)));
        Ok((self.len() - before) as u64)
    }
}

/// Estimates the camera and the tracks of a clip from its file of frames, and writes the poses of cars to `poses`.
///
/// The file of frames is read several times and is never in memory as a whole. The result contains all track rows.
///
/// # Errors
/// Returns a [`PipelineError`] if estimation cannot be completed. The file `poses` is then unchanged.
pub fn solve_clip(
    frames: &Path,
    poses: &Path,
    atlas: &ShapeAtlas,
    constraints: &CameraConstraints,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipSolution, PipelineError> {
    let mut rows = Vec::new();
    let solution =
        solve_constrained_clip(frames, poses, atlas, &Given::new(constraints), &mut rows, config, cancel)?;
    Ok(ClipSolution { rows, ..solution })
}

/// Inputs of estimation other than the frames.
pub(crate) struct Given<'a> {
    /// User constraints on the camera.
    pub constraints: &'a CameraConstraints,
    /// Evidence about the camera from its other clips, read from the camera database.
    pub history: Option<&'a CameraHistory>,
    /// The camera's position on the map, as given by the user.
    pub site: Option<&'a Site>,
    /// How the picture of the empty scene lies on the picture of an earlier frame.
    pub empty_scene: Option<&'a Registration>,
    /// Approximate upper limit on the number of track rows in a time chunk.
    pub most_rows: u64,
}

impl<'a> Given<'a> {
    /// Returns inputs that have only user constraints.
    pub(crate) fn new(constraints: &'a CameraConstraints) -> Self {
        Self { constraints, history: None, site: None, empty_scene: None, most_rows: MOST_ROWS }
    }
}

/// Estimates the camera and the tracks of a clip like [`solve_clip`], but with further inputs about the camera. The
/// track rows are passed to `sink`.
pub(crate) fn solve_constrained_clip(
    frames: &Path,
    poses: &Path,
    atlas: &ShapeAtlas,
    given: &Given<'_>,
    sink: &mut dyn RowSink,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipSolution, PipelineError> {
    let optics = optics_of(frames, given.constraints, given.history, atlas, config)?;
    let read = || -> Result<_, PipelineError> {
        let records = FrameReader::open(frames)?.map(|record| {
            cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }))?;
            Ok(record?)
        });
        Ok(optics.convert(records))
    };
    let Given { history, most_rows, .. } = *given;
    let (constraints, site, on_frames) = in_first_picture(given.constraints, given.site, read)?;
    let counts = RefCell::new((Load::default(), FollowCount::default(), ClockReader::default()));
    let is_first = Cell::new(true);
    let frames = || -> Result<_, PipelineError> {
        let counts = is_first.replace(false).then_some(&counts);
        Ok(read()?.inspect(move |frame| {
            if let (Ok(frame), Some(counts)) = (frame, counts) {
                let (load, follow, clock) = &mut *counts.borrow_mut();
                load.add(frame);
                follow.add(frame);
                clock.add(frame);
            }
        }))
    };
    let inputs = CameraInputs {
        optics: &optics,
        atlas,
        known: &constraints,
        history,
        scene: given.empty_scene,
        may_fold: !matches!(site, Some(Site::Points(_))),
        config,
    };
    let mut cameras = inputs.estimate(frames)?;
    let (load, follow, clock) = counts.into_inner();
    let mut warnings = warnings_of(&cameras);
    let placed = site.as_ref().map(|site| cameras.put_on_map(site)).transpose();
    if let Err(why) = &placed {
        warnings.push(format!("the camera is not put on the map: {why}"));
    }
    let has_refused_points = matches!(placed, Err(NotPlaced::Contradiction(_)));
    let place = placed.ok().flatten();
    if let Some(Place { fit, .. }) = &place {
        tracing::info!("{fit}");
        warnings.extend(fit.warnings.iter().cloned());
    }
    let contradictions = cameras.constraints.iter().filter_map(contradiction);
    let on_constraints: Vec<String> = on_frames
        .into_iter()
        .chain(contradictions)
        .chain(not_compared_in_words(cameras.not_compared))
        .chain(constraints.silent_later().filter(|_| cameras.visits.len() > 1))
        .collect();
    let not_followed = follow.finish();
    let on_motion = not_followed.in_words();
    on_motion.iter().for_each(|warning| tracing::warn!("{warning}"));
    let on_map = if site.is_some() { &warnings[..] } else { &[] };
    on_map.iter().chain(&on_constraints).for_each(|warning| tracing::warn!("{warning}"));
    warnings.extend(on_constraints);
    warnings.extend(on_motion);
    let any_car = any_car(atlas, cameras.size_of_cars);
    let clock = clock.finish();
    if clock.sd_s > 0.0 {
        tracing::info!("the time stamps are wrong by {:.3} s (sd); the tracks correct this", clock.sd_s);
    }
    let pass = Pass {
        cameras: &cameras,
        clock: &clock,
        place: place.as_ref(),
        atlas,
        any_car,
        options: config.solve.scene_options(None),
        config,
    };
    let (mut first, mut second) = (Replay::new(read()?), Replay::new(read()?));
    let spool = poses.with_extension("spool");
    let mut poses = Poses { lines: PoseLines::create(poses)?, reprojection_rms_px: Vec::new(), used: 0 };
    let (mut tally, mut numbers) = (Tally::default(), Numbers::default());
    let (mut shapes, mut evidence, mut joins) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    let (mut motion, mut row_count) = (Views::default(), 0);
    for chunk in load.chunks(most_rows) {
        // The first pass estimates the shape of a car in each frame separately. In the second pass, the car has the
        // shape of its track.
        let seen = first.seen_by(chunk);
        let (found, _) = pass.tracks(seen, chunk, None, &mut Tally::default(), |_| Ok(()))?;
        let vehicles = if config.track.takes(TrackStep::SecondPass) {
            tracked_cars(&found, atlas)
        } else {
            BTreeMap::new()
        };
        // The tracks of a chunk need much memory, so they are dropped as soon as possible.
        drop(found);
        let mut spooled = PoseLines::create(&spool)?;
        let seen = second.seen_by(chunk);
        let (mut tracks, views) =
            pass.tracks(seen, chunk, Some(&vehicles), &mut tally, |pose| Ok(spooled.write(pose)?))?;
        spooled.finish()?;
        for track in &mut tracks {
            track.shape.mean = atlas.clamped(&track.shape.mean);
        }
        drop(vehicles);
        tracks.retain(|track| {
            let is_kept = !config.track.takes(TrackStep::OwnBoxes) || pass.is_where_it_is_seen(track, &views);
            let is_own = track.states.first().is_some_and(|state| chunk.holds(state.stamp.time_s()));
            tally.left_out_tracks += u64::from(!is_kept && is_own);
            is_kept
        });
        let tracks = numbers.give(tracks, chunk);
        poses.add(&spool, &tracks, &views)?;
        shapes.extend(tracks.iter().map(|track| (track.id, track.shape.mean)));
        evidence.extend(tracks.iter().map(|track| (track.id, track.evidence)));
        joins.extend(tracks.iter().map(|track| (track.id, track.joins.clone())));
        let mut rows = Vec::with_capacity(tracks.iter().map(|track| track.states.len()).sum());
        for track in tracks {
            rows.extend(pass.rows(&track, &views));
        }
        motion.extend(views);
        rows.sort_unstable_by_key(|row: &TrackRow| (row.frame, row.track));
        row_count += sink.take(rows, chunk, place.as_ref())?;
    }
    std::fs::remove_file(&spool)
        .map_err(|source| PipelineError::Unreadable { source, path: spool.clone() })?;
    let Poses { lines, reprojection_rms_px, used: poses_used } = poses;
    lines.finish()?;
    Ok(ClipSolution {
        cameras,
        place,
        has_refused_points,
        shapes,
        evidence,
        joins,
        rows: Vec::new(),
        row_count,
        reprojection_rms_px,
        poses_used,
        tally,
        time_sd_s: (clock.sd_s * 1e4).round() / 1e4,
        not_followed,
        views: motion,
        warnings,
    })
}

/// Writer of `poses.jsonl`.
struct Poses {
    lines: PoseLines,
    reprojection_rms_px: Vec<f64>,
    used: u64,
}

impl Poses {
    /// Reads the poses of a time chunk from the file `spool`. Writes each pose to `poses.jsonl` with the number of its
    /// track, and with the pixels of its own frame.
    fn add(&mut self, spool: &Path, tracks: &[Track], views: &Views) -> Result<(), PipelineError> {
        let tracked: BTreeMap<CarRef, u64> =
            tracks.iter().flat_map(|track| track.measured().map(|(key, _)| (key, track.id))).collect();
        for pose in read_jsonl::<PoseRecord>(spool)? {
            let mut pose = pose?;
            if let Some(picture_from_world) = views.of(pose.frame) {
                move_to_picture(&mut pose, picture_from_world);
            }
            pose.track = tracked.get(&CarRef { frame: pose.frame, car: pose.car }).copied();
            self.used += u64::from(pose.used);
            if pose.track.is_some() && pose.pose_from.is_none() {
                self.reprojection_rms_px.push(pose.reprojection_rms_px);
            }
            self.lines.write(&pose)?;
        }
        Ok(())
    }
}

fn warnings_of(cameras: &CameraTrack) -> Vec<String> {
    let mut warnings = Vec::new();
    let about = |estimate: &CameraEstimate| match estimate.status {
        CameraStatus::Unobservable => {
            Some("the camera could not be estimated: its numbers are those of the prior")
        }
        CameraStatus::FocalFromPrior => {
            Some("the cars hardly constrain the focal length: it comes from the prior")
        }
        CameraStatus::Estimated | CameraStatus::FocalGiven => None,
    };
    for warning in cameras.estimates.iter().filter_map(about) {
        if !warnings.iter().any(|other| other == warning) {
            warnings.push(warning.to_owned());
        }
    }
    if cameras.estimates.is_empty() {
        warnings.push("no frame could be read".to_owned());
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};
    use roadplane_base::{
        Camera, CameraParams, CarRecord, FrameRecord, GroundPose, ImageSize, KEYPOINTS, Keypoint, WatchRecord,
    };
    use roadplane_write::JsonLines;

    const SIZE: ImageSize = ImageSize { width: 1280, height: 720 };
    /// Length of the clip, s. With the shortest possible time chunks, the clip has three chunks and two seams between
    /// chunks.
    const SECONDS: u64 = 11 * 60;
    const FPS: u64 = 2;

    /// First shape coefficient of moving vehicles; stationary vehicles have the mean shape.
    const DRIVEN: f64 = 1.2;

    /// Returns the detection of a vehicle by a net whose keypoints have errors of half a pixel.
    fn seen(atlas: &ShapeAtlas, pose: &GroundPose, shape: &Shape, frame: u64) -> CarRecord {
        seen_in_world(atlas, &pose.world_from_car(), shape, frame)
    }

    /// Returns the detection of a vehicle at a pose in the world.
    fn seen_in_world(
        atlas: &ShapeAtlas,
        world_from_car: &Isometry3<f64>,
        shape: &Shape,
        frame: u64,
    ) -> CarRecord {
        let params = CameraParams { log_focal: 1400f64.ln(), tilt: 0.35, roll: 0.02, log_height: 9f64.ln() };
        let camera = Camera::centred(params.focal_px(), SIZE);
        let camera_from_car = params.plane().camera_from_world() * world_from_car;
        let pose = world_from_car.translation.vector;
        let noise = |i: usize, phase: f64| 0.5 * (frame as f64 * 12.9898 + i as f64 * 78.233 + phase).sin();
        let pixels: [Vector2<f64>; KEYPOINTS] = std::array::from_fn(|i| {
            let point = Point3::from(atlas.keypoint_in_car(i, shape));
            camera.pixel_from_camera(&(camera_from_car * point).coords).unwrap()
        });
        let edge = |of: fn(f64, f64) -> f64, axis: usize, from: f64| {
            pixels.iter().map(|pixel| pixel[axis]).fold(from, of)
        };
        let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
        let bbox_px = [
            edge(f64::min, 0, low),
            edge(f64::min, 1, low),
            edge(f64::max, 0, high),
            edge(f64::max, 1, high),
        ];
        let keypoints = std::array::from_fn(|i| {
            let pixel = pixels[i] + Vector2::new(noise(i, pose.x), noise(i, 1.0 + pose.y));
            Some(Keypoint::isotropic(pixel, 0.9, 0.5))
        });
        CarRecord { keypoints: Some(Box::new(keypoints)), ..CarRecord::boxed(bbox_px) }
    }

    /// Writes the frames of a clip. Four vehicles are stationary. One of them is absent for half a minute around the
    /// first seam between time chunks. Another vehicle drives past every 25 s, also at both seams.
    fn frames(path: &Path, atlas: &ShapeAtlas) {
        let mut lines = JsonLines::create(path).unwrap();
        for frame in 0..SECONDS * FPS {
            let time_s = frame as f64 / FPS as f64;
            let mut poses: Vec<GroundPose> =
                [(-7.0, 22.0, 0.3), (-2.0, 30.0, 1.5), (6.0, 26.0, 2.2), (2.0, 18.0, 0.1)]
                    .map(|(x_m, y_m, heading_rad)| GroundPose { x_m, y_m, heading_rad })
                    .to_vec();
            if (285.0..315.0).contains(&time_s) {
                poses.remove(2);
            }
            let driven_m = 8.0 * (time_s % 25.0) - 16.0;
            if driven_m < 12.0 {
                poses.push(GroundPose { x_m: driven_m, y_m: 40.0, heading_rad: 0.0 });
            }
            let shape = |pose: &GroundPose| {
                Shape::new(if pose.y_m == 40.0 { DRIVEN } else { 0.0 }, 0.0, 0.0, 0.0, 0.0, 0.0)
            };
            let cars = poses.iter().map(|pose| seen(atlas, pose, &shape(pose), frame)).collect();
            lines.write(&FrameRecord { cars, ..FrameRecord::empty(frame, time_s, SIZE) }).unwrap();
        }
        lines.finish().unwrap();
    }

    /// Distance at which the road of [`rising_road`] begins to rise, m.
    const FOLD_M: f64 = 28.0;

    /// Writes the frames of a clip in which vehicles drive away on a road that rises by `slope` (rad) from [`FOLD_M`] on.
    fn rising_road(path: &Path, atlas: &ShapeAtlas, slope: f64) {
        let mut lines = JsonLines::create(path).unwrap();
        let fold = Translation3::new(0.0, FOLD_M, 0.0);
        let rise = fold * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), slope) * fold.inverse();
        for frame in 0..120_u64 {
            let time_s = frame as f64 / 4.0;
            let vehicle = |k: u32| {
                let y_m = (17.0 + 3.0 * time_s + 5.5 * f64::from(k)) % 44.0 + 16.0;
                let x_m = [-5.0, 0.0, 4.5][k as usize % 3];
                let on_plane = GroundPose { x_m, y_m, heading_rad: 1.5 }.world_from_car();
                let world_from_car = if y_m > FOLD_M { rise * on_plane } else { on_plane };
                let shape = Shape::new(f64::from(k % 5) * 0.4 - 0.8, 0.0, 0.0, 0.0, 0.0, 0.0);
                seen_in_world(atlas, &world_from_car, &shape, frame)
            };
            let cars = (0..8).map(vehicle).collect();
            // The vehicles have equal distances, so that only the picture shows that the camera is at rest.
            let watch = Some(WatchRecord { looked: true, ..WatchRecord::default() });
            lines.write(&FrameRecord { cars, watch, ..FrameRecord::empty(frame, time_s, SIZE) }).unwrap();
        }
        lines.finish().unwrap();
    }

    #[test]
    fn vehicles_on_a_rising_road_are_placed_on_two_planes() {
        let (folder, atlas) = (tempfile::tempdir().unwrap(), ShapeAtlas::shipped().unwrap());
        let (path, poses) = (folder.path().join("frames.jsonl"), folder.path().join("poses.jsonl"));
        let solve = |slope: f64| {
            rising_road(&path, &atlas, slope);
            let (known, cancel) = (CameraConstraints::default(), Cancel::default());
            solve_clip(&path, &poses, &atlas, &known, &Config::default(), &cancel).unwrap()
        };
        let slope = 0.12f64;
        let found = solve(slope);
        let slope_found = found.cameras.estimates[0].slope_rad().unwrap();
        assert!((slope_found - slope).abs() < 0.03, "{slope_found}");
        let far: Vec<&TrackRow> =
            found.rows.iter().filter(|row| row.observed && row.y_m > FOLD_M + 8.0).collect();
        assert!(far.len() > 100 && far.iter().all(|row| row.ground == 1));
        for row in far {
            let height_m = (row.y_m - FOLD_M) * slope.tan();
            assert!((row.z_m - height_m).abs() < 0.2 * height_m + 0.3, "{} {height_m}", row.z_m);
        }
        let near = found.rows.iter().filter(|row| row.y_m < FOLD_M - 4.0);
        assert!(near.clone().count() > 100 && near.into_iter().all(|row| row.ground == 0 && row.z_m == 0.0));
        assert_eq!(solve(0.0).cameras.estimates[0].slope_rad(), None);
    }

    #[test]
    fn time_chunks_give_the_tracks_of_the_whole_clip() {
        let (folder, atlas) = (tempfile::tempdir().unwrap(), ShapeAtlas::shipped().unwrap());
        let (path, constraints) = (folder.path().join("frames.jsonl"), CameraConstraints::default());
        frames(&path, &atlas);
        let solve = |most_rows: u64| {
            let (mut rows, poses) = (Vec::new(), folder.path().join("poses.jsonl"));
            let given = Given { most_rows, ..Given::new(&constraints) };
            let (config, cancel) = (Config::default(), Cancel::default());
            let solved =
                solve_constrained_clip(&path, &poses, &atlas, &given, &mut rows, &config, &cancel).unwrap();
            let poses: Vec<PoseRecord> = read_jsonl(&poses).unwrap().map(Result::unwrap).collect();
            (solved, rows, poses)
        };
        let (whole, whole_rows, whole_poses) = solve(MOST_ROWS);
        let (parts, part_rows, part_poses) = solve(1);
        assert_eq!(whole.shapes.len() as u64, 4 + SECONDS.div_ceil(25));
        assert_eq!(parts.shapes.len(), whole.shapes.len());
        // Shapes are fixed in the second pass. The detections of that pass must not change the shapes.
        let is_driven = |shape: &&Shape| (shape[0] - DRIVEN).abs() < 0.35;
        assert_eq!(whole.shapes.values().filter(is_driven).count() as u64, SECONDS.div_ceil(25));
        let key = |row: &TrackRow| (row.frame, row.track);
        assert_eq!(
            part_rows.iter().map(key).collect::<Vec<_>>(),
            whole_rows.iter().map(key).collect::<Vec<_>>()
        );
        let apart = |(a, b): (&TrackRow, &TrackRow)| (a.x_m - b.x_m).hypot(a.y_m - b.y_m);
        let worst = part_rows.iter().zip(&whole_rows).map(apart).fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst} m");
        assert_eq!((parts.row_count, parts.poses_used), (part_rows.len() as u64, whole.poses_used));
        assert_eq!((parts.tally.boxes, parts.tally.rejected), (whole.tally.boxes, whole.tally.rejected));
        let key = |pose: &PoseRecord| (pose.frame, pose.car, pose.track);
        assert_eq!(
            part_poses.iter().map(key).collect::<Vec<_>>(),
            whole_poses.iter().map(key).collect::<Vec<_>>()
        );
    }
}
