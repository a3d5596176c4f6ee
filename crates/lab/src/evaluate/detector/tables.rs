//! Tables of the detector's scores.

use roadplane_metrics::detection_curve::{Counts, DetectionCurve, JudgedPicture};
use roadplane_tables::{Cell, Column, Table, bootstrap_scenes, median};

use super::pictures::{PictureSet, range};
use super::score::{Case, Scored};

/// Limits of the groups of a box's width, px.
const WIDTHS_PX: [f64; 4] = [24.0, 48.0, 96.0, 192.0];

/// Returns the table with one row per number format: average precisions, and the vehicles found at given precisions and
/// at the product's threshold. Intervals are by resampling pictures.
pub fn curve_table(set: &str, rows: &[(&str, Scored)], threshold: f64) -> Table {
    let mut columns = vec![Column::new("format", 0), Column::new("pictures", 0), Column::new("vehicles", 0)];
    columns.extend(["AP50, %", "AP70, %"].map(|head| Column::new(head, 1)));
    for at in ["at 90 %", "at 95 %"] {
        columns.extend([Column::new(format!("found {at}"), 0), Column::new(format!("score {at}"), 2)]);
    }
    columns.extend(["found at best F1", "false at best F1"].map(|head| Column::new(head, 0)));
    columns.push(Column::new("score at best F1", 2));
    columns.extend(["found", "false"].map(|head| Column::new(format!("{head} from {threshold:.2}"), 0)));
    columns.push(Column::new("false a picture", 2));
    let note = "A vehicle is found by a box with an IoU of 0.5 (AP70: 0.7), whatever the class. AP: mean precision at 101 \
                levels of recall. At 90 and 95 %: the most vehicles that are found with this precision, and the score \
                that gives them. Vehicles of classes that the net lacks do not count.";
    let mut table = Table::new(format!("Detector: {set}"), note, columns);
    for (name, scored) in rows {
        let curve = scored.curve();
        let whole = |counts: usize| Cell::from(counts as f64);
        let of = |at: Option<Counts>, number: &dyn Fn(Counts) -> f64| Cell::from(at.map_or(f64::NAN, number));
        let mut row = vec![Cell::from(*name), scored.judged.len().to_string().into()];
        row.push(curve.vehicles().to_string().into());
        for iou in [0, 1] {
            let ap = |chosen: &[&[JudgedPicture; 2]]| {
                let pictures: Vec<&JudgedPicture> = chosen.iter().map(|picture| &picture[iou]).collect();
                100.0 * DetectionCurve::of(&pictures).average_precision()
            };
            row.push(bootstrap_scenes(&scored.judged, curve.vehicles(), ap).into());
        }
        for at in [curve.at_precision(0.9), curve.at_precision(0.95)] {
            row.extend([of(at, &|counts| counts.found as f64), of(at, &|counts| counts.score)]);
        }
        let best = curve.at_best_f1();
        row.extend([of(best, &|c| c.found as f64), of(best, &|c| c.wrong as f64), of(best, &|c| c.score)]);
        let kept = curve.from_score(threshold);
        row.extend([whole(kept.found), whole(kept.wrong)]);
        row.push((kept.wrong as f64 / scored.judged.len().max(1) as f64).into());
        table.rows.push(row);
    }
    table
}

