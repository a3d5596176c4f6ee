//! Result folders and tables of tracks → clips, one for each world frame.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roadplane_base::{PictureMotion, PictureVerdict, Shape, ShapeAtlas};
use roadplane_geo::Fit;
use roadplane_traffic::{Clip, Clock, Vehicle};
use roadplane_write::{
    CameraFile, CameraSegment, FrameMotion, Summary, WriteError, read_camera, read_summary,
    read_track_samples, start_in_name,
};

use super::samples::Vehicles;
use super::world::World;
use crate::PipelineError;

/// A clip with its world frame.
pub(super) struct RunClip {
    pub(super) clip: Clip,
    /// `None` for tracks of other programs.
    pub(super) world: Option<World>,
    /// Number of the world among those of its run, from 1.
    pub(super) world_number: usize,
    /// Name of the camera, if the input states it.
    pub(super) camera: Option<String>,
}

/// Reads an input: a result folder, a table of tracks, or a folder that contains such inputs at any depth. `start_s` is the
/// time of the first frame; without it, the date comes from the name.
pub(super) fn read_input(
    input: &Path,
    clock: &Clock,
    start_s: Option<f64>,
) -> Result<Vec<RunClip>, PipelineError> {
    if input.is_file() {
        return read_table(input, clock, start_s);
    }
    if input.join("summary.json").is_file() {
        let summary = read_summary(&input.join("summary.json"))?;
        return read_run(input, &stem_of_run(input), &summary, clock, start_s);
    }
    let mut inner = children(input)?;
    // An earlier output of this command is no input.
    inner.retain(|path| {
        let is_table = path.extension().is_some_and(|e| e == "parquet");
        is_table || path.is_dir() && !path.join("traffic.json").is_file()
    });
    let mut clips = Vec::new();
    for path in inner {
        if !path.is_dir() || !children(&path)?.is_empty() {
            clips.extend(read_input(&path, clock, start_s)?);
        }
    }
    if clips.is_empty() {
        let what = "no result of a run and no table of tracks is in this folder".to_owned();
        return Err(WriteError::Malformed { what, path: input.to_path_buf() }.into());
    }
    Ok(clips)
}

