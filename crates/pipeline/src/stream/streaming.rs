//! The left half of a run: decode → watch → detect → keypoints, frame by frame.

use std::path::Path;

use roadplane_activity::ActivityNet;
use roadplane_base::{FrameStamp, PictureVerdict};
use roadplane_decode::{DecodeReport, Input, InputKind, open, open_part};
use roadplane_detect::{Attention, Detector};
use roadplane_infer::{Session, SessionOptions};
use roadplane_keypoints::{KeypointNet, Schedule};
use roadplane_watch::{Background, Watcher};
use roadplane_write::ModelSummary;

use crate::commands::piece::Span;
use crate::stream::flow::{Stage, StageTime, Work, flow};
use crate::stream::scene_lines::LineFinder;
use crate::tracks::activities::open_activity;
use crate::{Cancel, Config, PipelineError, Progress};

/// The nets of a run.
pub struct Nets {
    /// Finds vehicles.
    pub detector: Detector,
    /// Finds their keypoints.
    pub keypoints: KeypointNet,
    /// Tells what tracks do; none where that is switched off.
    pub activity: Option<ActivityNet>,
}

impl Nets {
    /// Loads all from the models folder.
    ///
    /// # Errors
    /// [`PipelineError`] when a model is refused or the runtime is missing.
    pub fn open(models: &Path, config: &Config) -> Result<Self, PipelineError> {
        Ok(Self {
            detector: open_detector(models, config)?,
            keypoints: open_keypoints(models, config)?,
            activity: config.activity.enabled.then(|| open_activity(models, config)).transpose()?,
        })
    }

    /// What they are, for the summary.
    #[must_use]
    pub fn summaries(&self) -> Vec<ModelSummary> {
        self.sessions().map(summary_of).collect()
    }

    /// What their results depend on: weights, what computes them, and how outputs become measurements.
    #[must_use]
    pub fn fingerprints(&self) -> Vec<String> {
        let of = |session: &Session| {
            let card = session.card();
            let calibration = serde_json::Value::Object(card.calibration.clone());
            format!("{} {} {calibration}", card.sha256, session.provider())
        };
        self.sessions().map(of).collect()
    }

    fn sessions(&self) -> impl Iterator<Item = &Session> {
        let of_pictures = [self.detector.session(), self.keypoints.session()];
        of_pictures.into_iter().chain(self.activity.as_ref().map(ActivityNet::session))
    }
}

/// The detector alone.
///
/// # Errors
/// [`PipelineError`] when the model is refused or the runtime is missing.
pub fn open_detector(models: &Path, config: &Config) -> Result<Detector, PipelineError> {
    let session = Session::open(&models.join(&config.models.detector), &session_options(config))?;
    Ok(Detector::new(session, config.detect.clone())?)
}

/// The keypoint net alone.
///
/// # Errors
/// [`PipelineError`] when the model is refused or the runtime is missing.
pub fn open_keypoints(models: &Path, config: &Config) -> Result<KeypointNet, PipelineError> {
    let card = models.join(&config.models.keypoints);
    Ok(KeypointNet::open(&card, &session_options(config), config.keypoints.clone())?)
}

fn session_options(config: &Config) -> SessionOptions {
    SessionOptions { provider: config.infer.provider, threads: config.infer.threads, library: None }
}

fn summary_of(session: &Session) -> ModelSummary {
    let card = session.card();
    ModelSummary {
        name: card.name.clone(),
        version: card.version_text(),
        sha256: card.sha256.clone(),
        provider: session.provider().to_string(),
    }
}

/// What streaming an input came to.
#[derive(Debug)]
pub struct Streamed {
    /// What became of the frames.
    pub decode: DecodeReport,
    /// Work of each stage.
    pub times: Vec<StageTime>,
}

/// Opens an input as the configuration says.
///
/// # Errors
/// [`PipelineError::Decode`] when it cannot be used.
pub fn open_input(input: &Path, config: &Config) -> Result<Input, PipelineError> {
    Ok(open(input, &config.decode)?)
}

