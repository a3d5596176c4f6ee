//! Long inputs in pieces: `roadplane plan`, and the left half of a run over one piece (`run --piece`).
//!
//! What detector and keypoint net remember ends at every full minute, and what the watcher remembers begins [`RENEW_S`] before it
//! anew. A piece that begins at a full minute and is watched from a little earlier therefore finds what a run over the whole
//! input finds there.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use roadplane_decode::{DecodeOptions, DecodeReport, InputKind};
use roadplane_view::ViewError;
use roadplane_watch::RENEW_S;
use roadplane_write::{InputSummary, ModelSummary, OutFile, StageSeconds, schema, write_json};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::commands::run::{RunOptions, RunReport, given_up, stem_of};
use crate::stream::left::{Job, Left, LeftHalf, STAMP, Stamp, left_half};
use crate::stream::speed::Meter;
use crate::stream::stills::StillLevels;
use crate::stream::streaming::{FORGET_S, open_input, open_input_part};
use crate::{Cancel, Config, PipelineError, Progress};

/// Schema of a line of `roadplane plan`.
const PLAN_SCHEMA: &str = "roadplane.plan/1";
/// Schema of `piece.json`.
pub(crate) const PIECE_SCHEMA: &str = "roadplane.piece/1";
/// File that says what a piece is.
pub(crate) const PIECE: &str = "piece.json";
/// Watching begins so much before the watcher's memory is begun anew, s: looks are then where they are in a run over the whole.
const MARGIN_S: f64 = 2.0;
/// Pieces begin at multiples of this, s.
const STEP_S: u64 = FORGET_S as u64;
/// JPEG quality of frames for the report.
const QUALITY: u8 = 95;

/// A stretch of an input from one full minute to another, or to the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub struct Span {
    /// Its first second.
    pub from_s: u64,
    /// The second after its last; `None`: to the end.
    pub to_s: Option<u64>,
}

impl Span {
    /// What is decoded for it.
    pub(crate) fn options(&self, all: &DecodeOptions) -> DecodeOptions {
        let watched_s = self.from_s as f64 - RENEW_S - MARGIN_S;
        let to_s = self.to_s.map_or(f64::INFINITY, |to_s| to_s as f64);
        let end_s = all.end_s.unwrap_or(f64::INFINITY).min(to_s);
        DecodeOptions {
            start_s: all.start_s.max(watched_s),
            end_s: end_s.is_finite().then_some(end_s),
            ..all.clone()
        }
    }

    /// Name of the folder of an input's piece.
    fn folder(&self, stem: &str) -> String {
        format!("{stem}.piece-{:06}", self.from_s)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-", self.from_s)?;
        self.to_s.map_or(Ok(()), |to_s| write!(f, "{to_s}"))
    }
}

impl From<Span> for String {
    fn from(span: Span) -> Self {
        span.to_string()
    }
}

impl TryFrom<String> for Span {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl FromStr for Span {
    type Err = String;

    /// Reads `600-1200` and `3000-`.
    fn from_str(text: &str) -> Result<Self, String> {
        let seconds = |part: &str| part.parse::<u64>().ok().filter(|second| second.is_multiple_of(STEP_S));
        let span = text.split_once('-').and_then(|(from, to)| {
            let to_s = if to.is_empty() { None } else { Some(seconds(to)?) };
            Some(Self { from_s: seconds(from)?, to_s })
        });
        span.filter(|span| span.to_s.is_none_or(|to_s| to_s > span.from_s))
            .ok_or_else(|| format!("{text:?} is no piece: write FROM-TO or FROM-, multiples of {STEP_S} s"))
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_written_as_they_are_read_and_begin_at_full_minutes() {
        for text in ["0-60", "600-1200", "3000-"] {
            assert_eq!(text.parse::<Span>().unwrap().to_string(), text);
        }
        for text in ["", "-", "60", "0-59", "1-60", "120-60", "60-60", "-60", "a-b"] {
            assert!(text.parse::<Span>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_piece_is_watched_early_enough_and_stays_within_what_is_asked_for() {
        let all = DecodeOptions { start_s: 50.0, end_s: Some(130.0), ..DecodeOptions::default() };
        let of = |text: &str| {
            let options = text.parse::<Span>().unwrap().options(&all);
            (options.start_s, options.end_s)
        };
        assert_eq!(of("0-60"), (50.0, Some(60.0)));
        assert_eq!(of("120-"), (98.0, Some(130.0)));
    }
}
