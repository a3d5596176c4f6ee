//! Schedules the regions of interest: changes, vehicles that are not yet stationary, and a full scan. The full scan
//! covers the picture part by part and is repeated periodically.
//!
//! A vehicle that was stationary in several inference frames keeps its box. The net runs on it again only after a
//! change in its position, or in the next full scan. If the camera moves, changes and boxes are those of the keyframe
//! that the pictures show ([`View`]). All decisions depend only on the pictures, their times and their
//! positions in the input.

use roadplane_base::{CarRecord, FrameStamp, WeakBox, bbox_around, bbox_centre, bbox_covered};
use roadplane_watch::{Cells, ChangeMap, Observation, View};

use crate::fine_rows::FineRows;
use crate::frame_detections::{FrameDetections, weak_beside};
use crate::options::FinePass;
use crate::regions::{MARGIN_PX, regions};
use crate::resample::Part;
use crate::tracked_box::{TrackedBox, update};
use crate::{DetectError, DetectOptions, Detector};

/// Number of inference frames at the start in which the whole picture is inspected. If one of them misses a vehicle,
/// the next one can find it.
const FIRST_FULL_FRAMES: u32 = 3;
/// Smallest score at which a box marks a change in the picture as a vehicle. Such a score may be too low for a
/// detection, but the vehicle may already be tracked.
const WEAK_SCORE: f64 = 0.12;
/// Largest side of one part of the full scan, px of the net's input in the finest pass.
const SCAN_PART_PX: f64 = 400.0;
/// A box at the border of an inspected part may show a piece of a carried-over vehicle. It does so if the overlap of
/// both boxes exceeds this share of the smaller box.
const SAME_VEHICLE: f64 = 0.5;
/// Smallest share of changed cells in a stationary vehicle's box at which the whole box is inspected.
const CHANGED_SHARE: f64 = 0.2;
/// Time for which a cell is not inspected again after a change that was no vehicle (people, leaves), s.
const IDLE_S: f64 = 0.19;

/// The detections of one inference frame.
#[derive(Clone, Debug)]
pub struct RoiDetections {
    /// Vehicles that were detected in this frame or carried over from an earlier frame.
    pub cars: Vec<CarRecord>,
    /// Boxes with scores below the detection threshold that show none of the vehicles in `cars`.
    pub weak: Vec<WeakBox>,
    /// Share of the picture that changed since its last inspection, 0–1.
    pub changed: f64,
    /// Share of the picture that was inspected in this frame, 0–1.
    pub inspected: f64,
    /// The cells of the keyframe with a change or a vehicle.
    pub busy: Cells,
}

/// Chooses the regions of interest of each inference frame from the results of earlier frames.
#[derive(Debug)]
pub struct RoiScheduler {
    /// Number of inference frames within which a full scan covers the picture.
    frames_per_scan: u64,
    /// Largest number of inference frames from one fine pass to the next.
    frames_per_fine: u64,
    /// The keyframe to which changes and boxes belong, and its changes.
    map: Option<(Option<u64>, ChangeMap)>,
    tracked: Vec<TrackedBox>,
    /// Boxes of the last inference frame that were cut by a border of an inspected part, px of the keyframe.
    cut: Vec<[f64; 4]>,
    frames: u32,
    /// For each cell, the time until which a change in it is not inspected, s. The last change in the cell was no
    /// vehicle.
    idle_until: Vec<f64>,
    /// How the last inference frame shows the keyframe. `None` if it does not.
    view: Option<View>,
    /// The rows in which vehicles are small. `None` before the first inference frame.
    rows: Option<FineRows>,
}

impl RoiScheduler {
    /// Creates a scheduler for a new clip. A full scan covers the picture within `frames_per_scan` inference frames. Small
    /// vehicles are inspected at least once in `frames_per_fine` inference frames.
    #[must_use]
    pub fn new(frames_per_scan: u64, frames_per_fine: u64) -> Self {
        Self {
            frames_per_scan: frames_per_scan.max(1),
            frames_per_fine: frames_per_fine.max(1),
            map: None,
            tracked: Vec::new(),
            cut: Vec::new(),
            frames: 0,
            idle_until: Vec::new(),
            view: None,
            rows: None,
        }
    }

    /// Returns the vehicles of a frame on which the net does not run. They are carried over from earlier frames.
    #[must_use]
    pub fn carried_over(&self) -> Vec<CarRecord> {
        let Some(view) = &self.view else { return Vec::new() };
        let carried_over = self.tracked.iter().filter(|vehicle| vehicle.is_carried_over());
        carried_over.filter_map(|vehicle| carried_over_record(vehicle, view)).collect()
    }