/// Opens what a piece of an input needs, and counts what is its own.
///
/// # Errors
/// [`PipelineError::Decode`] when it cannot be used.
pub fn open_input_part(input: &Path, piece: &Span, config: &Config) -> Result<Input, PipelineError> {
    Ok(open_part(input, &piece.options(&config.decode), piece.from_s as f64)?)
}

/// When pictures are looked at, and when what is remembered of them ends: by a frame's place and time in the input alone, so
/// that runs that begin elsewhere, or go on after a stop, agree.
#[derive(Clone, Copy, Debug)]
pub struct Cadence {
    /// Every so many frames of the input one is looked at.
    every: u64,
    /// The keypoint net sees a car at most once in so many frames.
    crops_every: u64,
    /// Looks within which the sweep covers the picture.
    looks_a_sweep: u64,
    /// Whether the detector looks at parts only.
    attention: bool,
}

/// Pictures of which the detector sees less than so many px of its input, in all passes together, are looked at more often in
/// proportion, at the same cost: a vehicle that it finds now and then only is then found when it does. With the default passes
/// pictures from 1024 px on are large.
const LARGE_PX: f64 = 1e6;

/// What detector and keypoint net remember is thrown away this often, s of the input: a resumed run begins again there, and memory
/// of anything is at most so old.
pub const FORGET_S: f64 = 60.0;

/// Number of the stretch of [`FORGET_S`] that a time lies in.
#[must_use]
pub fn stretch_of(time_s: f64) -> u64 {
    (time_s / FORGET_S).max(0.0) as u64
}

/// Frames from look to look of the detector, which sees `input_px` of a picture, and of the keypoint net, which is as dear for
/// small pictures as for large ones; `frames` are those of `watch.look_s`.
fn beat(frames: f64, stride: u64, input_px: f64) -> (u64, u64) {
    let multiple = |of: u64, frames: f64| of * (frames / of as f64).round().clamp(1.0, 1e6) as u64;
    let every = multiple(stride, frames * (input_px / LARGE_PX).min(1.0));
    (every, multiple(every, frames))
}

impl Cadence {
    /// As the configuration says, for an input of this kind and rate.
    #[must_use]
    pub fn of(input: &Input, config: &Config) -> Self {
        let watch = &config.watch;
        let stride = u64::from(config.decode.stride.max(1));
        // The rate of a folder's pictures is not known: each may be worth a look.
        let frames = match input.kind() {
            InputKind::Video(_) if watch.attention => watch.look_s * input.nominal_fps(),
            _ => 0.0,
        };
        let size = input.size();
        let (every, crops_every) = beat(frames, stride, config.detect.input_px(size.width, size.height));
        let look_s = every as f64 / input.nominal_fps().max(1e-3);
        let looks_a_sweep = (watch.sweep_s / look_s).round().clamp(1.0, 1e6) as u64;
        Self { every, crops_every, looks_a_sweep, attention: watch.attention }
    }

    /// Frames of the input from look to look.
    #[must_use]
    pub fn every(&self) -> u64 {
        self.every
    }

    /// Number of the look that a frame belongs to, counted from the input's start.
    fn number(&self, index: u64) -> u64 {
        index / self.every
    }

    /// Says of each frame, in order, whether it is looked at: the first of every look, also where frames are missing.
    pub fn chooser(self) -> impl FnMut(&FrameStamp) -> bool + Send {
        let mut last = None;
        move |stamp| {
            let number = self.number(stamp.index);
            last.replace(number) != Some(number)
        }
    }
}

/// The stage that watches the picture.
pub fn watch_stage<'a>() -> Stage<'a> {
    let mut watcher = Watcher::new();
    Stage::new("watch", move |work: &mut Work| {
        work.record.watch = Some(match &work.image {
            Some(image) => {
                let seen = work.seen.insert(watcher.look(work.stamp, image)?);
                seen.record.clone()
            }
            None => watcher.unlooked(),
        });
        Ok(())
    })
}

