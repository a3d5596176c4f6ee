//! Which measurement belongs to which car, frame by frame.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{CarRef, FrameStamp, assign, bbox_centre, bbox_iou, bbox_moved, bbox_share_inside};

use crate::{
    CarMeasurement, FrameMeasurements, HeldCar, Looks, SeenAgain, Track, TrackOptions,
    duplicates::{merge_duplicates, merge_smoothed},
    filter::Filter,
    link::link,
    measurement::Sighting,
    raw_track::{RawTrack, same_car},
    shape::ShapeSum,
    smooth::smooth_track,
};

#[derive(Clone, Debug)]
struct Live {
    filter: Filter,
    raw: RawTrack,
    /// The last look that measured it.
    look: CarRef,
    /// Counts looks, not frames.
    born: usize,
    missed: usize,
    box_velocity_px_s: nalgebra::Vector2<f64>,
    /// Box of all of it while it stands, whatever hides a part of it.
    rest_px: [f64; 4],
}

/// A box is extrapolated for so long, s.
const BOX_TRUST_S: f64 = 1.0;
/// Cost at which a track rather stays alone; pose and overlap make up half of 1 each.
const ALONE: f64 = 0.9;
/// Overlap of a box with that of a car that stands, from which on it is that car's.
const SAME_PLACE: f64 = 0.7;
/// The same for one that may move.
const SAME_BOX: f64 = 0.9;
/// A sighting so near to a standing car is of that car, m.
const NEVER_NEARER_M: f64 = 1.0;
/// Least overlap of a standing car's box with that of a sighting.
const MIN_OVERLAP: f64 = 0.25;
/// Rear axle to the middle of a truck or bus, as a share of its length.
const HALF_WHEELBASE: f64 = 0.25;
/// A vehicle that stood may be hidden for so many times as long, until tracks as a whole are looked at.
const STANDS_ON: f64 = 3.0;
/// How much a look moves the edges of a standing car's box.
const OUTWARD: f64 = 0.3;
const INWARD: f64 = 0.1;
/// A box that lies within that of a standing car counts as if it overlapped it so much.
const HIDDEN_OVERLAP: f64 = 0.6;
/// A place whose sd is larger says little, m: the boxes must overlap, too.
const VAGUE_M: f64 = 1.5;
const TOUCHING: f64 = 0.05;
/// Overlap of boxes that makes a pair even where the pose went wrong.
const SURE_OVERLAP: f64 = 0.5;

impl Live {
    fn new(car: &CarMeasurement, observation: Sighting, look: CarRef, looks: usize) -> Self {
        let filter = Filter::new(&observation.pose, &observation.covariance, observation.time_s);
        let mut shape = ShapeSum::new(filter.position(), filter.axis());
        if !car.from_box {
            shape.add(car, filter.position(), filter.axis());
        }
        Self {
            look,
            born: looks,
            missed: 0,
            box_velocity_px_s: nalgebra::Vector2::zeros(),
            rest_px: car.bbox_px,
            raw: RawTrack::new(car, observation, shape),
            filter,
        }
    }

    fn last(&self) -> Option<&Sighting> {
        self.raw.observations.last()
    }

    /// Whether this is the box of the car, which stands still, or has not moved since it was seen.
    fn stands_in(&self, bbox_px: &[f64; 4]) -> bool {
        let least = if self.filter.is_still() { SAME_PLACE } else { SAME_BOX };
        self.last().is_some_and(|last| bbox_iou(&last.bbox_px, bbox_px) > least)
    }

    /// The car is where its last look saw it.
    fn hold(&mut self, held: &HeldCar, frame: usize, time_s: f64) {
        let Some(last) = self.last() else { return };
        let Sighting { pose, covariance, at_edge, hidden, from_box, .. } = *last;
        let HeldCar { bbox_px, score, car, .. } = *held;
        self.filter.hold(time_s);
        self.box_velocity_px_s = nalgebra::Vector2::zeros();
        self.raw.observations.push(Sighting {
            frame,
            time_s,
            pose,
            covariance,
            bbox_px,
            score,
            car,
            held: true,
            from_box,
            at_edge,
            hidden,
        });
        self.missed = 0;
    }

