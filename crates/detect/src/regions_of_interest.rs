//! Where the detector looks: at what changed, at vehicles that do not stand yet, and, bit by bit, at everything.
//!
//! A vehicle that stood in several looks keeps its box until something changes in its place or the sweep comes by. All of it
//! follows from the pictures, their times and their places in the input.

use nalgebra::Vector2;
use roadplane_base::{CarRecord, FrameStamp, WeakBox, bbox_around, bbox_centre, bbox_covered, bbox_moved};
use roadplane_watch::{Cells, ChangeMap, Seen};

use crate::frame_detections::{FrameDetections, weak_beside};
use crate::known::{Known, update};
use crate::regions::regions;
use crate::resample::Part;
use crate::{DetectError, Detector};

/// Looks at everything in the beginning: a vehicle that the first misses is found by the next.
const FIRST_LOOKS: u32 = 3;
/// Score from which on a box says that what changed was a vehicle, and may be one that is known, whether it counts or not.
const WEAK_SCORE: f64 = 0.12;
/// Side of a part of the sweep, px of the net's input in the finest pass.
const SWEEP_PX: f64 = 400.0;
/// A box of which more than this share lies within a vehicle that is held is that vehicle.
const KNOWN: f64 = 0.5;
/// A vehicle that stands is looked at where more than this share of its box changed.
const MUCH: f64 = 0.2;
/// What moves and is no vehicle (people, leaves) is looked at again only so much later, s.
const IDLE_S: f64 = 0.19;

/// What a look came to.
#[derive(Clone, Debug)]
pub struct Look {
    /// Vehicles: seen in this look, and held.
    pub cars: Vec<CarRecord>,
    /// Boxes of which the detector is not sure, beside those.
    pub weak: Vec<WeakBox>,
    /// Share of the picture that changed since it was looked at, 0–1.
    pub changed: f64,
    /// Share of the picture that was looked at, 0–1.
    pub seen: f64,
    /// Where something changed or a vehicle is.
    pub busy: Cells,
}

/// What the detector remembers of the frames before.
#[derive(Debug)]
pub struct RoiScheduler {
    /// Looks within which the sweep covers the picture.
    looks_a_sweep: u64,
    map: Option<ChangeMap>,
    known: Vec<Known>,
    /// Boxes that were cut by the border of what was looked at.
    cut: Vec<[f64; 4]>,
    looks: u32,
    /// Until when each cell may wait, s: what moves there was no vehicle just now.
    idle_until: Vec<f64>,
    /// Shake of the last picture that was looked at, px.
    offset: Vector2<f64>,
}

impl RoiScheduler {
    /// Before the first frame. The sweep covers the picture within so many looks.
    #[must_use]
    pub fn new(looks_a_sweep: u64) -> Self {
        Self {
            looks_a_sweep: looks_a_sweep.max(1),
            map: None,
            known: Vec::new(),
            cut: Vec::new(),
            looks: 0,
            idle_until: Vec::new(),
            offset: Vector2::zeros(),
        }
    }

    /// Vehicles of a frame that nobody looks at: those that are held.
    #[must_use]
    pub fn held(&self) -> Vec<CarRecord> {
        self.known
            .iter()
            .filter(|vehicle| vehicle.is_held())
            .map(|vehicle| held(vehicle, &self.offset))
            .collect()
    }

