//! Selects the views that go into a window's joint solve.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{CarRecord, FrameRecord, KeypointSet, VehicleClass, bbox_cut, bbox_iou};

use crate::{
    LinkId,
    fuse::VIEW_CORRELATION,
    stretch::{Look, Stretch},
};

/// One view of one car, as the joint solve reads it. Views with the same `link` share one shape.
#[derive(Clone, Debug)]
pub struct View {
    /// Identifier of the car.
    pub link: LinkId,
    /// Keypoints, px; combined over `frames` where the car was stationary.
    pub keypoints: Box<KeypointSet>,
    /// Box of the car in one frame of the view, px.
    pub bbox_px: [f64; 4],
    /// The picture of that frame as a box, px.
    pub picture_px: [f64; 4],
    /// Weight of the view's evidence, 0–1. It is below 1 where the car gives several views, which share a part of their
    /// bias.
    pub weight: f64,
    /// Whether the car was stationary.
    pub parked: bool,
}

/// Least overlap (intersection over union) of two boxes of the same vehicle; it may have left its bay and returned.
pub(crate) const SAME_BAY: f64 = 0.6;
/// Largest number of views in a window.
const MAX_VIEWS: usize = 400;
/// Beyond this number of views, only views of certain cars are taken: those found in many frames.
const ENOUGH_VIEWS: usize = 60;
/// Largest number of views of one car in a window.
const MAX_VIEWS_PER_CAR: usize = 6;
/// Least length of the box's longer side, px.
const MIN_SIDE_PX: f64 = 30.0;
/// Least sum of the keypoints' scores, and least number of keypoints that two vehicles are compared by.
pub(crate) const MIN_KEYPOINTS: f64 = 6.0;
/// Least number of frames of a certain car. Views of other cars come last, and only until there are enough views.
const SURELY_A_CAR: usize = 10;

/// A view that may be selected.
struct Candidate {
    /// Identifier of the car.
    link: LinkId,
    /// The observation; its keypoints are combined over many frames where the car was stationary.
    look: Look,
    /// Whether the car was stationary.
    parked: bool,
}

impl Candidate {
    /// Whether two views show the same place.
    fn is_in_place_of(&self, other: &Self) -> bool {
        bbox_iou(&self.look.bbox_px, &other.look.bbox_px) >= SAME_BAY
    }
}

/// Collects the views of a window.
pub struct ViewSelector {
    /// Largest number of views in a window.
    max_views: usize,
    /// Number of views beyond which only views of certain cars are taken.
    enough_views: usize,
    /// Views that are not complete yet, by car.
    open: BTreeMap<LinkId, Stretch>,
    /// Complete views of the current window.
    candidates: Vec<Candidate>,
    /// Cars that left the place of an earlier view in this window.
    moved: BTreeSet<LinkId>,
    /// Number of frames of this window in which each car was found or carried over.
    seen: BTreeMap<LinkId, usize>,
}

impl Default for ViewSelector {
    fn default() -> Self {
        Self::new(MAX_VIEWS, ENOUGH_VIEWS)
    }
}

impl ViewSelector {
    /// Creates a selector of at most `max_views` views. Beyond `enough_views`, it takes only cars found in many frames.
    #[must_use]
    pub fn new(max_views: usize, enough_views: usize) -> Self {
        Self {
            max_views,
            enough_views,
            open: BTreeMap::new(),
            candidates: Vec::new(),
            moved: BTreeSet::new(),
            seen: BTreeMap::new(),
        }
    }

    /// Takes the next frame with the identifiers of its cars (see [`Linker`](crate::Linker)).
    pub fn push(&mut self, frame: &FrameRecord, links: &[LinkId]) {
        for (car, &link) in frame.cars.iter().zip(links) {
            *self.seen.entry(link).or_default() += 1;
            let Some(look) = self.look(frame, car) else { continue };
            match self.open.get_mut(&link) {
                Some(stretch) if !stretch.is_left_by(car) => stretch.push(look),
                _ => {
                    if let Some(left) = self.open.insert(link, Stretch::new(look)) {
                        self.close(link, &left);
                        self.moved.insert(link);
                    }
                }
            }
        }
        // Only the best candidates can be chosen, so the others are dropped.
        if self.candidates.len() > 4 * self.max_views {
            let kept = 2 * self.max_views;
            self.candidates = self.best(kept, kept);
        }
    }

