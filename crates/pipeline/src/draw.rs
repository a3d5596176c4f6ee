//! A clip's result drawn into its frames, for the report and for annotated videos.

use std::collections::BTreeMap;
use std::path::Path;

use image::RgbImage;
use roadplane_base::{CameraEstimate, Shape, ShapeAtlas, TrackRow};
use roadplane_view::{DrawnCar, Overlay, ReportInput, VideoSink, ViewError, report_html, with_lines};
use roadplane_write::{OutFile, Summary, read_camera, read_jsonl};

use crate::cameras::CameraTrack;
use crate::cars::FrameCamera;
use crate::clip::ClipSolution;
use crate::flow::Work;
use crate::known::known_in_words;
use crate::streaming::{open_input, stream};
use crate::watched::in_words;
use crate::{Cancel, Config, PipelineError, Progress};

/// Time that trails reach back, s.
const TRAIL_S: f64 = 10.0;

/// What is drawn: rows of all frames, shapes of all tracks, cameras.
pub struct Scene<'a> {
    cameras: &'a CameraTrack,
    atlas: &'a ShapeAtlas,
    shapes: BTreeMap<u64, Shape>,
    of_frame: BTreeMap<u64, Vec<&'a TrackRow>>,
    of_track: BTreeMap<u64, Vec<&'a TrackRow>>,
}

impl<'a> Scene<'a> {
    /// Of a clip's rows and the shapes of its tracks.
    #[must_use]
    pub fn new(
        cameras: &'a CameraTrack,
        rows: &'a [TrackRow],
        shapes: BTreeMap<u64, Shape>,
        atlas: &'a ShapeAtlas,
    ) -> Self {
        let mut of_frame: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
        let mut of_track: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
        for row in rows {
            of_frame.entry(row.frame).or_default().push(row);
            of_track.entry(row.track).or_default().push(row);
        }
        Self { cameras, atlas, shapes, of_frame, of_track }
    }

    /// The frame with everything in it.
    ///
    /// # Errors
    /// [`ViewError`].
    pub fn draw(&self, frame: u64, time_s: f64, picture: &RgbImage) -> Result<RgbImage, ViewError> {
        let Some(estimate) = self.cameras.at(time_s) else { return Ok(picture.clone()) };
        let view = FrameCamera::from(estimate);
        let mut overlay = Overlay::new(picture, &view.camera, &view.plane, self.atlas)?;
        overlay.grid()?;
        for row in self.of_frame.get(&frame).into_iter().flatten() {
            let shape = self.shapes.get(&row.track).copied().unwrap_or_else(Shape::zeros);
            let trail: Vec<[f64; 2]> = self
                .of_track
                .get(&row.track)
                .into_iter()
                .flatten()
                .filter(|past| past.frame <= frame && past.time_s >= time_s - TRAIL_S)
                .map(|past| [past.x_m, past.y_m])
                .collect();
            overlay.car(&DrawnCar { row, shape: &shape, trail: &trail })?;
        }
        overlay.finish()
    }
}

/// Writes `report.html`.
///
/// # Errors
/// [`PipelineError`].
pub fn write_report(
    path: &Path,
    title: &str,
    atlas: &ShapeAtlas,
    solution: &ClipSolution,
    samples: &[(u64, f64, RgbImage)],
    background: Option<&RgbImage>,
    summary: &Summary,
) -> Result<(), PipelineError> {
    let scene = Scene::new(&solution.cameras, &solution.rows, solution.shapes(), atlas);
    let drawn: Vec<(u64, RgbImage)> = samples
        .iter()
        .map(|(frame, time_s, picture)| Ok((*frame, scene.draw(*frame, *time_s, picture)?)))
        .collect::<Result<_, ViewError>>()?;
    // The picture of the place is of the camera's last position.
    let lines = background.and_then(|place| {
        let view = solution.cameras.scene().iter().find(|view| view.position == solution.cameras.moves())?;
        let upright = &view.verticals.as_ref()?.upright;
        Some(with_lines(place, view.lines.iter().zip(upright.iter().copied())))
    });
    let lines = lines.transpose()?;
    let facts = facts_of(summary);
    let page = report_html(&ReportInput {
        title,
        cameras: solution.cameras.estimates(),
        rows: &solution.rows,
        samples: &drawn,
        reprojection_rms_px: &solution.reprojection_rms_px,
        facts: &facts,
        warnings: &summary.warnings,
        background,
        scene_lines: lines.as_ref(),
        camera_notes: &in_words(&summary.watch),
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
        ("frames a second".to_owned(), format!("{:.2}", summary.frames_per_s)),
    ];
    if let Some(speed) = &summary.speed {
        let (ms, seen) = (&speed.cpu_ms_per_frame, 100.0 * speed.seen_share);
        let cpu = format!(
            "{:.1}: decode {:.1}, watch {:.1}, detect {:.1}, keypoints {:.1}, solve {:.1}",
            ms.total, ms.decode, ms.watch, ms.detect, ms.keypoints, ms.solve
        );
        facts.push(("CPU ms a frame".to_owned(), cpu));
        facts.push(("share of the picture the detector saw".to_owned(), format!("{seen:.2} %")));
        facts.push(("crops".to_owned(), speed.crops.to_string()));
    }
    facts.extend(summary.known.iter().map(|known| (known.what.clone(), known_in_words(known))));
    facts.extend(counts.boxes.iter().map(|(class, n)| (format!("boxes: {class}"), n.to_string())));
    facts.extend(counts.rejected.iter().map(|(reason, n)| (format!("left out: {reason}"), n.to_string())));
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

/// Draws every frame of an input into a video. True if some of the input was lost.
///
/// # Errors
/// [`PipelineError`]; the video then does not appear.
pub fn draw_video(
    input: &Path,
    scene: &Scene<'_>,
    video: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<bool, PipelineError> {
    let input = open_input(input, config)?;
    let size = input.size();
    let frames_per_s = input.nominal_fps() / f64::from(config.decode.stride.max(1));
    let mut sink = VideoSink::create(video, size.width, size.height, frames_per_s)?;
    let draw = |work: Work| {
        let Some(image) = &work.image else { return Ok(()) };
        Ok(sink.write(&scene.draw(work.stamp.index, work.stamp.time_s(), image)?)?)
    };
    let streamed = stream(input, |_| true, Vec::new(), draw, config, cancel, progress)?;
    sink.finish()?;
    Ok(streamed.decode.is_damaged())
}

/// `roadplane render`: draws a finished run's folder into a video of its input. True if some of the input was lost.
///
/// # Errors
/// [`PipelineError`]; the video then does not appear.
pub fn render_run(
    input: &Path,
    run: &Path,
    video: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<bool, PipelineError> {
    let atlas = ShapeAtlas::shipped()?;
    let estimates: Vec<CameraEstimate> =
        read_camera(&run.join("camera.json"))?.all().iter().map(|segment| segment.estimate()).collect();
    let cameras = CameraTrack::from_estimates(estimates);
    let rows: Vec<TrackRow> = read_jsonl(&run.join("tracks.jsonl"))?.collect::<Result<_, _>>()?;
    let mut shapes = BTreeMap::new();
    for pose in read_jsonl::<roadplane_base::PoseRecord>(&run.join("poses.jsonl"))? {
        let pose = pose?;
        if let Some(track) = pose.track {
            shapes.insert(track, Shape::from(pose.shape));
        }
    }
    let scene = Scene::new(&cameras, &rows, shapes, &atlas);
    draw_video(input, &scene, video, config, cancel, progress)
}
