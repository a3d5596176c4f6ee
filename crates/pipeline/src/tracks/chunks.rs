//! Splits a long clip into time chunks for tracking, so that memory is bounded however long the clip is.
//!
//! Chunks meet at full minutes, where the nets start again without earlier results. Each chunk is tracked from
//! [`OVERLAP_S`] before it to [`OVERLAP_S`] after it, because tracks bridge no longer gaps. Detections that two chunks
//! share around their seam show which of their tracks are the same vehicle. A short clip is one chunk.

use std::collections::{BTreeMap, VecDeque};

use roadplane_base::{CarRef, FrameRecord};
use roadplane_track::Track;

use crate::stream::cadence::{RESET_S, interval_of};

/// Approximate largest number of rows of a chunk. A row takes about 500 bytes during processing.
pub(crate) const MOST_ROWS: u64 = 1_000_000;
/// Overlap of a chunk beyond its seams, s. It is one minute, as the nets start again at full minutes. It must be as long as the longest
/// gap that tracks bridge (`HIDDEN_S` in `track/src/expected.rs`).
const OVERLAP_S: f64 = RESET_S;
/// Least length of a chunk, minutes. The overlaps are tracked twice, so shorter chunks are wasteful.
const LEAST_MINUTES: u64 = 5;

/// The interval whose rows belong to a chunk, s; unbounded at the ends of the clip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimeChunk {
    /// Beginning of the interval, included, s.
    pub from_s: f64,
    /// End of the interval, excluded, s.
    pub to_s: f64,
}

impl TimeChunk {
    /// The chunk of a clip that is not split.
    pub(crate) const ALL: Self = Self { from_s: f64::NEG_INFINITY, to_s: f64::INFINITY };

    /// Returns whether a time belongs to this chunk.
    pub(crate) fn holds(&self, time_s: f64) -> bool {
        self.from_s <= time_s && time_s < self.to_s
    }
}

/// The approximate number of rows of a clip, by minute.
#[derive(Debug, Default)]
pub(crate) struct Load {
    /// Number of rows by minute of the clip.
    by_minute: BTreeMap<u64, u64>,
    /// Number of vehicles in the last inference frame.
    in_view: u64,
}

impl Load {
    /// Adds the rows of a frame, in the order of time. Vehicles of the last inference frame have rows until the next
    /// one.
    pub(crate) fn add(&mut self, frame: &FrameRecord) {
        let cars = frame.cars.len() as u64;
        if frame.watch.as_ref().is_none_or(|watch| watch.looked) {
            self.in_view = cars;
        }
        *self.by_minute.entry(interval_of(frame.time_s)).or_default() += cars.max(self.in_view);
    }

    /// Splits the clip into chunks of about `most` rows, but not shorter than [`LEAST_MINUTES`]; never empty.
    pub(crate) fn chunks(&self, most: u64) -> Vec<TimeChunk> {
        let (mut ends_s, mut rows) = (vec![f64::NEG_INFINITY], 0);
        let mut since = self.by_minute.keys().next().copied().unwrap_or_default();
        for (&minute, &count) in &self.by_minute {
            if rows + count > most && minute >= since + LEAST_MINUTES {
                ends_s.push(minute as f64 * RESET_S);
                (since, rows) = (minute, 0);
            }
            rows += count;
        }
        ends_s.push(f64::INFINITY);
        ends_s.windows(2).map(|ends_s| TimeChunk { from_s: ends_s[0], to_s: ends_s[1] }).collect()
    }
}

/// The frames of a clip in the order of time. Frames around a seam are given to both of its chunks.
pub(crate) struct Replay<I> {
    frames: I,
    /// Frames that the next chunk may need again.
    kept: VecDeque<FrameRecord>,
}

