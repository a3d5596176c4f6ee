//! Perception: reads an input and writes `frames.jsonl` and the other inputs of estimation. These files go into a
//! partial folder, which is renamed when the result is complete.

use std::path::Path;

use image::RgbImage;
use image::codecs::png::PngEncoder;
use roadplane_activity::ActivityNet;
use roadplane_base::FrameRecord;
use roadplane_decode::{DecodeReport, Input};
use roadplane_view::ViewError;
use roadplane_watch::{Background, EmptyScene};
use roadplane_write::{
    FrameReader, FrameSpool, InputSummary, ModelSummary, OutFile, OutputFolder, StageSeconds, WatchSummary,
    write_json,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::identity::file_identity;
use crate::limits::check_memory;
use crate::options::RunOptions;
use crate::recorded::{Recorded, recorded};
use crate::stream::backgrounds::Backgrounds;
use crate::stream::cadence::{Cadence, interval_of};
use crate::stream::flow::Work;
use crate::stream::nets::Nets;
use crate::stream::samples::SampleFrames;
use crate::stream::scene_lines::LineFinder;
use crate::stream::span::Span;
use crate::stream::speed::{InferenceFrames, Meter};
use crate::stream::stages::{detect_stage, keypoint_stage, watch_stage};
use crate::stream::stills::Stills;
use crate::stream::streaming::{Streamed, stream};
use crate::stream::watched::Watched;
use crate::{Cancel, Config, PipelineError, Progress};

/// Name of the file with the records of the frames, in the folder of an unfinished result.
pub(crate) const SPOOL: &str = "frames.jsonl";
/// Name of the file with the [`Stamp`] of a run, in the folder of an unfinished result.
pub(crate) const STAMP: &str = "stamp.json";

/// Identifies the program, input, configuration and nets that made a file of frames. A run resumes earlier work only if
/// the stamps are equal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Stamp {
    /// Version of the program that made the file of frames.
    pub version: String,
    /// sha256 of the whole input, hexadecimal.
    pub input_sha256: String,
    /// sha256 of the configuration, hexadecimal.
    pub config_sha256: String,
    /// One text per net: the hash of its weights, its execution provider and its calibration. A net with an equal text
    /// gives equal results.
    pub models: Vec<String>,
    /// Part of the input that was processed: `FROM-TO` or `FROM-`, in seconds. Absent for the whole input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub piece: Option<Span>,
}

impl Stamp {
    /// Returns the stamp of a run on an input, or on a piece of the input.
    pub(crate) fn new(input: &InputSummary, config: &Config, nets: &Nets, piece: Option<Span>) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            input_sha256: input.sha256.clone(),
            config_sha256: config.fingerprint(),
            models: nets.fingerprints(),
            piece,
        }
    }
}

/// Data that all parts of a run share: options, configuration, stop request and receiver of progress reports.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub options: &'a RunOptions,
    pub config: &'a Config,
    pub cancel: &'a Cancel,
    pub progress: &'a dyn Progress,
}

/// Creates the folder of the unfinished result `name` inside `out`. A resumed run opens the folder of the stopped run
/// instead, if the stamps of both runs are equal. Only the records of its frames are kept, because the options of the
/// two runs may ask for different files.
pub(crate) fn open_partial_folder(
    out: &Path,
    name: &str,
    stamp: &Stamp,
    options: &RunOptions,
) -> Result<OutputFolder, PipelineError> {
    let folder = OutputFolder::begin(out, name, options.existing)?;
    let continues = options.resume && read_stamp(folder.path()).as_ref() == Some(stamp);
    folder.clear(if continues { &[SPOOL] } else { &[] })?;
    write_json(&folder.path().join(STAMP), stamp)?;
    Ok(folder)
}

fn read_stamp(folder: &Path) -> Option<Stamp> {
    serde_json::from_slice(&std::fs::read(folder.join(STAMP)).ok()?).ok()
}

