//! The data of a result folder, as export formats need it. The data is grouped by track, with the class and the body
//! centre of each vehicle.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Vector2;
use roadplane_base::{PictureMotion, PoseRecord, Shape, ShapeAtlas, TrackRow, VehicleClass};
use roadplane_geo::{Fit, Site};
use roadplane_write::{
    CameraSegment, FrameMotion, Summary, WriteError, read_camera, read_evidence, read_jsonl, read_summary,
    rounded_row, seconds_since_1970, time_in_name,
};
use serde::Deserialize;

/// The data of a result folder, grouped by track.
#[derive(Debug)]
pub struct Run {
    /// Path of the result folder.
    pub folder: PathBuf,
    /// Name of the run. Exported files are named after the run.
    pub name: String,
    /// Name of the input file. Characters that other tools reject are replaced by `_`.
    pub media: String,
    /// sha256 of the input, hexadecimal.
    pub media_sha256: String,
    /// Start of the recording, s since the start of 1970 (UTC); `None` if it is unknown. It is the time in the name of
    /// the input. If the name has no time, it is the time of recording in the run's `evidence.json`.
    pub start_s: Option<i64>,
    /// Number of frames of the input, including frames without vehicles.
    pub frames: u64,
    /// Frame rate of the input, frames per second.
    pub frames_per_s: f64,
    /// Tracks, sorted by track number.
    pub tracks: Vec<Track>,
    /// Segments of the run between camera moves, in the order of time. Each segment has its own world frame. The list
    /// is never empty.
    pub segments: Vec<RunSegment>,
    /// Motion of the camera by frame index. Frames whose picture is not displaced are missing.
    pub motion: BTreeMap<u64, FrameMotion>,
    /// Position of the camera on the map; `None` if the user gave no position. With a position, the run has only one
    /// segment, and every row has `on_map`.
    pub place: Option<Fit>,
    /// Activities of vehicles; `None` if the run did not label activities.
    pub events: Option<Vec<Event>>,
}

/// The track of one vehicle.
#[derive(Debug)]
pub struct Track {
    /// Number of the track.
    pub id: u64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Fitted shape of the vehicle. If no shape was fitted, it is the shape of the mean car.
    pub shape: Shape,
    /// Distance from the vehicle's origin forward to the centre of its body, m. The origin of a car is midway between
    /// its axles.
    pub centre_m: f64,
    /// Rows of the track in the order of time.
    pub rows: Vec<TrackRow>,
}

/// An interval of a run in which the camera was not moved.
#[derive(Debug)]
pub struct RunSegment {
    /// Name of the segment's files. It is the name of the run. If the run has several segments, a number from 1 is
    /// added.
    pub name: String,
    /// Camera and ground plane of the segment.
    pub camera: CameraSegment,
    /// End of the segment (exclusive), s; infinite for the last segment.
    until_s: f64,
    /// Start of the segment (inclusive), s; negative infinity for the first segment.
    from_s: f64,
}

/// An activity of a vehicle in one interval: a line of `activities.jsonl`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Event {
    /// Number of the vehicle's track.
    pub track: u64,
    /// Name of the activity, as in the column `activity` of the rows.
    pub activity: String,
    /// Start of the activity, s.
    pub from_s: f64,
    /// End of the activity, s.
    pub to_s: f64,
    /// Probability of the activity, 0 to 1.
    pub confidence: f64,
}

impl Run {
    /// Reads a result folder. The run gets the name of the folder.
    ///
    /// # Errors
    /// [`WriteError::Io`] or [`WriteError::Malformed`], which name the file.
    pub fn read(folder: &Path) -> Result<Self, WriteError> {
        let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
        let name = whole.file_name().map_or_else(|| "run".into(), |name| name.to_string_lossy());
        // The summary is read before the rows. So for a folder that is not a run, the error is about the missing
        // summary.
        let rows: Box<dyn Iterator<Item = _>> = match read_jsonl(&folder.join("tracks.jsonl")) {
            Ok(rows) => Box::new(rows),
            Err(error) => Box::new(std::iter::once(Err(error))),
        };
        Self::with_rows(folder, &name, rows)
    }

