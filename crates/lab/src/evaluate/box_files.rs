//! Scores tracks and detections in files of other programs, by the overlap of boxes in the picture.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::bbox_iou;
use roadplane_tables::{Cell, Column, Report, Table};

use crate::LabError;
use crate::tables::boxes_table;
use roadplane_metrics::clear::{self, Clear};
use roadplane_metrics::hota::HotaCounts;
use roadplane_metrics::identity::Identity;
use roadplane_metrics::readers::coco::read_coco;
use roadplane_metrics::readers::kitti::{KittiTracked, read_tracked};
use roadplane_metrics::readers::mot::{MotFrames, read_mot, sequence_of_boxes};
use roadplane_metrics::text_file::read_text;

/// Scores tracks of boxes against true tracks. The similarity of two boxes is their IoU.
///
/// A file is a MOT Challenge file (commas between fields) or a label file of KITTI's tracking benchmark (spaces). In
/// KITTI's labels, the true objects are cars and vans. Tracks on other objects and in `DontCare` regions are ignored.
///
/// # Errors
/// [`MetricsError::Unreadable`](roadplane_metrics::MetricsError) if a file cannot be read, or
/// [`MetricsError::Malformed`](roadplane_metrics::MetricsError) if a file has another format.
pub fn evaluate_mot(truth: &Path, tracks: &Path) -> Result<Report, LabError> {
    let (truth, ignored) = read_frames(truth)?;
    let (mut found, _) = read_frames(tracks)?;
    for (frame, tracks) in &mut found {
        let regions = ignored.get(frame).map_or(&[][..], Vec::as_slice);
        let cars = truth.get(frame).map_or(&[][..], Vec::as_slice);
        let on = |bbox: &[f64; 4], truth: &[f64; 4]| bbox_iou(bbox, truth) >= clear::THRESHOLD;
        // A box is ignored if most of it lies inside a region. The region may be larger, because it can cover several
        // objects.
        let in_region =
            |bbox: &[f64; 4]| regions.iter().any(|region| covered_by(bbox, region) >= clear::THRESHOLD);
        tracks.retain(|(_, bbox)| cars.iter().any(|(_, car)| on(bbox, car)) || !in_region(bbox));
    }
    let sequence = sequence_of_boxes(&truth, &found);
    let hota = HotaCounts::of(&sequence).score();
    let clear = Clear::of(&sequence);
    let identity = Identity::of(&sequence);
    let note = "Similarity: IoU of the boxes. HOTA: Luiten 2021; MOTA, MOTP at IoU 0.5: Bernardin 2008; IDF1: Ristani 2016.";
    let scores = [
        ("HOTA, %", 100.0 * hota.hota),
        ("DetA, %", 100.0 * hota.det_a),
        ("AssA, %", 100.0 * hota.ass_a),
        ("LocA, %", 100.0 * hota.loc_a),
        ("MOTA, %", 100.0 * clear.mota()),
        ("MOTP, %", 100.0 * clear.motp()),
        ("IDF1, %", 100.0 * identity.idf1()),
        ("IDP, %", 100.0 * identity.precision()),
        ("IDR, %", 100.0 * identity.recall()),
        ("switches", clear.switches as f64),
    ];
    let columns = scores.map(|(title, _)| Column::new(title, if title == "switches" { 0 } else { 2 }));
    let mut table = Table::new("Tracks of boxes", note, columns.to_vec());
    table.rows.push(scores.map(|(_, value)| Cell::from(value)).to_vec());
    Ok(Report { title: "Tracks of boxes".to_owned(), tables: vec![table], ..Report::default() })
}

/// Regions in which no object needs to be found, by index of the frame. A region is left, top, right, bottom, px.
type Regions = BTreeMap<u64, Vec<[f64; 4]>>;

fn read_frames(path: &Path) -> Result<(MotFrames, Regions), LabError> {
    if read_text(path)?.lines().next().is_none_or(|line| line.contains(',')) {
        return Ok((read_mot(path)?, Regions::new()));
    }
    let (mut frames, mut regions) = (MotFrames::new(), Regions::new());
    for KittiTracked { frame, track, object } in read_tracked(path)? {
        match u64::try_from(track) {
            Ok(track) if object.is_car() => frames.entry(frame).or_default().push((track, object.bbox_px)),
            _ => regions.entry(frame).or_default().push(object.bbox_px),
        }
    }
    Ok((frames, regions))
}

/// Returns the share of a box that lies in a region.
fn covered_by(bbox: &[f64; 4], region: &[f64; 4]) -> f64 {
    let side = |low: usize, high: usize| (bbox[high].min(region[high]) - bbox[low].max(region[low])).max(0.0);
    side(0, 2) * side(1, 3) / ((bbox[2] - bbox[0]) * (bbox[3] - bbox[1]))
}

/// Scores detections against true boxes by the average precision of each category. Both files are COCO files.
///
/// # Errors
/// [`MetricsError::Unreadable`](roadplane_metrics::MetricsError) if a file cannot be read, or
/// [`MetricsError::Malformed`](roadplane_metrics::MetricsError) if a file has another format.
pub fn evaluate_coco(truth: &Path, found: &Path) -> Result<Report, LabError> {
    // All pictures form one scene, because the files do not give the scene of a picture. So there is no confidence
    // interval.
    let categories: Vec<_> =
        read_coco(truth, found)?.into_iter().map(|(name, pictures)| (name, [pictures])).collect();
    let rows: Vec<_> = categories.iter().map(|(name, scenes)| (name.as_str(), &scenes[..])).collect();
    let tables = vec![boxes_table("Boxes by category", &rows)];
    Ok(Report { title: "Boxes".to_owned(), tables, ..Report::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kitti_labels_ignore_objects_that_are_no_cars() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let line = |track: i64, kind: &str, x: u32| {
            format!("0 {track} {kind} 0 0 0 {x} 0 {} 50 1.5 1.6 4.0 1 1.6 20 0.1\n", x + 100)
        };
        let truth =
            [line(1, "Car", 0), line(2, "Van", 200), line(3, "Pedestrian", 400), line(-1, "DontCare", 600)];
        std::fs::write(at("gt.txt"), truth.concat()).unwrap();
        // The found boxes lie on the car, on the pedestrian, inside the region, and on no object.
        std::fs::write(
            at("mot.txt"),
            "0,7,0,0,100,50\n0,8,400,0,100,50\n0,9,620,10,20,20\n0,10,900,0,50,50\n",
        )
        .unwrap();
        let report = evaluate_mot(&at("gt.txt"), &at("mot.txt")).unwrap();
        let value = |column: &str| {
            let table = &report.tables[0];
            let column = table.columns.iter().position(|c| c.title == column).unwrap();
            match &table.rows[0][column] {
                Cell::Number(estimate) => estimate.value,
                Cell::Text(text) => panic!("{text}"),
            }
        };
        // One of two cars is found, and there is one false track.
        assert!((value("MOTA, %")).abs() < 1e-9 && (value("IDF1, %") - 50.0).abs() < 1e-9);
        assert!((value("DetA, %") - 100.0 / 3.0).abs() < 1e-9);
    }
}
