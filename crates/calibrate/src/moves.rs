//! Was the camera moved? Seen from boxes alone: all parked cars jump at once, by one similarity of the image (to first order
//! what a turn or zoom does to distant ones).

use nalgebra::Vector2;
use roadplane_base::{FrameRecord, Similarity, bbox_centre, median};

/// How a stretch of time with one camera position began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SegmentStart {
    /// The clip's first frame.
    Clip,
    /// The camera turned; the image was scaled by e^`log_scale`.
    Moved {
        /// Logarithm of the image's growth.
        log_scale: f64,
    },
    /// Another picture altogether: nothing of the camera before holds.
    Cut,
}

/// What one frame says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MoveState {
    /// Too few parked cars to tell.
    Unknown,
    /// Parked cars are where they were, up to this common shift, px.
    Steady {
        /// Median shift since the stretch began.
        shift_px: Vector2<f64>,
    },
    /// They are not, in this frame; it may be a shake or a bad frame.
    Suspect,
    /// It lasts: a new stretch began with the first of the suspect frames.
    Moved(SegmentStart),
}

/// What counts as a move.
#[derive(Clone, Debug)]
pub struct MoveOptions {
    /// Parked cars needed for a verdict.
    pub min_cars: usize,
    /// Least common shift, px.
    pub min_shift_px: f64,
    /// Least common shift, share of the boxes' diagonal.
    pub min_shift: f64,
    /// A move must last so many frames …
    pub confirm_frames: usize,
    /// … and so long, s.
    pub confirm_s: f64,
}

impl Default for MoveOptions {
    fn default() -> Self {
        Self { min_cars: 3, min_shift_px: 3.0, min_shift: 0.04, confirm_frames: 4, confirm_s: 0.3 }
    }
}

/// A box matches a reference within this share of its diagonal …
const NEAR: f64 = 0.25;
/// … and this difference of log size.
const SAME_SIZE: f64 = 0.35;
/// A box that stayed for so many frames and so long (s) belongs to a parked car.
const PROVEN_FRAMES: usize = 5;
const PROVEN_S: f64 = 0.5;
/// Frames over which a reference's place is averaged; fixed from then on, so that slow drift is seen as well.
const AVERAGED_FRAMES: f64 = 30.0;
/// References that were not seen for so long are forgotten, s.
const FORGOTTEN_S: f64 = 10.0;

#[derive(Clone, Debug)]
struct Reference {
    centre_px: Vector2<f64>,
    diagonal_px: f64,
    first_s: f64,
    last_s: f64,
    seen: usize,
}

impl Reference {
    fn is_proven(&self) -> bool {
        self.seen >= PROVEN_FRAMES && self.last_s - self.first_s >= PROVEN_S
    }
}

/// A box reduced to centre and diagonal, px.
type Spot = (Vector2<f64>, f64);

/// Watches the parked cars, streaming.
#[derive(Clone, Debug, Default)]
pub struct MoveDetector {
    options: MoveOptions,
    references: Vec<Reference>,
    suspect_frames: usize,
    suspect_since_s: f64,
}

impl MoveDetector {
    /// With these options.
    #[must_use]
    pub fn new(options: MoveOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// Takes the next frame, in the order of time.
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
            // A frame without an opinion does not clear a suspicion.
            MoveState::Unknown | MoveState::Suspect if self.suspect_frames > 0 => MoveState::Suspect,
            MoveState::Unknown | MoveState::Suspect => {
                self.learn(&spots, frame.time_s);
                state
            }
        }
    }

    /// Turns a frame's opinion into a verdict once it has lasted.
    fn confirmed(&mut self, state: MoveState, spots: &[Spot], time_s: f64) -> MoveState {
        if self.suspect_frames == 0 {
            self.suspect_since_s = time_s;
        }
        self.suspect_frames += 1;
        if self.suspect_frames < self.options.confirm_frames
            || time_s - self.suspect_since_s < self.options.confirm_s
        {
            return MoveState::Suspect;
        }
        self.suspect_frames = 0;
        self.references.clear();
        self.learn(spots, time_s);
        state
    }

    /// This frame's opinion, regardless of others.
    fn verdict(&self, spots: &[Spot]) -> MoveState {
        let proven: Vec<&Reference> = self.references.iter().filter(|r| r.is_proven()).collect();
        let enough = self.options.min_cars.max(1);
        if proven.len() < enough || spots.is_empty() {
            return MoveState::Unknown;
        }
        let unmoved = Similarity::carrying(&Vector2::zeros(), &Vector2::zeros(), 1.0);
        let stayed = matches(&proven, spots, &unmoved, NEAR);
        if 2 * stayed.len() >= proven.len() && stayed.len() >= enough {
            return self.small_shift(&stayed, &proven);
        }
        // Every pairing of a reference with a box of any size proposes a similarity.
        let proposals = proven.iter().flat_map(|r| {
            spots.iter().map(move |(centre, diagonal)| {
                Similarity::carrying(&r.centre_px, centre, (diagonal / r.diagonal_px).clamp(0.3, 3.0))
            })
        });
        let mut best: Vec<(Vector2<f64>, Vector2<f64>)> = Vec::new();
        for proposal in proposals {
            let coarse = matches(&proven, spots, &proposal, 2.0 * NEAR);
            if coarse.len() < enough {
                continue;
            }
            let refined = Similarity::fit(&coarse).map(|fit| matches(&proven, spots, &fit, 0.5 * NEAR));
            if let Some(fine) = refined.filter(|fine| fine.len() > best.len()) {
                best = fine;
            }
        }
        if best.len() >= enough && 2 * best.len() >= proven.len() && best.len() > stayed.len() + 1 {
            let log_scale = Similarity::fit(&best).map_or(0.0, |fit| fit.log_scale());
            return MoveState::Moved(SegmentStart::Moved { log_scale });
        }
        if 3 * stayed.len() < proven.len() && 2 * spots.len() >= proven.len() {
            return MoveState::Moved(SegmentStart::Cut);
        }
        MoveState::Unknown
    }

    /// All parked cars still match: do they agree on a shift that is more than jitter?
    fn small_shift(&self, stayed: &[(Vector2<f64>, Vector2<f64>)], proven: &[&Reference]) -> MoveState {
        let axis =
            |axis: usize| median(&mut stayed.iter().map(|(a, b)| b[axis] - a[axis]).collect::<Vec<_>>());
        let shift_px = Vector2::new(axis(0).unwrap_or(0.0), axis(1).unwrap_or(0.0));
        let diagonal = median(&mut proven.iter().map(|r| r.diagonal_px).collect::<Vec<_>>()).unwrap_or(0.0);
        let Some(fit) = Similarity::fit(stayed) else { return MoveState::Unknown };
        // A zoom or roll about the middle leaves the median shift small but not the single ones.
        let mut lengths: Vec<f64> = stayed.iter().map(|(a, _)| (fit.apply(a) - a).norm()).collect();
        let typical = median(&mut lengths).unwrap_or(0.0);
        let explained = stayed.iter().filter(|(a, b)| (fit.apply(a) - b).norm() < 0.5 * typical).count();
        let needed = self.options.min_shift_px.max(self.options.min_shift * diagonal);
        if typical > needed && 4 * explained >= 3 * stayed.len() {
            return MoveState::Moved(SegmentStart::Moved { log_scale: fit.log_scale() });
        }
        MoveState::Steady { shift_px }
    }

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

/// Index of the box where `reference` should be, if there is one.
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

/// (reference, box) centres that a similarity brings together.
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