    /// Ends the window and returns its views, best first. The next frame starts a new window.
    pub fn take(&mut self) -> Vec<View> {
        for (link, stretch) in std::mem::take(&mut self.open) {
            self.close(link, &stretch);
        }
        let chosen = self.best(self.max_views, self.enough_views);
        self.candidates.clear();
        self.moved.clear();
        self.seen.clear();
        let mut of_link: BTreeMap<LinkId, f64> = BTreeMap::new();
        for candidate in &chosen {
            *of_link.entry(candidate.link).or_default() += 1.0;
        }
        let weight = |link: LinkId| {
            let views = of_link.get(&link).copied().unwrap_or(1.0);
            1.0 / (1.0 + (views - 1.0) * VIEW_CORRELATION)
        };
        chosen
            .into_iter()
            .map(|Candidate { link, look, parked }| View {
                link,
                keypoints: look.keypoints,
                bbox_px: look.bbox_px,
                picture_px: look.picture_px,
                weight: weight(link),
                parked,
            })
            .collect()
    }

    /// Returns the observation of a car in a frame; `None` where it does not meet the requirements.
    fn look(&self, frame: &FrameRecord, car: &CarRecord) -> Option<Look> {
        let keypoints = car.keypoints.as_ref()?;
        let seen: f64 = keypoints.iter().flatten().map(|point| point.score).sum();
        if car.class != VehicleClass::Car || car.longer_side_px() < MIN_SIDE_PX || seen < MIN_KEYPOINTS {
            return None;
        }
        // A part of the car may lie outside the picture.
        let whole = if bbox_cut(&car.bbox_px, &frame.picture_px()) == [false; 4] { 1.0 } else { 0.4 };
        Some(Look {
            frame: frame.frame,
            bbox_px: car.bbox_px,
            picture_px: frame.picture_px(),
            quality: car.score * seen * car.longer_side_px() * whole,
            keypoints: keypoints.clone(),
        })
    }

    /// Completes a view and adds it to the candidates.
    fn close(&mut self, link: LinkId, stretch: &Stretch) {
        let Some((look, parked)) = stretch.view() else { return };
        self.candidates.push(Candidate { link, look, parked });
    }

    /// Returns the `count` best candidates, chosen one after another.
    ///
    /// Each chosen view lowers the value of others of its car. Cars that are not certain come after all others, and
    /// only while fewer than `enough` views are chosen.
    fn best(&mut self, count: usize, enough: usize) -> Vec<Candidate> {
        let mut left = std::mem::take(&mut self.candidates);
        left.sort_by_key(|c| (c.link, c.look.frame));
        let mut chosen: Vec<Candidate> = Vec::new();
        let mut of_car: BTreeMap<LinkId, usize> = BTreeMap::new();
        while chosen.len() < count {
            let worth = |c: &Candidate| {
                let same_car = of_car.get(&c.link).copied().unwrap_or(0);
                let seen = self.seen[&c.link].min(SURELY_A_CAR);
                let sure = seen == SURELY_A_CAR;
                let allowed = same_car < MAX_VIEWS_PER_CAR && (sure || chosen.len() < enough);
                allowed.then(|| (sure, seen as f64 * c.look.quality / (1 + same_car) as f64))
            };
            let ranked = left.iter().enumerate().filter_map(|(i, c)| Some((i, worth(c)?)));
            // Of equal candidates the first by car and frame is chosen.
            let Some((index, _)) = ranked.reduce(|best, next| if next.1 > best.1 { next } else { best })
            else {
                break;
            };
            let candidate = left.remove(index);
            // A stationary car that is found only in some pictures gets new identifiers. It counts once.
            let stays = |c: &Candidate| !self.moved.contains(&c.link);
            left.retain(|other| !(stays(&candidate) && stays(other) && candidate.is_in_place_of(other)));
            *of_car.entry(candidate.link).or_default() += 1;
            chosen.push(candidate);
        }
        chosen
    }
}
