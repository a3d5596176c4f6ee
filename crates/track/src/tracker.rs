//! Assigns measurements to cars, frame by frame.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{CarRef, VehicleClass, assign, bbox_iou};

use crate::{
    CarMeasurement, CarriedCar, Detection, FrameMeasurements, Scene, SeenAgain, Track, TrackOptions,
    TrackStep, Tracks,
    complete::complete,
    expected::{Expected, SURE_OVERLAP},
    filter::POSE_FLOOR_M,
    frames::{BoxesByFrame, Frames},
    measurement::Observation,
    noise::MIN_DETECTIONS,
    raw_track::{FEWEST, RawTrack, same_car},
    shape::ShapeSum,
};

/// A track that may continue.
#[derive(Clone, Debug)]
struct Live {
    expected: Expected,
    raw: RawTrack,
    /// Frame and index of the last measurement.
    source: Option<CarRef>,
    /// Number of counted inference frames when the track started.
    born: usize,
    /// Number of counted inference frames without a detection, since the last one.
    missed: usize,
    /// Whether an earlier pass over the frames had it on a track.
    known: bool,
}

impl Live {
    /// Starts a track with its first measurement. `counted` is the number of counted inference frames so far.
    fn new(car: &CarMeasurement, observation: Observation, source: Option<CarRef>, counted: usize) -> Self {
        let expected = Expected::new(&observation);
        let (position, axis) = (expected.filter.state.xy(), expected.filter.axis);
        let mut raw = RawTrack { shape: ShapeSum::new(position, axis), ..RawTrack::default() };
        if !car.from_box {
            raw.shape.add(car, position, axis);
        }
        raw.add(car, observation);
        Self { expected, raw, source, born: counted, missed: 0, known: car.known }
    }

    /// Whether it was detected often enough not to be a false alarm.
    fn is_confirmed(&self, options: &TrackOptions) -> bool {
        self.known || !options.takes(TrackStep::Confirm) || self.raw.observations.len() >= FEWEST
    }

    /// Adds a detection that is carried over: the car is in the position of its last measurement.
    fn carry_over(&mut self, car: &CarriedCar, frame: usize, time_s: f64) {
        let Some(last) = self.raw.observations.last().cloned() else { return };
        self.expected.carry_over(car.detection.bbox_px, time_s);
        let detection = Detection { carried_over: true, ..car.detection };
        self.raw.observations.push(Observation { frame, time_s, detection, ..last });
        self.missed = 0;
    }

    /// Adds a measurement.
    fn add(&mut self, car: &CarMeasurement, observation: Observation, source: Option<CarRef>) {
        self.source = source;
        self.expected.add(&observation);
        if !car.from_box {
            self.raw.shape.add(car, self.expected.filter.state.xy(), self.expected.filter.axis);
        }
        self.raw.add(car, observation);
        self.known |= car.known;
        self.missed = 0;
    }
}

/// The tracker of a clip's cars.
#[derive(Default)]
pub struct Tracker {
    options: TrackOptions,
    frames: Frames,
    /// Tracks that may continue.
    live: Vec<Live>,
    ended: Vec<RawTrack>,
    boxes: BoxesByFrame,
    /// Detections without a measurement, with the indices of their frames.
    seen_again: Vec<(u64, SeenAgain)>,
    /// Number of measurements that were not finite, had no area or had no valid covariance.
    pub rejected: usize,
}