impl<I, E> Replay<I>
where
    I: Iterator<Item = Result<FrameRecord, E>>,
{
    /// Creates the replay of `frames`.
    pub(crate) fn new(frames: I) -> Self {
        Self { frames, kept: VecDeque::new() }
    }

    /// Returns the frames that a chunk tracks. Chunks must be requested in their order.
    pub(crate) fn seen_by(&mut self, chunk: TimeChunk) -> impl Iterator<Item = Result<FrameRecord, E>> {
        self.kept.retain(|frame| frame.time_s >= chunk.from_s - OVERLAP_S);
        let mut at = 0;
        std::iter::from_fn(move || {
            if at == self.kept.len() {
                match self.frames.next()? {
                    Ok(frame) => self.kept.push_back(frame),
                    Err(error) => return Some(Err(error)),
                }
            }
            let time_s = self.kept[at].time_s;
            if time_s >= chunk.to_s + OVERLAP_S {
                return None;
            }
            if at == 0 && time_s < chunk.to_s - OVERLAP_S {
                return self.kept.pop_front().map(Ok);
            }
            at += 1;
            Some(Ok(self.kept[at - 1].clone()))
        })
    }
}

/// Assigns track numbers that stay the same from chunk to chunk.
#[derive(Debug, Default)]
pub(crate) struct Numbers {
    /// Last number in use.
    last: u64,
    /// Detections around the last seam, with the numbers of their vehicles.
    shared: BTreeMap<CarRef, u64>,
    /// Tracks of the last chunk, by number. Their class, size, shape and evidence are the same in all chunks.
    vehicles: BTreeMap<u64, Track>,
}

impl Numbers {
    /// Assigns numbers to the tracks of the next chunk, which are ordered by their beginnings.
    ///
    /// Vehicles of the previous chunk keep their properties. Tracks without a state inside the chunk are dropped.
    pub(crate) fn give(&mut self, mut tracks: Vec<Track>, chunk: TimeChunk) -> Vec<Track> {
        tracks.retain(|track| track.states.iter().any(|state| chunk.holds(state.stamp.time_s())));
        let known = self.known(&tracks);
        let mut numbered = Vec::new();
        for (track, known) in tracks.into_iter().zip(known) {
            numbered.push(match known {
                Some(before) => Track { states: track.states, joins: track.joins, ..before },
                None => {
                    self.last += 1;
                    Track { id: self.last, ..track }
                }
            });
        }
        self.shared.clear();
        self.vehicles.clear();
        // The next chunk also tracks these frames.
        let is_shared = |time_s: f64| (time_s - chunk.to_s).abs() <= OVERLAP_S;
        for track in &numbered {
            let around = track.measured().filter(|(_, state)| is_shared(state.stamp.time_s()));
            self.shared.extend(around.map(|(car, _)| (car, track.id)));
            self.vehicles.insert(track.id, Track { states: Vec::new(), joins: Vec::new(), ..*track });
        }
        numbered
    }