    /// Detects the vehicles of an inference frame.
    ///
    /// `number` is the number of this inference frame. It counts from the start of the input, even if this run started
    /// later.
    ///
    /// # Errors
    /// [`DetectError`] when the net fails.
    pub fn detect(
        &mut self,
        detector: &mut Detector,
        stamp: FrameStamp,
        number: u64,
        image: &image::RgbImage,
        observation: &Observation,
    ) -> Result<RoiDetections, DetectError> {
        let time_s = stamp.time_s();
        let all_cells = || ChangeMap::new(&observation.small).all_cells();
        // A black picture has no boxes to move.
        self.view = observation.view.filter(|_| !observation.record.verdict.is_blind());
        if observation.record.verdict.is_blind() {
            return Ok(RoiDetections {
                cars: Vec::new(),
                weak: Vec::new(),
                changed: 1.0,
                inspected: 0.0,
                busy: all_cells(),
            });
        }
        let Some(view) = observation.view else {
            // The camera moves too fast, or something is in front of it. The state of the keyframe stays as it is.
            let (own, all) = (View::at_rest(image), all_cells());
            let FrameDetections { found, weak, .. } =
                self.inspected(detector, image, own, &all, [&[whole(image)], &[]])?;
            let weak = weak_beside(&weak, &found, detector.options());
            return Ok(RoiDetections { cars: found, weak, changed: 1.0, inspected: 1.0, busy: all });
        };
        let known = self.map.take();
        let known =
            known.filter(|(keyframe, map)| *keyframe == view.keyframe && map.suits(&observation.small));
        let mut map = match known {
            Some((_, map)) => map,
            None => {
                self.tracked.clear();
                self.rows = None;
                (self.frames, self.cut) = (0, Vec::new());
                self.idle_until.clear();
                ChangeMap::new(&view.laid(&observation.small, &observation.small))
            }
        };
        let changed = map.changed(&observation.small, &view, time_s);
        self.idle_until.resize(changed.columns * changed.rows, 0.0);
        self.frames = self.frames.saturating_add(1);

        let detections = self.run(detector, number, time_s, image, &view, &changed)?;
        let mut on_keyframe: Vec<CarRecord> =
            detections.found.iter().map(|car| with_box(car, view.in_keyframe(&car.bbox_px))).collect();
        update(
            &mut self.tracked,
            &mut on_keyframe,
            stamp.index,
            time_s,
            |bbox| detections.cover(&view.in_picture(bbox)),
            |bbox| changed.share_of(bbox) <= 0.0,
        );
        let FrameDetections { inspected, mut vehicles, weak, .. } = detections;
        for vehicle in &self.tracked {
            vehicles.insert_box(&vehicle.inspection_box(time_s));
        }
        map.mark_inspected(&inspected, &vehicles);
        self.map = Some((view.keyframe, map));
        let is_idle =
            |(column, row): &(usize, usize)| inspected.has(*column, *row) && !vehicles.has(*column, *row);
        for (column, row) in changed.iter().filter(is_idle) {
            for (x, y) in changed.around(column, row) {
                self.idle_until[y * changed.columns + x] = time_s + IDLE_S;
            }
        }

        let mut cars: Vec<CarRecord> =
            on_keyframe.iter().map(|car| with_box(car, view.in_picture(&car.bbox_px))).collect();
        for vehicle in self.tracked.iter().filter(|v| v.is_carried_over() && v.seen_frame != stamp.index) {
            let Some(record) = carried_over_record(vehicle, &view) else { continue };
            // A detection replaces a carried-over vehicle in the same position.
            if !cars.iter().any(|car| detector.options().are_one(&car.bbox_px, &record.bbox_px)) {
                cars.push(record);
            }
        }
        let weak = weak_beside(&weak, &cars, detector.options());
        let mut busy = vehicles;
        changed.iter().for_each(|(column, row)| busy.insert(column, row));
        let (changed, inspected) = (changed.share(), inspected.share());
        Ok(RoiDetections { cars, weak, changed, inspected, busy })
    }