impl Tracker {
    /// Creates a tracker with these settings.
    #[must_use]
    pub fn new(options: TrackOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// Takes the next frame, in the order of time. Frames without cars must be given, too.
    pub fn push(&mut self, frame: &FrameMeasurements) {
        let (index, time_s, is_counted) = self.frames.push(frame.stamp, frame.delay_s, frame.is_inferred);
        let counted = self.frames.counted;
        let mut cars: Vec<&CarMeasurement> = frame.cars.iter().filter(|car| car.is_usable()).collect();
        self.rejected += frame.cars.len() - cars.len();
        // The cars are sorted, so that their order in the frame has no effect.
        cars.sort_by(|a, b| {
            let key = |c: &CarMeasurement| {
                let [x0, y0, x1, y1] = c.detection.bbox_px;
                [x0, y0, x1, y1, c.pose.x_m, c.pose.y_m]
            };
            key(a)
                .iter()
                .zip(key(b))
                .map(|(a, b)| a.total_cmp(&b))
                .find(|o| o.is_ne())
                .unwrap_or(a.detection.car.cmp(&b.detection.car))
        });
        let observations: Vec<Observation> = cars.iter().map(|car| observation(car, index, time_s)).collect();
        let mut carried: Vec<bool> = vec![false; self.live.len()];
        for car in &frame.carried_over {
            // A measurement that failed belongs to no track. The car is still the one that is stationary there.
            let by_source =
                car.source.and_then(|source| self.live.iter().position(|live| live.source == Some(source)));
            let overlap =
                |l: &usize| bbox_iou(&self.live[*l].expected.motion.last_px, &car.detection.bbox_px);
            let by_overlap = || {
                let free = (0..self.live.len()).filter(|l| !carried[*l] && overlap(l) > SURE_OVERLAP);
                free.max_by(|a, b| overlap(a).total_cmp(&overlap(b)))
            };
            if let Some(l) = by_source.filter(|l| !carried[*l]).or_else(by_overlap) {
                self.live[l].carry_over(car, index, time_s);
                carried[l] = true;
            }
        }
        let again: Vec<Option<&SeenAgain>> = (self.live.iter())
            .map(|live| frame.seen_again.iter().find(|car| Some(car.source) == live.source))
            .collect();
        self.seen_again.extend(frame.seen_again.iter().map(|car| (frame.stamp.index, *car)));
        // Tracks with a detection of their own take no other box.
        let has_own: Vec<bool> =
            carried.iter().zip(&again).map(|(carried, again)| *carried || again.is_some()).collect();
        let pairs = assign(self.live.len(), cars.len(), 1.0, |l, c| {
            if has_own[l] { f64::INFINITY } else { self.live[l].expected.cost(&observations[c]) }
        });
        let source = |c: usize| cars[c].detection.car.map(|car| CarRef { frame: frame.stamp.index, car });
        for (l, live) in self.live.iter_mut().enumerate() {
            live.raw.seen_again += usize::from(again[l].is_some());
            match pairs[l] {
                Some(c) => live.add(cars[c], observations[c].clone(), source(c)),
                None => live.missed += usize::from(is_counted && !has_own[l]),
            }
        }
        let taken = |c: usize| pairs.contains(&Some(c));
        let own: Vec<Observation> = (self.live.iter().zip(&again).zip(&has_own))
            .filter(|(_, has_own)| **has_own)
            .filter_map(|((live, again), _)| {
                let last = live.raw.observations.last()?;
                let bbox_px = again.map_or(last.detection.bbox_px, |car| car.bbox_px);
                Some(Observation { detection: Detection { bbox_px, ..last.detection }, ..last.clone() })
            })
            .collect();
        let births: Vec<usize> = (0..cars.len())
            // A car without a car's keypoints starts no track.
            .filter(|&c| !taken(c) && (!cars[c].from_box || cars[c].detection.class != VehicleClass::Car))
            .filter(|&c| {
                let same = |other: &Observation| same_car(&observations[c], other);
                !(0..cars.len()).any(|other| taken(other) && same(&observations[other]))
                    && !own.iter().any(same)
            })
            .collect();
        if !frame.boxes.is_empty() {
            self.boxes.insert(index, frame.boxes.clone());
        }
        self.bury(time_s);
        for c in births {
            self.live.push(Live::new(cars[c], observations[c].clone(), source(c), counted));
        }
    }

    /// Returns all tracks that are probably vehicles.
    #[must_use]
    pub fn finish(mut self, scene: &impl Scene) -> Tracks {
        self.ended.extend(self.live.drain(..).map(|live| live.raw));
        let Self { options, frames, ended, boxes, seen_again, .. } = self;
        let mut found = complete(ended, boxes, &frames, &options, scene);
        add_detections(&mut found.tracks, &seen_again);
        found
    }

    /// Ends tracks that were undetected for too long. Unconfirmed tracks get little time.
    fn bury(&mut self, time_s: f64) {
        let (options, counted) = (&self.options, self.frames.counted);
        let is_dead = |live: &mut Live| {
            if !live.is_confirmed(options) {
                return counted + 1 - live.born >= MIN_DETECTIONS || live.missed + FEWEST > MIN_DETECTIONS;
            }
            // Inference frames may be rare, so a track may miss one of them.
            live.missed > 1 && live.expected.is_lost(time_s)
        };
        // Unconfirmed tracks are dropped. In a clip that is itself too short, they are still live at the end and are
        // kept.
        let confirmed = self.live.extract_if(.., is_dead).filter(|live| live.is_confirmed(options));
        self.ended.extend(confirmed.map(|live| live.raw));
    }
}

/// Converts a measurement to an observation, and adds the variance of [`POSE_FLOOR_M`] to its position.
fn observation(car: &CarMeasurement, frame: usize, time_s: f64) -> Observation {
    let floor = POSE_FLOOR_M.powi(2);
    let covariance = car.covariance + Matrix3::from_diagonal(&Vector3::new(floor, floor, 0.0));
    Observation {
        frame,
        time_s,
        pose: car.pose_vector(),
        covariance: (covariance + covariance.transpose()) / 2.0,
        detection: car.detection,
        from_box: car.from_box,
        fit_rms_share: car.fit_rms_share,
    }
}

/// Adds detections without a measurement to the states of the tracks that have their last measurement. The first number
/// is the index of the frame. Positions do not change.
fn add_detections(tracks: &mut [Track], detections: &[(u64, SeenAgain)]) {
    let mut owners: BTreeMap<CarRef, usize> = BTreeMap::new();
    for (owner, track) in tracks.iter().enumerate() {
        owners.extend(track.measured().map(|(source, _)| (source, owner)));
    }
    for (frame, seen) in detections {
        let Some(&owner) = owners.get(&seen.source) else { continue };
        let states = &mut tracks[owner].states;
        let Ok(at) = states.binary_search_by_key(frame, |state| state.stamp.index) else { continue };
        let state = &mut states[at];
        if state.bbox_px.is_none() {
            (state.bbox_px, state.score) = (Some(seen.bbox_px), seen.score);
        }
    }
}
