//! Draws the result of a clip onto its frames, for the report and for annotated videos.

use std::collections::{BTreeMap, VecDeque};
use std::iter::Peekable;
use std::path::Path;

use image::RgbImage;
use roadplane_base::{CameraEstimate, SceneLine, Shape, ShapeAtlas, TrackRow};
use roadplane_decode::{DecodeOptions, refuse_address};
use roadplane_measure::FrameCamera;
use roadplane_view::{
    DrawnCar, GroundCells, Overlay, PlainFrame, ReportInput, VideoSink, report_html, with_lines,
};
use roadplane_write::{OutFile, Summary, read_camera, read_jsonl, read_summary};

use crate::cameras::camera_track::CameraTrack;
use crate::cameras::known::constraint_in_words;
use crate::estimation::ClipSolution;
use crate::identity::file_identity;
use crate::output::losses::losses_in_words;
use crate::stream::flow::Work;
use crate::stream::stills::Stills;
use crate::stream::streaming::{open_input, stream};
use crate::stream::watched::in_words;
use crate::tracks::views::Views;
use crate::{Cancel, Config, PipelineError, Progress};

/// Duration of the trail that is drawn behind a vehicle, s.
const TRAIL_S: f64 = 10.0;

/// The results of a run that are drawn.
#[derive(Clone, Copy)]
pub(crate) struct Drawn<'a> {
    /// Camera at every time.
    pub cameras: &'a CameraTrack,
    /// Motion of the camera.
    pub views: &'a Views,
    /// Shape of each track.
    pub shapes: &'a BTreeMap<u64, Shape>,
}

/// Draws the track rows of a run onto its frames. The rows must be in the order of frames. Rows that are too old for a
/// trail are dropped.
pub(crate) struct Scene<'a, R: Iterator<Item = Result<TrackRow, PipelineError>>> {
    result: Drawn<'a>,
    atlas: &'a ShapeAtlas,
    cells: Cells,
    coming: Peekable<R>,
    /// Rows of the last [`TRAIL_S`] seconds before the current frame.
    recent: VecDeque<TrackRow>,
}

/// Grid cells of the ground where vehicles were, by the number of the camera segment. A segment is an interval in which
/// the camera is constant.
pub(crate) type Cells = BTreeMap<usize, GroundCells>;

/// Returns the grid cells of the ground where vehicles were during a run.
pub(crate) fn cells_of(
    rows: impl Iterator<Item = Result<TrackRow, PipelineError>>,
) -> Result<Cells, PipelineError> {
    let mut cells = Cells::new();
    for row in rows {
        let row = row?;
        cells.entry(row.segment).or_default().add(row.x_m, row.y_m);
    }
    Ok(cells)
}

impl<'a, R: Iterator<Item = Result<TrackRow, PipelineError>>> Scene<'a, R> {
    /// Creates a scene from the rows of a clip and the shapes of its tracks.
    pub(crate) fn new(result: Drawn<'a>, rows: R, cells: Cells, atlas: &'a ShapeAtlas) -> Self {
        Self { result, atlas, cells, coming: rows.peekable(), recent: VecDeque::new() }
    }