    /// Returns the vehicle before the seam that each track continues: the pairs with the most common detections.
    fn known(&self, tracks: &[Track]) -> Vec<Option<Track>> {
        let mut pairs: BTreeMap<(usize, u64), usize> = BTreeMap::new();
        for (i, track) in tracks.iter().enumerate() {
            for number in track.measured().filter_map(|(car, _)| self.shared.get(&car)) {
                *pairs.entry((i, *number)).or_default() += 1;
            }
        }
        let mut pairs: Vec<_> = pairs.into_iter().collect();
        pairs.sort_by_key(|&(pair, cars)| (std::cmp::Reverse(cars), pair));
        let mut known = vec![None; tracks.len()];
        let mut free = self.vehicles.clone();
        for ((i, number), _) in pairs {
            if known[i].is_none() {
                known[i] = free.remove(&number);
            }
        }
        known
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use roadplane_base::{CarRecord, FrameStamp, GroundPose, ImageSize, VehicleClass};
    use roadplane_track::{Evidence, ShapeEstimate, TrackState};

    /// Returns a frame at a second of the clip with this number of cars.
    fn frame(second: u64, cars: usize) -> FrameRecord {
        let size = ImageSize { width: 640, height: 360 };
        let cars = vec![CarRecord::boxed([10.0, 10.0, 50.0, 40.0]); cars];
        FrameRecord { cars, ..FrameRecord::empty(second, second as f64, size) }
    }

    const EVIDENCE: Evidence = Evidence {
        class: VehicleClass::Car,
        score: 2.0,
        moved: 0.0,
        fitted: 1.0,
        log_rms: 0.0,
        above_car_m: 0.0,
        rides_p: 1.0,
    };

    /// Returns a track that is detected in these seconds as the car with index `car`.
    fn track(seconds: std::ops::Range<u64>, car: usize) -> Track {
        let state = |second: u64| TrackState {
            stamp: FrameStamp { index: second, pts_nanos: second.cast_signed() * 1_000_000_000 },
            pose: GroundPose { x_m: 0.0, y_m: 20.0, heading_rad: 0.0 },
            pose_sd: Vector3::repeat(0.1),
            speed_mps: 0.0,
            speed_sd_mps: 0.1,
            bbox_px: None,
            score: 1.0,
            car: Some(car),
        };
        Track {
            id: 0,
            class: VehicleClass::Car,
            dims_m: None,
            dims_covariance: None,
            states: seconds.map(state).collect(),
            shape: ShapeEstimate::default(),
            evidence: EVIDENCE,
            joins: Vec::new(),
        }
    }

    #[test]
    fn chunks_are_as_full_as_they_may_be_and_never_too_short() {
        let mut load = Load::default();
        assert_eq!(load.chunks(10), [TimeChunk::ALL]);
        (0..3600).for_each(|second| load.add(&frame(second, 2)));
        assert_eq!(load.chunks(7200), [TimeChunk::ALL]);
        let seams: Vec<f64> = load.chunks(1500).iter().map(|chunk| chunk.to_s).collect();
        assert_eq!(seams, [720.0, 1440.0, 2160.0, 2880.0, f64::INFINITY]);
        assert!(load.chunks(1).windows(2).all(|w| w[0].to_s == w[1].from_s && w[0].to_s % 300.0 == 0.0));
    }

    #[test]
    fn frames_around_a_seam_are_seen_from_both_sides() {
        let cuts = [f64::NEG_INFINITY, 300.0, 600.0, f64::INFINITY];
        let chunks = cuts.windows(2).map(|w| TimeChunk { from_s: w[0], to_s: w[1] });
        let mut replay = Replay::new((0..1000).map(|second| Ok::<_, ()>(frame(second, 0))));
        let seen: Vec<Vec<u64>> =
            chunks.map(|chunk| replay.seen_by(chunk).map(|frame| frame.unwrap().frame).collect()).collect();
        let expected = [0..360, 240..660, 540..1000].map(|range| range.collect::<Vec<u64>>());
        assert_eq!(seen, expected);
    }

    #[test]
    fn vehicles_keep_their_numbers_and_what_they_are() {
        let mut numbers = Numbers::default();
        let first = TimeChunk { from_s: f64::NEG_INFINITY, to_s: 300.0 };
        let second = TimeChunk { from_s: 300.0, to_s: f64::INFINITY };
        let bus =
            Track { class: VehicleClass::Bus, dims_m: Some(Vector3::repeat(3.0)), ..track(100..350, 1) };
        // The last track begins beyond the seam, so it belongs to the next chunk.
        let before = numbers.give(vec![track(10..290, 0), bus, track(320..350, 2)], first);
        assert_eq!(before.iter().map(|track| track.id).collect::<Vec<_>>(), [1, 2]);
        // The first vehicle ended before the seam. The bus was taken for a car, and for another vehicle for a while.
        let tracks = vec![track(240..290, 0), track(240..500, 1), track(350..360, 1), track(320..400, 2)];
        let after = numbers.give(tracks, second);
        assert_eq!(after.iter().map(|track| track.id).collect::<Vec<_>>(), [2, 3, 4]);
        assert_eq!((after[0].class, after[0].dims_m), (VehicleClass::Bus, Some(Vector3::repeat(3.0))));
    }
}