    fn add(&mut self, car: &CarMeasurement, observation: Sighting, look: CarRef, gate: f64) {
        self.look = look;
        if let Some(last) = self.last() {
            let gap_s = observation.time_s - last.time_s;
            if gap_s > 0.0 {
                let velocity = (bbox_centre(&observation.bbox_px) - bbox_centre(&last.bbox_px)) / gap_s;
                let share = if self.raw.observations.len() < 2 { 1.0 } else { 1.0 - (-gap_s / 0.15).exp() };
                self.box_velocity_px_s += share * (velocity - self.box_velocity_px_s);
            }
        }
        self.filter.update(&observation.pose, &observation.covariance, observation.time_s, gate);
        if !car.from_box {
            self.raw.shape.add(car, self.filter.position(), self.filter.axis());
        }
        self.rest_px = std::array::from_fn(|i| {
            let (known, seen) = (self.rest_px[i], observation.bbox_px[i]);
            let outward = (seen < known) == (i < 2);
            match (self.filter.is_still(), outward) {
                (false, _) => seen,
                (true, true) => known + OUTWARD * (seen - known),
                (true, false) if observation.hidden => known,
                (true, false) => known + INWARD * (seen - known),
            }
        });
        self.raw.add(car, observation);
        self.missed = 0;
    }

    /// Where the box should be; `None` when it was seen too long ago.
    fn expected_box(&self, time_s: f64) -> Option<[f64; 4]> {
        let last = self.last()?;
        if self.filter.is_still() {
            return Some(self.rest_px);
        }
        let gap_s = time_s - last.time_s;
        (gap_s <= BOX_TRUST_S).then(|| bbox_moved(&last.bbox_px, &(self.box_velocity_px_s * gap_s)))
    }

    /// 0 for a perfect match; [`ALONE`] and above for none.
    fn cost(&self, observation: &Sighting, gate: f64) -> f64 {
        let distance = self.filter.distance(&observation.pose, &observation.covariance, observation.time_s);
        let near = (distance / gate).min(1.0);
        match self.expected_box(observation.time_s) {
            Some(expected) => {
                let mut overlap = bbox_iou(&expected, &observation.bbox_px);
                if self.filter.is_still() && observation.hidden {
                    // What is left to see of a car that is being hidden.
                    let within = bbox_share_inside(&observation.bbox_px, &expected);
                    overlap = overlap.max(HIDDEN_OVERLAP * within.powi(2));
                }
                if self.filter.is_still() && overlap < MIN_OVERLAP {
                    return f64::INFINITY;
                }
                let away = (observation.pose.xy() - self.filter.position()).norm();
                let in_place = self.filter.is_still() && away < NEVER_NEARER_M;
                // What may be anywhere is near to everything.
                let spread = observation.covariance.fixed_view::<2, 2>(0, 0).trace().sqrt();
                let is_near = distance < gate && (spread < VAGUE_M || overlap > TOUCHING);
                if is_near || overlap > SURE_OVERLAP || in_place {
                    0.5 * near + 0.5 * (1.0 - overlap)
                } else {
                    f64::INFINITY
                }
            }
            None if distance < gate => 0.25 + 0.65 * near,
            None => f64::INFINITY,
        }
    }
}

/// Follows the cars of a clip.
pub struct Tracker {
    options: TrackOptions,
    stamps: Vec<FrameStamp>,
    /// From the first frame on: what a clock says at the start of a clip must not change a digit.
    times_s: Vec<f64>,
    /// Which of the frames were looked at.
    looked: Vec<bool>,
    looks: Looks,
    live: Vec<Live>,
    ended: Vec<RawTrack>,
    rejected: usize,
}

impl Tracker {
    /// With these options.
    #[must_use]
    pub fn new(options: TrackOptions) -> Self {
        Self {
            options,
            stamps: Vec::new(),
            times_s: Vec::new(),
            looked: Vec::new(),
            looks: Looks::default(),
            live: Vec::new(),
            ended: Vec::new(),
            rejected: 0,
        }
    }

    /// Measurements that were no numbers or had no covariance.
    #[must_use]
    pub fn rejected(&self) -> usize {
        self.rejected
    }

