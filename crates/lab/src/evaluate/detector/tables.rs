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
    columns.extend(
        ["at 90 %: found", "score", "at 95 %: found", "score", "best F1: found", "false", "score"]
            .map(|head| Column::new(head, if head == "score" { 2 } else { 0 })),
    );
    columns.push(Column::new(format!("from {threshold:.2}: found"), 0));
    columns.extend([Column::new("false", 0), Column::new("false a picture", 2)]);
    let note = "A vehicle is found by a box with an IoU of 0.5 (AP70: 0.7). AP as in COCO. At 90 and 95 %: the most \
                vehicles that are found with this precision, and the score that gives them.";
    let mut table = Table::new(format!("Detector: {set}"), note, columns);
    for (name, scored) in rows {
        let curve = scored.curve();
        let whole = |counts: usize| Cell::from(counts as f64);
        let found_at = |Counts { found, score, .. }: Counts| [whole(found), score.into()];
        let mut row = vec![Cell::from(*name), scored.judged.len().to_string().into()];
        row.push(curve.vehicles().to_string().into());
        for iou in [0, 1] {
            let ap = |chosen: &[&[JudgedPicture; 2]]| {
                let pictures: Vec<&JudgedPicture> = chosen.iter().map(|picture| &picture[iou]).collect();
                100.0 * DetectionCurve::of(&pictures).average_precision()
            };
            row.push(bootstrap_scenes(&scored.judged, curve.vehicles(), ap).into());
        }
        row.extend(found_at(curve.at_precision(0.9)));
        row.extend(found_at(curve.at_precision(0.95)));
        let best = curve.at_best_f1();
        row.extend([whole(best.found), whole(best.wrong), best.score.into()]);
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
    groups.sort_by(|a, b| natural(&a.0).cmp(&natural(&b.0)));
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
