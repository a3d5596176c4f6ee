//! Effect of each step of the tracker: clips are tracked with all steps, and again with one step left out at a time.

use roadplane_metrics::clear::Clear;
use roadplane_metrics::hota::HotaCounts;
use roadplane_metrics::identity::Identity;
use roadplane_metrics::scoring::TrackScore;
use roadplane_tables::{Cell, Column, Table, bootstrap, mean};
use roadplane_track::TrackStep;

/// The rows of the table: the name of the row, and the step of the tracker that is left out there.
pub(super) const VARIANTS: [(&str, Option<TrackStep>); 12] = [
    ("all steps", None),
    ("new tracks not confirmed", Some(TrackStep::Confirm)),
    ("no merging of tracks", Some(TrackStep::Merge)),
    ("no links over gaps", Some(TrackStep::Link)),
    ("improbable links, too", Some(TrackStep::Cut)),
    ("all tracks exist", Some(TrackStep::Existence)),
    ("no tracklets of free boxes", Some(TrackStep::Boxes)),
    ("path and size not together", Some(TrackStep::ByBoxes)),
    ("no second pass", Some(TrackStep::SecondPass)),
    ("no colours", Some(TrackStep::Colours)),
    ("no hidden edges", Some(TrackStep::HiddenEdges)),
    ("boxes of others not checked", Some(TrackStep::OwnBoxes)),
];

/// Figures of a clip's tracks, on the ground after the fit of one scale.
#[derive(Clone, Copy)]
struct Figures {
    /// HOTA, %.
    hota: f64,
    /// IDF1, %.
    idf1: f64,
    /// Number of identity switches.
    switches: f64,
}

impl Figures {
    fn of(score: &TrackScore) -> Self {
        Self {
            hota: 100.0 * HotaCounts::of(&score.fitted).score().hota,
            idf1: 100.0 * Identity::of(&score.fitted).idf1(),
            switches: Clear::of(&score.fitted).switches as f64,
        }
    }
}

/// Returns the table of the steps' effects. `scores` has the scores of all clips for each of the [`VARIANTS`].
pub(super) fn layers_table(scores: &[Vec<TrackScore>]) -> Table {
    let columns = [
        ("HOTA fitted, %", 1),
        ("more than with all", 2),
        ("IDF1 fitted, %", 1),
        ("more than with all", 2),
        ("switches a clip, more", 2),
    ];
    let mut table = Table::new(
        "Steps of the tracker left out",
        "Means over clips, on the ground, after the fit of one scale a clip. More: minus the figure with all steps in the \
         same clip; an interval below 0 (for switches: above 0) shows that the step is worth its cost. 95 % intervals by \
         resampling clips.",
        std::iter::once(Column::new("", 0))
            .chain(columns.map(|(title, decimals)| Column::new(title, decimals)))
            .collect(),
    );
    let figures: Vec<Vec<Figures>> =
        scores.iter().map(|clips| clips.iter().map(Figures::of).collect()).collect();
    for ((name, _), own) in VARIANTS.into_iter().zip(&figures) {
        let average = |of: fn(&Figures) -> f64| mean(&own.iter().map(of).collect::<Vec<_>>());
        let more = |of: fn(&Figures) -> f64| {
            let pairs = own.iter().zip(&figures[0]);
            bootstrap(&pairs.map(|(own, all)| vec![of(own) - of(all)]).collect::<Vec<_>>(), mean)
        };
        table.rows.push(vec![
            Cell::from(name),
            average(|f| f.hota).into(),
            more(|f| f.hota).into(),
            average(|f| f.idf1).into(),
            more(|f| f.idf1).into(),
            more(|f| f.switches).into(),
        ]);
    }
    table
}
