//! The right half of a run: records of all frames → camera over time, poses, smoothed tracks.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::{CameraEstimate, CameraStatus, CarRef, PoseRecord, Shape, ShapeAtlas, TrackRow};
use roadplane_calibrate::AtRest;
use roadplane_geo::{Place, Site};
use roadplane_track::Track;
use roadplane_write::{FrameReader, PoseLines, read_jsonl, read_scene_curves};

use crate::cameras::camera_track::CameraTrack;
use crate::cameras::estimate::estimate_cameras;
use crate::cameras::known::contradiction;
use crate::cameras::memory::Recall;
use crate::tracks::cars::any_car;
use crate::tracks::known::known_cars;
use crate::tracks::pass::{Pass, Tally};
use crate::tracks::stretch::{Load, MOST_ROWS, Numbers, Replay, Stretch, sightings};
use crate::{CameraConstraints, Cancel, Config, PipelineError};

/// What became of a clip.
#[derive(Debug)]
pub struct ClipSolution {
    /// The camera, a stretch of time each.
    pub cameras: CameraTrack,
    /// Where it stands on the map, where that was told.
    pub place: Option<Place>,
    /// Shape of each track, by number.
    pub shapes: BTreeMap<u64, Shape>,
    /// Rows of the track files, by frame, then by track: those that are kept to be drawn.
    pub rows: Vec<TrackRow>,
    /// Number of all rows.
    pub row_count: u64,
    /// Root mean square reprojection errors of the tracked poses, px.
    pub reprojection_rms_px: Vec<f64>,
    /// Cars (car and frame) with a pose that is used.
    pub poses_used: u64,
    /// Cars found and dropped.
    pub tally: Tally,
    /// What a reader should know.
    pub warnings: Vec<String>,
}

