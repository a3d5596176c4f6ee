//! Runs each stage in its own named thread. Bounded channels carry the frames from the source through the stages to the
//! sink.
//!
//! When a stage fails, panics or is asked to stop, its ends of the channels close. The neighbouring stages notice the
//! closed channels and end too, so no stage waits for ever. After a request to stop, each stage completes its current
//! frame. Frames that have passed all stages still reach the sink, so the sink gets an unbroken sequence of complete
//! frames.

use std::thread::{Builder, ScopedJoinHandle};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, SendTimeoutError, Sender, bounded};
use image::RgbImage;
use roadplane_base::{FrameRecord, FrameStamp, ImageSize};
use roadplane_decode::Decoded;
use roadplane_watch::Observation;

use crate::stream::cpu::thread_cpu_s;
use crate::{Cancel, PipelineError};

/// A stage logs a warning when it has waited this long for the next stage.
const STALL: Duration = Duration::from_secs(5);

/// A frame that passes through the stages, with the results of the stages so far.
#[derive(Debug)]
pub struct Work {
    /// Index and time of the frame.
    pub stamp: FrameStamp,
    /// The picture of the frame; `None` if no stage needs the picture.
    pub image: Option<RgbImage>,
    /// The result of the watcher, which measures camera motion, for the picture.
    pub seen: Option<Observation>,
    /// The record of the frame, to which the stages add their results.
    pub record: FrameRecord,
}

impl Work {
    /// Returns a decoded frame with an empty record, ready for the first stage.
    #[must_use]
    pub fn new(decoded: Decoded, size: ImageSize) -> Self {
        let Decoded { stamp, image } = decoded;
        Self { stamp, image, seen: None, record: FrameRecord::empty(stamp.index, stamp.time_s(), size) }
    }
}

/// The function that a stage calls on each frame.
type StageWork<'a> = Box<dyn FnMut(&mut Work) -> Result<(), PipelineError> + Send + 'a>;

/// A named stage of the pipeline.
pub struct Stage<'a> {
    name: &'static str,
    work: StageWork<'a>,
}

impl<'a> Stage<'a> {
    /// Creates a stage that calls `work` on every frame.
    pub fn new(
        name: &'static str,
        work: impl FnMut(&mut Work) -> Result<(), PipelineError> + Send + 'a,
    ) -> Self {
        Self { name, work: Box::new(work) }
    }

    /// Returns a stage that works only on frames for which `due` is true. Other frames pass through the stage
    /// unchanged.
    #[must_use]
    pub fn only(self, due: impl Fn(&FrameRecord) -> bool + Send + 'a) -> Self {
        let Self { name, mut work } = self;
        Self::new(name, move |item| if due(&item.record) { work(item) } else { Ok(()) })
    }
}

/// Time that a stage worked. Waiting for other stages does not count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageTime {
    /// Name of the stage.
    pub name: &'static str,
    /// Wall-clock time of work, s.
    pub seconds: f64,
    /// Processor time of the stage's thread, s.
    pub cpu_s: f64,
}

/// Sends the frames of `source` through the stages into `sink`. Returns the time that the source, each stage and the
/// sink worked.
///
/// `source_name` is the name of the source's thread. The sink runs on the calling thread. At most `capacity` frames
/// wait between two stages.
///
/// # Errors
/// Returns the error of the first stage that failed, in the order of the stages. A panic becomes
/// [`PipelineError::Bug`]. A stop request in `cancel` becomes [`PipelineError::Stopped`], after the completed frames
/// have reached the sink.
pub fn flow<'a>(
    source_name: &'static str,
    mut source: impl FnMut() -> Result<Option<Work>, PipelineError> + Send + 'a,
    stages: Vec<Stage<'a>>,
    mut sink: impl FnMut(Work) -> Result<(), PipelineError>,
    capacity: usize,
    cancel: &Cancel,
) -> Result<Vec<StageTime>, PipelineError> {
    std::thread::scope(|scope| {
        let mut threads: Vec<(&'static str, ScopedJoinHandle<'_, Result<StageTime, PipelineError>>)> =
            Vec::new();
        let (sender, mut receiver) = bounded::<Work>(capacity);
        let stop = cancel.clone();
        let read = move || {
            let mut busy = Duration::ZERO;
            while !stop.is_stopped() {
                let started = Instant::now();
                let work = source()?;
                busy += started.elapsed();
                let Some(work) = work else { break };
                if !send(&sender, work, source_name) {
                    break;
                }
            }
            Ok(StageTime { name: source_name, seconds: busy.as_secs_f64(), cpu_s: thread_cpu_s() })
        };
        // Log lines of the stages belong to the tracing span of the caller.
        let span = tracing::Span::current();
        let source_span = span.clone();
        let spawned = Builder::new()
            .name(source_name.to_owned())
            .spawn_scoped(scope, move || source_span.in_scope(read));
        threads.push((source_name, spawned.map_err(PipelineError::thread)?));
        for stage in stages {
            let (sender, next_receiver) = bounded::<Work>(capacity);
            let input = std::mem::replace(&mut receiver, next_receiver);
            let name = stage.name;
            let spawned = Builder::new().name(name.to_owned()).spawn_scoped(scope, {
                let (stop, span) = (cancel.clone(), span.clone());
                move || span.in_scope(|| run_stage(stage, &input, &sender, &stop))
            });
            threads.push((name, spawned.map_err(PipelineError::thread)?));
        }
        let sink_from_s = thread_cpu_s();
        let mut sunk = Ok(());
        let mut sink_busy = Duration::ZERO;
        for work in &receiver {
            let started = Instant::now();
            sunk = sink(work);
            sink_busy += started.elapsed();
            if sunk.is_err() {
                break;
            }
        }
        drop(receiver);
        let sink_cpu_s = thread_cpu_s() - sink_from_s;
        let mut times = Vec::new();
        let mut first_error = None;
        for (name, thread) in threads {
            match thread.join() {
                Ok(Ok(time)) => times.push(time),
                Ok(Err(error)) => first_error = first_error.or(Some(error)),
                Err(panic) => {
                    first_error = first_error.or(Some(PipelineError::panicked(name, panic.as_ref())))
                }
            }
        }
        times.push(StageTime { name: "spool", seconds: sink_busy.as_secs_f64(), cpu_s: sink_cpu_s });
        match first_error {
            Some(error) => Err(error),
            None => {
                sunk?;
                cancel.signal().map_or(Ok(times), |signal| Err(PipelineError::Stopped { signal }))
            }
        }
    })
}

