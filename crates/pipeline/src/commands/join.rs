//! Command `roadplane join`: joins the pieces of an input. The result is the same as that of one run over the whole
//! input.
//!
//! The pieces do not overlap, so their frames are written one piece after another. Then the camera, the poses and the
//! tracks are estimated from all frames together. Results of separate pieces never have to be merged.

use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use image::RgbImage;
use roadplane_base::FrameRecord;
use roadplane_decode::DecodeReport;
use roadplane_view::ViewError;
use roadplane_watch::EmptyScene;
use roadplane_write::{FrameReader, OutFile, StageSeconds, WatchSummary, WriteError};

use crate::commands::piece::{PieceFile, STILLS, read_piece};
use crate::commands::run::{complete, finished_before};
use crate::options::{RunOptions, RunReport};
use crate::stream::nets::open_activity;
use crate::stream::perception::{Job, Perceived, SPOOL, Stamp, open_partial_folder};
use crate::stream::stills::Stills;
use crate::stream::watched::Watched;
use crate::{Cancel, Config, PipelineError, Progress};

/// Returns the input path of each piece, as the user wrote it when the piece was made.
///
/// # Errors
/// Returns [`PipelineError::Usage`] if a folder does not contain a piece.
pub fn inputs_of(pieces: &[PathBuf]) -> Result<Vec<PathBuf>, PipelineError> {
    pieces.iter().map(|folder| Ok(PathBuf::from(read_piece(folder)?.input.path))).collect()
}

/// Joins the pieces of one input and writes the result to `out/<stem>/`, where `<stem>` is the name of the result. The
/// caller must have the lock of the folder `out`.
///
/// # Errors
/// Returns [`PipelineError::Usage`] if the pieces differ in input, models, configuration or version, or if a piece is
/// missing. After any error, `out/<stem>/` is unchanged.
pub fn join_pieces(
    folders: &[PathBuf],
    out: &Path,
    options: &RunOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let started = Instant::now();
    let mut pieces = Vec::new();
    for folder in folders {
        pieces.push((folder.as_path(), read_piece(folder)?));
    }
    pieces.sort_by_key(|(_, piece)| piece.stamp.piece.map(|span| span.from_s));
    check(&pieces, config)?;
    let Some((_, first)) = pieces.first() else {
        return Err(PipelineError::usage("no piece is given"));
    };
    let stem = first.stem.clone();
    if let Some(report) = finished_before(&out.join(&stem), options)? {
        return Ok(report);
    }
    let stamp = Stamp { piece: None, ..first.stamp.clone() };
    let folder = open_partial_folder(out, &stem, &stamp, options)?;
    progress.phase("frames");
    let job = Job { options, config, cancel, progress };
    let perceived = perceived_of(&pieces, &folder.path().join(SPOOL), config).and_then(|perceived| {
        let activity = config.activity.enabled.then(|| open_activity(&options.models, config)).transpose()?;
        Ok((perceived, activity))
    });
    complete(folder, perceived, &stem, started, None, &job)
}

/// Checks that the pieces, sorted by time, belong to one input and cover that input without a gap.
fn check(pieces: &[(&Path, PieceFile)], config: &Config) -> Result<(), PipelineError> {
    let fail =
        |folder: &Path, what: &str| Err(PipelineError::usage(&format!("{what}: {}", folder.display())));
    let mut reached_s = None;
    for (i, (folder, piece)) in pieces.iter().enumerate() {
        let Some(span) = piece.stamp.piece else {
            return fail(folder, "its piece.json lacks the interval of the piece");
        };
        let first = &pieces[0].1;
        let alike =
            Stamp { piece: None, ..piece.stamp.clone() } == Stamp { piece: None, ..first.stamp.clone() };
        if !alike || piece.stem != first.stem {
            return fail(
                folder,
                "the piece differs from the first one in input, models, configuration or version",
            );
        }
        if piece.stamp.config_sha256 != config.fingerprint() {
            return fail(
                folder,
                "the piece was made with another configuration: give the same --config and --set",
            );
        }
        match reached_s {
            None if i == 0 && span.from_s as f64 <= config.decode.start_s => {}
            Some(to_s) if to_s == span.from_s => {}
            _ => {
                return fail(
                    folder,
                    &format!("the piece before {} s is missing, or a piece is given twice", span.from_s),
                );
            }
        }
        match (span.to_s, i + 1 == pieces.len()) {
            (Some(to_s), false) => reached_s = Some(to_s),
            (Some(to_s), true) if config.decode.end_s.is_some_and(|end_s| end_s <= to_s as f64) => {}
            (None, true) => {}
            _ => return fail(folder, "the pieces after this one are missing, or they overlap with it"),
        }
    }
    Ok(())
}