    /// Takes the next frame, in the order of time; frames without cars as well.
    pub fn push(&mut self, frame: &FrameMeasurements) {
        let index = self.stamps.len();
        self.stamps.push(frame.stamp);
        let since_first = frame.stamp.pts_nanos.saturating_sub(self.stamps[0].pts_nanos);
        let time_s = since_first as f64 * 1e-9;
        self.times_s.push(time_s);
        self.looked.push(frame.looked);
        let is_look = frame.looked && self.looks.add(time_s);
        let looks = self.looks.count;
        let mut cars: Vec<&CarMeasurement> = frame.cars.iter().filter(|car| car.is_usable()).collect();
        self.rejected += frame.cars.len() - cars.len();
        // An order of their own, so that the frame's order has no say.
        cars.sort_by(|a, b| {
            let key = |c: &CarMeasurement| {
                [c.bbox_px[0], c.bbox_px[1], c.bbox_px[2], c.bbox_px[3], c.pose.x_m, c.pose.y_m]
            };
            key(a)
                .iter()
                .zip(key(b))
                .map(|(a, b)| a.total_cmp(&b))
                .find(|o| o.is_ne())
                .unwrap_or(a.car.cmp(&b.car))
        });
        let observations: Vec<Sighting> =
            cars.iter().map(|car| self.observation(car, index, time_s)).collect();
        let gate = self.options.gate;
        let mut held: Vec<bool> = vec![false; self.live.len()];
        for car in &frame.held {
            // A look that came to nothing is no track's; the car is still the one that stands there.
            let by_look = car.look.and_then(|look| self.live.iter().position(|live| live.look == look));
            let by_place = || self.live.iter().position(|live| live.stands_in(&car.bbox_px));
            if let Some(l) = by_look.or_else(by_place).filter(|l| !held[*l]) {
                self.live[l].hold(car, index, time_s);
                held[l] = true;
            }
        }
        let again: Vec<Option<&SeenAgain>> = (self.live.iter())
            .map(|live| frame.seen_again.iter().find(|car| car.look == live.look))
            .collect();
        // Neither takes another's box.
        let has_own: Vec<bool> =
            held.iter().zip(&again).map(|(held, again)| *held || again.is_some()).collect();
        let pairs = assign(self.live.len(), cars.len(), ALONE, |l, c| {
            if has_own[l] { f64::INFINITY } else { self.live[l].cost(&observations[c], gate) }
        });
        let look = |c: usize| CarRef { frame: frame.stamp.index, car: cars[c].car };
        let mut taken = vec![false; cars.len()];
        for ((live, pair), has_own) in self.live.iter_mut().zip(&pairs).zip(&has_own) {
            match *pair {
                Some(c) => {
                    live.add(cars[c], observations[c].clone(), look(c), gate);
                    taken[c] = true;
                }
                None => live.missed += usize::from(is_look && !has_own),
            }
        }
        let own: Vec<Sighting> = (self.live.iter().zip(&again).zip(&has_own))
            .filter(|(_, has_own)| **has_own)
            .filter_map(|((live, again), _)| {
                let last = live.last()?;
                Some(Sighting { bbox_px: again.map_or(last.bbox_px, |car| car.bbox_px), ..last.clone() })
            })
            .collect();
        let births: Vec<usize> = (0..cars.len())
            .filter(|&c| !taken[c] && cars[c].score >= self.options.birth_score && cars[c].may_begin())
            .filter(|&c| {
                let same = |other: &Sighting| same_car(&observations[c], other);
                !(0..cars.len()).any(|other| taken[other] && same(&observations[other]))
                    && !own.iter().any(same)
            })
            .collect();
        self.bury(looks, time_s);
        for c in births {
            self.live.push(Live::new(cars[c], observations[c].clone(), look(c), looks));
        }
    }