    /// Reads a result folder, except for its rows and its name. The caller gives the rows in `all_rows`, sorted by
    /// frame, and the name of the run.
    ///
    /// # Errors
    /// [`WriteError::Io`] or [`WriteError::Malformed`], which name the file, or the first error in `all_rows`.
    pub fn with_rows(
        folder: &Path,
        name: &str,
        all_rows: impl IntoIterator<Item = Result<TrackRow, WriteError>>,
    ) -> Result<Self, WriteError> {
        let atlas = ShapeAtlas::shipped()
            .map_err(|e| WriteError::Malformed { what: e.to_string(), path: folder.to_path_buf() })?;
        let summary = read_summary(&folder.join("summary.json"))?;
        let camera = read_camera(&folder.join("camera.json"))?;
        let mut rows: BTreeMap<u64, Vec<TrackRow>> = BTreeMap::new();
        for row in all_rows {
            let row = row?;
            rows.entry(row.track).or_default().push(row);
        }
        let shapes = shapes_of_tracks(&folder.join("poses.jsonl"))?;
        let events = folder.join("activities.jsonl");
        let events =
            if events.exists() { Some(read_jsonl(&events)?.collect::<Result<_, _>>()?) } else { None };
        let place = Fit::read(folder)?;
        let name = plain(name);
        let last_frame = rows.values().flatten().map(|row| row.frame + 1).max().unwrap_or(0);
        Ok(Self {
            frames: summary.counts.frames_expected.unwrap_or(summary.counts.frames_read).max(last_frame),
            frames_per_s: frames_per_s(&rows),
            tracks: rows
                .into_iter()
                .map(|(id, rows)| Track::new(id, rows, shapes.get(&id).copied(), &atlas))
                .collect(),
            segments: segments(&name, camera.all()),
            motion: camera.motion.into_iter().map(|row| (row.frame, row)).collect(),
            start_s: start_s(folder, &summary)?,
            media: media_of(&summary),
            media_sha256: summary.input.sha256,
            events,
            place,
            name,
            folder: folder.to_path_buf(),
        })
    }

    /// Returns all rows, each with its track. The rows are sorted by frame and then by track number.
    #[must_use]
    pub fn rows(&self) -> Vec<(&Track, &TrackRow)> {
        let mut rows: Vec<(&Track, &TrackRow)> = self.tracks.iter().flat_map(Track::rows_with).collect();
        rows.sort_by_key(|(track, row)| (row.frame, track.id));
        rows
    }

    /// Adds positions on the map to all rows, and returns the camera's position on the map.
    ///
    /// This is possible only if the camera was not moved.
    ///
    /// # Errors
    /// A message in each of these cases: `site` is not valid, the camera was moved, or the run already has a position
    /// on the map. In the last case, the run has already used the survey to refine the camera.
    pub fn put_on_map(&mut self, site: &Site) -> Result<&Fit, String> {
        if self.place.is_some() {
            return Err("the run is on the map already: leave out --geo and --camera-at".to_owned());
        }
        let [only] = self.segments.as_slice() else {
            let count = self.segments.len();
            return Err(format!(
                "the camera was moved: its {count} positions cannot all have one place on the map"
            ));
        };
        let camera = only.camera.estimate();
        if camera.second_plane.is_some() && matches!(site, Site::Points(_)) {
            return Err(
                "the ground of the run is two planes, but --geo needs one: use --camera-at".to_owned()
            );
        }
        // Frames that are not displaced have no entry.
        let view = |frame: u64| only.camera.picture_from_world(self.motion.get(&frame)?);
        let world_from_picture =
            |frame| (frame, view(frame).map_or(PictureMotion::IDENTITY, |view| view.inverse()));
        let (site, _) = site.in_first_picture(&site.frames().map(world_from_picture).collect());
        let place = site.place(&camera).map_err(|why| why.to_string())?;
        for row in self.tracks.iter_mut().flat_map(|track| &mut track.rows) {
            let on_map = place.of_row(row, &camera);
            row.on_map =
                Some(on_map.map_err(|what| format!("track {} in frame {}: {what}", row.track, row.frame))?);
            *row = rounded_row(row);
        }
        Ok(self.place.insert(place.fit))
    }

    /// Returns the index of the frame that is nearest to a time (s).
    #[must_use]
    pub fn frame_at(&self, time_s: f64) -> u64 {
        let rows = self.tracks.iter().flat_map(|track| &track.rows);
        let nearest = rows.min_by(|a, b| (a.time_s - time_s).abs().total_cmp(&(b.time_s - time_s).abs()));
        let (frame, at_s) = nearest.map_or((0, 0.0), |row| (row.frame, row.time_s));
        let steps = ((time_s - at_s) * self.frames_per_s).round() as i64;
        frame.saturating_add_signed(steps)
    }
}

impl Track {
    /// Creates a track. `shape` is the fitted shape from the track's poses.
    ///
    /// Other classes than cars have no fitted shape. Their position is the middle of a box-shaped body.
    fn new(id: u64, rows: Vec<TrackRow>, shape: Option<Shape>, atlas: &ShapeAtlas) -> Self {
        let class = rows.first().map_or(VehicleClass::Car, |row| row.class);
        let is_placed_by_middle = class != VehicleClass::Car;
        let shape = shape.unwrap_or_else(Shape::zeros);
        let centre_m = if is_placed_by_middle { 0.0 } else { atlas.body_middle_m(&shape) };
        Self { id, class, centre_m, shape, rows }
    }

    /// Returns the length, width and height of the vehicle, m. These values are equal in all rows.
    #[must_use]
    pub fn dims_m(&self) -> [f64; 3] {
        self.rows.first().map_or([0.0; 3], |row| [row.length_m, row.width_m, row.height_m])
    }