/// Joins the perception results of all pieces, and writes their frames to the file `spool`.
fn perceived_of(
    pieces: &[(&Path, PieceFile)],
    spool: &Path,
    config: &Config,
) -> Result<Perceived, PipelineError> {
    let mut joined = OutFile::create(spool)?;
    for (folder, piece) in pieces {
        let path = folder.join(SPOOL);
        let unreadable = |source| PipelineError::Unreadable { source, path: path.clone() };
        let mut reader = BufReader::new(File::open(&path).map_err(unreadable)?);
        let mut buffer = vec![0; 1 << 18];
        let mut frames = 0;
        loop {
            let read = reader.read(&mut buffer).map_err(unreadable)?;
            if read == 0 {
                break;
            }
            frames += buffer[..read].iter().filter(|byte| **byte == b'\n').count() as u64;
            joined.write_bytes(&buffer[..read])?;
        }
        let made = piece.decode.delivered;
        if frames != made {
            let what = format!("{frames} of {made} frames are there: copy the piece again");
            return Err(WriteError::malformed(&path, what).into());
        }
    }
    joined.finish()?;
    let first = &pieces[0].1;
    let (_, last) = &pieces[pieces.len() - 1];
    let stills: Vec<_> = pieces.iter().map(|(folder, piece)| (folder.join(STILLS), piece.stills)).collect();
    let background =
        pieces.iter().rev().find_map(|(folder, piece)| Some((folder.join(piece.place.as_ref()?), piece)));
    let background = background.map(|(path, piece)| -> Result<EmptyScene, PipelineError> {
        Ok(EmptyScene { picture: read_picture(&path)?, registration: piece.place_registration })
    });
    Ok(Perceived {
        input: first.input.clone(),
        recorded: first.recorded.clone(),
        models: first.models.clone(),
        fingerprints: first.stamp.models.clone(),
        decode: decode_of(pieces.iter().map(|(_, piece)| &piece.decode), &last.decode),
        seconds: seconds_of(pieces),
        rejected_cars: pieces.iter().map(|(_, piece)| piece.rejected_cars).sum(),
        watch: watch_of(spool)?,
        samples: samples_of(pieces, config.output.sample_frames)?,
        stills: Stills::read(
            config.output.report_mib,
            stills.iter().map(|(path, levels)| (path.as_path(), *levels)),
        )?,
        background: background.transpose()?,
    })
}

/// Adds up the decoding reports of all pieces. Only the report of the last piece shows whether the input file ends too
/// early.
fn decode_of<'a>(reports: impl Iterator<Item = &'a DecodeReport>, last: &DecodeReport) -> DecodeReport {
    let mut all = DecodeReport { cut_short: last.cut_short, ..DecodeReport::default() };
    for report in reports {
        all.expected += report.expected;
        all.decoded += report.decoded;
        all.delivered += report.delivered;
        all.missing += report.missing;
        all.damaged_stretches.extend(report.damaged_stretches.iter().cloned());
        all.damaged_stretch_count += report.damaged_stretch_count;
        all.broken_packets += report.broken_packets;
        all.times_made_up += report.times_made_up;
        all.explained += report.explained;
        for warning in &report.warnings {
            if !all.warnings.contains(warning) {
                all.warnings.push(warning.clone());
            }
        }
    }
    all
}

fn seconds_of(pieces: &[(&Path, PieceFile)]) -> Vec<StageSeconds> {
    let mut all: Vec<StageSeconds> = Vec::new();
    for stage in pieces.iter().flat_map(|(_, piece)| &piece.seconds) {
        match all.iter_mut().find(|sum| sum.stage == stage.stage) {
            Some(sum) => sum.seconds += stage.seconds,
            None => all.push(stage.clone()),
        }
    }
    all
}

fn watch_of(spool: &Path) -> Result<WatchSummary, PipelineError> {
    let mut watched = Watched::default();
    for record in FrameReader::open(spool)? {
        let record: FrameRecord = record?;
        watched.push(&record);
    }
    Ok(watched.finish())
}

/// Returns at most `wanted` frames for the report, spread over all pieces: index, time in s, picture.
fn samples_of(
    pieces: &[(&Path, PieceFile)],
    wanted: usize,
) -> Result<Vec<(u64, f64, RgbImage)>, PipelineError> {
    let of_piece = |(folder, piece): &(&Path, PieceFile)| {
        let folder = folder.to_path_buf();
        piece.samples.clone().into_iter().map(move |(frame, time_s, name)| {
            (frame, time_s, folder.join(Path::new(&name).file_name().unwrap_or_default()))
        })
    };
    let all: Vec<(u64, f64, PathBuf)> = pieces.iter().flat_map(of_piece).collect();
    let chosen = wanted.min(all.len());
    let at = |i: usize| if chosen > 1 { i * (all.len() - 1) / (chosen - 1) } else { 0 };
    (0..chosen)
        .map(|i| &all[at(i)])
        .map(|(frame, time_s, path)| Ok((*frame, *time_s, read_picture(path)?)))
        .collect()
}

fn read_picture(path: &Path) -> Result<RgbImage, PipelineError> {
    let bytes = std::fs::read(path)
        .map_err(|source| PipelineError::Unreadable { source, path: path.to_path_buf() })?;
    let picture = image::load_from_memory_with_format(&bytes, image::ImageFormat::Jpeg);
    Ok(picture.map_err(ViewError::from)?.into_rgb8())
}