    /// Returns a copy of a frame's picture with all drawings. Frames must be drawn in their order.
    ///
    /// # Errors
    /// Returns a [`PipelineError`] if drawing fails or a row cannot be read.
    pub(crate) fn draw(
        &mut self,
        frame: u64,
        time_s: f64,
        picture: &RgbImage,
    ) -> Result<RgbImage, PipelineError> {
        while let Some(row) = self.coming.next_if(|row| row.as_ref().map_or(true, |row| row.frame <= frame)) {
            let row = row?;
            if row.time_s >= time_s - TRAIL_S {
                self.recent.push_back(row);
            }
        }
        while self.recent.front().is_some_and(|row| row.time_s < time_s - TRAIL_S) {
            self.recent.pop_front();
        }
        let Drawn { cameras, views, shapes } = self.result;
        let Some(estimate) = cameras.at(time_s) else { return Ok(picture.clone()) };
        let view = FrameCamera::from(estimate);
        let mut overlay = Overlay::new(picture, &view.camera, view.ground, self.atlas)?;
        if let Some(picture_from_world) = views.of(frame) {
            overlay = overlay.displaced(picture_from_world);
        }
        if let Some(cells) = self.cells.get(&cameras.segment_at(time_s)) {
            overlay.grid(cells)?;
        }
        let mut trails: BTreeMap<u64, Vec<[f64; 2]>> = BTreeMap::new();
        for row in &self.recent {
            trails.entry(row.track).or_default().push([row.x_m, row.y_m]);
        }
        let rows: Vec<&TrackRow> = self.recent.iter().filter(|row| row.frame == frame).collect();
        for row in &rows {
            let shape = shapes.get(&row.track).copied().unwrap_or_else(Shape::zeros);
            let trail = trails.get(&row.track).map(Vec::as_slice).unwrap_or_default();
            overlay.car(&DrawnCar { row, shape: &shape, trail })?;
        }
        overlay.labels(&rows)?;
        Ok(overlay.finish()?)
    }
}

/// Parts of a report that do not come from the solution.
pub(crate) struct ReportParts<'a> {
    /// Sections on traffic, as HTML.
    pub traffic: &'a str,
    /// Frames on which the result is drawn: index, time in s, picture.
    pub samples: &'a [(u64, f64, RgbImage)],
    /// Small frames and cut-outs of vehicles that the player in the report shows.
    pub stills: &'a Stills,
    /// The background image: the scene without vehicles.
    pub background: Option<&'a RgbImage>,
    /// Whether only some of the rows are drawn, because the clip is long.
    pub is_thinned: bool,
}

/// Writes the report of a result, an HTML page, to `path`.
///
/// # Errors
/// Returns a [`PipelineError`] if a picture cannot be drawn or the file cannot be written.
pub(crate) fn write_report(
    path: &Path,
    title: &str,
    atlas: &ShapeAtlas,
    solution: &ClipSolution,
    seen: &ReportParts<'_>,
    summary: &Summary,
    config: &Config,
) -> Result<(), PipelineError> {
    let &ReportParts { traffic, samples, stills, background, is_thinned } = seen;
    let rows = || solution.rows.iter().cloned().map(Ok);
    let result = Drawn { cameras: &solution.cameras, views: &solution.views, shapes: &solution.shapes };
    let mut scene = Scene::new(result, rows(), cells_of(rows())?, atlas);
    let drawn: Vec<(u64, RgbImage)> = samples
        .iter()
        .map(|(frame, time_s, picture)| Ok((*frame, scene.draw(*frame, *time_s, picture)?)))
        .collect::<Result<_, PipelineError>>()?;
    // The background image shows the scene from the last position of the camera.
    let lines = background.and_then(|background| {
        let scene = solution.cameras.scene_from_world.as_ref()?;
        let view =
            solution.cameras.scene.iter().find(|view| view.position == solution.cameras.last_position())?;
        let upright = &view.verticals.as_ref()?.upright;
        let in_scene =
            |line: &SceneLine| SceneLine { ends_px: line.ends_px.map(|end| scene.apply(&end)), ..*line };
        let lines: Vec<SceneLine> = view.lines.iter().map(in_scene).collect();
        Some(with_lines(background, lines.iter().zip(upright.iter().copied())))
    });
    let lines = lines.transpose()?;
    let facts = facts_of(summary);
    let mut losses = losses_in_words(&summary.counts, &solution.rows, &config.decode);
    if is_thinned {
        losses.push(
            "This clip is long: the page shows one or two rows of a track per second. The files have all rows."
                .to_owned(),
        );
    }
    let small = stills.frames();
    let still_motion: Vec<Option<[f64; 8]>> = small
        .iter()
        .map(|still| solution.views.at_ms(still.time_ms).map(|view| view.homography.numbers()))
        .collect();
    let is_estimated = !solution.cameras.estimates.is_empty();
    let plain: Vec<PlainFrame<'_>> = samples
        .iter()
        .map(|&(frame, time_s, ref picture)| PlainFrame {
            frame,
            time_s,
            segment: is_estimated.then(|| solution.cameras.segment_at(time_s)),
            picture,
        })
        .collect();
    let page = report_html(&ReportInput {
        title,
        cameras: &solution.cameras.estimates,
        rows: &solution.rows,
        samples: &drawn,
        frames: &plain,
        stills: &small,
        still_motion: &still_motion,
        views: &stills.views(&solution.rows),
        reprojection_rms_px: &solution.reprojection_rms_px,
        facts: &facts,
        warnings: &summary.warnings,
        background,
        scene_lines: lines.as_ref(),
        moves: &summary.watch.moves,
        camera_notes: &in_words(&summary.watch),
        losses: &losses,
        traffic,
        place: solution.place.as_ref().map(|place| &place.fit),
    })?;
    let mut file = OutFile::create(path)?;
    file.write_bytes(page.as_bytes())?;
    Ok(file.finish()?)
}

