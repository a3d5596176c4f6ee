//! `roadplane run` for one input: stream it, solve the clip, write and draw the result.

use std::path::{Path, PathBuf};
use std::time::Instant;

use image::codecs::png::PngEncoder;
use roadplane_base::ShapeAtlas;
use roadplane_export::{Run, write_ways};
use roadplane_geo::Site;
use roadplane_view::ViewError;
use roadplane_watch::Background;
use roadplane_write::{
    Existing, FrameSpool, InputSummary, OutFile, OutputFolder, RunStatus, StageSeconds, Summary,
    read_summary, write_evidence, write_json, write_summary,
};
use serde::{Deserialize, Serialize};

use crate::activities::{label_rows, write_events};
use crate::clip::{ClipSolution, Given, solve_known_clip};
use crate::draw::{Scene, draw_video, write_report};
use crate::flow::Work;
use crate::identity::{file_identity, peak_memory_bytes, versions};
use crate::limits::check_memory;
use crate::memory::{CameraMemory, EVIDENCE};
use crate::samples::SampleFrames;
use crate::scene_lines::{LineFinder, SceneView};
use crate::speed::{Looks, Meter};
use crate::streaming::{
    Cadence, Nets, Streamed, detect_stage, keypoint_stage, open_input, stream, stretch_of, watch_stage,
};
use crate::track_file::write_solution;
use crate::watched::Watched;
use crate::{Cancel, Config, Known, PipelineError, Progress, Silent};

/// The streaming half's product within the partial folder.
const SPOOL: &str = "frames.jsonl";
/// What the spool was made of; a resumed run must be of the same.
const STAMP: &str = "stamp.json";

/// What a caller of [`run_input`] chooses besides the configuration.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Folder of the models.
    pub models: PathBuf,
    /// What is known of the camera.
    pub known: Known,
    /// What is remembered of the cameras.
    pub cameras: Option<CameraMemory>,
    /// Where the camera stands on the map; one for all inputs.
    pub site: Option<Site>,
    /// What to do about a finished result of the same name.
    pub existing: Existing,
    /// Go on where a stopped run ended; leave finished results alone.
    pub resume: bool,
    /// Also write the annotated video.
    pub video: bool,
    /// Also write the empty place as a picture.
    pub background: bool,
    /// Leave what the streaming half found, frame by frame, in the result: `frames.jsonl`.
    pub frames: bool,
    /// No other input is worked on in this process at the same time: its processor time is this run's.
    pub alone: bool,
}

impl RunOptions {
    /// Nothing asked for beside the results, which must not be there yet.
    #[must_use]
    pub fn new(models: PathBuf) -> Self {
        Self {
            models,
            known: Known::default(),
            cameras: None,
            site: None,
            existing: Existing::Refuse,
            resume: false,
            video: false,
            background: false,
            frames: false,
            alone: false,
        }
    }
}

/// What came of one input.
#[derive(Clone, Debug)]
pub struct RunReport {
    /// The result.
    pub folder: PathBuf,
    /// Tracks in it; `None` for a result that was there before.
    pub tracks: Option<u64>,
    /// The camera in words.
    pub camera: String,
    /// Some of the input was lost.
    pub damaged: bool,
    /// Frames that could not be decoded.
    pub frames_lost: u64,
}

/// Identifies the work that a spool belongs to.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Stamp {
    version: String,
    input_sha256: String,
    config_sha256: String,
    models: Vec<String>,
}