/// Results of perception other than the file of frames.
pub(crate) struct Perceived {
    /// Path, size and hash of the input.
    pub input: InputSummary,
    /// Time at which the input was recorded.
    pub recorded: Recorded,
    /// Names and versions of the nets that ran.
    pub models: Vec<ModelSummary>,
    /// One text per net: the hash of its weights, its execution provider and its calibration.
    pub fingerprints: Vec<String>,
    /// Counts of frames that were read, lost or skipped.
    pub decode: DecodeReport,
    /// Time that each stage worked.
    pub seconds: Vec<StageSeconds>,
    /// Number of cars that were rejected because their keypoints were not finite numbers.
    pub rejected_cars: u64,
    /// Summary of the watcher's results: camera moves, shake and unusable pictures.
    pub watch: WatchSummary,
    /// Frames for the report: index, time in s, picture.
    pub samples: Vec<(u64, f64, RgbImage)>,
    /// Small frames and cut-outs of vehicles for the report.
    pub stills: Stills,
    /// The background image: the scene without vehicles.
    pub background: Option<EmptyScene>,
}

/// State of a run after perception.
pub(crate) struct Perception {
    /// Folder of the unfinished result. The run writes into this folder until the result is complete.
    pub folder: OutputFolder,
    /// Stamp that identifies the program, input, configuration and nets of the run.
    pub stamp: Stamp,
    /// The results of perception, or the error that ended perception.
    pub perceived: Result<Perceived, PipelineError>,
    /// The activity net, for later use by estimation; `None` if activities are switched off.
    pub activity: Option<ActivityNet>,
    /// Meter of the run's processor time. This meter also measures estimation later.
    pub meter: Meter,
}

/// Collections that are filled from the frames while the file of frames is written.
struct Sinks<'a> {
    samples: &'a mut SampleFrames,
    stills: &'a mut Stills,
    watched: &'a mut Watched,
    inference: &'a mut InferenceFrames,
    backgrounds: &'a mut Backgrounds,
}

/// Runs perception on an opened input, or on a piece of the input, and writes into the folder of the unfinished result.
/// `result` is the output folder and the name of the result.
///
/// # Errors
/// Returns a [`PipelineError`] if the work fails before the folder is created. A later error is stored in
/// [`Perception::perceived`], and the folder is kept.
pub(crate) fn perceive(
    input_path: &Path,
    input: Input,
    piece: Option<Span>,
    result: (&Path, &str),
    mut meter: Meter,
    job: &Job<'_>,
) -> Result<Perception, PipelineError> {
    check_memory(input.size())?;
    job.options.constraints.for_pictures(input.size())?;
    let identity = file_identity(input_path)?;
    let mut nets = Nets::open(&job.options.models, job.config)?;
    let stamp = Stamp::new(&identity, job.config, &nets, piece);
    let (out, name) = result;
    let folder = open_partial_folder(out, name, &stamp, job.options)?;
    meter.opened(1.0 / input.nominal_fps().max(1e-3));
    let perceived = stream_input(identity, input, &mut nets, folder.path(), piece, &mut meter, job);
    Ok(Perception { folder, stamp, perceived, activity: nets.activity.take(), meter })
}

fn stream_input(
    identity: InputSummary,
    input: Input,
    nets: &mut Nets,
    folder: &Path,
    piece: Option<Span>,
    meter: &mut Meter,
    job: &Job<'_>,
) -> Result<Perceived, PipelineError> {
    let (options, config) = (job.options, job.config);
    job.progress.phase("frames");
    let every = Cadence::of(&input, config).every() / u64::from(config.decode.stride.max(1));
    let frames = match piece.and_then(|piece| Some(piece.to_s? - piece.from_s)) {
        Some(seconds) => Some((seconds as f64 * input.nominal_fps()) as u64),
        None => input.frames_due(),
    };
    let pictures = frames.map(|frames| frames / every.max(1));
    let mut samples = SampleFrames::new(config.output.sample_frames, pictures);
    let mut stills = Stills::new(config.output.report_mib);
    let (mut watched, mut inference) = (Watched::default(), InferenceFrames::default());
    let mut backgrounds = Backgrounds::default();
    let mut sinks = Sinks {
        samples: &mut samples,
        stills: &mut stills,
        watched: &mut watched,
        inference: &mut inference,
        backgrounds: &mut backgrounds,
    };
    let streamed = stream_to_spool(nets, input, folder, piece, &mut sinks, job)?;
    meter.streamed(&streamed, inference, nets);
    if let Some(background) = backgrounds.best().filter(|_| options.background) {
        write_background(folder, background)?;
    }
    let second =
        |t: &crate::stream::flow::StageTime| StageSeconds { stage: t.name.to_owned(), seconds: t.seconds };
    Ok(Perceived {
        recorded: recorded(Path::new(&identity.path)),
        input: identity,
        models: nets.summaries(),
        fingerprints: nets.fingerprints(),
        seconds: streamed.times.iter().map(second).collect(),
        decode: streamed.decode,
        rejected_cars: nets.keypoints.rejected(),
        watch: watched.finish(),
        samples: samples.finish(),
        stills,
        background: backgrounds.empty_scene(),
    })
}