fn facts_of(summary: &Summary) -> Vec<(String, String)> {
    let counts = &summary.counts;
    let mut facts = vec![
        ("input".to_owned(), summary.input.path.clone()),
        ("frames read".to_owned(), counts.frames_read.to_string()),
        ("frames lost".to_owned(), counts.frames_lost.to_string()),
        ("frames left out on purpose".to_owned(), counts.frames_skipped.to_string()),
        ("frames per second".to_owned(), format!("{:.2}", summary.frames_per_s)),
    ];
    if let Some(speed) = &summary.speed {
        let (ms, share) = (&speed.cpu_ms_per_frame, 100.0 * speed.seen_share);
        let cpu = format!(
            "{:.1}: decode {:.1}, watch {:.1}, detect {:.1}, keypoints {:.1}, solve {:.1}",
            ms.total, ms.decode, ms.watch, ms.detect, ms.keypoints, ms.solve
        );
        facts.push(("CPU ms per frame".to_owned(), cpu));
        facts.push(("share of the pixels that the detector processed".to_owned(), format!("{share:.2} %")));
        facts.push(("crops".to_owned(), speed.crops.to_string()));
    }
    facts.extend(summary.known.iter().map(|one| (one.what.clone(), constraint_in_words(one))));
    facts.extend(counts.boxes.iter().map(|(class, n)| (format!("boxes: {class}"), n.to_string())));
    facts.extend(counts.rejected.iter().map(|(reason, n)| (format!("left out: {reason}"), n.to_string())));
    if summary.watch.time_sd_s > 0.0 {
        let sd = format!("{:.3} s", summary.watch.time_sd_s);
        facts.push(("error of the time stamps (sd)".to_owned(), sd));
    }
    if counts.tracks_left_out > 0 {
        facts.push((
            "left out: tracks that are probably no vehicles".to_owned(),
            counts.tracks_left_out.to_string(),
        ));
    }
    facts.extend(
        summary.seconds.iter().map(|t| (format!("seconds in {}", t.stage), format!("{:.1}", t.seconds))),
    );
    facts.extend(
        summary
            .models
            .iter()
            .map(|model| (model.name.clone(), format!("version {}, on {}", model.version, model.provider))),
    );
    facts.extend(summary.versions.iter().map(|(name, version)| (name.clone(), version.clone())));
    facts.push(("configuration".to_owned(), format!("sha256 {}", summary.config_sha256)));
    facts
}