    /// Runs the net on the parts of the picture that are due for inspection.
    fn run(
        &mut self,
        detector: &mut Detector,
        number: u64,
        time_s: f64,
        image: &image::RgbImage,
        view: &View,
        changed: &Cells,
    ) -> Result<FrameDetections, DetectError> {
        let [_, _, width, height] = whole(image);
        let finest = detector.options().scales(image.width(), image.height()).last().copied().unwrap_or(1.0);
        let (mut areas, mut scan) = (vec![whole(image)], None);
        if self.frames > FIRST_FULL_FRAMES {
            scan = scan_part(number, self.frames_per_scan, width, height, finest);
            scan = scan.map(|core| self.with_vehicles(core, time_s, view));
            areas = self.due_areas(changed, time_s, view);
        }
        let fine = self.fine(detector.options(), image);
        let is_above = |area: &[f64; 4]| fine.is_some_and(|(_, end_px)| area[3] < end_px);
        // At first, it is not known where vehicles are small.
        let has_fine = fine.is_some_and(|(fine, _)| {
            self.rows.is_none() || number.is_multiple_of(fine.every.min(self.frames_per_fine))
        });
        let mut fine_areas = if has_fine { areas.clone() } else { Vec::new() };
        areas.retain(|area| !is_above(area));
        // All passes run on the part of the full scan, so that an error about the rows does not last.
        areas.extend(scan);
        fine_areas.extend(scan);
        // Cut boxes above the row wait for the fine pass.
        let is_waiting = |cut: &[f64; 4]| !has_fine && is_above(&view.in_picture(cut));
        let waiting: Vec<[f64; 4]> = self.cut.iter().copied().filter(is_waiting).collect();
        let detections = self.inspected(detector, image, *view, changed, [&areas, &fine_areas])?;
        self.rows.get_or_insert_default().add(&detections.found, height, finest);
        // A cut box is inspected as a whole in the next inference frame. The exception is a box that shows a
        // carried-over vehicle beside the inspected area.
        let is_carried_over = |bbox: &[f64; 4]| {
            self.tracked.iter().any(|vehicle| {
                vehicle.is_carried_over() && bbox_covered(&vehicle.bbox_px, bbox) > SAME_VEHICLE
            })
        };
        let cut = detections.cut.iter().map(|cut| view.in_keyframe(cut));
        self.cut = cut.filter(|cut| !is_carried_over(cut)).chain(waiting).collect();
        Ok(detections)
    }

    /// Returns the fine pass, and the row above which it runs, px. At first, it runs on the whole picture.
    fn fine(&self, options: &DetectOptions, image: &image::RgbImage) -> Option<(FinePass, f64)> {
        let height = f64::from(image.height());
        let end_px = self.rows.as_ref().map_or(height, |rows| rows.end_px(height));
        options.fine(image.width(), image.height()).map(|fine| (fine, end_px))
    }

    /// Runs the net on areas of a picture, px. The fine pass has its own areas, and runs only on their parts above its row.
    /// An area above this row counts as inspected only after the fine pass.
    fn inspected(
        &self,
        detector: &mut Detector,
        image: &image::RgbImage,
        view: View,
        grid: &Cells,
        [areas, fine_areas]: [&[[f64; 4]]; 2],
    ) -> Result<FrameDetections, DetectError> {
        let [_, _, width, height] = whole(image);
        let scales = detector.options().scales(image.width(), image.height());
        let fine = self.fine(detector.options(), image);
        let is_above = |area: &[f64; 4]| fine.is_some_and(|(_, end_px)| area[3] < end_px);
        let mut detections = FrameDetections::new(detector.options(), view, grid);
        for region in regions(areas, Part::whole(image), &scales) {
            let cores = region.cores.into_iter().filter(|core| !is_above(core)).collect();
            detections.add(detector.inspect(image, region.part, &scales)?, cores);
        }
        if let Some((fine, end_px)) = fine {
            let part_px = (end_px + MARGIN_PX / fine.scale).min(height) as usize;
            let part = Part { height: part_px, ..Part::whole(image) };
            let small: Vec<[f64; 4]> = fine_areas.iter().filter(|area| area[1] < end_px).copied().collect();
            for region in regions(&small, part, &[fine.scale]) {
                detections.add(detector.inspect(image, region.part, &[fine.scale])?, region.cores);
            }
        }
        detections.merge(WEAK_SCORE, (width, height));
        Ok(detections)
    }

