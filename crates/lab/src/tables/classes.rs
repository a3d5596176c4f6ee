//! The table of the tracks' classes against truth.

use std::collections::BTreeMap;

use roadplane_base::{TrackRow, VehicleClass, bbox_iou};
use roadplane_metrics::truth::Truth;
use roadplane_tables::{Cell, Column, Table};

/// Smallest mean overlap (intersection over union) of a track with its vehicle.
const SAME_VEHICLE_IOU: f64 = 0.5;

/// Returns the table of the classes that the tracks got, with one row per true class.
///
/// A track belongs to the true vehicle with the largest sum of overlaps between their boxes. Tracks whose mean overlap
/// is below 0.5 are no vehicle.
#[must_use]
pub fn classes_table(truth: &Truth, rows: &[TrackRow]) -> Table {
    let mut columns = vec![Column::new("true class", 0), Column::new("tracks", 0)];
    columns.extend(VehicleClass::ALL.map(|class| Column::new(class.name(), 0)));
    columns.push(Column::new("right class, %", 1));
    let note = "Tracks by the true class of their vehicle (rows) and by the class that they got (columns).";
    let mut table = Table::new("Classes of tracks", note, columns);
    let tracks = classes(truth, rows);
    for class in VehicleClass::ALL {
        let got = |other: VehicleClass| tracks.iter().filter(|pair| **pair == (class, other)).count();
        let all: usize = VehicleClass::ALL.map(got).iter().sum();
        if all > 0 {
            let counts = VehicleClass::ALL.map(|other| Cell::from(got(other).to_string()));
            let mut row = vec![Cell::from(class.name()), all.to_string().into()];
            row.extend(counts);
            row.push((100.0 * got(class) as f64 / all as f64).into());
            table.rows.push(row);
        }
    }
    table
}

/// Returns the true class and the class of each track that belongs to a vehicle.
fn classes(truth: &Truth, rows: &[TrackRow]) -> Vec<(VehicleClass, VehicleClass)> {
    let frames: BTreeMap<u64, _> = truth.frames.iter().map(|frame| (frame.frame, &frame.cars)).collect();
    let true_class: BTreeMap<u64, VehicleClass> =
        truth.models.iter().map(|model| (model.id, model.class)).collect();
    // For each track: its class, the number of its detections in frames with truth, and the overlaps with each vehicle.
    let mut tracks: BTreeMap<u64, (VehicleClass, usize, BTreeMap<u64, f64>)> = BTreeMap::new();
    for row in rows {
        let Some(cars) = frames.get(&row.frame).filter(|_| row.observed) else { continue };
        let track = tracks.entry(row.track).or_insert((row.class, 0, BTreeMap::new()));
        track.1 += 1;
        for car in cars.iter() {
            *track.2.entry(car.id).or_default() += bbox_iou(&car.bbox_px, &row.bbox_px);
        }
    }
    let of_vehicle = |(class, boxes, overlaps): (VehicleClass, usize, BTreeMap<u64, f64>)| {
        let (id, sum) = overlaps.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let is_vehicle = sum >= SAME_VEHICLE_IOU * boxes as f64;
        is_vehicle.then(|| true_class.get(&id).map(|true_class| (*true_class, class)))?
    };
    tracks.into_values().filter_map(of_vehicle).collect()
}

#[cfg(test)]
mod tests {
    use roadplane_metrics::truth::fixture::lot;
    use roadplane_synth::stationary_row;

    use super::*;

    #[test]
    fn each_track_counts_for_its_own_vehicle() {
        let mut truth = lot(4);
        truth.models[1].class = VehicleClass::Truck;
        let row = |track: u64, car: usize, class: VehicleClass, frame: u64| TrackRow {
            class,
            bbox_px: truth.frames[frame as usize].cars[car].bbox_px,
            ..stationary_row(track, frame, frame as f64 * 0.1)
        };
        let mut rows: Vec<TrackRow> = (0..4)
            .flat_map(|frame| [row(7, 1, VehicleClass::Bus, frame), row(8, 0, VehicleClass::Car, frame)])
            .collect();
        rows.push(TrackRow { bbox_px: [0.0, 0.0, 9.0, 9.0], ..row(9, 0, VehicleClass::Car, 1) });
        let found = classes(&truth, &rows);
        assert_eq!(
            found,
            [(VehicleClass::Truck, VehicleClass::Bus), (VehicleClass::Car, VehicleClass::Car)],
            "track 9 is no vehicle"
        );
        assert_eq!(classes_table(&truth, &rows).rows.len(), 2);
    }
}
