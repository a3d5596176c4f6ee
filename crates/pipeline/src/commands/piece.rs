//! Divides long inputs into pieces (`roadplane plan`), and runs perception on one piece (`roadplane run --piece`).
//!
//! The detector and the keypoint net discard their state at every full minute. The watcher, which measures camera
//! motion, replaces its state there. The new state comes from the last [`RENEW_S`](roadplane_watch::RENEW_S) seconds
//! before the full minute. A piece starts at a full minute, and the watcher also gets the frames shortly before the
//! piece. Therefore a piece gives the same results as a run over the whole input.

use std::path::{Path, PathBuf};

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use roadplane_base::Registration;
use roadplane_decode::{DecodeReport, InputKind};
use roadplane_traffic::{TRAFFIC_SCHEMA, TrafficFile};
use roadplane_view::ViewError;
use roadplane_write::{InputSummary, ModelSummary, OutFile, StageSeconds, schema, write_json};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::commands::run::discarded;
use crate::identity::stem_of;
use crate::not_followed::NotFollowed;
use crate::options::{RunOptions, RunReport};
use crate::recorded::{Recorded, recorded};
use crate::stream::perception::{Job, Perceived, Perception, STAMP, Stamp, perceive};
use crate::stream::span::{STEP_S, Span};
use crate::stream::speed::Meter;
use crate::stream::stills::StillLevels;
use crate::stream::streaming::{open_input, open_input_part};
use crate::{Cancel, Config, PipelineError, Progress};

/// Id of the schema for a line that `roadplane plan` prints.
const PLAN_SCHEMA: &str = "roadplane.plan/1";
/// Id of the schema for `piece.json`.
pub(crate) const PIECE_SCHEMA: &str = "roadplane.piece/1";
/// Name of the file that describes a piece, in the folder of the piece.
pub(crate) const PIECE: &str = "piece.json";
/// JPEG quality of the frames that a piece stores for the report.
const QUALITY: u8 = 95;

/// One planned piece of an input. `roadplane plan` prints each planned piece as one line.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(title = "plan: one line per piece")]
pub struct PlannedPiece {
    /// Path of the input, as given on the command line.
    pub input: PathBuf,
    /// Name of the input's result folder.
    pub stem: String,
    /// Argument for `roadplane run --piece`: `FROM-TO` or `FROM-`, in seconds.
    pub piece: Span,
    /// Name of the piece's folder inside the output folder.
    pub folder: String,
    /// Number of the piece, counted from 1 for the first piece of the input.
    #[schemars(range(min = 1))]
    pub number: u64,
    /// Total number of pieces of the input.
    #[schemars(range(min = 1))]
    pub pieces: u64,
    /// Time at which the input was recorded, and its origin.
    #[serde(flatten)]
    pub recorded: Recorded,
}

/// Returns the name and the JSON schema of every kind of file. These are the files of a result, `piece` for
/// `piece.json`, `plan` for the lines that `roadplane plan` prints, and `traffic` for `traffic.json`.
#[must_use]
pub fn schemas() -> Vec<(&'static str, Value)> {
    let mut all = roadplane_write::schemas();
    all.push(("piece", schema::<PieceFile>(PIECE_SCHEMA)));
    all.push(("plan", schema::<PlannedPiece>(PLAN_SCHEMA)));
    all.push(("traffic", schema::<TrafficFile>(TRAFFIC_SCHEMA)));
    all
}