/// Returns the table of groups of vehicles, by width and by all that the truth says; `None` without vehicles.
pub fn group_table(set: &str, pictures: &PictureSet, scored: &Scored, threshold: f64) -> Option<Table> {
    let cases = scored.cases(threshold);
    let mut groups: Vec<(String, Vec<&Case<'_>>)> = Vec::new();
    for case in &cases {
        let width = range(&WIDTHS_PX, case.vehicle.bbox_px[2] - case.vehicle.bbox_px[0]);
        let class = case.vehicle.class.map(|class| ("class", class.name().to_owned()));
        let of_picture = pictures.pictures[case.picture].groups.iter().cloned();
        let all = [("width, px", width)].into_iter().chain(class).chain(case.vehicle.groups.iter().cloned());
        for (kind, value) in all.chain(of_picture) {
            let name = format!("{kind}: {value}");
            match groups.iter_mut().find(|(known, _)| *known == name) {
                Some((_, members)) => members.push(case),
                None => groups.push((name, vec![case])),
            }
        }
    }
    groups.sort_by_key(|(name, _)| natural(name));
    let columns = vec![
        Column::new("group", 0),
        Column::new("vehicles", 0),
        Column::new("found, %", 1),
        Column::new("IoU, median", 3),
        Column::new("right class, %", 1),
    ];
    let note = format!("Vehicles found from score {threshold:.2} on, by the first number format.");
    let mut table = Table::new(format!("Detector, groups of vehicles: {set}"), note, columns);
    for (name, members) in &groups {
        let found: Vec<_> =
            members.iter().filter_map(|case| Some((case.vehicle.class, case.found?))).collect();
        let ious: Vec<f64> = found.iter().map(|(_, (iou, _))| *iou).collect();
        let classed: Vec<bool> =
            found.iter().filter_map(|(class, (_, called))| Some((*class)? == *called)).collect();
        let share = |part: usize, all: usize| Cell::from(100.0 * part as f64 / all as f64);
        table.rows.push(vec![
            name.as_str().into(),
            members.len().to_string().into(),
            share(found.len(), members.len()),
            if ious.is_empty() { Cell::from("") } else { median(&ious).into() },
            if classed.is_empty() {
                Cell::from("")
            } else {
                share(classed.iter().filter(|right| **right).count(), classed.len())
            },
        ]);
    }
    (!table.rows.is_empty()).then_some(table)
}

/// Returns a key that sorts names by their text, and ranges by their first number; `below …` comes first.
fn natural(name: &str) -> (String, bool, i64) {
    let (kind, value) = name.split_once(": ").unwrap_or((name, ""));
    let number = value.trim_start_matches("below ").split(['–', ' ']).next().unwrap_or("");
    let number: Option<f64> = number.parse().ok();
    let text = if number.is_some() { "" } else { value };
    let thousandths = number.map_or(0, |number| (1000.0 * number) as i64);
    (format!("{kind}: {text}"), !value.starts_with("below"), thousandths)
}

#[cfg(test)]
mod tests {
    use roadplane_base::{CarRecord, VehicleClass};

    use super::*;
    use crate::evaluate::detector::pictures::{Labelled, LabelledPicture};
    use crate::evaluate::detector::score::score;

    const WIDE: [f64; 4] = [0.0, 0.0, 40.0, 30.0];
    const NARROW: [f64; 4] = [100.0, 0.0, 110.0, 10.0];
    const BUS: [f64; 4] = [200.0, 0.0, 320.0, 60.0];
    const RIDER: [f64; 4] = [400.0, 0.0, 430.0, 50.0];

    fn vehicle(bbox_px: [f64; 4], class: VehicleClass) -> Labelled {
        Labelled { bbox_px, class: Some(class), groups: vec![("hidden share", "below 0.05".to_owned())] }
    }

    fn found(bbox_px: [f64; 4], class: VehicleClass, score: f64) -> CarRecord {
        CarRecord { class, score, ..CarRecord::boxed(bbox_px) }
    }

    /// Returns a set of one picture, and its scored detections: the wide car, the bus as a truck, and a false box.
    fn example() -> (PictureSet, Scored) {
        use VehicleClass::{Bus, Car, Motorcycle, Truck};
        let vehicles =
            vec![vehicle(WIDE, Car), vehicle(NARROW, Car), vehicle(BUS, Bus), vehicle(RIDER, Motorcycle)];
        let picture = LabelledPicture { path: "a.jpg".into(), vehicles, ignored: vec![], groups: vec![] };
        let set = PictureSet { name: "set".to_owned(), pictures: vec![picture] };
        let cars = vec![
            found(WIDE, Car, 0.9),
            found(NARROW, Car, 0.8),
            found(BUS, Truck, 0.7),
            found([600.0, 0.0, 640.0, 30.0], Car, 0.6),
            found([700.0, 0.0, 710.0, 10.0], Car, 0.5),
        ];
        let scored = score(&set, &[cars], &VehicleClass::ALL[..3], 24.0);
        (set, scored)
    }

    #[test]
    fn narrow_vehicles_and_classes_that_the_net_lacks_do_not_count() {
        let (_, scored) = example();
        let curve = scored.curve();
        assert_eq!(curve.vehicles(), 2);
        assert_eq!(curve.from_score(0.1), Counts { found: 2, wrong: 1, score: 0.1 });
        assert_eq!(scored.errors(0, 0.65), (vec![], vec![]));
        assert_eq!(scored.errors(0, 0.8), (vec![BUS], vec![]));
        assert_eq!(scored.errors(0, 0.1).1.len(), 1);
        assert_eq!(scored.found(0, 0.65), [WIDE, BUS]);
    }

    #[test]
    fn groups_are_in_order_and_count_right_classes() {
        let (set, scored) = example();
        let table = group_table("set", &set, &scored, 0.35).unwrap();
        let names: Vec<String> = table.rows.iter().map(|row| format!("{:?}", row[0])).collect();
        let expected =
            ["class: bus", "class: car", "hidden share: below 0.05", "width, px: 24–48", "width, px: 96–192"];
        assert!(names.iter().zip(expected).all(|(name, expected)| name.contains(expected)), "{names:?}");
        let value = |row: usize, column: usize| match &table.rows[row][column] {
            Cell::Number(estimate) => estimate.value,
            Cell::Text(text) => panic!("{text}"),
        };
        assert_eq!((value(0, 2), value(0, 4)), (100.0, 0.0), "the bus was found as a truck");
        assert_eq!((value(1, 2), value(1, 4)), (100.0, 100.0));
        assert!(natural("width, px: below 24") < natural("width, px: 24–48"));
        assert!(natural("width, px: 96–192") < natural("width, px: 192 and more"));
    }

    #[test]
    fn pictures_without_vehicles_have_false_boxes_alone() {
        let picture =
            LabelledPicture { path: "a.jpg".into(), vehicles: vec![], ignored: vec![], groups: vec![] };
        let set = PictureSet { name: "empty".to_owned(), pictures: vec![picture] };
        let scored = score(&set, &[vec![found(WIDE, VehicleClass::Car, 0.9)]], &VehicleClass::ALL, 24.0);
        assert!(group_table("empty", &set, &scored, 0.35).is_none());
        let table = curve_table("empty", &[("f32", scored)], 0.35);
        let text = table.to_text();
        assert!(text.contains("1.00") && !text.contains("0.90"), "{text}");
    }
}