/// Writes the background image to `background.png`. `background.json` gets, for each cell of the image, the time when
/// the cell was last free of vehicles, and the index of the frame whose pixels the image has.
fn write_background(folder: &Path, background: &Background) -> Result<(), PipelineError> {
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    background.picture().write_with_encoder(encoder).map_err(ViewError::from)?;
    let mut file = OutFile::create(&folder.join("background.png"))?;
    file.write_bytes(&png)?;
    file.finish()?;
    let ages = serde_json::json!({
        "schema": "roadplane.background/1",
        "frame": background.keyframe(),
        "cell_px": background.cell_px(),
        "last_bare_s": background.bare_s(),
    });
    Ok(write_json(&folder.join("background.json"), &ages)?)
}

fn stream_to_spool(
    nets: &mut Nets,
    input: Input,
    folder: &Path,
    piece: Option<Span>,
    sinks: &mut Sinks<'_>,
    job: &Job<'_>,
) -> Result<Streamed, PipelineError> {
    let &Job { config, cancel, progress, .. } = job;
    // The nets discard their state at the same times of the input in every run. A stopped run continues at one of these
    // times.
    let (mut spool, recovered) = FrameSpool::open(&folder.join(SPOOL), |record| interval_of(record.time_s))?;
    if recovered.frames > 0 {
        tracing::info!("continuing after {} frames of the stopped run", recovered.frames);
    }
    let is_new = move |record: &FrameRecord| recovered.last_frame.is_none_or(|last| record.frame > last);
    // Only the watcher uses frames before the start of the piece.
    let is_own = move |record: &FrameRecord| piece.is_none_or(|piece| record.time_s >= piece.from_s as f64);
    let is_due = move |record: &FrameRecord| is_own(record) && is_new(record);
    let cadence = Cadence::of(&input, config);
    let is_later_piece = piece.is_some_and(|piece| piece.from_s as f64 > config.decode.start_s);
    let is_continued = recovered.frames > 0 || is_later_piece;
    let lines = LineFinder::new(is_continued || !config.solve.reads_scene());
    let stages = vec![
        watch_stage(),
        detect_stage(&mut nets.detector, cadence, sinks.backgrounds, lines).only(is_due),
        keypoint_stage(&mut nets.keypoints, cadence).only(is_due),
    ];
    // Records of the frames that the stopped run completed.
    let spooled = (recovered.frames > 0).then(|| FrameReader::open(&folder.join(SPOOL))).transpose()?;
    let mut found_before = spooled.into_iter().flatten();
    let sink = |work: &Work| {
        if !is_own(&work.record) {
            return Ok(());
        }
        let is_new = is_new(&work.record);
        let found = if is_new { None } else { found_before.next().transpose()? }
            .filter(|found| found.frame == work.record.frame);
        if let Some(image) = &work.image {
            sinks.samples.offer(work.stamp, image);
            if sinks.stills.offer(work.stamp, image) {
                sinks.stills.cut(work.stamp, image, found.as_ref().unwrap_or(&work.record));
            }
        }
        sinks.watched.push(&work.record);
        sinks.inference.add(&work.record, is_new);
        if is_new { Ok(spool.append(&work.record)?) } else { Ok(()) }
    };
    let streamed = stream(input, cadence.chooser(), stages, sink, config, cancel, progress);
    // The file is also synced after a stop, so that a resumed run does not repeat completed frames.
    spool.sync()?;
    streamed
}