/// Name of an input's result folder: its file name without extension, or the folder's name.
#[must_use]
pub fn stem_of(input: &Path) -> String {
    let absolute = std::path::absolute(input).unwrap_or_else(|_unresolvable| input.to_path_buf());
    let name = if absolute.is_dir() { absolute.file_name() } else { absolute.file_stem() };
    name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Runs one input into `out/<stem>/`. Hold the lock of `out`.
///
/// # Errors
/// [`PipelineError`]; nothing then appears under the final name. What a stopped run did stays for `resume`.
pub fn run_input(
    input_path: &Path,
    out: &Path,
    options: &RunOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let started = Instant::now();
    let mut meter = Meter::start(options.alone);
    let stem = stem_of(input_path);
    let finished = out.join(&stem);
    let summary = finished.join("summary.json");
    if options.resume && summary.is_file() {
        let camera = "finished before".to_owned();
        let summary = read_summary(&summary)?;
        let damaged = summary.status == RunStatus::InputDamaged;
        let frames_lost = summary.counts.frames_lost;
        return Ok(RunReport { folder: finished, tracks: None, camera, damaged, frames_lost });
    }
    let input = open_input(input_path, config)?;
    check_memory(input.size())?;
    let known = options.known.for_pictures(input.size())?;
    let identity = file_identity(input_path)?;
    let mut nets = Nets::open(&options.models, config)?;
    let models = nets.summaries();
    let atlas = ShapeAtlas::shipped()?;

    let mut folder = OutputFolder::begin(out, &stem, options.existing)?;
    let stamp = Stamp {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        input_sha256: identity.sha256.clone(),
        config_sha256: config.fingerprint(),
        models: nets.fingerprints(),
    };
    if folder.is_resumed() && !(options.resume && read_stamp(folder.path()).as_ref() == Some(&stamp)) {
        folder.reset()?;
    }
    write_json(&folder.path().join(STAMP), &stamp)?;

    meter.opened(1.0 / input.nominal_fps().max(1e-3));
    let result = (|| {
        progress.phase("frames");
        let offered = input.frames_hint().map(|frames| frames / Cadence::of(&input, config).every());
        let mut samples = SampleFrames::new(config.output.sample_frames, offered);
        let (mut watched, mut looks) = (Watched::default(), Looks::default());
        let mut background = None;
        let mut sinks = Sinks {
            samples: &mut samples,
            watched: &mut watched,
            looks: &mut looks,
            background: &mut background,
        };
        let streamed =
            stream_to_spool(&mut nets, input, folder.path(), &mut sinks, config, cancel, progress)?;
        meter.streamed(&streamed, looks, &nets);
        if let Some(background) = background.as_ref().filter(|_| options.background) {
            write_background(folder.path(), background)?;
        }
        let rejected_cars = nets.keypoints.rejected();
        let place = background.as_ref().map(Background::picture);
        let cameras = options.cameras.as_ref();
        let recall = cameras
            .map(|memory| memory.recall(input_path, &identity, nets.fingerprints(), place))
            .transpose()?;
        let mut activity = nets.activity.take();
        drop(nets);
        progress.phase("solving");
        let spool = folder.path().join(SPOOL);
        let solving = Instant::now();
        let poses = folder.path().join("poses.jsonl");
        let given = Given { known: &known, recall: recall.as_ref(), site: options.site.as_ref() };
        let mut solution = solve_known_clip(&spool, &poses, &atlas, &given, config, cancel)?;
        let events = activity.as_mut().map(|net| label_rows(net, &mut solution.rows)).transpose()?;
        let solve_s = solving.elapsed().as_secs_f64();
        meter.solved();
        progress.phase("writing");
        write_solution(folder.path(), &solution)?;
        if let Some(said) = solution.cameras.said() {
            write_evidence(&folder.path().join(EVIDENCE), said)?;
        }
        if let Some(events) = &events {
            write_events(&folder.path().join("activities.jsonl"), events)?;
        }

        let mut summary = summary_of(identity, &streamed, &solution, config, rejected_cars);
        summary.models = models;
        summary.watch = watched.finish();
        summary.seconds.push(StageSeconds { stage: "solve".to_owned(), seconds: solve_s });
        summary.wall_s = started.elapsed().as_secs_f64();
        summary.frames_per_s = streamed.decode.delivered as f64 / summary.wall_s.max(1e-9);
        summary.peak_memory_bytes = peak_memory_bytes();
        summary.speed = Some(meter.speed());
        let samples = samples.finish();
        write_report(
            &folder.path().join("report.html"),
            &stem,
            &atlas,
            &solution,
            &samples,
            place,
            &summary,
        )?;
        // The report cannot tell what it costs itself.
        summary.speed = Some(meter.speed());
        if options.video {
            progress.phase("drawing");
            let scene = Scene::new(&solution.cameras, &solution.rows, solution.shapes(), &atlas);
            let video = folder.path().join("annotated.mp4");
            draw_video(input_path, &scene, &video, config, cancel, &Silent)?;
        }
        write_summary(&folder.path().join("summary.json"), &summary)?;
        if solution.place.is_some() {
            write_ways(&Run::read_as(folder.path(), &stem)?, &folder.path().join("tracks.geojson"))?;
        }
        Ok((streamed.decode, solution))
    })();
    let (decode, solution) = match result {
        Ok(done) => done,
        Err(error) => {
            // Only a stopped run leaves something to go on from.
            if !matches!(error, PipelineError::Stopped { .. }) {
                folder.discard()?;
            }
            return Err(error);
        }
    };
    let work_files = if options.frames { &[STAMP][..] } else { &[STAMP, SPOOL] };
    for work_file in work_files {
        let path = folder.path().join(work_file);
        std::fs::remove_file(&path).map_err(|source| PipelineError::Unreadable { source, path })?;
    }
    let tracks = Some(solution.tracks.len() as u64);
    let camera = solution.camera_in_words();
    let (damaged, frames_lost) = (decode.is_damaged(), decode.missing);
    Ok(RunReport { folder: folder.publish()?, tracks, camera, damaged, frames_lost })
}

fn read_stamp(folder: &Path) -> Option<Stamp> {
    serde_json::from_slice(&std::fs::read(folder.join(STAMP)).ok()?).ok()
}

/// What streaming fills besides the spool.
struct Sinks<'a> {
    samples: &'a mut SampleFrames,
    watched: &'a mut Watched,
    looks: &'a mut Looks,
    background: &'a mut Option<Background>,
}

