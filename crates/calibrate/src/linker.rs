//! Which box of this frame is which car of the frames before: association in the image, streaming.

use nalgebra::Vector2;
use roadplane_base::{CarRecord, FrameRecord, VehicleClass, assign, bbox_centre, bbox_iou, bbox_moved};

/// Provisional name of a car, unique within a [`Linker`]; not the number of a track.
pub type LinkId = u64;

/// How far boxes may move between frames.
#[derive(Clone, Debug)]
pub struct LinkerOptions {
    /// A moving car that is missing for longer gets a new name, s.
    pub max_gap_s: f64,
    /// The same for a car that stood still, s.
    pub max_parked_gap_s: f64,
    /// sd of a box's centre around its prediction, in box diagonals.
    pub centre_sd: f64,
    /// Growth of that sd when the box's velocity is known, diagonals per s.
    pub known_drift: f64,
    /// Growth of that sd for a box seen once or twice, diagonals per s.
    pub unknown_drift: f64,
    /// sd of the log of width and height.
    pub log_size_sd: f64,
}

impl Default for LinkerOptions {
    fn default() -> Self {
        Self {
            max_gap_s: 1.0,
            max_parked_gap_s: 30.0,
            centre_sd: 0.06,
            known_drift: 0.6,
            unknown_drift: 2.5,
            log_size_sd: 0.2,
        }
    }
}

/// Squared normalised distance beyond which two boxes are different cars: 4 sd.
const GATE: f64 = 16.0;
/// A box that stayed within this share of its diagonal …
const STILL: f64 = 0.06;
/// … for this long stands still, s.
const STILL_S: f64 = 1.0;

#[derive(Clone, Debug)]
struct Link {
    id: LinkId,
    bbox_px: [f64; 4],
    class: VehicleClass,
    velocity_px_s: Vector2<f64>,
    seen: usize,
    seen_s: f64,
    anchor_px: Vector2<f64>,
    anchor_s: f64,
}

impl Link {
    fn is_still(&self) -> bool {
        self.seen_s - self.anchor_s >= STILL_S
    }

    fn predicted(&self, time_s: f64) -> [f64; 4] {
        if self.is_still() {
            return self.bbox_px;
        }
        bbox_moved(&self.bbox_px, &(self.velocity_px_s * (time_s - self.seen_s)))
    }
}

/// Gives every box the name of its car.
#[derive(Clone, Debug, Default)]
pub struct Linker {
    options: LinkerOptions,
    links: Vec<Link>,
    next: LinkId,
}

impl Linker {
    /// With these options.
    #[must_use]
    pub fn new(options: LinkerOptions) -> Self {
        Self { options, links: Vec::new(), next: 0 }
    }

    /// Names the cars of the next frame, in the frame's order. Frames come in the order of time.
    pub fn push(&mut self, frame: &FrameRecord) -> Vec<LinkId> {
        let time_s = frame.time_s;
        let LinkerOptions { max_gap_s, max_parked_gap_s, .. } = self.options;
        self.links.retain(|link| {
            let gap_s = time_s - link.seen_s;
            gap_s <= if link.is_still() { max_parked_gap_s } else { max_gap_s }
        });
        // Boxes in an order of their own, so that the frame's order has no say.
        let mut order: Vec<usize> = (0..frame.cars.len()).collect();
        order.sort_by(|&a, &b| {
            let key = |i: usize| frame.cars[i].bbox_px;
            key(a).iter().zip(key(b)).map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne()).unwrap_or(a.cmp(&b))
        });
        let predicted: Vec<[f64; 4]> = self.links.iter().map(|link| link.predicted(time_s)).collect();
        let pairs = assign(self.links.len(), order.len(), 1.0, |l, c| {
            self.cost(&self.links[l], &predicted[l], time_s, &frame.cars[order[c]])
        });
        let mut names = vec![None; frame.cars.len()];
        for (link, column) in self.links.iter_mut().zip(pairs) {
            let Some(car) = column.map(|c| order[c]) else { continue };
            update(link, &frame.cars[car], time_s);
            names[car] = Some(link.id);
        }
        for car in order {
            if names[car].is_none() {
                names[car] = Some(self.start(&frame.cars[car], time_s));
            }
        }
        names.into_iter().flatten().collect()
    }

    /// Forgets all cars, as after a move of the camera; names are not used again.
    pub fn reset(&mut self) {
        self.links.clear();
    }

    fn start(&mut self, car: &CarRecord, time_s: f64) -> LinkId {
        let id = self.next;
        self.next += 1;
        self.links.push(Link {
            id,
            bbox_px: car.bbox_px,
            class: car.class,
            velocity_px_s: Vector2::zeros(),
            seen: 1,
            seen_s: time_s,
            anchor_px: bbox_centre(&car.bbox_px),
            anchor_s: time_s,
        });
        id
    }

    /// 0 for a perfect match, 1 at the gate.
    fn cost(&self, link: &Link, predicted: &[f64; 4], time_s: f64, car: &CarRecord) -> f64 {
        let options = &self.options;
        let gap_s = (time_s - link.seen_s).clamp(0.0, 1.0);
        let drift = match (link.is_still(), link.seen) {
            (true, _) => 0.2 * options.known_drift,
            (false, 0..=2) => options.unknown_drift,
            (false, _) => options.known_drift,
        };
        let diagonal = (diagonal_px(predicted) * diagonal_px(&car.bbox_px)).sqrt();
        let centre_sd = options.centre_sd + drift * gap_s;
        let away =
            (bbox_centre(predicted) - bbox_centre(&car.bbox_px)).norm() / (diagonal * centre_sd).max(1e-9);
        let (w0, h0) = size_px(predicted);
        let (w1, h1) = size_px(&car.bbox_px);
        let grown = ((w1 / w0).ln().powi(2) + (h1 / h0).ln().powi(2)) / options.log_size_sd.powi(2);
        let other_class = if link.class == car.class { 0.0 } else { 2.0 };
        let distance = (away * away + grown + other_class) / GATE;
        // Overlap decides between neighbours that are both within the gate.
        if distance < 1.0 {
            0.7 * distance + 0.3 * (1.0 - bbox_iou(predicted, &car.bbox_px))
        } else {
            f64::INFINITY
        }
    }
}

fn update(link: &mut Link, car: &CarRecord, time_s: f64) {
    let gap_s = time_s - link.seen_s;
    let centre = bbox_centre(&car.bbox_px);
    if gap_s > 0.0 {
        let velocity = (centre - bbox_centre(&link.bbox_px)) / gap_s;
        // Half-life of about 0.1 s: long enough to calm a box's jitter, short enough to follow braking.
        let share = if link.seen < 2 { 1.0 } else { 1.0 - (-gap_s / 0.15).exp() };
        link.velocity_px_s += share * (velocity - link.velocity_px_s);
    }
    if (centre - link.anchor_px).norm() > STILL * diagonal_px(&car.bbox_px) {
        link.anchor_px = centre;
        link.anchor_s = time_s;
    }
    link.bbox_px = car.bbox_px;
    link.class = car.class;
    link.seen += 1;
    link.seen_s = time_s;
}

fn size_px([x0, y0, x1, y1]: &[f64; 4]) -> (f64, f64) {
    ((x1 - x0).max(1e-3), (y1 - y0).max(1e-3))
}

fn diagonal_px(bbox_px: &[f64; 4]) -> f64 {
    let (w, h) = size_px(bbox_px);
    w.hypot(h)
}
