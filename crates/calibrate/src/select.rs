//! Selects the views that go into a window's joint solve.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{CarRecord, FrameRecord, VehicleClass, bbox_cut, bbox_iou};

use crate::{
    LinkId,
    fuse::VIEW_CORRELATION,
    view::{OpenView, View},
};

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

/// Collects the views of a window.
pub struct ViewSelector {
    /// Largest number of views in a window.
    pub max_views: usize,
    /// Number of views beyond which only views of certain cars are taken: those found in many frames.
    pub enough_views: usize,
    /// Views that are not complete yet, by car.
    open: BTreeMap<LinkId, OpenView>,
    /// Complete views of the current window.
    candidates: Vec<View>,
    /// Cars that left the place of an earlier view in this window.
    moved: BTreeSet<LinkId>,
    /// Number of frames of this window in which each car was found or carried over.
    seen: BTreeMap<LinkId, usize>,
}

impl Default for ViewSelector {
    fn default() -> Self {
        let (open, candidates, moved, seen) = Default::default();
        Self { max_views: MAX_VIEWS, enough_views: ENOUGH_VIEWS, open, candidates, moved, seen }
    }
}

impl ViewSelector {
    /// Takes the next frame with the identifiers of its cars (see [`Linker`](crate::Linker)).
    pub fn push(&mut self, frame: &FrameRecord, links: &[LinkId]) {
        for (car, &link) in frame.cars.iter().zip(links) {
            *self.seen.entry(link).or_default() += 1;
            let Some(observation) = observation_of(frame, car, link) else { continue };
            match self.open.get_mut(&link) {
                Some(open) if !open.is_left_by(car) => open.push(observation),
                _ => {
                    if let Some(left) = self.open.insert(link, OpenView::new(observation)) {
                        self.candidates.extend(left.view());
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
        self.candidates.extend(std::mem::take(&mut self.open).values().filter_map(OpenView::view));
        let mut chosen = self.best(self.max_views, self.enough_views);
        self.candidates.clear();
        self.moved.clear();
        self.seen.clear();
        let mut of_link: BTreeMap<LinkId, f64> = BTreeMap::new();
        for candidate in &chosen {
            *of_link.entry(candidate.link).or_default() += 1.0;
        }
        for view in &mut chosen {
            view.weight = 1.0 / (1.0 + (of_link[&view.link] - 1.0) * VIEW_CORRELATION);
        }
        chosen
    }

    /// Returns the `count` best candidates, chosen one after another.
    ///
    /// Each chosen view lowers the value of others of its car. Cars that are not certain come after all others, and
    /// only while fewer than `enough` views are chosen.
    fn best(&mut self, count: usize, enough: usize) -> Vec<View> {
        let mut left = std::mem::take(&mut self.candidates);
        left.sort_by_key(|c| (c.link, c.frame));
        let mut chosen: Vec<View> = Vec::new();
        let mut of_car: BTreeMap<LinkId, usize> = BTreeMap::new();
        while chosen.len() < count {
            let worth = |c: &View| {
                let same_car = of_car.get(&c.link).copied().unwrap_or(0);
                let seen = self.seen[&c.link].min(SURELY_A_CAR);
                let sure = seen == SURELY_A_CAR;
                let allowed = same_car < MAX_VIEWS_PER_CAR && (sure || chosen.len() < enough);
                allowed.then(|| (sure, seen as f64 * c.quality / (1 + same_car) as f64))
            };
            let ranked = left.iter().enumerate().filter_map(|(i, c)| Some((i, worth(c)?)));
            // Of equal candidates the first by car and frame is chosen.
            let Some((index, _)) = ranked.reduce(|best, next| if next.1 > best.1 { next } else { best })
            else {
                break;
            };
            let candidate = left.remove(index);
            // A stationary car that is found only in some pictures gets new identifiers. It counts once.
            let stays = |c: &View| !self.moved.contains(&c.link);
            let is_there = |c: &View| bbox_iou(&candidate.bbox_px, &c.bbox_px) >= SAME_BAY;
            left.retain(|other| !(stays(&candidate) && stays(other) && is_there(other)));
            *of_car.entry(candidate.link).or_default() += 1;
            chosen.push(candidate);
        }
        chosen
    }
}

/// Returns the observation of a car in a frame; `None` where it does not meet the requirements.
fn observation_of(frame: &FrameRecord, car: &CarRecord, link: LinkId) -> Option<View> {
    let keypoints = car.keypoints.as_ref()?;
    let scores: f64 = keypoints.iter().flatten().map(|point| point.score).sum();
    if car.class != VehicleClass::Car || car.longer_side_px() < MIN_SIDE_PX || scores < MIN_KEYPOINTS {
        return None;
    }
    // A part of the car may lie outside the picture.
    let whole = if bbox_cut(&car.bbox_px, &frame.picture_px()) == [false; 4] { 1.0 } else { 0.4 };
    Some(View {
        link,
        frame: frame.frame,
        weight: 1.0,
        parked: false,
        bbox_px: car.bbox_px,
        picture_px: frame.picture_px(),
        quality: car.score * scores * car.longer_side_px() * whole,
        keypoints: keypoints.clone(),
    })
}
