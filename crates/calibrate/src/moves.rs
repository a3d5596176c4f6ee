//! Detects camera moves from boxes alone.
//!
//! After a move all parked cars jump at once, by one similarity of the picture. To first order, this is the effect of a
//! turn or a zoom on distant cars.

use nalgebra::Vector2;
use roadplane_base::{FrameRecord, Similarity, bbox_centre, median};

/// How an interval with one camera position began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SegmentStart {
    /// It began with the clip's first frame.
    Clip,
    /// The camera turned or zoomed; the picture was scaled by e^`log_scale`.
    Moved {
        /// Log of the picture's growth.
        log_scale: f64,
    },
    /// The picture changed completely; nothing of the previous camera holds.
    Cut,
    /// The camera is the same, and its cars are on the second plane of a folded ground ([`Fold`](crate::Fold)).
    SecondPlane,
}

/// The verdict of one frame on the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MoveState {
    /// There are too few parked cars for a verdict.
    Unknown,
    /// Parked cars are in their old positions, up to a common shift.
    Steady {
        /// Median shift since the interval began, px.
        shift_px: Vector2<f64>,
    },
    /// Parked cars are not in their old positions in this frame. It may be a shake or a bad frame.
    Suspect,
    /// The change lasts: a new interval began with the first of the suspect frames.
    Moved(SegmentStart),
}

/// Least number of parked cars for a verdict.
const MIN_CARS: usize = 3;
/// Least common shift of a move, px.
const MIN_SHIFT_PX: f64 = 3.0;
/// Least common shift of a move, as a share of the boxes' diagonal.
const MIN_SHIFT: f64 = 0.04;
/// Least number of frames that a move must last.
const CONFIRM_FRAMES: usize = 4;
/// Least time that a move must last, s.
const CONFIRM_S: f64 = 0.3;
/// Largest distance of a box's centre from a reference that it matches, as a share of the reference's diagonal.
const NEAR: f64 = 0.25;
/// Largest difference of log size between a box and a reference that it matches.
const SAME_SIZE: f64 = 0.35;
/// Least number of frames in which a box must be in place to be a parked car.
const PROVEN_FRAMES: usize = 5;
/// Least time for which a box must be in place to be a parked car, s.
const PROVEN_S: f64 = 0.5;
/// Number of frames over which a reference's position is averaged. It is fixed afterwards, so that slow drift is
/// detected.
const AVERAGED_FRAMES: f64 = 30.0;
/// References without a detection for longer than this are removed, s.
const FORGOTTEN_S: f64 = 10.0;

/// The position of a box that may be a parked car.
#[derive(Clone, Debug)]
struct Reference {
    /// Mean centre of the box, px.
    centre_px: Vector2<f64>,
    /// Mean diagonal of the box, px.
    diagonal_px: f64,
    /// Time of the first detection, s.
    first_s: f64,
    /// Time of the last detection, s.
    last_s: f64,
    /// Number of detections.
    seen: usize,
}

impl Reference {
    /// Returns whether the reference is a parked car.
    fn is_proven(&self) -> bool {
        self.seen >= PROVEN_FRAMES && self.last_s - self.first_s >= PROVEN_S
    }
}

/// A box reduced to its centre and its diagonal, px.
type Spot = (Vector2<f64>, f64);

/// Monitors the parked cars, frame by frame.
#[derive(Clone, Debug, Default)]
pub struct MoveDetector {
    /// Boxes of earlier frames that may be parked cars.
    references: Vec<Reference>,
    /// Number of suspect frames since the suspicion began; 0 without a suspicion.
    suspect_frames: usize,
    /// Time when the suspicion began, s.
    suspect_since_s: f64,
}

impl MoveDetector {
    /// Takes the next frame, in the order of time, and returns its verdict.
    pub fn push(&mut self, frame: &FrameRecord) -> MoveState {
        let mut spots: Vec<Spot> = frame
            .cars
            .iter()
            .map(|car| {
                let [x0, y0, x1, y1] = car.bbox_px;
                (bbox_centre(&car.bbox_px), (x1 - x0).hypot(y1 - y0).max(1e-3))
            })
            .collect();
        spots.sort_by(|a, b| a.0.x.total_cmp(&b.0.x).then(a.0.y.total_cmp(&b.0.y)).then(a.1.total_cmp(&b.1)));
        let state = self.verdict(&spots);
        match state {
            MoveState::Moved(_) => self.confirmed(state, &spots, frame.time_s),
            MoveState::Steady { .. } => {
                self.suspect_frames = 0;
                self.learn(&spots, frame.time_s);
                state
            }
            // A frame without a verdict does not end a suspicion.
            MoveState::Unknown | MoveState::Suspect if self.suspect_frames > 0 => MoveState::Suspect,
            MoveState::Unknown | MoveState::Suspect => {
                self.learn(&spots, frame.time_s);
                state
            }
        }
    }

    /// Returns `state` once it has lasted; until then [`MoveState::Suspect`].
    fn confirmed(&mut self, state: MoveState, spots: &[Spot], time_s: f64) -> MoveState {
        if self.suspect_frames == 0 {
            self.suspect_since_s = time_s;
        }
        self.suspect_frames += 1;
        if self.suspect_frames < CONFIRM_FRAMES || time_s - self.suspect_since_s < CONFIRM_S {
            return MoveState::Suspect;
        }
        self.suspect_frames = 0;
        self.references.clear();
        self.learn(spots, time_s);
        state
    }