impl ClipSolution {
    /// The camera in words, for a log line.
    #[must_use]
    pub fn camera_in_words(&self) -> String {
        let Some(first) = self.cameras.estimates().first() else { return "no camera".to_owned() };
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

/// What becomes of a clip's rows.
pub(crate) trait RowSink {
    /// Takes those of a stretch's tracks, by frame, then by track: also rows around the stretch, which are known better by its
    /// neighbours. Gives the number of its own.
    fn take(
        &mut self,
        rows: Vec<TrackRow>,
        stretch: Stretch,
        place: Option<&Place>,
    ) -> Result<u64, PipelineError>;
}

impl RowSink for Vec<TrackRow> {
    fn take(
        &mut self,
        rows: Vec<TrackRow>,
        stretch: Stretch,
        _place: Option<&Place>,
    ) -> Result<u64, PipelineError> {
        let before = self.len();
        self.extend(rows.into_iter().filter(|row| stretch.holds(row.time_s)));
        Ok((self.len() - before) as u64)
    }
}

/// Solves a clip from its frames file and writes `poses.jsonl`. Every pass streams over the file; all rows are kept.
///
/// # Errors
/// [`PipelineError`]; the poses file then does not appear.
pub fn solve_clip(
    frames: &Path,
    poses: &Path,
    atlas: &ShapeAtlas,
    known: &CameraConstraints,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipSolution, PipelineError> {
    let mut rows = Vec::new();
    let solution =
        solve_constrained_clip(frames, poses, atlas, &Given::new(known), &mut rows, config, cancel)?;
    Ok(ClipSolution { rows, ..solution })
}

/// What is known of a clip's camera before it is seen.
pub(crate) struct Given<'a> {
    /// What the user knows.
    pub known: &'a CameraConstraints,
    /// What is remembered.
    pub recall: Option<&'a Recall>,
    /// Its place on the map.
    pub site: Option<&'a Site>,
    /// About so many rows are worked on at a time.
    pub most_rows: u64,
}

impl<'a> Given<'a> {
    /// By the user alone.
    pub(crate) fn new(known: &'a CameraConstraints) -> Self {
        Self { known, recall: None, site: None, most_rows: MOST_ROWS }
    }
}

/// The same, with what is known of the camera before; rows go to a sink.
pub(crate) fn solve_constrained_clip(
    frames: &Path,
    poses: &Path,
    atlas: &ShapeAtlas,
    given: &Given<'_>,
    sink: &mut dyn RowSink,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipSolution, PipelineError> {
    let read = || -> Result<_, PipelineError> {
        Ok(AtRest::new(FrameReader::open(frames)?.map(|record| {
            cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }))?;
            Ok(record?)
        })))
    };
    let Given { known, recall, site, most_rows } = *given;
    let mut load = Load::default();
    let counted = read()?.inspect(|frame| frame.iter().for_each(|frame| load.add(frame)));
    let mut cameras = estimate_cameras(counted, &read_scene_curves(frames)?, atlas, known, recall, config)?;
    let mut warnings = warnings_of(&cameras);
    let place = site.and_then(|site| {
        let place = cameras.put_on_map(site);
        place.map_err(|what| warnings.push(format!("not put on the map: {what}"))).ok()
    });
    if let Some(Place { fit, .. }) = &place {
        tracing::info!("{fit}");
        warnings.extend(fit.warnings.iter().cloned());
    }
    let contradictions = cameras.known().iter().filter_map(contradiction);
    let told: Vec<String> =
        contradictions.chain(known.silent_later().filter(|_| cameras.moves() > 0)).collect();
    let on_map = if site.is_some() { &warnings[..] } else { &[] };
    on_map.iter().chain(&told).for_each(|warning| tracing::warn!("{warning}"));
    warnings.extend(told);
    let any_car = any_car(atlas, cameras.size_of_cars());
    let pass = Pass {
        cameras: &cameras,
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
    let (mut shapes, mut row_count) = (BTreeMap::new(), 0);
    for stretch in load.stretches(most_rows) {
        // First with every car's shape free in every frame; then with the one shape that its track came to.
        let seen = first.seen_by(stretch);
        let (found, _) = pass.tracks(seen, stretch, None, &mut Tally::default(), |_| Ok(()))?;
        let vehicles = known_cars(&found, atlas);
        // A stretch's tracks are large: none is kept for longer than it is needed.
        drop(found);
        let mut spooled = PoseLines::create(&spool)?;
        let seen = second.seen_by(stretch);
        let (mut tracks, shake_px) =
            pass.tracks(seen, stretch, Some(&vehicles), &mut tally, |pose| Ok(spooled.write(pose)?))?;
        spooled.finish()?;
        for track in &mut tracks {
            track.shape.mean = atlas.clamped(&track.shape.mean);
        }
        drop(vehicles);
        tracks.retain(|track| pass.is_where_it_is_seen(track));
        let tracks = numbers.give(tracks, stretch);
        poses.tell_tracks(&spool, &tracks)?;
        shapes.extend(tracks.iter().map(|track| (track.id, track.shape.mean)));
        let mut rows = Vec::with_capacity(tracks.iter().map(|track| track.states.len()).sum());
        for track in tracks {
            rows.extend(pass.rows(&track, &shake_px));
        }
        rows.sort_unstable_by_key(|row: &TrackRow| (row.frame, row.track));
        row_count += sink.take(rows, stretch, place.as_ref())?;
    }
    std::fs::remove_file(&spool)
        .map_err(|source| PipelineError::Unreadable { source, path: spool.clone() })?;
    let Poses { lines, reprojection_rms_px, used: poses_used } = poses;
    lines.finish()?;
    Ok(ClipSolution {
        cameras,
        place,
        shapes,
        rows: Vec::new(),
        row_count,
        reprojection_rms_px,
        poses_used,
        tally,
        warnings,
    })
}

/// `poses.jsonl` as it grows.
struct Poses {
    lines: PoseLines,
    reprojection_rms_px: Vec<f64>,
    used: u64,
}

impl Poses {
    /// Adds the poses of a stretch, which say now whose they are.
    fn tell_tracks(&mut self, spool: &Path, tracks: &[Track]) -> Result<(), PipelineError> {
        let tracked: BTreeMap<CarRef, u64> =
            tracks.iter().flat_map(|track| sightings(track).map(|(key, _)| (key, track.id))).collect();
        for pose in read_jsonl::<PoseRecord>(spool)? {
            let mut pose = pose?;
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
        CameraStatus::Unobservable => Some("the camera could not be estimated: its numbers are the prior"),
        CameraStatus::FocalFromPrior => {
            Some("the cars say little about the focal length: it rests on the prior")
        }
        CameraStatus::Estimated | CameraStatus::FocalGiven => None,
    };
    for warning in cameras.estimates().iter().filter_map(about) {
        if !warnings.iter().any(|known| known == warning) {
            warnings.push(warning.to_owned());
        }
    }
    if cameras.estimates().is_empty() {
        warnings.push("no frame could be read".to_owned());
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector2};
    use roadplane_base::{
        Camera, CameraParams, CarRecord, FrameRecord, GroundPose, ImageSize, KEYPOINTS, Keypoint,
    };
    use roadplane_write::JsonLines;

    const SIZE: ImageSize = ImageSize { width: 1280, height: 720 };
    /// Two seams of stretches that are as short as they may be.
    const SECONDS: u64 = 11 * 60;
    const FPS: u64 = 2;

    /// First coefficient of the shape of what drives; what stands is of the mean shape.
    const DRIVEN: f64 = 1.2;

    /// A vehicle as a net with an error of half a pixel sees it.
    fn seen(atlas: &ShapeAtlas, pose: &GroundPose, shape: &Shape, frame: u64) -> CarRecord {
        let params = CameraParams { log_focal: 1400f64.ln(), tilt: 0.35, roll: 0.02, log_height: 9f64.ln() };
        let camera = Camera::centred(params.focal_px(), SIZE);
        let camera_from_car = params.plane().camera_from_world() * pose.world_from_car();
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
            let pixel = pixels[i] + Vector2::new(noise(i, pose.x_m), noise(i, 1.0 + pose.y_m));
            Some(Keypoint::isotropic(pixel, 0.9, 0.5))
        });
        CarRecord { keypoints: Some(Box::new(keypoints)), ..CarRecord::boxed(bbox_px) }
    }

