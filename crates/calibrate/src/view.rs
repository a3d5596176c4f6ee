//! Collects the observations of one car while its box stays near one position in the picture.

use roadplane_base::{CarRecord, KeypointSet, bbox_centre, bbox_longer_side, median};

use crate::{
    LinkId, combine,
    linker::{CENTRE_SD, size_px},
};

/// One view of one car. Views with the same `link` share one shape. Until the window ends, a view is a single
/// observation with the weight 1.
#[derive(Clone, Debug)]
pub struct View {
    /// Identifier of the car.
    pub link: LinkId,
    /// Keypoints, px; combined over the frames of the view where the car was stationary.
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
    /// Index of that frame.
    pub(crate) frame: u64,
    /// Quality of the view (px, larger is better): score, keypoints, size and completeness.
    pub(crate) quality: f64,
}

/// Observations of a car whose box stayed near its first one. Even thinning bounds the memory.
#[derive(Clone, Debug)]
pub(crate) struct OpenView {
    /// The observations that are kept, in the order of time.
    observations: Vec<View>,
    /// Only every `stride`-th observation is kept.
    stride: u64,
    /// Number of all observations, kept or not.
    seen: u64,
}

/// Largest number of observations that are kept.
const MAX_OBSERVATIONS: usize = 64;

impl OpenView {
    /// Starts with one observation.
    pub(crate) fn new(observation: View) -> Self {
        Self { observations: vec![observation], stride: 1, seen: 1 }
    }

    /// Returns whether this box needs a view of its own.
    ///
    /// It does if it is half a box away from the first box, or if its shape or size has changed. Such a change happens
    /// when the car turns by about 10° or comes nearer.
    pub(crate) fn is_left_by(&self, car: &CarRecord) -> bool {
        let Some(first) = self.observations.first() else { return true };
        let ((w0, h0), (w1, h1)) = (size_px(&first.bbox_px), size_px(&car.bbox_px));
        let moved = (bbox_centre(&first.bbox_px) - bbox_centre(&car.bbox_px)).norm();
        let turned = ((w1 * h0) / (w0 * h1)).ln().abs();
        let scaled = ((w1 * h1) / (w0 * h0)).ln().abs() / 2.0;
        moved > 0.5 * w0.max(h0) || turned > 0.2 || scaled > 0.25
    }

    /// Adds an observation. When the memory is full, every second observation is dropped.
    pub(crate) fn push(&mut self, observation: View) {
        if self.seen.is_multiple_of(self.stride) {
            if self.observations.len() == MAX_OBSERVATIONS {
                let mut keep = false;
                self.observations.retain(|_| {
                    keep = !keep;
                    keep
                });
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.observations.push(observation);
            }
        }
        self.seen += 1;
    }

    /// Returns the best observation. If most observations are stationary, the keypoints are combined over these.
    pub(crate) fn view(&self) -> Option<View> {
        let median_on = |axis: usize| {
            median(
                &mut self.observations.iter().map(|one| bbox_centre(&one.bbox_px)[axis]).collect::<Vec<_>>(),
            )
        };
        let middle = nalgebra::Vector2::new(median_on(0)?, median_on(1)?);
        let away = |one: &View| (bbox_centre(&one.bbox_px) - middle).norm();
        let bound = CENTRE_SD * bbox_longer_side(&self.observations.first()?.bbox_px) + 1.0;
        let still: Vec<&View> = self.observations.iter().filter(|one| away(one) <= bound).collect();
        let by_quality = |a: &&View, b: &&View| a.quality.total_cmp(&b.quality).then(b.frame.cmp(&a.frame));
        if still.len() < 3 || 2 * still.len() < self.observations.len() {
            return self.observations.iter().max_by(by_quality).cloned();
        }
        let sets: Vec<&KeypointSet> = still.iter().map(|one| one.keypoints.as_ref()).collect();
        let best = still.into_iter().max_by(by_quality)?.clone();
        Some(View { keypoints: combine(&sets), parked: true, ..best })
    }
}
