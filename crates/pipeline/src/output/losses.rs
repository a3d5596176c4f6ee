//! Sentences for the report about lost frames, skipped frames and rejected boxes.

use std::collections::BTreeSet;

use roadplane_base::{TrackRow, VehicleClass};
use roadplane_decode::DecodeOptions;
use roadplane_write::Counts;

/// Returns one sentence for each kind of loss. The list is empty if nothing was lost.
pub(crate) fn losses_in_words(counts: &Counts, rows: &[TrackRow], options: &DecodeOptions) -> Vec<String> {
    let mut sentences = Vec::new();
    let &Counts { frames_read, frames_lost, frames_skipped, frames_not_followed, .. } = counts;
    if frames_lost > 0 {
        sentences
            .push(format!("{frames_lost} of {} frames could not be decoded.", frames_read + frames_lost));
    }
    if frames_not_followed > 0 {
        sentences.push(format!(
            "Vehicles were not followed in {frames_not_followed} frames, because of the motion of the camera."
        ));
    }
    sentences.extend(left_out(options));
    if frames_skipped > 0 {
        sentences.push(format!(
            "{frames_skipped} of {frames_read} decoded frames were skipped by these settings."
        ));
    }
    for (class, one, many) in [
        (VehicleClass::Truck, "a truck", "trucks"),
        (VehicleClass::Bus, "a bus", "buses"),
        (VehicleClass::Motorcycle, "a motorcycle", "motorcycles"),
    ] {
        let tracks: BTreeSet<u64> =
            rows.iter().filter(|row| row.class == class).map(|row| row.track).collect();
        if let Some(boxes) = counts.boxes.get(class.name()).filter(|boxes| **boxes > 0) {
            sentences.push(format!(
                "{} of {}, in {}: {} has no shape model, so position, heading and size come from the box. The error is a metre or two.",
                amount(*boxes, "box", "boxes"),
                many,
                match tracks.len() {
                    0 => "no track of the class".to_owned(),
                    n => amount(n as u64, "track", "tracks"),
                },
                one,
            ));
        }
    }
    for (reason, count) in counts.rejected.iter().filter(|(_, count)| **count > 0) {
        sentences.push(format!("{} {}.", amount(*count, "box", "boxes"), why(reason)));
    }
    sentences
}

fn left_out(options: &DecodeOptions) -> Option<String> {
    let mut parts = Vec::new();
    if options.start_s > 0.0 {
        parts.push(format!("the time before {} s", options.start_s));
    }
    if let Some(end_s) = options.end_s {
        parts.push(format!("the time from {end_s} s on"));
    }
    if options.stride > 1 {
        parts.push(format!("all but one of every {} frames", options.stride));
    }
    if let Some(most) = options.max_frames {
        parts.push(format!("all after the first {most} frames"));
    }
    (!parts.is_empty()).then(|| format!("Skipped by the configuration: {}.", parts.join(", ")))
}

fn amount(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// Returns the end of a report sentence about boxes that were rejected for `reason`.
fn why(reason: &str) -> String {
    match reason {
        "no_pose" => {
            "gave no position: too few keypoints, and no contact with the ground is visible".to_owned()
        }
        "keypoints_disagree" => {
            "gave no position: their keypoints fit no car, and no contact with the ground is visible"
                .to_owned()
        }
        "pose_not_finite" => "rejected, because their positions or boxes were not valid numbers".to_owned(),
        "keypoints_not_finite" => "rejected, because their keypoints were not finite".to_owned(),
        other => format!("rejected: {}", other.replace('_', " ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_count_has_a_sentence_and_no_loss_has_none() {
        assert!(losses_in_words(&Counts::default(), &[], &DecodeOptions::default()).is_empty());
        let counts = Counts {
            frames_read: 90,
            frames_lost: 10,
            frames_skipped: 60,
            frames_not_followed: 7,
            boxes: [("car", 400), ("truck", 135)].map(|(class, n)| (class.to_owned(), n)).into(),
            rejected: [("no_pose", 1), ("odd_one", 3)].map(|(reason, n)| (reason.to_owned(), n)).into(),
            ..Counts::default()
        };
        let options = DecodeOptions { stride: 3, start_s: 4.0, ..DecodeOptions::default() };
        let sentences = losses_in_words(&counts, &[], &options);
        assert_eq!(
            sentences,
            [
                "10 of 100 frames could not be decoded.",
                "Vehicles were not followed in 7 frames, because of the motion of the camera.",
                "Skipped by the configuration: the time before 4 s, all but one of every 3 frames.",
                "60 of 90 decoded frames were skipped by these settings.",
                "135 boxes of trucks, in no track of the class: a truck has no shape model, so position, heading and size come \
                 from the box. The error is a metre or two.",
                "1 box gave no position: too few keypoints, and no contact with the ground is visible.",
                "3 boxes rejected: odd one.",
            ]
        );
    }
}
