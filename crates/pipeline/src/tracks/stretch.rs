//! A long clip is followed stretch by stretch, so that what is held in memory is that of a stretch, however long the clip is.
//!
//! Stretches meet at full minutes, where whatever the nets remember begins anew. Each is followed from [`OVERLAP_S`] before it to
//! so long after it, as tracks bridge no longer gaps. Cars that two stretches both saw around their seam tell which of their tracks
//! are one vehicle. A clip that fits is one stretch.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::Vector3;
use roadplane_base::{CarRef, FrameRecord, VehicleClass};
use roadplane_track::{ShapeBelief, Track, TrackState};

use crate::stream::cadence::{FORGET_S, stretch_of};

/// About so many rows a stretch has at most: each takes some 500 bytes while it is worked on.
pub(crate) const MOST_ROWS: u64 = 1_000_000;
/// A stretch reaches so far beyond its seams, s: tracks bridge gaps of `track.max_hidden_s`, and begin with the nets' minutes.
const OVERLAP_S: f64 = FORGET_S;
/// No stretch is shorter, minutes: what lies around seams is followed twice.
const LEAST_MINUTES: u64 = 5;

/// From when (with it) to when (without it) the rows of a stretch are taken, s; unbounded at the ends of the clip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stretch {
    /// Beginning.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
}

impl Stretch {
    /// A clip that is one stretch.
    pub(crate) const ALL: Self = Self { from_s: f64::NEG_INFINITY, to_s: f64::INFINITY };

    /// Whether it is the one that a time belongs to.
    pub(crate) fn holds(&self, time_s: f64) -> bool {
        self.from_s <= time_s && time_s < self.to_s
    }

    /// Whether the next one sees it, too.
    fn shares(&self, time_s: f64) -> bool {
        (time_s - self.to_s).abs() <= OVERLAP_S
    }
}

/// How many rows a clip will about have, by minute.
#[derive(Debug, Default)]
pub(crate) struct Load {
    by_minute: BTreeMap<u64, u64>,
    in_view: u64,
}

impl Load {
    /// Counts a frame's, in the order of time: what was in view at the last look has rows until the next.
    pub(crate) fn add(&mut self, frame: &FrameRecord) {
        let cars = frame.cars.len() as u64;
        if frame.watch.as_ref().is_none_or(|watch| watch.looked) {
            self.in_view = cars;
        }
        *self.by_minute.entry(stretch_of(frame.time_s)).or_default() += cars.max(self.in_view);
    }

    /// The clip in stretches of about `most` rows where that leaves them long enough; never none.
    pub(crate) fn stretches(&self, most: u64) -> Vec<Stretch> {
        let (mut seams, mut rows) = (Vec::new(), 0);
        let mut since = self.by_minute.keys().next().copied().unwrap_or_default();
        for (&minute, &count) in &self.by_minute {
            if rows + count > most && minute >= since + LEAST_MINUTES {
                seams.push(minute as f64 * FORGET_S);
                (since, rows) = (minute, 0);
            }
            rows += count;
        }
        let mut all = vec![Stretch::ALL];
        for seam_s in seams {
            if let Some(last) = all.last_mut() {
                last.to_s = seam_s;
            }
            all.push(Stretch { from_s: seam_s, ..Stretch::ALL });
        }
        all
    }
}

/// A clip's frames in the order of time, of which those around a seam are gone through by both of its stretches.
pub(crate) struct Replay<I> {
    frames: I,
    kept: VecDeque<FrameRecord>,
}

impl<I, E> Replay<I>
where
    I: Iterator<Item = Result<FrameRecord, E>>,
{
    /// Of these.
    pub(crate) fn new(frames: I) -> Self {
        Self { frames, kept: VecDeque::new() }
    }

    /// The frames that a stretch sees. Ask for stretches in their order.
    pub(crate) fn seen_by(&mut self, stretch: Stretch) -> impl Iterator<Item = Result<FrameRecord, E>> {
        self.kept.retain(|frame| frame.time_s >= stretch.from_s - OVERLAP_S);
        let mut at = 0;
        std::iter::from_fn(move || {
            if at == self.kept.len() {
                match self.frames.next()? {
                    Ok(frame) => self.kept.push_back(frame),
                    Err(error) => return Some(Err(error)),
                }
            }
            let time_s = self.kept[at].time_s;
            if time_s >= stretch.to_s + OVERLAP_S {
                return None;
            }
            if at == 0 && time_s < stretch.to_s - OVERLAP_S {
                return self.kept.pop_front().map(Ok);
            }
            at += 1;
            Some(Ok(self.kept[at - 1].clone()))
        })
    }
}

/// The states in which a track was seen, with the car that it was seen as.
pub(crate) fn sightings(track: &Track) -> impl Iterator<Item = (CarRef, &TrackState)> {
    track
        .states
        .iter()
        .filter_map(|state| Some((CarRef { frame: state.stamp.index, car: state.car? }, state)))
}

/// Numbers of vehicles from stretch to stretch.
#[derive(Debug, Default)]
pub(crate) struct Numbers {
    last: u64,
    /// Cars around the last seam, and whose they are.
    shared: BTreeMap<CarRef, u64>,
    /// What those vehicles are.
    vehicles: BTreeMap<u64, Vehicle>,
}

/// What a track's vehicle is, in all stretches alike.
#[derive(Clone, Copy, Debug)]
struct Vehicle {
    class: VehicleClass,
    dims_m: Option<Vector3<f64>>,
    shape: ShapeBelief,
}