fn run_stage(
    mut stage: Stage<'_>,
    input: &Receiver<Work>,
    output: &Sender<Work>,
    stop: &Cancel,
) -> Result<StageTime, PipelineError> {
    let mut busy = Duration::ZERO;
    for mut work in input {
        if stop.is_stopped() {
            break;
        }
        let started = Instant::now();
        (stage.work)(&mut work)?;
        busy += started.elapsed();
        if !send(output, work, stage.name) {
            break;
        }
    }
    Ok(StageTime { name: stage.name, seconds: busy.as_secs_f64(), cpu_s: thread_cpu_s() })
}

/// Sends a frame to the next stage and logs long waits. Returns false when the next stage has ended.
fn send(sender: &Sender<Work>, work: Work, stage: &str) -> bool {
    let mut pending = work;
    loop {
        match sender.send_timeout(pending, STALL) {
            Ok(()) => return true,
            Err(SendTimeoutError::Disconnected(_)) => return false,
            Err(SendTimeoutError::Timeout(work)) => {
                tracing::warn!("{stage} has been waiting {} s for the next stage", STALL.as_secs());
                pending = work;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(count: u64) -> impl FnMut() -> Result<Option<Work>, PipelineError> + Send {
        let mut next = 0;
        move || {
            next += 1;
            let stamp = FrameStamp { index: next - 1, pts_nanos: 0 };
            let decoded = Decoded { stamp, image: Some(RgbImage::new(4, 4)) };
            Ok((next <= count).then(|| Work::new(decoded, ImageSize { width: 4, height: 4 })))
        }
    }

    #[test]
    fn frames_arrive_in_order_through_all_stages() {
        let mut seen = Vec::new();
        let tag = |work: &mut Work| {
            work.record.time_s += work.record.frame as f64;
            Ok(())
        };
        let stages = vec![Stage::new("a", tag), Stage::new("b", tag)];
        let sink = |work: Work| {
            seen.push(work.record.time_s);
            Ok(())
        };
        let times = flow("source", frames(50), stages, sink, 2, &Cancel::default()).unwrap();
        assert_eq!(seen, (0..50).map(|i| 2.0 * f64::from(i)).collect::<Vec<_>>());
        assert_eq!(times.iter().map(|t| t.name).collect::<Vec<_>>(), ["source", "a", "b", "spool"]);
    }

    #[test]
    fn a_panicking_stage_ends_the_run_with_its_name() {
        let stages = vec![Stage::new("fragile", |work: &mut Work| {
            assert!(work.record.frame < 3, "broke on frame 3");
            Ok(())
        })];
        let error = flow("source", frames(1000), stages, |_work| Ok(()), 2, &Cancel::default()).unwrap_err();
        assert!(matches!(&error, PipelineError::Bug { stage: "fragile", .. }), "{error}");
        assert!(error.to_string().contains("broke on frame 3"));
    }

    #[test]
    fn a_failing_sink_ends_endless_sources() {
        let error = flow(
            "source",
            frames(u64::MAX),
            Vec::new(),
            |_work| Err(PipelineError::Stopped { signal: 99 }),
            1,
            &Cancel::default(),
        );
        assert!(matches!(error, Err(PipelineError::Stopped { signal: 99 })));
    }

    #[test]
    fn a_stop_delivers_the_completed_frames() {
        let cancel = Cancel::default();
        let mut delivered = 0;
        let sink = |work: Work| {
            delivered += 1;
            if work.record.frame == 9 {
                cancel.stop(15);
            }
            Ok(())
        };
        let result = flow("source", frames(u64::MAX), Vec::new(), sink, 2, &cancel);
        assert!(matches!(result, Err(PipelineError::Stopped { signal: 15 })));
        assert!((10..=14).contains(&delivered), "{delivered}");
    }
}
