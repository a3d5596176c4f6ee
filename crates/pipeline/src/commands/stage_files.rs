//! Commands `roadplane stage detect` and `roadplane stage keypoints`: each runs one stage of perception and writes a
//! file.

use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use roadplane_base::FrameRecord;
use roadplane_write::{FrameReader, JsonLines, WriteError};

use crate::stream::backgrounds::Backgrounds;
use crate::stream::cadence::Cadence;
use crate::stream::flow::{Stage, Work};
use crate::stream::nets::{open_detector, open_keypoints};
use crate::stream::scene_lines::LineFinder;
use crate::stream::stages::{detect_stage, keypoint_stage, watch_stage};
use crate::stream::streaming::{open_input, stream};
use crate::{Cancel, Config, PipelineError, Progress};

/// Destination of the records of frames: a file, or standard output for the path `-`. A file gets its final name when
/// it is complete.
enum Sink {
    File(JsonLines),
    Stdout(std::io::StdoutLock<'static>),
}

impl Sink {
    fn create(path: &Path) -> Result<Self, PipelineError> {
        if path == Path::new("-") {
            return Ok(Self::Stdout(std::io::stdout().lock()));
        }
        Ok(Self::File(JsonLines::create(path)?))
    }

    fn write(&mut self, record: &FrameRecord) -> Result<(), PipelineError> {
        match self {
            Self::File(lines) => Ok(lines.write_frame(record)?),
            Self::Stdout(out) => {
                let line = serde_json::to_string(record).map_err(std::io::Error::from);
                let written = line.and_then(|line| writeln!(out, "{line}"));
                written.map_err(|source| PipelineError::Stdout { source })
            }
        }
    }

    fn finish(self) -> Result<(), WriteError> {
        match self {
            Self::File(lines) => lines.finish(),
            Self::Stdout(_) => Ok(()),
        }
    }
}

/// Detects vehicles in an input and writes a file of frames with the boxes of these vehicles. Returns true if some of
/// the input was lost or damaged.
///
/// # Errors
/// Returns a [`PipelineError`] if the file cannot be completed. A file `out` is then unchanged.
pub fn detect_file(
    input: &Path,
    out: &Path,
    models: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<bool, PipelineError> {
    let input = open_input(input, config)?;
    let mut detector = open_detector(models, config)?;
    let mut sink = Sink::create(out)?;
    let write = |work: &Work| sink.write(&work.record);
    let cadence = Cadence::of(&input, config);
    let mut backgrounds = Backgrounds::default();
    let lines = LineFinder::new(!config.solve.reads_scene());
    let stages = vec![watch_stage(), detect_stage(&mut detector, cadence, &mut backgrounds, lines)];
    let streamed = stream(input, cadence.chooser(), stages, write, config, cancel, progress)?;
    sink.finish()?;
    Ok(streamed.decode.is_damaged())
}

/// Finds the keypoints of vehicles in an input and writes a file of frames. The file `boxes` has the boxes of the
/// vehicles, sorted by frame. A frame that is missing from `boxes` is written without vehicles. Returns true if some of
/// the input was lost or damaged.
///
/// # Errors
/// Returns a [`PipelineError`] if the file cannot be completed. A file `out` is then unchanged.
pub fn keypoints_file(
    input: &Path,
    boxes: &Path,
    out: &Path,
    models: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<bool, PipelineError> {
    let input = open_input(input, config)?;
    let mut net = open_keypoints(models, config)?;
    let cadence = Cadence::of(&input, config);
    let mut records = in_order(FrameReader::open(boxes)?, boxes).peekable();
    let unused = AtomicU64::new(0);
    let lose = |record: &FrameRecord| {
        let count = record.cars.len() + record.weak.len();
        unused.fetch_add(count as u64, Ordering::Relaxed);
    };
    let take_boxes = |work: &mut Work| {
        while let Some(record) =
            records.next_if(|r| r.as_ref().map_or(true, |r| r.frame <= work.record.frame))
        {
            let record = record?;
            if record.frame < work.record.frame {
                lose(&record);
            } else {
                work.record.watch = record.watch;
                work.record.scene_lines = record.scene_lines;
                work.record.scene_curves = record.scene_curves;
                work.record.cars = record.cars;
                work.record.weak = record.weak;
                work.record.extra = record.extra;
            }
        }
        Ok(())
    };
    let mut sink = Sink::create(out)?;
    let write = |work: &Work| sink.write(&work.record);
    let stages = vec![Stage::new("boxes", take_boxes), keypoint_stage(&mut net, cadence)];
    let streamed = stream(input, |_| true, stages, write, config, cancel, progress)?;
    // A bad line after the last frame also leaves `out` unchanged.
    for record in records {
        lose(&record?);
    }
    sink.finish()?;
    let unused = unused.into_inner();
    if unused > 0 {
        tracing::warn!(
            "{unused} boxes belong to frames that were not read from the input: {}",
            boxes.display()
        );
    }
    Ok(streamed.decode.is_damaged())
}

/// Returns the records of the file `path` as long as they are sorted by frame, and then an error.
fn in_order<E>(
    records: impl Iterator<Item = Result<FrameRecord, E>>,
    path: &Path,
) -> impl Iterator<Item = Result<FrameRecord, PipelineError>>
where
    PipelineError: From<E>,
{
    let mut last = None;
    records.map(move |record| {
        let record = record?;
        if let Some(last) = last.replace(record.frame).filter(|last| record.frame <= *last) {
            let frame = record.frame;
            let what = if frame == last {
                format!("frame {frame} has two lines: join them")
            } else {
                format!("frame {frame} comes after frame {last}: sort the lines by `frame`")
            };
            return Err(WriteError::malformed(path, what).into());
        }
        Ok(record)
    })
}
