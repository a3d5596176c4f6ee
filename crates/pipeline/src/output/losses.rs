//! What a run lost, left out or could not place, a sentence each, for the report.

use std::collections::BTreeSet;

use roadplane_base::{TrackRow, VehicleClass};
use roadplane_decode::DecodeOptions;
use roadplane_write::Counts;

/// The sentences; none where nothing was lost.
pub(crate) fn losses_in_words(counts: &Counts, rows: &[TrackRow], options: &DecodeOptions) -> Vec<String> {
    let mut told = Vec::new();
    let &Counts { frames_read, frames_lost, frames_skipped, .. } = counts;
    if frames_lost > 0 {
        told.push(format!("{frames_lost} of {} frames could not be decoded.", frames_read + frames_lost));
    }
    told.extend(left_out(options));
    if frames_skipped > 0 {
        told.push(format!("{frames_skipped} of {frames_read} decoded frames were left out by that."));
    }
    for (class, name) in [(VehicleClass::Truck, "truck"), (VehicleClass::Bus, "bus")] {
        let tracks: BTreeSet<u64> =
            rows.iter().filter(|row| row.class == class).map(|row| row.track).collect();
        if let Some(boxes) = counts.boxes.get(name).filter(|boxes| **boxes > 0) {
            told.push(format!(
                "{} of {}, in {}: {} has no model of shape, so place, heading and size rest on the box, to a metre or two.",
                amount(*boxes, "box", "boxes"),
                if class == VehicleClass::Truck { "trucks" } else { "buses" },
                match tracks.len() {
                    0 => "no track of the class".to_owned(),
                    n => amount(n as u64, "track", "tracks"),
                },
                if class == VehicleClass::Truck { "a truck" } else { "a bus" },
            ));
        }
    }
    for (reason, count) in counts.rejected.iter().filter(|(_, count)| **count > 0) {
        told.push(format!("{} {}.", amount(*count, "box", "boxes"), why(reason)));
    }
    told
}

fn left_out(options: &DecodeOptions) -> Option<String> {
    let mut parts = Vec::new();
    if options.start_s > 0.0 {
        parts.push(format!("what is before {} s", options.start_s));
    }
    if let Some(end_s) = options.end_s {
        parts.push(format!("what is from {end_s} s on"));
    }
    if options.stride > 1 {
        parts.push(format!("all but every {}. frame", options.stride));
    }
    if let Some(most) = options.max_frames {
        parts.push(format!("what comes after {most} frames"));
    }
    (!parts.is_empty()).then(|| format!("As asked for, left out: {}.", parts.join(", ")))
}

fn amount(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// Why boxes gave no place.
fn why(reason: &str) -> String {
    match reason {
        "no_pose" => "gave no place: too few keypoints, and no foot on the ground in sight".to_owned(),
        "keypoints_disagree" => {
            "gave no place: their keypoints fit no car, and no foot on the ground is in sight".to_owned()
        }
        "keypoints_not_finite" => "were dropped, as their keypoints were no numbers".to_owned(),
        other => format!("left out: {}", other.replace('_', " ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_count_is_told_and_nothing_where_nothing_was_lost() {
        assert!(losses_in_words(&Counts::default(), &[], &DecodeOptions::default()).is_empty());
        let counts = Counts {
            frames_read: 90,
            frames_lost: 10,
            frames_skipped: 60,
            boxes: [("car", 400), ("truck", 135)].map(|(class, n)| (class.to_owned(), n)).into(),
            rejected: [("no_pose", 1), ("odd_one", 3)].map(|(reason, n)| (reason.to_owned(), n)).into(),
            ..Counts::default()
        };
        let options = DecodeOptions { stride: 3, start_s: 4.0, ..DecodeOptions::default() };
        let told = losses_in_words(&counts, &[], &options);
        assert_eq!(
            told,
            [
                "10 of 100 frames could not be decoded.",
                "As asked for, left out: what is before 4 s, all but every 3. frame.",
                "60 of 90 decoded frames were left out by that.",
                "135 boxes of trucks, in no track of the class: a truck has no model of shape, so place, heading and size rest on \
                 the box, to a metre or two.",
                "1 box gave no place: too few keypoints, and no foot on the ground in sight.",
                "3 boxes left out: odd one.",
            ]
        );
    }
}
