//! Sends every frame of an input through the stages.

use std::path::Path;

use roadplane_base::FrameStamp;
use roadplane_decode::{DecodeReport, Input, open, open_part};

use crate::stream::flow::{Stage, StageTime, Work, flow};
use crate::stream::span::Span;
use crate::{Cancel, Config, PipelineError, Progress};

/// Result of sending the frames of an input through the stages.
#[derive(Debug)]
pub struct Streamed {
    /// Counts of frames that were read, lost or skipped.
    pub decode: DecodeReport,
    /// Time that each stage worked.
    pub times: Vec<StageTime>,
}

/// Opens an input with the `[decode]` settings of the configuration.
///
/// # Errors
/// Returns [`PipelineError::Decode`] if the input cannot be used.
pub fn open_input(input: &Path, config: &Config) -> Result<Input, PipelineError> {
    Ok(open(input, &config.decode)?)
}

/// Opens the part of an input that is needed to process a piece. This part starts before the piece, but the decoder's
/// report counts only frames of the piece.
///
/// # Errors
/// Returns [`PipelineError::Decode`] if the input cannot be used.
pub fn open_input_part(input: &Path, piece: &Span, config: &Config) -> Result<Input, PipelineError> {
    Ok(open_part(input, &piece.options(&config.decode), piece.from_s as f64)?)
}

/// Sends every frame of `input` through the stages into `sink`. Only frames for which `wanted` is true have a picture.
///
/// # Errors
/// Returns the error of the first stage that failed, or [`PipelineError::Stopped`] after a request to stop.
pub fn stream(
    mut input: Input,
    mut wanted: impl FnMut(&FrameStamp) -> bool + Send,
    stages: Vec<Stage<'_>>,
    mut sink: impl FnMut(&Work) -> Result<(), PipelineError>,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Streamed, PipelineError> {
    progress.expect(input.frames_due());
    let size = input.size();
    let frame_bytes = 3 * u64::from(size.width) * u64::from(size.height);
    // Memory is limited, so fewer frames wait between two stages if their pictures are large.
    let budget = config.pipeline.buffer_mib * (1 << 20) / (stages.len() as u64 + 1);
    let capacity = (budget / frame_bytes.max(1)).clamp(1, 64) as usize;
    let source_input = &mut input;
    // The decoder reuses the buffers of pictures that the sink has released.
    let (used, to_fill) = crossbeam_channel::bounded(capacity);
    let source = move || {
        to_fill.try_iter().for_each(|image| source_input.reuse(image));
        Ok(source_input.next_where(&mut wanted)?.map(|decoded| Work::new(decoded, size)))
    };
    let counted = |work: Work| {
        sink(&work)?;
        if let Some(image) = work.image {
            // If the channel is full, the buffer is freed.
            used.try_send(image).ok();
        }
        progress.frame_done();
        Ok(())
    };
    let times = flow("decode", source, stages, counted, capacity, cancel)?;
    Ok(Streamed { decode: input.report().clone(), times })
}