/// `background.png`, and in `background.json` when each part of it was last seen bare.
fn write_background(folder: &Path, background: &Background) -> Result<(), PipelineError> {
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    background.picture().write_with_encoder(encoder).map_err(ViewError::from)?;
    let mut file = OutFile::create(&folder.join("background.png"))?;
    file.write_bytes(&png)?;
    file.finish()?;
    let ages = serde_json::json!({
        "schema": "roadplane.background/1",
        "cell_px": background.cell_px(),
        "last_bare_s": background.bare_s(),
    });
    Ok(write_json(&folder.join("background.json"), &ages)?)
}

fn stream_to_spool(
    nets: &mut Nets,
    input: roadplane_decode::Input,
    folder: &Path,
    sinks: &mut Sinks<'_>,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Streamed, PipelineError> {
    // What the nets remember ends at the same places of the input in every run: there a stopped one goes on.
    let (mut spool, recovered) = FrameSpool::open(&folder.join(SPOOL), |record| stretch_of(record.time_s))?;
    if recovered.frames > 0 {
        tracing::info!("going on after {} frames of the stopped run", recovered.frames);
    }
    let is_new = move |frame: u64| recovered.last_frame.is_none_or(|last| frame > last);
    let cadence = Cadence::of(&input, config);
    let lines = LineFinder::new(recovered.frames > 0 || !config.solve.use_verticals);
    let stages = vec![
        watch_stage(),
        detect_stage(&mut nets.detector, cadence, sinks.background, lines)
            .only(move |record| is_new(record.frame)),
        keypoint_stage(&mut nets.keypoints, cadence).only(move |record| is_new(record.frame)),
    ];
    let sink = |work: Work| {
        if let Some(image) = &work.image {
            sinks.samples.offer(work.stamp, image);
        }
        sinks.watched.push(&work.record);
        let is_new = is_new(work.record.frame);
        sinks.looks.add(&work.record, is_new);
        if is_new { Ok(spool.append(&work.record)?) } else { Ok(()) }
    };
    let streamed = stream(input, cadence.chooser(), stages, sink, config, cancel, progress);
    // Also after a stop: what is done is not done again.
    spool.sync()?;
    streamed
}

fn summary_of(
    input: InputSummary,
    streamed: &Streamed,
    solution: &ClipSolution,
    config: &Config,
    rejected_cars: u64,
) -> Summary {
    let decode = &streamed.decode;
    let mut summary = Summary {
        status: if decode.is_damaged() { RunStatus::InputDamaged } else { RunStatus::Complete },
        exit_code: if decode.is_damaged() { 3 } else { 0 },
        versions: versions(),
        input,
        config: serde_json::to_value(config).unwrap_or_default(),
        config_sha256: config.fingerprint(),
        warnings: decode.warnings.clone(),
        ..Summary::default()
    };
    let counts = &mut summary.counts;
    counts.frames_expected = Some(decode.expected);
    counts.frames_read = decode.decoded;
    counts.frames_lost = decode.missing;
    counts.frames_skipped = decode.decoded.saturating_sub(decode.delivered);
    if decode.missing > 0 {
        let (lost, places) = (decode.missing, decode.damaged_stretch_count);
        summary.warnings.push(format!("{lost} frames in {places} places could not be decoded"));
    }
    note_solution(&mut summary, solution);
    if rejected_cars > 0 {
        summary.counts.rejected.insert("keypoints_not_finite".to_owned(), rejected_cars);
    }
    summary.seconds = streamed
        .times
        .iter()
        .map(|t| StageSeconds { stage: t.name.to_owned(), seconds: t.seconds })
        .collect();
    summary
}

/// Counts and warnings of a solved clip.
pub fn note_solution(summary: &mut Summary, solution: &ClipSolution) {
    let counts = &mut summary.counts;
    counts.boxes = solution.tally.boxes.clone();
    counts.rejected = solution.tally.rejected.clone();
    counts.poses_used = solution.poses_used;
    counts.tracks = solution.tracks.len() as u64;
    counts.track_rows = solution.rows.len() as u64;
    summary.known = solution.cameras.known().to_vec();
    summary.scene_lines = solution.cameras.scene().iter().map(SceneView::summary).collect();
    summary.warnings.extend(solution.warnings.iter().cloned());
}