    /// Returns the verdict of this frame alone.
    fn verdict(&self, spots: &[Spot]) -> MoveState {
        let proven: Vec<&Reference> = self.references.iter().filter(|r| r.is_proven()).collect();
        if proven.len() < MIN_CARS || spots.is_empty() {
            return MoveState::Unknown;
        }
        let unmoved = Similarity::carrying(&Vector2::zeros(), &Vector2::zeros(), 1.0);
        let stayed = matches(&proven, spots, &unmoved, NEAR);
        if 2 * stayed.len() >= proven.len() && stayed.len() >= MIN_CARS {
            return self.small_shift(&stayed, &proven);
        }
        // Each pair of a reference and a box proposes a similarity; the box may have any size.
        let proposals = proven.iter().flat_map(|r| {
            spots.iter().map(move |(centre, diagonal)| {
                Similarity::carrying(&r.centre_px, centre, (diagonal / r.diagonal_px).clamp(0.3, 3.0))
            })
        });
        let mut best: Vec<(Vector2<f64>, Vector2<f64>)> = Vec::new();
        for proposal in proposals {
            let coarse = matches(&proven, spots, &proposal, 2.0 * NEAR);
            if coarse.len() < MIN_CARS {
                continue;
            }
            let refined = Similarity::fit(&coarse).map(|fit| matches(&proven, spots, &fit, 0.5 * NEAR));
            if let Some(fine) = refined.filter(|fine| fine.len() > best.len()) {
                best = fine;
            }
        }
        if best.len() >= MIN_CARS && 2 * best.len() >= proven.len() && best.len() > stayed.len() + 1 {
            let log_scale = Similarity::fit(&best).map_or(0.0, |fit| fit.log_scale());
            return MoveState::Moved(SegmentStart::Moved { log_scale });
        }
        if 3 * stayed.len() < proven.len() && 2 * spots.len() >= proven.len() {
            return MoveState::Moved(SegmentStart::Cut);
        }
        MoveState::Unknown
    }

    /// Returns the verdict where the parked cars still match: a move if they agree on a shift larger than jitter.
    fn small_shift(&self, stayed: &[(Vector2<f64>, Vector2<f64>)], proven: &[&Reference]) -> MoveState {
        let axis =
            |axis: usize| median(&mut stayed.iter().map(|(a, b)| b[axis] - a[axis]).collect::<Vec<_>>());
        let shift_px = Vector2::new(axis(0).unwrap_or(0.0), axis(1).unwrap_or(0.0));
        let diagonal = median(&mut proven.iter().map(|r| r.diagonal_px).collect::<Vec<_>>()).unwrap_or(0.0);
        let Some(fit) = Similarity::fit(stayed) else { return MoveState::Unknown };
        // A zoom or roll about the picture's centre gives a small median shift, but large single shifts.
        let mut lengths: Vec<f64> = stayed.iter().map(|(a, _)| (fit.apply(a) - a).norm()).collect();
        let typical = median(&mut lengths).unwrap_or(0.0);
        let explained = stayed.iter().filter(|(a, b)| (fit.apply(a) - b).norm() < 0.5 * typical).count();
        let needed = MIN_SHIFT_PX.max(MIN_SHIFT * diagonal);
        if typical > needed && 4 * explained >= 3 * stayed.len() {
            return MoveState::Moved(SegmentStart::Moved { log_scale: fit.log_scale() });
        }
        MoveState::Steady { shift_px }
    }

    /// Updates the references with the boxes of a frame.
    fn learn(&mut self, spots: &[Spot], time_s: f64) {
        self.references.retain(|r| time_s - r.last_s <= FORGOTTEN_S);
        let mut taken = vec![false; spots.len()];
        for reference in &mut self.references {
            let Some(index) = nearest(reference, &reference.centre_px, 1.0, NEAR, spots) else { continue };
            taken[index] = true;
            let share = 1.0 / (reference.seen as f64 + 1.0);
            if reference.seen as f64 <= AVERAGED_FRAMES {
                reference.centre_px += share * (spots[index].0 - reference.centre_px);
                reference.diagonal_px += share * (spots[index].1 - reference.diagonal_px);
            }
            reference.seen += 1;
            reference.last_s = time_s;
        }
        for ((centre_px, diagonal_px), _) in spots.iter().zip(&taken).filter(|(_, taken)| !**taken) {
            self.references.push(Reference {
                centre_px: *centre_px,
                diagonal_px: *diagonal_px,
                first_s: time_s,
                last_s: time_s,
                seen: 1,
            });
        }
    }
}

/// Returns the index of the box nearest to the expected position of `reference`; `None` if there is none.
fn nearest(
    reference: &Reference,
    expected_px: &Vector2<f64>,
    scale: f64,
    near: f64,
    spots: &[Spot],
) -> Option<usize> {
    let diagonal = reference.diagonal_px * scale;
    let away = |spot: &Spot| (spot.0 - expected_px).norm();
    let fits = |spot: &Spot| away(spot) < near * diagonal && (spot.1 / diagonal).ln().abs() < SAME_SIZE;
    let fitting = spots.iter().enumerate().filter(|(_, spot)| fits(spot));
    fitting.min_by(|a, b| away(a.1).total_cmp(&away(b.1))).map(|(i, _)| i)
}

/// Returns the pairs of (reference, box) centres that a similarity brings together, px.
fn matches(
    proven: &[&Reference],
    spots: &[Spot],
    similarity: &Similarity,
    near: f64,
) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let scale = similarity.log_scale().exp();
    proven
        .iter()
        .filter_map(|r| {
            let index = nearest(r, &similarity.apply(&r.centre_px), scale, near, spots)?;
            Some((r.centre_px, spots[index].0))
        })
        .collect()
}