    /// Returns the rows of the track. Each row is paired with the track itself.
    pub fn rows_with(&self) -> impl Iterator<Item = (&Self, &TrackRow)> {
        self.rows.iter().map(move |row| (self, row))
    }

    /// Returns the centre of the vehicle's body on the ground at the time of a row: world x and y, m.
    #[must_use]
    pub fn body_centre(&self, row: &TrackRow) -> Vector2<f64> {
        ahead(row, self.centre_m)
    }

    /// Returns the middle of the vehicle's front bumper on the ground at the time of a row: world x and y, m.
    #[must_use]
    pub fn front(&self, row: &TrackRow) -> Vector2<f64> {
        ahead(row, self.centre_m + row.length_m / 2.0)
    }

    /// Returns the middle of the vehicle's rear bumper on the ground at the time of a row: world x and y, m.
    #[must_use]
    pub fn rear(&self, row: &TrackRow) -> Vector2<f64> {
        ahead(row, self.centre_m - row.length_m / 2.0)
    }

    /// Returns the acceleration along the heading in each row, m/s².
    ///
    /// It is the difference in speed between the next row and the previous row, divided by the time between these rows.
    #[must_use]
    pub fn accelerations(&self) -> Vec<f64> {
        let rows = &self.rows;
        let slope = |i: usize| {
            let (a, b) = (&rows[i.saturating_sub(1)], &rows[(i + 1).min(rows.len() - 1)]);
            let span = b.time_s - a.time_s;
            if span > 1e-9 { (b.speed_mps - a.speed_mps) / span } else { 0.0 }
        };
        (0..rows.len()).map(slope).collect()
    }
}

impl RunSegment {
    /// Whether the time of a row is within the segment.
    #[must_use]
    pub fn contains(&self, row: &TrackRow) -> bool {
        self.from_s <= row.time_s && row.time_s < self.until_s
    }
}

/// Returns the point that is `metres` ahead of the vehicle's origin along its heading: world x and y, m.
fn ahead(row: &TrackRow, metres: f64) -> Vector2<f64> {
    let (sin, cos) = row.heading_rad.sin_cos();
    Vector2::new(row.x_m + metres * cos, row.y_m + metres * sin)
}

/// Reads the fitted shape of each track from the file `poses`. Tracks without poses have no entry.
fn shapes_of_tracks(poses: &Path) -> Result<BTreeMap<u64, Shape>, WriteError> {
    let mut shapes = BTreeMap::new();
    for pose in read_jsonl::<PoseRecord>(poses)? {
        let pose = pose?;
        shapes.extend(pose.track.map(|track| (track, Shape::from(pose.shape))));
    }
    Ok(shapes)
}

fn segments(name: &str, cameras: &[CameraSegment]) -> Vec<RunSegment> {
    let count = cameras.len();
    let segment = |(i, camera): (usize, &CameraSegment)| RunSegment {
        name: if count == 1 { name.to_owned() } else { format!("{name}_{}", i + 1) },
        from_s: if i == 0 { f64::NEG_INFINITY } else { camera.span_s[0] },
        until_s: cameras.get(i + 1).map_or(f64::INFINITY, |next| next.span_s[0]),
        camera: camera.clone(),
    };
    cameras.iter().enumerate().map(segment).collect()
}

/// Returns the mean frame rate between the first and the last frame with rows, frames per second; 1 if it cannot be
/// computed.
fn frames_per_s(rows: &BTreeMap<u64, Vec<TrackRow>>) -> f64 {
    let all = || rows.values().flatten();
    let ends = all().min_by_key(|row| row.frame).zip(all().max_by_key(|row| row.frame));
    ends.map(|(a, b)| (b.frame - a.frame) as f64 / (b.time_s - a.time_s))
        .filter(|rate| rate.is_finite() && *rate > 0.0)
        .unwrap_or(1.0)
}

fn media_of(summary: &Summary) -> String {
    let name = Path::new(&summary.input.path).file_name();
    plain(&name.map_or_else(|| "input".to_owned(), |name| name.to_string_lossy().into_owned()))
}

/// Returns the start of the recording, s since the start of 1970 (UTC); `None` if it is unknown.
fn start_s(folder: &Path, summary: &Summary) -> Result<Option<i64>, WriteError> {
    let name = Path::new(&summary.input.path).file_name();
    if let Some(time) = name.and_then(|name| time_in_name(&name.to_string_lossy())) {
        return Ok(seconds_since_1970(&time));
    }
    let evidence = folder.join("evidence.json");
    if !evidence.exists() {
        return Ok(None);
    }
    Ok(seconds_since_1970(&read_evidence(&evidence)?.clip.recorded))
}

/// Replaces each character by `_`, except for ASCII letters, digits, `_`, `-` and `.`.
fn plain(name: &str) -> String {
    let keep = |c: char| if c.is_ascii_alphanumeric() || "_-.".contains(c) { c } else { '_' };
    name.chars().map(keep).collect()
}