/// The stage that finds vehicles, and learns how the place looks without them, and its lines.
pub(crate) fn detect_stage<'a>(
    detector: &'a mut Detector,
    cadence: Cadence,
    background: &'a mut Option<Background>,
    mut lines: LineFinder,
) -> Stage<'a> {
    let mut memory: Option<(u64, Attention)> = None;
    Stage::new("detect", move |work: &mut Work| {
        let stretch = stretch_of(work.record.time_s);
        let (_, attention) = match &mut memory {
            Some(memory) if memory.0 == stretch && cadence.attention => memory,
            memory => memory.insert((stretch, Attention::new(cadence.looks_a_sweep))),
        };
        let (Some(image), Some(seen)) = (&work.image, &work.seen) else {
            work.record.cars = attention.held();
            return Ok(());
        };
        let look = attention.look(detector, work.stamp, cadence.number(work.stamp.index), image, seen)?;
        if let Some(watch) = &mut work.record.watch {
            let rounded = |share: f64| Some((share * 1e4).round() / 1e4);
            (watch.changed, watch.seen) = (rounded(look.changed), rounded(look.seen));
        }
        if seen.is_new_position {
            *background = None;
        }
        let background = background.get_or_insert_with(|| Background::new(image, look.busy.emptied()));
        if seen.record.verdict == PictureVerdict::Rest {
            background.take(image, &look.busy, work.record.time_s);
        }
        let told = lines.look(seen, background.picture(), &look.cars, work.record.time_s)?;
        (work.record.scene_lines, work.record.scene_curves) = told.unzip();
        work.record.cars = look.cars;
        Ok(())
    })
}

/// The stage that finds keypoints; every car of every frame without attention.
pub fn keypoint_stage(net: &mut KeypointNet, cadence: Cadence) -> Stage<'_> {
    let schedule = move || Schedule::new(cadence.crops_every);
    let mut memory = (0, schedule());
    Stage::new("keypoints", move |work: &mut Work| {
        let stretch = stretch_of(work.record.time_s);
        if memory.0 != stretch || !cadence.attention {
            memory = (stretch, schedule());
        }
        Ok(net.follow(&mut memory.1, work.image.as_ref(), &mut work.record)?)
    })
}

/// Sends every frame of `input` through the stages into `sink`; `wanted` says which have their pictures.
///
/// # Errors
/// The first stage's error, or [`PipelineError::Stopped`].
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
    // Memory, not frames, is what is bounded: large pictures leave room for fewer between two stages.
    let budget = config.pipeline.buffer_mib * (1 << 20) / (stages.len() as u64 + 1);
    let capacity = (budget / frame_bytes.max(1)).clamp(1, 64) as usize;
    let source_input = &mut input;
    // Pictures go round: what the sink is through with, the decoder fills again.
    let (used, to_fill) = crossbeam_channel::bounded(capacity);
    let source = move || {
        to_fill.try_iter().for_each(|image| source_input.reuse(image));
        Ok(source_input.next_where(&mut wanted)?.map(|decoded| Work::new(decoded, size)))
    };
    let counted = |work: Work| {
        sink(&work)?;
        if let Some(image) = work.image {
            // What the decoder has no use for is let go.
            used.try_send(image).ok();
        }
        progress.frame_done();
        Ok(())
    };
    let times = flow("decode", source, stages, counted, capacity, cancel)?;
    Ok(Streamed { decode: input.report().clone(), times })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_are_looked_at_more_often_and_cars_as_often() {
        let look = |fps: f64| 0.11 * fps;
        assert_eq!(beat(look(30.0), 1, 1.67e6), (3, 3));
        assert_eq!(beat(look(30.0), 1, 0.23e6), (1, 3));
        assert_eq!(beat(look(25.0), 1, 0.75e6), (2, 2), "whole looks");
        assert_eq!(beat(look(30.0), 12, 0.23e6), (12, 12));
        assert_eq!(beat(0.0, 2, 1.67e6), (2, 2), "pictures of a folder");
    }
}