    /// Four vehicles that stand, of which one is gone for half a minute around the first seam, and one that drives by every 25 s:
    /// at both seams, too.
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
            let way_m = 8.0 * (time_s % 25.0) - 16.0;
            if way_m < 12.0 {
                poses.push(GroundPose { x_m: way_m, y_m: 40.0, heading_rad: 0.0 });
            }
            let shape = |pose: &GroundPose| {
                Shape::new(if pose.y_m == 40.0 { DRIVEN } else { 0.0 }, 0.0, 0.0, 0.0, 0.0, 0.0)
            };
            let cars = poses.iter().map(|pose| seen(atlas, pose, &shape(pose), frame)).collect();
            lines.write(&FrameRecord { cars, ..FrameRecord::empty(frame, time_s, SIZE) }).unwrap();
        }
        lines.finish().unwrap();
    }

    #[test]
    fn stretches_tell_what_the_whole_tells() {
        let (folder, atlas) = (tempfile::tempdir().unwrap(), ShapeAtlas::shipped().unwrap());
        let (path, known) = (folder.path().join("frames.jsonl"), CameraConstraints::default());
        frames(&path, &atlas);
        let solve = |most_rows: u64| {
            let (mut rows, poses) = (Vec::new(), folder.path().join("poses.jsonl"));
            let given = Given { most_rows, ..Given::new(&known) };
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
        // Shapes are held in the second pass, whose looks must not add them up.
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