    /// All tracks, by first frame, then by x.
    #[must_use]
    pub fn finish(mut self) -> Vec<Track> {
        self.ended.extend(self.live.drain(..).map(|live| live.raw));
        let least = self.options.min_observed.min(self.looks.count.div_ceil(2));
        let mut raw = merge_duplicates(link(merge_duplicates(self.ended), self.options.max_hidden_s));
        raw.retain(|track| {
            let seen = Looks::of(track.observations.iter().map(|o| o.time_s));
            // Frames in which it could have been seen: those that were looked at, and where it was held.
            let (mut life, mut next) = (Looks::default(), 0);
            for o in &track.observations {
                let between = next.max(track.observations[0].frame)..o.frame;
                between.filter(|&frame| self.looked[frame]).for_each(|frame| {
                    life.add(self.times_s[frame]);
                });
                life.add(o.time_s);
                next = o.frame + 1;
            }
            let dense = seen.count as f64 >= self.options.min_duty * life.count as f64;
            track.observations.len() >= least && (dense || is_coherent(&track.observations))
        });
        let smooth = |track: &RawTrack| {
            let mut options = self.options.clone();
            if let Some(dims_m) = track.dims_m() {
                options.half_wheelbase_m = HALF_WHEELBASE * dims_m.x;
            }
            smooth_track(&track.observations, &self.stamps, &self.times_s, &options)
        };
        let mut tracks: Vec<Track> = merge_smoothed(raw, smooth)
            .into_iter()
            .map(|(track, states)| {
                let (shape, shape_information) = track.shape.fused();
                Track {
                    id: 0,
                    class: track.class(),
                    dims_m: track.dims_m(),
                    states,
                    shape,
                    shape_information,
                }
            })
            .collect();
        let key = |track: &Track| track.states.first().map(|s| (s.stamp.index, s.pose.x_m, s.pose.y_m));
        tracks.sort_by(|a, b| match (key(a), key(b)) {
            (Some(a), Some(b)) => a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)),
            (a, b) => a.is_some().cmp(&b.is_some()),
        });
        for (id, track) in (1..).zip(&mut tracks) {
            track.id = id;
        }
        tracks
    }

    fn observation(&self, car: &CarMeasurement, frame: usize, time_s: f64) -> Sighting {
        let floor = Vector3::new(
            self.options.min_position_sd_m,
            self.options.min_position_sd_m,
            self.options.min_heading_sd_rad,
        );
        let covariance = car.covariance + Matrix3::from_diagonal(&floor.component_mul(&floor));
        Sighting {
            frame,
            time_s,
            pose: car.pose_vector(),
            covariance: (covariance + covariance.transpose()) / 2.0,
            bbox_px: car.bbox_px,
            score: car.score,
            car: car.car,
            held: false,
            from_box: car.from_box,
            at_edge: car.at_edge,
            hidden: car.hidden,
        }
    }

    /// Ends tracks that were not seen for too long. New ones get little time.
    fn bury(&mut self, looks: usize, time_s: f64) {
        let options = &self.options;
        let (dead, live) = std::mem::take(&mut self.live).into_iter().partition(|live: &Live| {
            let hits = live.raw.observations.len();
            if hits < options.confirm_hits {
                return looks + 1 - live.born >= options.confirm_frames
                    || live.missed + options.confirm_hits > options.confirm_frames;
            }
            // Whoever stood for a while goes on standing for about as long.
            let parked_s = options.max_parked_coast_s.min(STANDS_ON * live.filter.stood_s());
            let coast_s = if live.filter.is_still() { parked_s } else { 0.0 }.max(options.max_coast_s);
            // Looks may be rare: it may be missed in one of them.
            live.missed > 1 && live.last().is_none_or(|last| time_s - last.time_s > coast_s)
        });
        self.live = live;
        // What was never confirmed is forgotten, unless the clip itself is that short.
        let confirmed = |live: &Live| live.raw.observations.len() >= options.confirm_hits;
        self.ended.extend(Vec::into_iter(dead).filter(confirmed).map(|live| live.raw));
    }
}

/// Whether the box is mostly where it was at the sighting before, as of a parked car that is often hidden; false alarms
/// strung together jump.
fn is_coherent(sightings: &[Sighting]) -> bool {
    let stays =
        sightings.windows(2).filter(|pair| bbox_iou(&pair[0].bbox_px, &pair[1].bbox_px) > 0.3).count();
    2 * stays + 1 > sightings.len()
}