/// Returns the files and folders in a folder, sorted by name, without hidden ones.
fn children(folder: &Path) -> Result<Vec<PathBuf>, PipelineError> {
    let fail = |source| PipelineError::Unreadable { source, path: folder.to_path_buf() };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let is_hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
        if !is_hidden {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

fn read_table(path: &Path, clock: &Clock, start_s: Option<f64>) -> Result<Vec<RunClip>, PipelineError> {
    let mut vehicles = Vehicles::default();
    read_track_samples(path, |sample| vehicles.add(&sample, None, 0.0))?;
    if vehicles.is_unsorted {
        return Err(WriteError::malformed(path, "the rows of a track must be in the order of time").into());
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    // The nightly data set is divided into folders with names such as `camera=gate-3`.
    let camera = path
        .components()
        .find_map(|part| part.as_os_str().to_str()?.strip_prefix("camera=").map(str::to_owned));
    let local = vehicles.start_local_s.and_then(|s| {
        let moment = jiff::Timestamp::from_second(s.floor() as i64).ok()?;
        Some(clock.unix_of(jiff::tz::TimeZone::UTC.to_datetime(moment))? + s.fract())
    });
    let named = start_in_name(&stem).and_then(|local| clock.unix_of(local));
    let scale_sd = (!vehicles.lack_sds && vehicles.span_s.is_some()).then_some(0.0);
    let found = vehicles.finish(&[]);
    let clip = |(segment, vehicles): (usize, Vec<Vehicle>)| {
        let spans = vehicles.iter().map(Vehicle::span_s);
        let clip = Clip {
            name: stem.clone(),
            start_s: start_s.or(local).or(named),
            span_s: spans.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default(),
            not_followed_s: Vec::new(),
            scale_sd,
            vehicles,
        };
        RunClip { clip, world: None, world_number: segment + 1, camera: camera.clone() }
    };
    Ok(found.into_iter().map(clip).collect())
}

/// Reads the run in a folder, which has the given name and summary.
pub(super) fn read_run(
    folder: &Path,
    name: &str,
    summary: &Summary,
    clock: &Clock,
    start_s: Option<f64>,
) -> Result<Vec<RunClip>, PipelineError> {
    let camera = read_camera(&folder.join("camera.json"))?;
    let place = Fit::read(folder)?;
    let segments = camera.all();
    let world_of = worlds_of(segments);
    let mut worlds: Vec<Option<World>> = Vec::new();
    for (i, segment) in segments.iter().enumerate() {
        let is_first = world_of[i] == i;
        let visits = (i..segments.len()).filter(|&j| world_of[j] == i);
        let motion = visits.clone().flat_map(|j| motion_in(&camera, &segments[j])).collect();
        let frames = visits.map(|j| first_frame(summary, &camera, j)..first_frame(summary, &camera, j + 1));
        worlds
            .push(is_first.then(|| World::new(segment.estimate(), motion, place.clone(), frames.collect())));
    }
    let centre_m = ShapeAtlas::shipped()?.body_middle_m(&Shape::zeros());
    let mut vehicles = Vehicles::default();
    read_track_samples(&folder.join("tracks.parquet"), |mut sample| {
        sample.segment = world_of.get(sample.segment).copied().unwrap_or(0);
        if let (Some(Some(world)), Some(map_m)) = (worlds.get_mut(sample.segment), sample.map_m) {
            world.add_pair(sample.position_m, map_m);
        }
        let world = worlds.get(sample.segment).and_then(Option::as_ref);
        vehicles.add(&sample, world, centre_m);
    })?;
    let start_s = start_s.or_else(|| start_in_name(name).and_then(|local| clock.unix_of(local)));
    let mut found = vehicles.finish(&worlds);
    let span_s = [segments[0].span_s[0], segments[segments.len() - 1].span_s[1]];
    let mut clips = Vec::new();
    for (i, world) in worlds.into_iter().enumerate() {
        let Some(world) = world else { continue };
        let elsewhere = (0..segments.len()).filter(|&j| world_of[j] != i).map(|j| segments[j].span_s);
        let clip = Clip {
            name: name.to_owned(),
            start_s,
            span_s,
            not_followed_s: merged(not_followed(summary).chain(elsewhere).collect()),
            scale_sd: Some(segments[i].height_sd_m.map_or(0.0, |sd| sd / segments[i].height_m)),
            vehicles: found.remove(&i).unwrap_or_default(),
        };
        let world_number = clips.len() + 1;
        clips.push(RunClip { clip, world: Some(world), world_number, camera: None });
    }
    Ok(clips)
}

/// Returns the first segment with the same camera for each segment. A camera that comes back has the same world frame.
fn worlds_of(segments: &[CameraSegment]) -> Vec<usize> {
    let same = |a: &CameraSegment, b: &CameraSegment| {
        a.plane_in_camera == b.plane_in_camera && a.focal_px.to_bits() == b.focal_px.to_bits()
    };
    let first = |i: usize| (0..i).find(|&j| same(&segments[i], &segments[j])).unwrap_or(i);
    (0..segments.len()).map(first).collect()
}

/// Returns the first frame of a segment of the camera; the largest number after the last segment. Only some frames have
/// known times: those of camera moves, and those whose picture is displaced.
fn first_frame(summary: &Summary, camera: &CameraFile, segment: usize) -> u64 {
    let segments = camera.all();
    let Some(begins_s) = segments.get(segment).map(|segment| segment.span_s[0]) else { return u64::MAX };
    let moves = summary.watch.moves.iter().map(|moved| (moved.since_frame, moved.since_s));
    let displaced = camera.motion.iter().map(|row| (row.frame, row.time_s));
    let known = moves.chain(displaced).filter(|_| segment > 0);
    let nearest = known.min_by(|a, b| (a.1 - begins_s).abs().total_cmp(&(b.1 - begins_s).abs()));
    nearest.map_or(0, |(frame, _)| frame)
}

fn motion_in(camera: &CameraFile, segment: &CameraSegment) -> BTreeMap<u64, PictureMotion> {
    let [from, to] = segment.span_s;
    let here = camera.motion.iter().filter(|row| from <= row.time_s && row.time_s <= to);
    let inverse = |row: &FrameMotion| Some((row.frame, segment.picture_from_world(row)?.inverse()));
    here.filter_map(inverse).collect()
}

/// Returns the intervals in which no vehicle could be followed.
fn not_followed(summary: &Summary) -> impl Iterator<Item = [f64; 2]> {
    let lost = summary.watch.not_followed.iter().map(|i| [i.from_s, i.to_s]);
    let blind = summary
        .watch
        .stretches
        .iter()
        .filter(|i| i.verdict.is_blind() || i.verdict == PictureVerdict::Frozen);
    lost.chain(blind.map(|i| [i.from_s, i.to_s]))
}

/// Sorts intervals and merges those that overlap.
fn merged(mut intervals: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    intervals.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut whole: Vec<[f64; 2]> = Vec::new();
    for [from, to] in intervals {
        match whole.last_mut() {
            Some(last) if from <= last[1] => last[1] = last[1].max(to),
            _ => whole.push([from, to]),
        }
    }
    whole
}

fn stem_of_run(folder: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    whole.file_name().map_or_else(|| "run".to_owned(), |name| name.to_string_lossy().into_owned())
}
