//! The left half of a run into its partial folder: frames.jsonl, and what else the right half needs.

use std::path::Path;

use image::RgbImage;
use image::codecs::png::PngEncoder;
use roadplane_activity::ActivityNet;
use roadplane_base::FrameRecord;
use roadplane_decode::{DecodeReport, Input};
use roadplane_view::ViewError;
use roadplane_watch::Background;
use roadplane_write::{
    FrameReader, FrameSpool, InputSummary, ModelSummary, OutFile, OutputFolder, StageSeconds, WatchSummary,
    write_json,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::identity::file_identity;
use crate::limits::check_memory;
use crate::options::RunOptions;
use crate::stream::cadence::{Cadence, stretch_of};
use crate::stream::flow::Work;
use crate::stream::nets::Nets;
use crate::stream::samples::SampleFrames;
use crate::stream::scene_lines::LineFinder;
use crate::stream::span::Span;
use crate::stream::speed::{Looks, Meter};
use crate::stream::stages::{detect_stage, keypoint_stage, watch_stage};
use crate::stream::stills::Stills;
use crate::stream::streaming::{Streamed, stream};
use crate::stream::watched::Watched;
use crate::{Cancel, Config, PipelineError, Progress};

/// The streaming half's product within the partial folder.
pub(crate) const SPOOL: &str = "frames.jsonl";
/// What the spool was made of; a resumed run must be of the same.
pub(crate) const STAMP: &str = "stamp.json";

/// Identifies the work that a spool belongs to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Stamp {
    /// Version of the program.
    pub version: String,
    /// sha256 of the whole input, hex.
    pub input_sha256: String,
    /// sha256 of the configuration, hex.
    pub config_sha256: String,
    /// What the nets' results depend on: weights, what computed them, calibration.
    pub models: Vec<String>,
    /// Which piece of the input; absent: all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub piece: Option<Span>,
}

impl Stamp {
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

/// What goes through all of a run.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub options: &'a RunOptions,
    pub config: &'a Config,
    pub cancel: &'a Cancel,
    pub progress: &'a dyn Progress,
}

/// Makes the partial folder, or takes up the one that a stopped run of the same work left.
pub(crate) fn begin_folder(
    out: &Path,
    name: &str,
    stamp: &Stamp,
    options: &RunOptions,
) -> Result<OutputFolder, PipelineError> {
    let mut folder = OutputFolder::begin(out, name, options.existing)?;
    if folder.is_resumed() && !(options.resume && read_stamp(folder.path()).as_ref() == Some(stamp)) {
        folder.reset()?;
    }
    write_json(&folder.path().join(STAMP), stamp)?;
    Ok(folder)
}

fn read_stamp(folder: &Path) -> Option<Stamp> {
    serde_json::from_slice(&std::fs::read(folder.join(STAMP)).ok()?).ok()
}

/// What streaming an input left beside the spool.
pub(crate) struct Left {
    /// What was read.
    pub input: InputSummary,
    /// The nets.
    pub models: Vec<ModelSummary>,
    /// What their results depend on.
    pub fingerprints: Vec<String>,
    /// What became of the frames.
    pub decode: DecodeReport,
    /// Work of each stage.
    pub seconds: Vec<StageSeconds>,
    /// Cars whose keypoints were not finite.
    pub rejected_cars: u64,
    /// What watching came to.
    pub watch: WatchSummary,
    /// Frames for the report: index, time in s, picture.
    pub samples: Vec<(u64, f64, RgbImage)>,
    /// What the report plays.
    pub stills: Stills,
    /// The empty place.
    pub place: Option<RgbImage>,
}

/// The left half of a run, in its partial folder.
pub(crate) struct LeftHalf {
    /// The partial folder.
    pub folder: OutputFolder,
    /// What it is of.
    pub stamp: Stamp,
    /// What streaming left beside the spool there, or why it ended.
    pub left: Result<Left, PipelineError>,
    /// For the right half.
    pub activity: Option<ActivityNet>,
    /// Counts on.
    pub meter: Meter,
}

/// What streaming fills besides the spool.
struct Sinks<'a> {
    samples: &'a mut SampleFrames,
    stills: &'a mut Stills,
    watched: &'a mut Watched,
    looks: &'a mut Looks,
    background: &'a mut Option<Background>,
}