/// Divides an input into pieces of `piece_s` seconds, which must be a multiple of 60.
///
/// An input is a single piece if decoding cannot start in its middle. Examples are a folder of pictures and a video
/// without a steady frame rate.
///
/// # Errors
/// Returns a [`PipelineError`] if the input cannot be used, or if `piece_s` is not a multiple of 60.
pub fn plan(input_path: &Path, piece_s: u64, config: &Config) -> Result<Vec<PlannedPiece>, PipelineError> {
    if piece_s == 0 || !piece_s.is_multiple_of(STEP_S) {
        return Err(PipelineError::usage(&format!("the length of a piece must be a multiple of {STEP_S} s")));
    }
    let decode = &config.decode;
    let mut cuts = vec![(decode.start_s / piece_s as f64) as u64 * piece_s];
    if decode.max_frames.is_none() {
        let input = open_input(input_path, config)?;
        let frames = input.frames_hint().filter(|_| matches!(input.kind(), InputKind::Video(_)));
        let seconds = frames.map_or(0.0, |frames| frames as f64 / input.nominal_fps());
        let end_s = seconds.min(decode.end_s.unwrap_or(f64::INFINITY));
        cuts.extend((cuts[0] + piece_s..).step_by(piece_s as usize).take_while(|cut| (*cut as f64) < end_s));
    }
    if let [_, .., last] = cuts[..] {
        let last = Span { from_s: last, to_s: None };
        let whole_is_best = match open_input_part(input_path, &last, config) {
            Ok(input) => !input.is_begun_within(),
            // The video file claims to have more frames than can be read.
            Err(error) => {
                tracing::warn!("{error}");
                true
            }
        };
        if whole_is_best {
            tracing::info!("{} is one piece: it cannot be decoded from its middle", input_path.display());
            cuts.truncate(1);
        }
    }
    let stem = stem_of(input_path);
    let recorded = recorded(input_path);
    let piece = |(i, from_s): (usize, &u64)| {
        let piece = Span { from_s: *from_s, to_s: cuts.get(i + 1).copied() };
        PlannedPiece {
            input: input_path.to_path_buf(),
            folder: piece.folder(&stem),
            stem: stem.clone(),
            piece,
            number: i as u64 + 1,
            pieces: cuts.len() as u64,
            recorded: recorded.clone(),
        }
    };
    Ok(cuts.iter().enumerate().map(piece).collect())
}

/// Name of the file with the small frames and cut-outs for the report, in the folder of a piece.
pub(crate) const STILLS: &str = "stills.jsonl";

/// `piece.json`: the perception results of a piece, without the records of its frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "piece: one object per piece")]
pub(crate) struct PieceFile {
    /// Id of the schema: `roadplane.piece/1`.
    #[schemars(extend("const" = PIECE_SCHEMA))]
    pub schema: String,
    /// Name of the input's result folder.
    pub stem: String,
    /// Identifies the program, input, configuration and models of the piece. Pieces are joined only if these are the
    /// same.
    pub stamp: Stamp,
    /// The whole input, of which the piece is a part.
    pub input: InputSummary,
    /// Time at which the input was recorded, and its origin.
    #[serde(flatten)]
    pub recorded: Recorded,
    /// The nets that ran on the piece.
    pub models: Vec<ModelSummary>,
    /// Counts of the piece's frames that were read, lost or skipped.
    pub decode: DecodeReport,
    /// Time that each stage worked, in the order of the pipeline.
    pub seconds: Vec<StageSeconds>,
    /// Number of cars that were rejected because their keypoints were not finite numbers.
    pub rejected_cars: u64,
    /// Frames of the piece for the report, each as `[index, time in s, file name]`.
    pub samples: Vec<(u64, f64, String)>,
    /// Spacing in time of the small frames and cut-outs in `stills.jsonl`.
    pub stills: StillLevels,
    /// Name of the file with the background image: the scene without moving objects.
    pub place: Option<String>,
    /// How the background image lies on the picture of an earlier frame.
    #[serde(default)]
    pub place_registration: Option<Registration>,
}

