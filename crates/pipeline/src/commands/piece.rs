//! Long inputs in pieces: `roadplane plan`, and the left half of a run over one piece (`run --piece`).
//!
//! What detector and keypoint net remember ends at every full minute, and what the watcher remembers begins [`RENEW_S`](roadplane_watch::RENEW_S) before it
//! anew. A piece that begins at a full minute and is watched from a little earlier therefore finds what a run over the whole
//! input finds there.

use std::path::{Path, PathBuf};

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use roadplane_decode::{DecodeReport, InputKind};
use roadplane_view::ViewError;
use roadplane_write::{InputSummary, ModelSummary, OutFile, StageSeconds, schema, write_json};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::commands::run::given_up;
use crate::identity::stem_of;
use crate::options::{RunOptions, RunReport};
use crate::stream::perception::{Job, Left, LeftHalf, STAMP, Stamp, left_half};
use crate::stream::span::{STEP_S, Span};
use crate::stream::speed::Meter;
use crate::stream::stills::StillLevels;
use crate::stream::streaming::{open_input, open_input_part};
use crate::{Cancel, Config, PipelineError, Progress};

/// Schema of a line of `roadplane plan`.
const PLAN_SCHEMA: &str = "roadplane.plan/1";
/// Schema of `piece.json`.
pub(crate) const PIECE_SCHEMA: &str = "roadplane.piece/1";
/// File that says what a piece is.
pub(crate) const PIECE: &str = "piece.json";
/// JPEG quality of frames for the report.
const QUALITY: u8 = 95;

/// A line of `roadplane plan`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PlannedPiece {
    /// The input, as given.
    pub input: PathBuf,
    /// Name of its result.
    pub stem: String,
    /// For `run --piece`: `FROM-TO` or `FROM-`, s.
    pub piece: Span,
    /// Folder that the piece gets in the output folder.
    pub folder: String,
    /// Which of the input's pieces it is, from 1.
    pub number: u64,
    /// How many the input has.
    pub pieces: u64,
}

/// Name and schema of every file: those of a result, `piece` for a piece's `piece.json`, `plan` for a line of `roadplane plan`.
#[must_use]
pub fn schemas() -> Vec<(&'static str, Value)> {
    let mut all = roadplane_write::schemas();
    all.push(("piece", schema::<PieceFile>(PIECE_SCHEMA)));
    all.push(("plan", schema::<PlannedPiece>(PLAN_SCHEMA)));
    all
}

/// Cuts an input into pieces of `piece_s`, a multiple of 60 s. What cannot be begun in its middle (pictures, a video whose frames do
/// not come at a steady rate) is one piece.
///
/// # Errors
/// [`PipelineError`] where the input cannot be used.
pub fn plan(input_path: &Path, piece_s: u64, config: &Config) -> Result<Vec<PlannedPiece>, PipelineError> {
    if piece_s == 0 || !piece_s.is_multiple_of(STEP_S) {
        return Err(PipelineError::usage(&format!("a piece is as long as a multiple of {STEP_S} s")));
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
            // Less of it can be read than its container promises.
            Err(error) => {
                tracing::warn!("{error}");
                true
            }
        };
        if whole_is_best {
            tracing::info!("{} is one piece: it cannot be begun in its middle", input_path.display());
            cuts.truncate(1);
        }
    }
    let stem = stem_of(input_path);
    let piece = |(i, from_s): (usize, &u64)| {
        let piece = Span { from_s: *from_s, to_s: cuts.get(i + 1).copied() };
        PlannedPiece {
            input: input_path.to_path_buf(),
            folder: piece.folder(&stem),
            stem: stem.clone(),
            piece,
            number: i as u64 + 1,
            pieces: cuts.len() as u64,
        }
    };
    Ok(cuts.iter().enumerate().map(piece).collect())
}

/// What the report plays, in a piece's folder.
pub(crate) const STILLS: &str = "stills.jsonl";

/// `piece.json`: what the right half needs beside the frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct PieceFile {
    /// `roadplane.piece/1`.
    pub schema: String,
    /// Name of the input's result.
    pub stem: String,
    /// What it was made of; pieces of other makes are not joined with it.
    pub stamp: Stamp,
    /// The whole input.
    pub input: InputSummary,
    /// The nets.
    pub models: Vec<ModelSummary>,
    /// What became of the piece's frames.
    pub decode: DecodeReport,
    /// Work of each stage.
    pub seconds: Vec<StageSeconds>,
    /// Cars whose keypoints were not finite.
    pub rejected_cars: u64,
    /// Frames for the report: index, time in s, file.
    pub samples: Vec<(u64, f64, String)>,
    /// How coarse the frames and cut-outs of [`STILLS`] are.
    pub stills: StillLevels,
    /// File with the empty place.
    pub place: Option<String>,
}

/// Finds vehicles and keypoints in one piece of an input, into `out/<stem>.piece-<from>/`. Hold the lock of `out`.
///
/// # Errors
/// [`PipelineError`]; nothing then appears under the final name. What a stopped run did stays for `resume`.
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
        return Ok(report(finished.clone(), &read_piece(&finished)?.decode));
    }
    let meter = Meter::start(options.alone);
    let input = open_input_part(input_path, &piece, config)?;
    let job = Job { options, config, cancel, progress };
    let LeftHalf { folder, stamp, left, .. } =
        left_half(input_path, input, Some(piece), (out, &name), meter, &job)?;
    let decode = match left.and_then(|left| write_piece(folder.path(), &stem, stamp, left)) {
        Ok(decode) => decode,
        Err(error) => return Err(given_up(folder, error)),
    };
    let path = folder.path().join(STAMP);
    std::fs::remove_file(&path).map_err(|source| PipelineError::Unreadable { source, path })?;
    Ok(report(folder.publish()?, &decode))
}

fn report(folder: PathBuf, decode: &DecodeReport) -> RunReport {
    let camera = "a piece".to_owned();
    RunReport { folder, tracks: None, camera, damaged: decode.is_damaged(), frames_lost: decode.missing }
}

/// Reads what a piece is.
pub(crate) fn read_piece(folder: &Path) -> Result<PieceFile, PipelineError> {
    let path = folder.join(PIECE);
    let fail = |why: &str| PipelineError::usage(&format!("{why}: {}", path.display()));
    let bytes = std::fs::read(&path).map_err(|error| fail(&format!("no piece of a run ({error})")))?;
    let piece: PieceFile = serde_json::from_slice(&bytes).map_err(|error| fail(&error.to_string()))?;
    if piece.schema != PIECE_SCHEMA {
        return Err(fail(&format!("its schema is {:?}, not {PIECE_SCHEMA:?}", piece.schema)));
    }
    Ok(piece)
}

fn write_piece(folder: &Path, stem: &str, stamp: Stamp, left: Left) -> Result<DecodeReport, PipelineError> {
    let mut samples = Vec::new();
    for (frame, time_s, picture) in &left.samples {
        let name = format!("frame_{frame:08}.jpg");
        write_picture(&folder.join(&name), picture)?;
        samples.push((*frame, *time_s, name));
    }
    let stills = left.stills.write(&folder.join(STILLS))?;
    let place = left.place.as_ref().map(|picture| {
        let name = "place.jpg".to_owned();
        write_picture(&folder.join(&name), picture).map(|()| name)
    });
    let piece = PieceFile {
        schema: PIECE_SCHEMA.to_owned(),
        stem: stem.to_owned(),
        stamp,
        input: left.input,
        models: left.models,
        decode: left.decode,
        seconds: left.seconds,
        rejected_cars: left.rejected_cars,
        samples,
        stills,
        place: place.transpose()?,
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