    /// Returns the areas that are due for inspection, as boxes in px of the frame.
    fn due_areas(&self, changed: &Cells, time_s: f64, view: &View) -> Vec<[f64; 4]> {
        let mut due = changed.emptied();
        for (column, row) in changed.iter() {
            // A change at the picture's border may be the front of a vehicle that is just entering.
            let at_border = changed.is_at_border(column, row);
            if at_border || self.idle_until[row * changed.columns + column] <= time_s {
                due.insert(column, row);
            }
        }
        let (late, early): (Vec<&TrackedBox>, Vec<&TrackedBox>) = self
            .tracked
            .iter()
            .filter(|vehicle| !vehicle.is_settled())
            .partition(|vehicle| vehicle.is_due(time_s));
        // Changes inside the box of a moving vehicle are caused by this vehicle. They are not inspected before the
        // vehicle is due.
        for vehicle in early {
            due.remove_box(&vehicle.inspection_box(time_s));
        }
        for vehicle in late {
            due.insert_box(&vehicle.inspection_box(time_s));
        }
        for bbox in &self.cut {
            due.insert_box(bbox);
        }
        // A stationary vehicle with many changed cells is inspected as a whole.
        for vehicle in self.tracked.iter().filter(|vehicle| vehicle.is_settled()) {
            if due.share_of(&vehicle.bbox_px) >= CHANGED_SHARE {
                due.insert_box(&vehicle.bbox_px);
            }
        }
        let groups = due.groups();
        let in_picture = groups.iter().map(|area| view.in_picture(area));
        let mut areas: Vec<[f64; 4]> = in_picture.filter(|area| view.is_in_view(area)).collect();
        areas.extend(view.new_parts(changed.side_px as f64));
        areas
    }

    /// Returns a part of the full scan, enlarged by the vehicles in it, px.
    fn with_vehicles(&self, mut core: [f64; 4], time_s: f64, view: &View) -> [f64; 4] {
        for vehicle in &self.tracked {
            let area = view.in_picture(&vehicle.inspection_box(time_s));
            let centre = bbox_centre(&area);
            if (core[0]..core[2]).contains(&centre.x) && (core[1]..core[3]).contains(&centre.y) {
                core = bbox_around(&core, &area);
            }
        }
        core
    }
}

/// Returns the whole picture as a box, px.
fn whole(image: &image::RgbImage) -> [f64; 4] {
    [0.0, 0.0, f64::from(image.width()), f64::from(image.height())]
}

/// Returns the part of the full scan that is due in this inference frame, or `None` if no part is due. The parts are
/// spread evenly over the inference frames of a scan.
fn scan_part(number: u64, frames_per_scan: u64, width: f64, height: f64, finest: f64) -> Option<[f64; 4]> {
    let count = |length: f64| (length * finest / SCAN_PART_PX).ceil().max(1.0) as u64;
    let (columns, rows) = (count(width), count(height));
    let parts = columns * rows;
    let before = |number: u64| number * parts / frames_per_scan.max(parts);
    let part = before(number);
    if number > 0 && part == before(number - 1) {
        return None;
    }
    let (column, row) = ((part % parts) % columns, (part % parts) / columns);
    let (w, h) = (width / columns as f64, height / rows as f64);
    let (x, y) = (column as f64 * w, row as f64 * h);
    Some([x, y, x + w, y + h])
}

fn with_box(car: &CarRecord, bbox_px: [f64; 4]) -> CarRecord {
    CarRecord { bbox_px: bbox_px.map(|v| (v * 100.0).round() / 100.0), ..car.clone() }
}

/// Returns the record of a vehicle that is carried over; `None` if less than half of its box is in view.
fn carried_over_record(vehicle: &TrackedBox, view: &View) -> Option<CarRecord> {
    let car = CarRecord {
        score: vehicle.score,
        class: vehicle.class(),
        held_since: Some(vehicle.seen_frame),
        ..CarRecord::boxed(vehicle.bbox_px)
    };
    let bbox_px = view.in_picture(&vehicle.bbox_px);
    let shown = if view.is_displaced() { view.visible(&bbox_px)? } else { bbox_px };
    Some(with_box(&car, shown))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_scan_covers_the_picture_from_any_starting_frame() {
        for (frames, width, height, finest) in
            [(36, 1920.0, 1080.0, 2.0 / 3.0), (36, 640.0, 360.0, 1.0), (2, 1280.0, 720.0, 1.0)]
        {
            for start in [0_u64, 5, 1000] {
                let parts: Vec<[f64; 4]> = (start + 1..=start + frames.max(8))
                    .filter_map(|number| scan_part(number, frames, width, height, finest))
                    .collect();
                let area: f64 = parts.iter().map(|[x0, y0, x1, y1]| (x1 - x0) * (y1 - y0)).sum();
                assert!(
                    (area / (width * height) - parts.len() as f64 / parts.len().max(1) as f64).abs() < 1.01
                );
                assert!(area >= 0.99 * width * height, "{frames} from {start}: {parts:?}");
            }
        }
    }
}