/// Runs perception on one piece of an input and writes the folder `out/<stem>.piece-<from>/`.
///
/// `<stem>` is the name of the input's result, and `<from>` is the start of the piece, s. The caller must have the lock
/// of the folder `out`.
///
/// # Errors
/// Returns a [`PipelineError`] if the piece cannot be completed. The folder of the piece is then unchanged. After a
/// request to stop or an internal fault, the unfinished work is kept elsewhere, and a run with `options.resume`
/// continues it.
pub fn run_piece(
    input_path: &Path,
    piece: Span,
    out: &Path,
    options: &RunOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let stem = stem_of(input_path);
    let name = piece.folder(&stem);
    let finished = out.join(&name);
    if options.resume && finished.join(PIECE).is_file() {
        let before = read_piece(&finished)?;
        if before.stamp.piece != Some(piece) {
            let what = format!("another piece is there already; use --overwrite: {}", finished.display());
            return Err(PipelineError::usage(&what));
        }
        return Ok(report(finished, &before.decode));
    }
    let meter = Meter::start(options.alone);
    let input = open_input_part(input_path, &piece, config)?;
    let job = Job { options, config, cancel, progress };
    let Perception { folder, stamp, perceived, .. } =
        perceive(input_path, input, Some(piece), (out, &name), meter, &job)?;
    let decode = match perceived.and_then(|perceived| write_piece(folder.path(), &stem, stamp, perceived)) {
        Ok(decode) => decode,
        Err(error) => return Err(discarded(folder, error)),
    };
    let path = folder.path().join(STAMP);
    std::fs::remove_file(&path).map_err(|source| PipelineError::Unreadable { source, path })?;
    Ok(report(folder.publish()?, &decode))
}

fn report(folder: PathBuf, decode: &DecodeReport) -> RunReport {
    let camera = "a piece".to_owned();
    RunReport {
        folder,
        tracks: None,
        camera,
        status: NotFollowed::default().status(decode.is_damaged()),
        frames_lost: decode.missing,
        frames_not_followed: 0,
    }
}

/// Reads `piece.json` from the folder of a piece.
pub(crate) fn read_piece(folder: &Path) -> Result<PieceFile, PipelineError> {
    let path = folder.join(PIECE);
    let fail = |why: &str| PipelineError::usage(&format!("{why}: {}", path.display()));
    let bytes =
        std::fs::read(&path).map_err(|error| fail(&format!("this folder is no piece of a run ({error})")))?;
    let piece: PieceFile = serde_json::from_slice(&bytes).map_err(|error| fail(&error.to_string()))?;
    if piece.schema != PIECE_SCHEMA {
        return Err(fail(&format!("the schema is {:?}, not {PIECE_SCHEMA:?}", piece.schema)));
    }
    Ok(piece)
}

fn write_piece(
    folder: &Path,
    stem: &str,
    stamp: Stamp,
    perceived: Perceived,
) -> Result<DecodeReport, PipelineError> {
    let mut samples = Vec::new();
    for (frame, time_s, picture) in &perceived.samples {
        let name = format!("frame_{frame:08}.jpg");
        write_picture(&folder.join(&name), picture)?;
        samples.push((*frame, *time_s, name));
    }
    let stills = perceived.stills.write(&folder.join(STILLS))?;
    let scene = perceived.background.as_ref();
    let background = scene.map(|scene| {
        let name = "place.jpg".to_owned();
        write_picture(&folder.join(&name), &scene.picture).map(|()| name)
    });
    let piece = PieceFile {
        schema: PIECE_SCHEMA.to_owned(),
        stem: stem.to_owned(),
        stamp,
        input: perceived.input,
        recorded: perceived.recorded,
        models: perceived.models,
        decode: perceived.decode,
        seconds: perceived.seconds,
        rejected_cars: perceived.rejected_cars,
        samples,
        stills,
        place: background.transpose()?,
        place_registration: scene.and_then(|scene| scene.registration),
    };
    write_json(&folder.join(PIECE), &piece)?;
    Ok(piece.decode)
}

fn write_picture(path: &Path, picture: &RgbImage) -> Result<(), PipelineError> {
    let mut jpeg = Vec::new();
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, QUALITY)).map_err(ViewError::from)?;
    let mut file = OutFile::create(path)?;
    file.write_bytes(&jpeg)?;
    Ok(file.finish()?)
}