    /// Looks at a frame; `number` counts looks from the input's first frame on, whether this run began there or not.
    ///
    /// # Errors
    /// [`DetectError`] when the net fails.
    pub fn look(
        &mut self,
        detector: &mut Detector,
        stamp: FrameStamp,
        number: u64,
        image: &image::RgbImage,
        seen: &Seen,
    ) -> Result<Look, DetectError> {
        let time_s = stamp.time_s();
        if seen.record.verdict.is_blind() {
            let busy = ChangeMap::new(&seen.small).all_cells();
            return Ok(Look { cars: Vec::new(), weak: Vec::new(), changed: 1.0, seen: 0.0, busy });
        }
        if seen.is_new_position {
            self.known.clear();
            self.looks = 0;
        }
        self.offset = seen.record.offset();
        let offset = self.offset;
        let fits = self.map.as_ref().is_some_and(|map| map.suits(&seen.small));
        let mut map = self.map.take().filter(|_| fits).unwrap_or_else(|| ChangeMap::new(&seen.small));
        let changed = map.changed(&seen.small, seen.shift, time_s);
        self.idle_until.resize(changed.columns * changed.rows, 0.0);
        self.looks = self.looks.saturating_add(1);

        let detections = self.run(detector, number, time_s, image, &changed)?;
        let mut at_rest: Vec<CarRecord> = detections.found.iter().map(|car| moved(car, &-offset)).collect();
        let unchanged = |bbox: &[f64; 4]| changed.share_of(&bbox_moved(bbox, &offset)) <= 0.0;
        update(&mut self.known, &mut at_rest, stamp.index, time_s, |bbox| detections.cover(bbox), unchanged);
        let FrameDetections { looked, mut vehicles, weak, .. } = detections;
        for vehicle in &self.known {
            vehicles.insert_box(&vehicle.place(time_s));
        }
        map.looked(&seen.small, seen.shift, &looked, &vehicles);
        self.map = Some(map);
        let is_idle =
            |(column, row): &(usize, usize)| looked.has(*column, *row) && !vehicles.has(*column, *row);
        for (column, row) in changed.iter().filter(is_idle) {
            for (x, y) in changed.around(column, row) {
                self.idle_until[y * changed.columns + x] = time_s + IDLE_S;
            }
        }

        let mut cars: Vec<CarRecord> = at_rest.iter().map(|car| moved(car, &offset)).collect();
        for vehicle in self.known.iter().filter(|v| v.is_held() && v.seen_frame != stamp.index) {
            let record = held(vehicle, &offset);
            // What was seen just now hides what is only remembered.
            if !cars.iter().any(|car| detector.options().are_one(&car.bbox_px, &record.bbox_px)) {
                cars.push(record);
            }
        }
        let weak = weak_beside(&weak, &cars, detector.options());
        let mut busy = vehicles;
        changed.iter().for_each(|(column, row)| busy.insert(column, row));
        Ok(Look { cars, weak, changed: changed.share(), seen: looked.share(), busy })
    }

    /// Runs the net on the parts of the picture that want a look.
    fn run(
        &mut self,
        detector: &mut Detector,
        number: u64,
        time_s: f64,
        image: &image::RgbImage,
        changed: &Cells,
    ) -> Result<FrameDetections, DetectError> {
        let whole = Part::whole(image);
        let (width, height) = (whole.width as f64, whole.height as f64);
        let scales = detector.options().scales(image.width(), image.height());
        let places = if self.looks <= FIRST_LOOKS {
            vec![[0.0, 0.0, width, height]]
        } else {
            let finest = scales.last().copied().unwrap_or(1.0);
            self.places(changed, time_s, sweep_part(number, self.looks_a_sweep, width, height, finest))
        };
        let mut detections = FrameDetections::new(detector.options(), changed);
        for region in regions(&places, whole, &scales) {
            detections.add(detector.look(image, region.part, WEAK_SCORE)?, region.cores, (width, height));
        }
        // What was cut is looked at as a whole next time, unless it is a vehicle that stands beside what was looked at.
        let is_held = |bbox: &[f64; 4]| {
            self.known.iter().any(|vehicle| vehicle.is_held() && bbox_covered(&vehicle.bbox_px, bbox) > KNOWN)
        };
        self.cut = detections.cut.iter().filter(|cut| !is_held(cut)).copied().collect();
        Ok(detections)
    }

