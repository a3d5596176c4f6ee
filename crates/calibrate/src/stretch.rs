//! Collects the observations of one car while its box stays near one position in the picture.

use roadplane_base::{CarRecord, KeypointSet, bbox_centre, median};

use crate::{combine, linker::CENTRE_SD};

/// One observation of the car.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    /// Index of the frame.
    pub frame: u64,
    /// Box of the car: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// The picture of the frame as a box, px.
    pub picture_px: [f64; 4],
    /// Quality of the observation (px, larger is better): score, keypoints, size and completeness.
    pub quality: f64,
    /// Keypoints of the car, px.
    pub keypoints: Box<KeypointSet>,
}

/// Observations of a car whose box stayed near its first one. Even thinning bounds the memory.
#[derive(Clone, Debug)]
pub(crate) struct Stretch {
    /// The observations that are kept, in the order of time.
    looks: Vec<Look>,
    /// Only every `stride`-th observation is kept.
    stride: u64,
    /// Number of all observations, kept or not.
    seen: u64,
}

/// Largest number of observations that are kept.
const MAX_LOOKS: usize = 64;

impl Stretch {
    /// Starts with one observation.
    pub(crate) fn new(look: Look) -> Self {
        Self { looks: vec![look], stride: 1, seen: 1 }
    }

    /// Returns whether this box needs a view of its own.
    ///
    /// It does if it is half a box away from the first box, or if its shape or size has changed. Such a change happens
    /// when the car turns by about 10° or comes nearer.
    pub(crate) fn is_left_by(&self, car: &CarRecord) -> bool {
        let Some(first) = self.looks.first() else { return true };
        let sides = |[x0, y0, x1, y1]: &[f64; 4]| ((x1 - x0).max(1e-3), (y1 - y0).max(1e-3));
        let (w0, h0) = sides(&first.bbox_px);
        let (w1, h1) = sides(&car.bbox_px);
        let moved = (bbox_centre(&first.bbox_px) - bbox_centre(&car.bbox_px)).norm();
        let turned = ((w1 * h0) / (w0 * h1)).ln().abs();
        let scaled = ((w1 * h1) / (w0 * h0)).ln().abs() / 2.0;
        moved > 0.5 * w0.max(h0) || turned > 0.2 || scaled > 0.25
    }

    /// Adds an observation. When the memory is full, every second observation is dropped.
    pub(crate) fn push(&mut self, look: Look) {
        if self.seen.is_multiple_of(self.stride) {
            if self.looks.len() == MAX_LOOKS {
                let mut keep = false;
                self.looks.retain(|_| {
                    keep = !keep;
                    keep
                });
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.looks.push(look);
            }
        }
        self.seen += 1;
    }

    /// Returns the best observation, and whether the car was stationary. If most observations are stationary, the
    /// keypoints are combined over these.
    pub(crate) fn view(&self) -> Option<(Look, bool)> {
        let axis = |axis: usize| {
            median(&mut self.looks.iter().map(|l| bbox_centre(&l.bbox_px)[axis]).collect::<Vec<_>>())
        };
        let middle = nalgebra::Vector2::new(axis(0)?, axis(1)?);
        let away = |look: &Look| (bbox_centre(&look.bbox_px) - middle).norm();
        let [x0, y0, x1, y1] = self.looks.first()?.bbox_px;
        let bound = CENTRE_SD * (x1 - x0).max(y1 - y0) + 1.0;
        let still: Vec<&Look> = self.looks.iter().filter(|look| away(look) <= bound).collect();
        let best = |looks: &[&Look]| -> Option<Look> {
            looks
                .iter()
                .max_by(|a, b| a.quality.total_cmp(&b.quality).then(b.frame.cmp(&a.frame)))
                .map(|l| (*l).clone())
        };
        if still.len() < 3 || 2 * still.len() < self.looks.len() {
            return Some((best(&self.looks.iter().collect::<Vec<_>>())?, false));
        }
        let sets: Vec<&KeypointSet> = still.iter().map(|look| look.keypoints.as_ref()).collect();
        Some((Look { keypoints: combine(&sets), ..best(&still)? }, true))
    }
}
