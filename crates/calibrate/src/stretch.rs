//! What was seen of one car while it stayed about where it was.

use roadplane_base::{CarRecord, KeypointSet, bbox_centre, median};

use crate::combine;

/// One look at the car.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub frame: u64,
    pub bbox_px: [f64; 4],
    pub quality: f64,
    pub keypoints: Box<KeypointSet>,
}

/// Looks of a car whose box stayed near its first one; memory is bounded by thinning them out evenly.
#[derive(Clone, Debug)]
pub(crate) struct Stretch {
    looks: Vec<Look>,
    stride: u64,
    seen: u64,
}

/// The view that a stretch yields.
pub(crate) struct StretchView {
    pub look: Look,
    pub frames: Vec<u64>,
    pub parked: bool,
}

/// Looks that are kept.
const MAX_LOOKS: usize = 64;
/// Looks within this share of the box's longer side from the middle one show a car that stood still.
const STILL: f64 = 0.025;

impl Stretch {
    pub(crate) fn new(look: Look) -> Self {
        Self { looks: vec![look], stride: 1, seen: 1 }
    }

    /// Whether this box shows the car from a place that deserves a view of its own: half a box away, or a box whose shape
    /// changed as it does when the car turns by about 10° or comes nearer.
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

    /// The looks at rest combined, where they are the better part; else the best single look.
    pub(crate) fn view(&self, bias_share: f64) -> Option<StretchView> {
        let axis = |axis: usize| {
            median(&mut self.looks.iter().map(|l| bbox_centre(&l.bbox_px)[axis]).collect::<Vec<_>>())
        };
        let middle = nalgebra::Vector2::new(axis(0)?, axis(1)?);
        let away = |look: &Look| (bbox_centre(&look.bbox_px) - middle).norm();
        let [x0, y0, x1, y1] = self.looks.first()?.bbox_px;
        let bound = STILL * (x1 - x0).max(y1 - y0) + 1.0;
        let still: Vec<&Look> = self.looks.iter().filter(|look| away(look) <= bound).collect();
        let best = |looks: &[&Look]| -> Option<Look> {
            looks
                .iter()
                .max_by(|a, b| a.quality.total_cmp(&b.quality).then(b.frame.cmp(&a.frame)))
                .map(|l| (*l).clone())
        };
        if still.len() < 3 || 2 * still.len() < self.looks.len() {
            let look = best(&self.looks.iter().collect::<Vec<_>>())?;
            return Some(StretchView { frames: vec![look.frame], look, parked: false });
        }
        let sets: Vec<&KeypointSet> = still.iter().map(|look| look.keypoints.as_ref()).collect();
        let combined = combine(&sets, bias_share);
        let look = Look { keypoints: combined.keypoints, ..best(&still)? };
        let frames = still.iter().map(|look| look.frame).collect();
        Some(StretchView { look, frames, parked: true })
    }
}
