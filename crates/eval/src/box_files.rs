//! Boxes in files of others' forms, compared in the picture.

use std::path::Path;

use crate::metrics::clear::Clear;
use crate::metrics::hota::HotaCounts;
use crate::metrics::identity::Identity;
use crate::readers::coco::read_coco;
use crate::readers::mot::{read_mot, sequence_of_boxes};
use crate::tables::boxes_table;
use crate::{Cell, Column, EvalError, Report, Table};

/// Tracks of boxes against true ones, both as MOT Challenge files, alike by IoU.
///
/// # Errors
/// [`EvalError::Unreadable`] or [`EvalError::Malformed`].
pub fn evaluate_mot(truth: &Path, tracks: &Path) -> Result<Report, EvalError> {
    let sequence = sequence_of_boxes(&read_mot(truth)?, &read_mot(tracks)?);
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
    Ok(Report { title: "Tracks of boxes".to_owned(), tables: vec![table], plots: Vec::new() })
}

/// Detections against true boxes, both as COCO files: average precision of each category.
///
/// # Errors
/// [`EvalError::Unreadable`] or [`EvalError::Malformed`].
pub fn evaluate_coco(truth: &Path, found: &Path) -> Result<Report, EvalError> {
    // All pictures as one scene: nobody says which of them belong together, so there is no interval.
    let categories: Vec<_> =
        read_coco(truth, found)?.into_iter().map(|(name, pictures)| (name, [pictures])).collect();
    let rows: Vec<_> = categories.iter().map(|(name, scenes)| (name.as_str(), &scenes[..])).collect();
    let tables = vec![boxes_table("Boxes by category", &rows)];
    Ok(Report { title: "Boxes".to_owned(), tables, plots: Vec::new() })
}