    /// What wants a look.
    fn places(&self, changed: &Cells, time_s: f64, sweep: Option<[f64; 4]>) -> Vec<[f64; 4]> {
        let mut due = changed.emptied();
        for (column, row) in changed.iter() {
            // At the picture's border it may be the front of a vehicle that only just comes in.
            let at_border = changed.is_at_border(column, row);
            if at_border || self.idle_until[row * changed.columns + column] <= time_s {
                due.insert(column, row);
            }
        }
        let in_frame = |bbox: [f64; 4]| bbox_moved(&bbox, &self.offset);
        let (late, early): (Vec<&Known>, Vec<&Known>) = self
            .known
            .iter()
            .filter(|vehicle| !vehicle.is_settled())
            .partition(|vehicle| vehicle.is_due(time_s));
        // What changed where a vehicle is known to move is that vehicle, whose turn will come.
        for vehicle in early {
            due.remove_box(&in_frame(vehicle.place(time_s)));
        }
        for vehicle in late {
            due.insert_box(&in_frame(vehicle.place(time_s)));
        }
        for bbox in &self.cut {
            due.insert_box(bbox);
        }
        // Vehicles that stand where much changed are looked at as a whole.
        for vehicle in self.known.iter().filter(|vehicle| vehicle.is_settled()) {
            let bbox = in_frame(vehicle.bbox_px);
            if due.share_of(&bbox) >= MUCH {
                due.insert_box(&bbox);
            }
        }
        let mut places = due.groups();
        if let Some(mut core) = sweep {
            for vehicle in &self.known {
                let place = in_frame(vehicle.place(time_s));
                let centre = bbox_centre(&place);
                if (core[0]..core[2]).contains(&centre.x) && (core[1]..core[3]).contains(&centre.y) {
                    core = bbox_around(&core, &place);
                }
            }
            places.push(core);
        }
        places
    }
}

/// The part of the sweep that is due in this look, if any: parts are spread evenly over the looks of a sweep.
fn sweep_part(number: u64, looks_a_sweep: u64, width: f64, height: f64, finest: f64) -> Option<[f64; 4]> {
    let count = |length: f64| (length * finest / SWEEP_PX).ceil().max(1.0) as u64;
    let (columns, rows) = (count(width), count(height));
    let parts = columns * rows;
    let before = |number: u64| number * parts / looks_a_sweep.max(parts);
    let part = before(number);
    if number > 0 && part == before(number - 1) {
        return None;
    }
    let (column, row) = ((part % parts) % columns, (part % parts) / columns);
    let (w, h) = (width / columns as f64, height / rows as f64);
    let (x, y) = (column as f64 * w, row as f64 * h);
    Some([x, y, x + w, y + h])
}

fn moved(car: &CarRecord, by: &Vector2<f64>) -> CarRecord {
    let bbox_px = bbox_moved(&car.bbox_px, by).map(|v| (v * 100.0).round() / 100.0);
    CarRecord { bbox_px, ..car.clone() }
}

fn held(vehicle: &Known, offset: &Vector2<f64>) -> CarRecord {
    let car = CarRecord {
        score: vehicle.score,
        class: vehicle.class(),
        held_since: Some(vehicle.seen_frame),
        ..CarRecord::boxed(vehicle.bbox_px)
    };
    moved(&car, offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sweep_covers_the_picture_once_wherever_it_is_joined() {
        for (looks, width, height, finest) in
            [(36, 1920.0, 1080.0, 2.0 / 3.0), (36, 640.0, 360.0, 1.0), (2, 1280.0, 720.0, 1.0)]
        {
            for start in [0_u64, 5, 1000] {
                let parts: Vec<[f64; 4]> = (start + 1..=start + looks.max(8))
                    .filter_map(|number| sweep_part(number, looks, width, height, finest))
                    .collect();
                let area: f64 = parts.iter().map(|[x0, y0, x1, y1]| (x1 - x0) * (y1 - y0)).sum();
                assert!(
                    (area / (width * height) - parts.len() as f64 / parts.len().max(1) as f64).abs() < 1.01
                );
                assert!(area >= 0.99 * width * height, "{looks} from {start}: {parts:?}");
            }
        }
    }
}
