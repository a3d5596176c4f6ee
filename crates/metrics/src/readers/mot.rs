//! Reads tracks in the format of the MOT Challenge. The fields of a line are `frame, id, left, top, width, height, …`.
//! Boxes are in px, and frames are counted from 1.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use roadplane_base::bbox_iou;

use super::{field, lines, number};
use crate::MetricsError;
use crate::sequence::{Sequence, SequenceFrame};

/// Boxes of each frame, by frame number. Each box has the id of its track, and its left, top, right and bottom, px.
pub type MotFrames = BTreeMap<u64, Vec<(u64, [f64; 4])>>;

/// Reads a file of tracks. All fields after the sixth are ignored.
///
/// # Errors
/// [`MetricsError::Unreadable`], or [`MetricsError::Malformed`], which names the line and the field.
pub fn read_mot(path: &Path) -> Result<MotFrames, MetricsError> {
    let rows = lines(
        path,
        |line| line.split(',').map(str::trim).collect(),
        |fields| {
            let frame: u64 = field(fields, 0, "frame")?;
            let track: u64 = field(fields, 1, "id")?;
            let at = |index: usize, name: &str| number(fields, index, name);
            let [left, top, width, height] =
                [at(2, "left")?, at(3, "top")?, at(4, "width")?, at(5, "height")?];
            if width > 0.0 && height > 0.0 {
                Ok((frame, (track, [left, top, left + width, top + height])))
            } else {
                Err("the box has no area".to_owned())
            }
        },
    )?;
    let mut frames = MotFrames::new();
    let mut seen = BTreeSet::new();
    for (frame, (track, bbox_px)) in rows {
        if !seen.insert((frame, track)) {
            return Err(MetricsError::malformed(path, format!("frame {frame}: id {track} appears twice")));
        }
        frames.entry(frame).or_default().push((track, bbox_px));
    }
    Ok(frames)
}

/// Combines true and estimated tracks into a sequence. The similarity of two boxes is their IoU.
#[must_use]
pub fn sequence_of_boxes(truth: &MotFrames, tracks: &MotFrames) -> Sequence {
    let frames: BTreeSet<u64> = truth.keys().chain(tracks.keys()).copied().collect();
    let of = |all: &MotFrames, frame: u64| all.get(&frame).cloned().unwrap_or_default();
    let side_by_side = |frame: u64| SequenceFrame::new(&of(truth, frame), &of(tracks, frame), bbox_iou);
    frames.into_iter().map(side_by_side).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_are_read_and_compared() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gt.txt");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_mot(&path)
        };
        let truth = read("1,7,0,0,10,10,1,-1,-1,-1\n2,7,0,0,10,10\n2, 8, 50, 0, 10, 10\n").unwrap();
        let tracks = read("2,3,5,0,10,10,0.9,-1,-1,-1\n4,3,5,0,10,10\n").unwrap();
        let sequence = sequence_of_boxes(&truth, &tracks);
        assert_eq!(sequence.len(), 3);
        assert_eq!((&sequence[1].truth, &sequence[1].found), (&vec![7, 8], &vec![3]));
        assert!((sequence[1].similarity[0][0] - 1.0 / 3.0).abs() < 1e-12);
        for (text, word) in [
            ("1,7,0,0,10", "line 1: height is missing"),
            ("1,-7,0,0,10,10", "id \"-7\""),
            ("\n1,7,0,0,0,10", "line 2: the box has no area"),
            ("1,7,0,0,9,9\n1,7,0,0,9,9", "id 7 appears twice"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(word) && error.ends_with("gt.txt"), "{error}");
        }
    }
}
