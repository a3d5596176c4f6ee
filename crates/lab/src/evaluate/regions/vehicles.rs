//! Vehicles that a run without region-of-interest scheduling finds, and the times for which a run with scheduling
//! misses them.

use std::collections::BTreeMap;

use roadplane_base::{CarRecord, FrameRecord, bbox_iou};

/// Least width of a vehicle's box, px. Narrower boxes are left out.
pub(super) const MIN_WIDTH_PX: f64 = 40.0;
/// Intersection over union above which two boxes belong to one vehicle.
const SAME: f64 = 0.3;
/// Time without a box after which a vehicle counts as gone, s. A vehicle must also be visible for longer than this
/// time.
pub(super) const GAP_S: f64 = 0.3;

/// A detection of a vehicle in a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Detection {
    frame: u64,
    time_s: f64,
    bbox_px: [f64; 4],
    score: f64,
}

/// The detections of a vehicle, in order of time.
pub(super) type Boxes = Vec<Detection>;

/// Links boxes from frame to frame by overlap. Returns the vehicles that are wide enough and visible long enough.
pub(super) fn vehicles(frames: &[FrameRecord]) -> Vec<Boxes> {
    let mut done: Vec<Boxes> = Vec::new();
    let mut open: Vec<Boxes> = Vec::new();
    for frame in frames {
        let is_open = |boxes: &Boxes| boxes.last().is_some_and(|last| frame.time_s - last.time_s <= GAP_S);
        let (kept, left): (Vec<Boxes>, Vec<Boxes>) = open.into_iter().partition(is_open);
        done.extend(left);
        open = kept;
        let mut taken = vec![false; open.len()];
        for car in &frame.cars {
            let overlap =
                |boxes: &Boxes| boxes.last().map_or(0.0, |last| bbox_iou(&last.bbox_px, &car.bbox_px));
            let best = (0..taken.len())
                .filter(|&i| !taken[i] && overlap(&open[i]) >= SAME)
                .max_by(|&a, &b| overlap(&open[a]).total_cmp(&overlap(&open[b])));
            let entry = Detection {
                frame: frame.frame,
                time_s: frame.time_s,
                bbox_px: car.bbox_px,
                score: car.score,
            };
            match best {
                Some(i) => {
                    taken[i] = true;
                    open[i].push(entry);
                }
                None => open.push(vec![entry]),
            }
        }
    }
    done.extend(open);
    for boxes in &mut done {
        boxes.retain(|Detection { bbox_px: [x0, _, x1, _], .. }| x1 - x0 > MIN_WIDTH_PX);
    }
    done.retain(|boxes| match (boxes.first(), boxes.last()) {
        (Some(first), Some(last)) => last.time_s - first.time_s > GAP_S,
        _ => false,
    });
    done
}

/// An interval in which a vehicle is missing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gap {
    /// Start of the interval, s.
    pub from_s: f64,
    /// End of the interval, s.
    pub to_s: f64,
    /// Number of the vehicle's boxes after `from_s`, up to `to_s`.
    boxes: usize,
    /// The vehicle's first box in the interval, px.
    pub bbox_px: [f64; 4],
    /// The highest score of the vehicle's boxes in the interval.
    pub score: f64,
}

impl Gap {
    /// Returns the share of this interval's frames in which the vehicle has a box. `times_s` are the times (s) of all
    /// frames.
    pub fn share_found(&self, times_s: &[f64]) -> f64 {
        let frames = times_s.iter().filter(|&&time_s| time_s > self.from_s && time_s <= self.to_s).count();
        self.boxes as f64 / frames.max(1) as f64
    }
}

/// Returns the longest interval in which no box in `found` overlaps the vehicle's box. `found` has boxes by frame
/// index.
pub(super) fn longest_missing(vehicle: &Boxes, found: &BTreeMap<u64, &[CarRecord]>) -> Gap {
    let mut longest = Gap::default();
    let found_at = |time_s: f64| Gap { from_s: time_s, to_s: time_s, ..Gap::default() };
    let mut open = found_at(vehicle.first().map_or(0.0, |first| first.time_s));
    for Detection { frame, time_s, bbox_px, score } in vehicle {
        let here = found.get(frame).copied().unwrap_or_default();
        if here.iter().any(|car| bbox_iou(&car.bbox_px, bbox_px) >= SAME) {
            open = found_at(*time_s);
        } else {
            open.to_s = *time_s;
            open.score = open.score.max(*score);
            if open.boxes == 0 {
                open.bbox_px = *bbox_px;
            }
            open.boxes += 1;
        }
        if open.to_s - open.from_s > longest.to_s - longest.from_s {
            longest = open;
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::ImageSize;

    fn frames(count: u64, here: impl Fn(u64) -> bool) -> Vec<FrameRecord> {
        let size = ImageSize { width: 640, height: 360 };
        (0..count)
            .map(|i| {
                let x = i as f64 * 4.0;
                let cars = here(i).then(|| CarRecord::boxed([x, 100.0, x + 80.0, 150.0]));
                FrameRecord {
                    cars: cars.into_iter().collect(),
                    ..FrameRecord::empty(i, i as f64 * 0.04, size)
                }
            })
            .collect()
    }

    #[test]
    fn a_vehicle_is_missing_while_it_has_no_box() {
        let vehicles = vehicles(&frames(50, |_| true));
        assert_eq!((vehicles.len(), vehicles[0].len()), (1, 50));
        let missing = |here: fn(u64) -> bool| {
            let on = frames(50, here);
            let gap =
                longest_missing(&vehicles[0], &on.iter().map(|f| (f.frame, f.cars.as_slice())).collect());
            gap.to_s - gap.from_s
        };
        assert!(missing(|i| i % 3 == 0) < 0.1);
        assert!((missing(|i| !(20..30).contains(&i)) - 0.4).abs() < 1e-9);
        assert!((missing(|_| false) - 49.0 * 0.04).abs() < 1e-9);
    }

    #[test]
    fn a_vehicle_that_is_seldom_found_wavers() {
        let off = frames(50, |i| i % 3 == 0);
        let vehicles = vehicles(&off);
        let times: Vec<f64> = off.iter().map(|frame| frame.time_s).collect();
        let on = frames(50, |i| i == 0);
        let gap = longest_missing(&vehicles[0], &on.iter().map(|f| (f.frame, f.cars.as_slice())).collect());
        assert!((gap.share_found(&times) - 1.0 / 3.0).abs() < 1e-9, "{gap:?}");
        assert_eq!(gap.bbox_px, [12.0, 100.0, 92.0, 150.0], "the first missing box");
    }
}
