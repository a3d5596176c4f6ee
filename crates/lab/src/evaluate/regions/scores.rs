//! Scores clips against their truth, with and without region-of-interest scheduling.
//!
//! The measures are those that `roadplane-lab eval dataset` shows for runs from video.

use roadplane_base::ShapeAtlas;
use roadplane_tables::{Cell, Column, Table, bootstrap_scenes, median, share_within};

use crate::finished_run::FinishedRun;
use roadplane_metrics::hota::HotaCounts;
use roadplane_metrics::identity::Identity;
use roadplane_metrics::scoring::{PoseScore, score_poses, score_tracks};
use roadplane_metrics::truth::Truth;

/// Scores of one run of a clip against its truth.
pub(super) struct ClipScore {
    hota: HotaCounts,
    fitted: HotaCounts,
    identity: Identity,
    poses: Vec<PoseScore>,
    positions_m: Vec<f64>,
    focal_relative: f64,
}

impl ClipScore {
    pub(super) fn of(run: &FinishedRun, truth: &Truth, atlas: &ShapeAtlas) -> Self {
        let frames = run.analysed(truth);
        let analysed = |frame: u64, _: f64| frames.contains(&frame);
        let tracks = score_tracks(truth, &run.rows, analysed);
        Self {
            hota: HotaCounts::of(&tracks.sequence),
            fitted: HotaCounts::of(&tracks.fitted),
            identity: Identity::of(&tracks.fitted),
            poses: score_poses(truth, &run.poses, atlas, analysed),
            positions_m: tracks.positions.iter().map(|error| error.error_m).collect(),
            focal_relative: run.camera.focal_px / truth.camera.focal_px - 1.0,
        }
    }

    /// Returns the HOTA of the tracks, %.
    pub(super) fn hota(&self) -> f64 {
        hota(&[&self.hota])
    }

    /// Returns the HOTA (%) of the tracks after scaling all positions by one factor that fits the truth best.
    pub(super) fn fitted_hota(&self) -> f64 {
        hota(&[&self.fitted])
    }
}

fn hota(clips: &[&HotaCounts]) -> f64 {
    100.0 * HotaCounts::sum(clips.iter().copied()).score().hota
}

/// The name of a measure, and its value for some clips.
type Measure = (&'static str, fn(&[&ClipScore]) -> f64);

const MEASURES: [Measure; 8] = [
    ("HOTA, %", |clips| hota(&clips.iter().map(|clip| &clip.hota).collect::<Vec<_>>())),
    ("HOTA fitted, %", |clips| hota(&clips.iter().map(|clip| &clip.fitted).collect::<Vec<_>>())),
    ("IDF1 fitted, %", |clips| 100.0 * Identity::sum(clips.iter().map(|clip| &clip.identity)).idf1()),
    ("ADD ≤ 0.2 d, %", |clips| 100.0 * share_within(&poses(clips, |pose| pose.add), 0.2)),
    ("ADD ≤ 0.4 d, %", |clips| 100.0 * share_within(&poses(clips, |pose| pose.add), 0.4)),
    ("rotation ≤ 0.14 rad, %", |clips| 100.0 * share_within(&poses(clips, |pose| pose.rotation_rad), 0.14)),
    ("position, median m", |clips| {
        median(&clips.iter().flat_map(|clip| clip.positions_m.iter().copied()).collect::<Vec<_>>())
    }),
    ("focal, median % off", |clips| {
        100.0 * median(&clips.iter().map(|clip| clip.focal_relative.abs()).collect::<Vec<_>>())
    }),
];

fn poses(clips: &[&ClipScore], of: fn(&PoseScore) -> f64) -> Vec<f64> {
    clips.iter().flat_map(|clip| clip.poses.iter().map(of)).collect()
}

/// Returns a table with one row per measure: its value without region-of-interest scheduling (off), its value with
/// scheduling (on), and their difference.
///
/// `clips` holds the scores of each clip: off and on.
pub(super) fn table(clips: &[[ClipScore; 2]]) -> Table {
    let note = "Clips from their video alone, as one long sequence, with 95 % intervals by resampling clips; the \
        difference is of the same clips. Fitted: scored after one scale per clip, about the camera's foot, that fits the clip best. \
        Poses: of every frame and car; cars without a pose count as wrong. The other rows of `eval dataset` (stills, \
        given boxes) use no such scheduling.";
    let titles = ["off", "on", "on − off"].map(|title| Column::new(title, 2));
    let columns = std::iter::once(Column::new("measure", 0)).chain(titles).collect();
    let mut table = Table::new(format!("Against truth, {} clips", clips.len()), note, columns);
    for (name, number) in MEASURES {
        let of = |chosen: &[&[ClipScore; 2]], on: usize| {
            number(&chosen.iter().map(|clip| &clip[on]).collect::<Vec<_>>())
        };
        let estimate = |statistic: &dyn Fn(&[&[ClipScore; 2]]) -> f64| -> Cell {
            bootstrap_scenes(clips, clips.len(), statistic).into()
        };
        table.rows.push(vec![
            name.into(),
            estimate(&|chosen| of(chosen, 0)),
            estimate(&|chosen| of(chosen, 1)),
            estimate(&|chosen| of(chosen, 1) - of(chosen, 0)),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_metrics::sequence::Sequence;

    fn clip(adds: &[f64], focal_relative: f64) -> ClipScore {
        let pose =
            |add: &f64| PoseScore { distance_m: 20.0, add: *add, add_of_pose: *add, rotation_rad: 0.1 };
        let nothing = Sequence::default();
        ClipScore {
            hota: HotaCounts::of(&nothing),
            fitted: HotaCounts::of(&nothing),
            identity: Identity::of(&nothing),
            poses: adds.iter().map(pose).collect(),
            positions_m: adds.to_vec(),
            focal_relative,
        }
    }

    #[test]
    fn an_equal_loss_of_all_clips_has_a_narrow_interval() {
        // The clips differ from each other. The two runs of a clip differ in only one of four cars.
        let clips =
            [0.1, 0.3].map(|add| [clip(&[add; 4], -0.02), clip(&[add, add, add, f64::INFINITY], 0.03)]);
        let table = table(&clips);
        let row = |name: &str| {
            let row = table.rows.iter().find(|row| row[0] == Cell::from(name)).unwrap();
            [1, 2, 3].map(|column| match &row[column] {
                Cell::Number(estimate) => *estimate,
                Cell::Text(text) => panic!("{text}"),
            })
        };
        let [off, on, gain] = row("ADD ≤ 0.4 d, %");
        assert_eq!((off.value, on.value), (100.0, 75.0));
        assert_eq!((gain.value, gain.low, gain.high), (-25.0, -25.0, -25.0));
        let [off, on, gain] = row("ADD ≤ 0.2 d, %");
        assert_eq!((off.value, on.value, gain.value), (50.0, 37.5, -12.5));
        assert_eq!((gain.low, gain.high), (-25.0, 0.0), "the difference of either clip");
        let focal = row("focal, median % off").map(|estimate| estimate.value);
        assert!(focal.iter().zip([2.0, 3.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{focal:?}");
    }
}
