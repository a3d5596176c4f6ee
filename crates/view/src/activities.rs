//! Activities of tracks as drawings show them: intervals with one activity, their colours and their names.

use roadplane_base::TrackRow;

use crate::canvas::Rgb;

/// An interval in which all rows of a track have the same activity.
#[derive(Debug)]
pub(crate) struct ActivityInterval<'a, 'b> {
    pub activity: &'a str,
    pub rows: &'b [&'a TrackRow],
}

impl ActivityInterval<'_, '_> {
    /// Returns the activity, its start and end, and its mean probability as text.
    ///
    /// An example is `turning left 3.1–6.0 s (0.93)`.
    pub(crate) fn in_words(&self) -> String {
        let time = |row: Option<&&TrackRow>| row.map_or(0.0, |row| row.time_s);
        let p =
            self.rows.iter().filter_map(|row| row.activity_p).sum::<f64>() / self.rows.len().max(1) as f64;
        let (from, to) = (time(self.rows.first()), time(self.rows.last()));
        format!("{} {from:.1}–{to:.1} s ({p:.2})", words(self.activity))
    }
}

/// Returns the intervals of one track in the order of time. Intervals of `not_moving` and `moving` are left out.
pub(crate) fn activity_intervals<'a, 'b>(
    rows: &'b [&'a TrackRow],
) -> impl Iterator<Item = ActivityInterval<'a, 'b>> {
    rows.chunk_by(|a, b| a.activity == b.activity).filter_map(|rows| {
        let activity = notable_activity(rows.first()?)?;
        Some(ActivityInterval { activity, rows })
    })
}

/// Returns the activity of a row; `None` if the row has no activity, or if the activity is `not_moving` or `moving`.
pub(crate) fn notable_activity(row: &TrackRow) -> Option<&str> {
    row.activity.as_deref().filter(|activity| !matches!(*activity, "not_moving" | "moving"))
}

/// Returns the name of an activity with spaces instead of underscores.
pub(crate) fn words(activity: &str) -> String {
    activity.replace('_', " ")
}

/// Returns the colour that drawings use for an activity.
pub(crate) fn activity_colour(activity: &str) -> Rgb {
    match activity {
        "starting" => [110, 230, 120],
        "stopping" => [255, 92, 92],
        "turning_left" => [90, 200, 255],
        "turning_right" => [255, 200, 70],
        "u_turn" => [220, 130, 255],
        "reversing" => [255, 255, 255],
        _ => [170, 170, 170],
    }
}

/// Activities that have their own colour, in the order of the legend.
pub(crate) const SHOWN: [&str; 6] =
    ["starting", "stopping", "turning_left", "turning_right", "u_turn", "reversing"];