impl Numbers {
    /// Gives the tracks of the next stretch, which come in the order of their beginnings, their numbers. Vehicles that the one before
    /// knew stay what they are; tracks of which the stretch holds nothing are left out.
    pub(crate) fn give(&mut self, tracks: Vec<Track>, stretch: Stretch) -> Vec<Track> {
        let known = self.known(&tracks);
        let mut numbered = Vec::new();
        for (mut track, known) in tracks.into_iter().zip(known) {
            if !track.states.iter().any(|state| stretch.holds(state.stamp.time_s())) {
                continue;
            }
            if let Some((number, Vehicle { class, dims_m, shape })) = known {
                track = Track { id: number, class, dims_m, shape, ..track };
            } else {
                self.last += 1;
                track.id = self.last;
            }
            numbered.push(track);
        }
        self.shared.clear();
        self.vehicles.clear();
        for track in &numbered {
            let around = sightings(track).filter(|(_, state)| stretch.shares(state.stamp.time_s()));
            self.shared.extend(around.map(|(car, _)| (car, track.id)));
            let &Track { id, class, dims_m, shape, .. } = track;
            self.vehicles.insert(id, Vehicle { class, dims_m, shape });
        }
        numbered
    }

    /// The vehicle before the seam that each track goes on: of all pairs those that share most cars.
    fn known(&self, tracks: &[Track]) -> Vec<Option<(u64, Vehicle)>> {
        let mut pairs: BTreeMap<(usize, u64), usize> = BTreeMap::new();
        for (i, track) in tracks.iter().enumerate() {
            for number in sightings(track).filter_map(|(car, _)| self.shared.get(&car)) {
                *pairs.entry((i, *number)).or_default() += 1;
            }
        }
        let mut pairs: Vec<_> = pairs.into_iter().collect();
        pairs.sort_by_key(|&(pair, cars)| (std::cmp::Reverse(cars), pair));
        let mut known = vec![None; tracks.len()];
        let mut free = self.vehicles.clone();
        for ((i, number), _) in pairs {
            if known[i].is_none() {
                known[i] = free.remove_entry(&number);
            }
        }
        known
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{CarRecord, FrameStamp, GroundPose, ImageSize};

    fn frame(second: u64, cars: usize) -> FrameRecord {
        let size = ImageSize { width: 640, height: 360 };
        let cars = vec![CarRecord::boxed([10.0, 10.0, 50.0, 40.0]); cars];
        FrameRecord { cars, ..FrameRecord::empty(second, second as f64, size) }
    }

    /// Seen in these seconds as the car so numbered.
    fn track(seconds: std::ops::Range<u64>, car: usize) -> Track {
        let state = |second: u64| TrackState {
            stamp: FrameStamp { index: second, pts_nanos: second.cast_signed() * 1_000_000_000 },
            observed: true,
            held: false,
            pose: GroundPose { x_m: 0.0, y_m: 20.0, heading_rad: 0.0 },
            pose_sd: Vector3::repeat(0.1),
            speed_mps: 0.0,
            speed_sd_mps: 0.1,
            bbox_px: None,
            score: 1.0,
            car: Some(car),
            lacks_keypoints: false,
        };
        Track {
            id: 0,
            class: VehicleClass::Car,
            dims_m: None,
            dims_covariance: None,
            states: seconds.map(state).collect(),
            shape: ShapeBelief::default(),
        }
    }

    #[test]
    fn stretches_are_as_full_as_they_may_be_and_never_too_short() {
        let mut load = Load::default();
        assert_eq!(load.stretches(10), [Stretch::ALL]);
        (0..3600).for_each(|second| load.add(&frame(second, 2)));
        assert_eq!(load.stretches(7200), [Stretch::ALL]);
        let seams: Vec<f64> = load.stretches(1500).iter().map(|stretch| stretch.to_s).collect();
        assert_eq!(seams, [720.0, 1440.0, 2160.0, 2880.0, f64::INFINITY]);
        assert!(load.stretches(1).windows(2).all(|w| w[0].to_s == w[1].from_s && w[0].to_s % 300.0 == 0.0));
    }

    #[test]
    fn frames_around_a_seam_are_seen_from_both_sides() {
        let cuts = [f64::NEG_INFINITY, 300.0, 600.0, f64::INFINITY];
        let stretches = cuts.windows(2).map(|w| Stretch { from_s: w[0], to_s: w[1] });
        let mut replay = Replay::new((0..1000).map(|second| Ok::<_, ()>(frame(second, 0))));
        let seen: Vec<Vec<u64>> = stretches
            .map(|stretch| replay.seen_by(stretch).map(|frame| frame.unwrap().frame).collect())
            .collect();
        let expected = [0..360, 240..660, 540..1000].map(|range| range.collect::<Vec<u64>>());
        assert_eq!(seen, expected);
    }

    #[test]
    fn vehicles_keep_their_numbers_and_what_they_are() {
        let mut numbers = Numbers::default();
        let first = Stretch { from_s: f64::NEG_INFINITY, to_s: 300.0 };
        let second = Stretch { from_s: 300.0, to_s: f64::INFINITY };
        let bus =
            Track { class: VehicleClass::Bus, dims_m: Some(Vector3::repeat(3.0)), ..track(100..350, 1) };
        // The last begins beyond the seam: it is the next stretch's.
        let before = numbers.give(vec![track(10..290, 0), bus, track(320..350, 2)], first);
        assert_eq!(before.iter().map(|track| track.id).collect::<Vec<_>>(), [1, 2]);
        // The first ended before the seam; the bus was taken for a car, and for another for a while.
        let tracks = vec![track(240..290, 0), track(240..500, 1), track(350..360, 1), track(320..400, 2)];
        let after = numbers.give(tracks, second);
        assert_eq!(after.iter().map(|track| track.id).collect::<Vec<_>>(), [2, 3, 4]);
        assert_eq!((after[0].class, after[0].dims_m), (VehicleClass::Bus, Some(Vector3::repeat(3.0))));
    }
}
