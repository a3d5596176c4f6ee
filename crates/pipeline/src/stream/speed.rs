//! The cost of a run: processor time by stage, and the share of all pixels that the detector processed.

use std::time::Instant;

use roadplane_base::FrameRecord;
use roadplane_write::{CpuMs, Speed};

use crate::stream::cpu::Laps;
use crate::stream::nets::Nets;
use crate::stream::streaming::Streamed;

/// Statistics of the detector over a run: the number of frames on which it ran, and the share of pixels that it
/// processed.
#[derive(Debug, Default)]
pub struct InferenceFrames {
    first_s: Option<f64>,
    last_s: f64,
    count: u64,
    seen: f64,
}

impl InferenceFrames {
    /// Adds the next frame. `is_new` is false for a frame that an earlier, stopped run has already processed.
    pub fn add(&mut self, record: &FrameRecord, is_new: bool) {
        self.first_s.get_or_insert(record.time_s);
        self.last_s = record.time_s;
        let seen = record.watch.as_ref().and_then(|watch| watch.seen).unwrap_or(0.0);
        if is_new && seen > 0.0 {
            self.count += 1;
            self.seen += seen;
        }
    }

    /// Returns the time from the first frame to the last, s.
    fn span_s(&self) -> f64 {
        self.last_s - self.first_s.unwrap_or(0.0)
    }
}

/// Measures the processor time of a run in progress.
#[derive(Debug)]
pub struct Meter {
    started: Instant,
    alone: bool,
    laps: Laps,
    frame_s: f64,
    inference: InferenceFrames,
    crops: u64,
    frames: u64,
    /// Processor time of each part of the run so far, s. Each value is the sum over all frames.
    cpu_s: CpuMs,
}

impl Meter {
    /// Starts a measurement. `alone` is true if this process works on no other input at the same time.
    #[must_use]
    pub fn start(alone: bool) -> Self {
        Self {
            started: Instant::now(),
            alone,
            laps: Laps::start(alone),
            frame_s: 0.0,
            inference: InferenceFrames::default(),
            crops: 0,
            frames: 0,
            cpu_s: CpuMs::default(),
        }
    }

    /// Ends the measurement of opening the input and the nets. `frame_s` is the duration of one frame of the input, s.
    pub fn opened(&mut self, frame_s: f64) {
        self.frame_s = frame_s;
        self.cpu_s.open = self.laps.next_s();
    }

    /// Ends the measurement of the stages, after all frames have passed them.
    pub fn streamed(&mut self, streamed: &Streamed, inference: InferenceFrames, nets: &Nets) {
        let all_s = self.laps.next_s();
        let of =
            |name: &str| streamed.times.iter().filter(|time| time.name == name).map(|time| time.cpu_s).sum();
        let stages_s: f64 = streamed.times.iter().map(|time| time.cpu_s).sum();
        // Time outside the stages is that of the decoder's own threads. If the process also works on other inputs, this
        // time is unknown.
        let decoder_s = if self.alone { (all_s - stages_s).max(0.0) } else { 0.0 };
        let own_s: f64 = of("decode");
        self.cpu_s.decode = own_s + decoder_s;
        self.cpu_s.watch = of("watch");
        self.cpu_s.detect = of("detect");
        self.cpu_s.detect_net = nets.detector.session().net_s();
        self.cpu_s.keypoints = of("keypoints");
        self.cpu_s.keypoints_net = nets.keypoints.session().net_s();
        self.cpu_s.spool = of("spool");
        self.frames = streamed.decode.decoded;
        self.crops = nets.keypoints.crops();
        self.inference = inference;
    }

    /// Ends the measurement of estimation.
    pub fn solved(&mut self) {
        self.cpu_s.solve += self.laps.next_s();
    }

    /// Returns the cost of the run so far. Processor time after estimation counts as writing.
    pub fn speed(&mut self) -> Speed {
        self.cpu_s.write += self.laps.next_s();
        let s = &self.cpu_s;
        let total_s = s.open + s.decode + s.watch + s.detect + s.keypoints + s.spool + s.solve + s.write;
        let wall_s = self.started.elapsed().as_secs_f64();
        let frames = self.frames.max(1) as f64;
        let ms = |seconds: f64| 1e3 * seconds / frames;
        Speed {
            frames: self.frames,
            clip_s: self.inference.span_s() + self.frame_s,
            wall_s,
            cpu_ms_per_frame: CpuMs {
                total: ms(total_s),
                open: ms(s.open),
                decode: ms(s.decode),
                watch: ms(s.watch),
                detect: ms(s.detect),
                detect_net: ms(s.detect_net),
                keypoints: ms(s.keypoints),
                keypoints_net: ms(s.keypoints_net),
                spool: ms(s.spool),
                solve: ms(s.solve),
                write: ms(s.write),
            },
            cores_busy: total_s / wall_s.max(1e-9),
            seen_share: self.inference.seen / frames,
            looks: self.inference.count,
            crops: self.crops,
        }
    }
}