/// Streams an input that was opened, or a piece of it, into the spool of the partial folder of a `result`. An error: nothing was
/// begun; one in [`LeftHalf::left`] leaves the folder.
pub(crate) fn left_half(
    input_path: &Path,
    input: Input,
    piece: Option<Span>,
    result: (&Path, &str),
    mut meter: Meter,
    job: &Job<'_>,
) -> Result<LeftHalf, PipelineError> {
    check_memory(input.size())?;
    job.options.known.for_pictures(input.size())?;
    let identity = file_identity(input_path)?;
    let mut nets = Nets::open(&job.options.models, job.config)?;
    let stamp = Stamp::new(&identity, job.config, &nets, piece);
    let (out, name) = result;
    let folder = begin_folder(out, name, &stamp, job.options)?;
    meter.opened(1.0 / input.nominal_fps().max(1e-3));
    let left = stream_input(identity, input, &mut nets, folder.path(), piece, &mut meter, job);
    Ok(LeftHalf { folder, stamp, left, activity: nets.activity.take(), meter })
}

fn stream_input(
    identity: InputSummary,
    input: Input,
    nets: &mut Nets,
    folder: &Path,
    piece: Option<Span>,
    meter: &mut Meter,
    job: &Job<'_>,
) -> Result<Left, PipelineError> {
    let (options, config) = (job.options, job.config);
    job.progress.phase("frames");
    let looked_at = Cadence::of(&input, config).every() / u64::from(config.decode.stride.max(1));
    let frames = match piece.and_then(|piece| Some(piece.to_s? - piece.from_s)) {
        Some(seconds) => Some((seconds as f64 * input.nominal_fps()) as u64),
        None => input.frames_due(),
    };
    let pictures = frames.map(|frames| frames / looked_at.max(1));
    let mut samples = SampleFrames::new(config.output.sample_frames, pictures);
    let mut stills = Stills::new(config.output.report_mib);
    let (mut watched, mut looks) = (Watched::default(), Looks::default());
    let mut background = None;
    let mut sinks = Sinks {
        samples: &mut samples,
        stills: &mut stills,
        watched: &mut watched,
        looks: &mut looks,
        background: &mut background,
    };
    let streamed = stream_to_spool(nets, input, folder, piece, &mut sinks, job)?;
    meter.streamed(&streamed, looks, nets);
    if let Some(background) = background.as_ref().filter(|_| options.background) {
        write_background(folder, background)?;
    }
    let second =
        |t: &crate::stream::flow::StageTime| StageSeconds { stage: t.name.to_owned(), seconds: t.seconds };
    Ok(Left {
        input: identity,
        models: nets.summaries(),
        fingerprints: nets.fingerprints(),
        seconds: streamed.times.iter().map(second).collect(),
        decode: streamed.decode,
        rejected_cars: nets.keypoints.rejected(),
        watch: watched.finish(),
        samples: samples.finish(),
        stills,
        place: background.as_ref().map(|background| background.picture().clone()),
    })
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
    input: Input,
    folder: &Path,
    piece: Option<Span>,
    sinks: &mut Sinks<'_>,
    job: &Job<'_>,
) -> Result<Streamed, PipelineError> {
    let &Job { config, cancel, progress, .. } = job;
    // What the nets remember ends at the same places of the input in every run: there a stopped one goes on.
    let (mut spool, recovered) = FrameSpool::open(&folder.join(SPOOL), |record| stretch_of(record.time_s))?;
    if recovered.frames > 0 {
        tracing::info!("going on after {} frames of the stopped run", recovered.frames);
    }
    let is_new = move |record: &FrameRecord| recovered.last_frame.is_none_or(|last| record.frame > last);
    // What comes before a piece is for the watcher alone.
    let is_own = move |record: &FrameRecord| piece.is_none_or(|piece| record.time_s >= piece.from_s as f64);
    let is_due = move |record: &FrameRecord| is_own(record) && is_new(record);
    let cadence = Cadence::of(&input, config);
    let begun_before = recovered.frames > 0 || piece.is_some_and(|piece| piece.from_s > 0);
    let lines = LineFinder::new(begun_before || !config.solve.reads_scene());
    let stages = vec![
        watch_stage(),
        detect_stage(&mut nets.detector, cadence, sinks.background, lines).only(is_due),
        keypoint_stage(&mut nets.keypoints, cadence).only(is_due),
    ];
    // What a stopped run found in the frames that it was through with.
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
        sinks.looks.add(&work.record, is_new);
        if is_new { Ok(spool.append(&work.record)?) } else { Ok(()) }
    };
    let streamed = stream(input, cadence.chooser(), stages, sink, config, cancel, progress);
    // Also after a stop: what is done is not done again.
    spool.sync()?;
    streamed
}
