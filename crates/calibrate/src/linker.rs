//! Assigns the boxes of a frame to the cars of earlier frames, by association in the picture, frame by frame.

use nalgebra::Vector2;
use roadplane_base::{CarRecord, FrameRecord, VehicleClass, assign, bbox_centre, bbox_iou, bbox_moved};

/// Provisional identifier of a car, unique within a [`Linker`]; not the number of a track.
pub type LinkId = u64;

/// A short time, s. A moving car that is missing for longer gets a new identifier. A box that stays in place for as long
/// is stationary.
const SHORT_S: f64 = 1.0;
/// A stationary car that is missing for longer gets a new identifier, s.
const MAX_PARKED_GAP_S: f64 = 30.0;
/// Sd of a box's centre around its prediction, as a share of its size (diagonal or longer side). A box that stays within
/// one sd may be stationary.
pub(crate) const CENTRE_SD: f64 = 0.06;
/// Growth of the centre's sd for a moving box, diagonals per s.
const DRIFT: f64 = 2.5;
/// Growth of the centre's sd for a stationary box, diagonals per s.
const STILL_DRIFT: f64 = 0.12;
/// Sd of the log of a box's width and height.
const LOG_SIZE_SD: f64 = 0.2;
/// Squared normalised distance beyond which two boxes are different cars: 4 sds, squared.
const GATE: f64 = 16.0;

/// A car and its last detection.
#[derive(Clone, Debug)]
struct Link {
    id: LinkId,
    /// Last box: left, top, right, bottom, px.
    bbox_px: [f64; 4],
    class: VehicleClass,
    /// Smoothed velocity of the box's centre, px/s.
    velocity_px_s: Vector2<f64>,
    seen: usize,
    seen_s: f64,
    /// Centre of the box when it last moved, px.
    anchor_px: Vector2<f64>,
    /// Time when the box last moved, s.
    anchor_s: f64,
}

impl Link {
    /// Returns whether the car is stationary.
    fn is_still(&self) -> bool {
        self.seen_s - self.anchor_s >= SHORT_S
    }

    /// Returns the predicted box at a time, px.
    fn predicted(&self, time_s: f64) -> [f64; 4] {
        if self.is_still() {
            return self.bbox_px;
        }
        bbox_moved(&self.bbox_px, &(self.velocity_px_s * (time_s - self.seen_s)))
    }
}

/// Assigns every box the identifier of its car.
#[derive(Clone, Debug, Default)]
pub struct Linker {
    links: Vec<Link>,
    next: LinkId,
}

impl Linker {
    /// Returns the identifiers of the next frame's cars, in the frame's order. Frames come in the order of time.
    pub fn push(&mut self, frame: &FrameRecord) -> Vec<LinkId> {
        let time_s = frame.time_s;
        self.links.retain(|link| {
            let gap_s = time_s - link.seen_s;
            gap_s <= if link.is_still() { MAX_PARKED_GAP_S } else { SHORT_S }
        });
        // Boxes are sorted, so that their order in the frame does not matter.
        let mut order: Vec<usize> = (0..frame.cars.len()).collect();
        order.sort_by(|&a, &b| {
            let key = |i: usize| frame.cars[i].bbox_px;
            key(a).iter().zip(key(b)).map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne()).unwrap_or(a.cmp(&b))
        });
        let predicted: Vec<[f64; 4]> = self.links.iter().map(|link| link.predicted(time_s)).collect();
        let pairs = assign(self.links.len(), order.len(), 1.0, |l, c| {
            cost(&self.links[l], &predicted[l], time_s, &frame.cars[order[c]])
        });
        let mut names = vec![None; frame.cars.len()];
        for (link, column) in self.links.iter_mut().zip(pairs) {
            let Some(car) = column.map(|c| order[c]) else { continue };
            update(link, &frame.cars[car], time_s);
            names[car] = Some(link.id);
        }
        for i in order.into_iter().filter(|i| names[*i].is_none()).collect::<Vec<_>>() {
            let CarRecord { bbox_px, class, .. } = frame.cars[i];
            names[i] = Some(self.next);
            self.links.push(Link {
                id: self.next,
                bbox_px,
                class,
                velocity_px_s: Vector2::zeros(),
                seen: 1,
                seen_s: time_s,
                anchor_px: bbox_centre(&bbox_px),
                anchor_s: time_s,
            });
            self.next += 1;
        }
        names.into_iter().flatten().collect()
    }

    /// Removes all cars, as after a camera move. Their identifiers are not used again.
    pub fn reset(&mut self) {
        self.links.clear();
    }
}

/// Returns the cost of assigning a box to a car: 0 for a perfect match, 1 at the gate, infinite beyond it.
fn cost(link: &Link, predicted: &[f64; 4], time_s: f64, car: &CarRecord) -> f64 {
    let gap_s = (time_s - link.seen_s).clamp(0.0, 1.0);
    let drift = if link.is_still() { STILL_DRIFT } else { DRIFT };
    let diagonal = (diagonal_px(predicted) * diagonal_px(&car.bbox_px)).sqrt();
    let centre_sd = CENTRE_SD + drift * gap_s;
    let away = (bbox_centre(predicted) - bbox_centre(&car.bbox_px)).norm() / (diagonal * centre_sd).max(1e-9);
    let (w0, h0) = size_px(predicted);
    let (w1, h1) = size_px(&car.bbox_px);
    let grown = ((w1 / w0).ln().powi(2) + (h1 / h0).ln().powi(2)) / LOG_SIZE_SD.powi(2);
    let other_class = if link.class == car.class { 0.0 } else { 2.0 };
    let distance = (away * away + grown + other_class) / GATE;
    // Overlap decides between neighbours that are both within the gate.
    if distance < 1.0 {
        0.7 * distance + 0.3 * (1.0 - bbox_iou(predicted, &car.bbox_px))
    } else {
        f64::INFINITY
    }
}

/// Updates a car with its detection at `time_s`.
fn update(link: &mut Link, car: &CarRecord, time_s: f64) {
    let gap_s = time_s - link.seen_s;
    let centre = bbox_centre(&car.bbox_px);
    if gap_s > 0.0 {
        let velocity = (centre - bbox_centre(&link.bbox_px)) / gap_s;
        // The half-life is about 0.1 s: long enough to smooth a box's jitter, short enough to follow braking.
        let share = if link.seen < 2 { 1.0 } else { 1.0 - (-gap_s / 0.15).exp() };
        link.velocity_px_s += share * (velocity - link.velocity_px_s);
    }
    if (centre - link.anchor_px).norm() > CENTRE_SD * diagonal_px(&car.bbox_px) {
        link.anchor_px = centre;
        link.anchor_s = time_s;
    }
    link.bbox_px = car.bbox_px;
    link.class = car.class;
    link.seen += 1;
    link.seen_s = time_s;
}

/// Returns the width and height of a box, px.
pub(crate) fn size_px([x0, y0, x1, y1]: &[f64; 4]) -> (f64, f64) {
    ((x1 - x0).max(1e-3), (y1 - y0).max(1e-3))
}

/// Returns the diagonal of a box, px.
fn diagonal_px(bbox_px: &[f64; 4]) -> f64 {
    let (w, h) = size_px(bbox_px);
    w.hypot(h)
}