/// Draws the tracks in the folder `run` onto the frames of the input and writes the video. Returns true if some of the
/// input was lost or damaged.
///
/// # Errors
/// Returns a [`PipelineError`] if the video cannot be completed. No video file is then created.
pub(crate) fn draw_video(
    input: &Path,
    run: &Path,
    result: Drawn<'_>,
    video: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<bool, PipelineError> {
    let rows = || -> Result<_, PipelineError> {
        Ok(read_jsonl::<TrackRow>(&run.join("tracks.jsonl"))?.map(|row| Ok(row?)))
    };
    let atlas = ShapeAtlas::shipped()?;
    let mut scene = Scene::new(result, rows()?, cells_of(rows()?)?, &atlas);
    let input = open_input(input, config)?;
    let size = input.size();
    let frames_per_s = input.nominal_fps() / f64::from(config.decode.stride.max(1));
    let mut sink = VideoSink::create(video, size.width, size.height, frames_per_s)?;
    let draw = |work: &Work| {
        let Some(image) = &work.image else { return Ok(()) };
        Ok(sink.write(&scene.draw(work.stamp.index, work.stamp.time_s(), image)?)?)
    };
    let streamed = stream(input, |_| true, Vec::new(), draw, config, cancel, progress)?;
    sink.finish()?;
    Ok(streamed.decode.is_damaged())
}

/// Runs `roadplane render`: draws the tracks of a finished run onto the frames of its input and writes the video.
/// Returns true if some of the input was lost or damaged.
///
/// # Errors
/// Returns [`PipelineError::Usage`] if the run has another input, and another [`PipelineError`] if the video cannot be
/// completed. No video file is then created.
pub fn render_run(
    input: &Path,
    run: &Path,
    video: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<bool, PipelineError> {
    let summary = read_summary(&run.join("summary.json"))?;
    refuse_other_input(input, run, &summary)?;
    let config = &as_run(&summary, config);
    let file = read_camera(&run.join("camera.json"))?;
    let estimates: Vec<CameraEstimate> = file.all().iter().map(|segment| segment.estimate()).collect();
    let (cameras, views) = (CameraTrack { estimates, ..CameraTrack::default() }, Views::from_file(&file));
    let mut shapes = BTreeMap::new();
    for pose in read_jsonl::<roadplane_base::PoseRecord>(&run.join("poses.jsonl"))? {
        let pose = pose?;
        if let Some(track) = pose.track {
            shapes.insert(track, Shape::from(pose.shape));
        }
    }
    let result = Drawn { cameras: &cameras, views: &views, shapes: &shapes };
    draw_video(input, run, result, video, config, cancel, progress)
}

/// Returns `config` with the `[decode]` settings of a finished run, because only the frames that the run read have
/// rows. Settings in `config` that differ from their defaults take precedence.
fn as_run(summary: &Summary, config: &Config) -> Config {
    let of = |options: &DecodeOptions| serde_json::to_value(options).unwrap_or_default();
    let (asked, default) = (of(&config.decode), of(&DecodeOptions::default()));
    let mut chosen = summary.config.get("decode").cloned().unwrap_or_default();
    if let (Some(chosen), Some(asked)) = (chosen.as_object_mut(), asked.as_object()) {
        let other = asked.iter().filter(|(option, value)| default.get(option.as_str()) != Some(value));
        chosen.extend(other.map(|(option, value)| (option.clone(), value.clone())));
    }
    let decode = serde_json::from_value(chosen).unwrap_or_else(|_absent| config.decode.clone());
    Config { decode, ..config.clone() }
}

/// Refuses an input whose content differs from that of the run's input.
///
/// A run without nets was made from a file of frames (`stage track`), and has no hash of its video.
fn refuse_other_input(input: &Path, run: &Path, summary: &Summary) -> Result<(), PipelineError> {
    refuse_address(input)?;
    let made_of = &summary.input;
    if summary.models.is_empty() || file_identity(input)?.sha256 == made_of.sha256 {
        return Ok(());
    }
    Err(PipelineError::usage(&format!(
        "{} is not the input of the run {}: give that input, {} (sha256 {}…), or make a run of {0} first",
        input.display(),
        run.display(),
        made_of.path,
        made_of.sha256.get(..12).unwrap_or(&made_of.sha256),
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracks::shared_error::tests::estimate;
    use roadplane_synth::stationary_row;
    use roadplane_write::{ModelSummary, write_summary};

    #[test]
    fn rows_are_kept_as_long_as_they_are_drawn() {
        let row = |frame: u64| TrackRow {
            x_m: 0.02 * frame as f64 - 6.0,
            ..stationary_row(1, frame, frame as f64 / 10.0)
        };
        let rows: Vec<TrackRow> = (0..600).map(row).collect();
        let cells = || cells_of(rows.iter().cloned().map(Ok)).unwrap();
        let (atlas, shapes, views) = (ShapeAtlas::shipped().unwrap(), BTreeMap::new(), Views::default());
        let cameras = CameraTrack { estimates: vec![estimate([0.01; 4])], ..CameraTrack::default() };
        let scene = |from: usize| {
            let rows = rows[from..].iter().cloned().map(Ok);
            Scene::new(Drawn { cameras: &cameras, views: &views, shapes: &shapes }, rows, cells(), &atlas)
        };
        let empty = RgbImage::new(1280, 720);
        let (mut whole, mut last) = (scene(0), empty.clone());
        for frame in 0..=500 {
            if frame % 50 == 0 {
                last = whole.draw(frame, frame as f64 / 10.0, &empty).unwrap();
            }
            assert!(whole.recent.len() <= 101, "{}", whole.recent.len());
        }
        // The picture depends on all rows of the trail and on no earlier row. Rows of the last second alone give
        // another picture.
        let [trail, second] = [400, 490].map(|from| scene(from).draw(500, 50.0, &empty).unwrap());
        assert!(last == trail && last != second && second != empty);
    }

    #[test]
    fn a_run_is_drawn_with_the_frames_that_it_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut made = Config::default();
        made.decode.stride = 3;
        let summary = Summary { config: serde_json::to_value(&made).unwrap(), ..Summary::default() };
        write_summary(&folder.path().join("summary.json"), &summary).unwrap();
        let as_run =
            |config: &Config| as_run(&read_summary(&folder.path().join("summary.json")).unwrap(), config);
        assert_eq!(as_run(&Config::default()).decode.stride, 3);
        let mut asked = Config::default();
        asked.decode.end_s = Some(5.0);
        let both = as_run(&asked).decode;
        assert_eq!((both.stride, both.end_s), (3, Some(5.0)));
        write_summary(&folder.path().join("summary.json"), &Summary::default()).unwrap();
        assert_eq!(as_run(&Config::default()), Config::default());
    }

    #[test]
    fn another_input_than_that_of_the_run_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [clip, other] = ["a.mp4", "b.mp4"].map(|name| folder.path().join(name));
        std::fs::write(&clip, "one clip").unwrap();
        std::fs::write(&other, "another clip").unwrap();
        let made = Summary {
            input: file_identity(&clip).unwrap(),
            models: vec![ModelSummary::default()],
            ..Summary::default()
        };
        let check = |input: &Path, summary: &Summary| {
            refuse_other_input(input, folder.path(), summary).map_err(|error| error.to_string())
        };
        // Only the content counts.
        std::fs::rename(&clip, folder.path().join("moved.mp4")).unwrap();
        assert_eq!(check(&folder.path().join("moved.mp4"), &made), Ok(()));
        let message = check(&other, &made).unwrap_err();
        assert!(message.contains("is not the input of the run") && message.contains("a.mp4"), "{message}");
        // The input of `stage track` is a file of frames.
        assert_eq!(check(&other, &Summary { models: Vec::new(), ..made }), Ok(()));
    }
}
