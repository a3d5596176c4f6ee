//! Activities of tracks for drawings: intervals of one activity, their colours and their words.

use roadplane_base::TrackRow;

use crate::canvas::Rgb;

/// An interval of a track with one activity.
#[derive(Debug)]
pub(crate) struct ActivityInterval<'a, 'b> {
    pub activity: &'a str,
    pub rows: &'b [&'a TrackRow],
}

impl ActivityInterval<'_, '_> {
    /// Returns the interval in words: `turning left 3.1–6.0 s (0.93)`, with the mean probability.
    pub(crate) fn in_words(&self) -> String {
        let time = |row: Option<&&TrackRow>| row.map_or(0.0, |row| row.time_s);
        let p =
            self.rows.iter().filter_map(|row| row.activity_p).sum::<f64>() / self.rows.len().max(1) as f64;
        let (from, to) = (time(self.rows.first()), time(self.rows.last()));
        format!("{} {from:.1}–{to:.1} s ({p:.2})", words(self.activity))
    }
}

/// Returns the intervals of one track with a notable activity, in the order of time.
pub(crate) fn activity_intervals<'a, 'b>(
    rows: &'b [&'a TrackRow],
) -> impl Iterator<Item = ActivityInterval<'a, 'b>> {
    rows.chunk_by(|a, b| a.activity == b.activity).filter_map(|rows| {
        let activity = notable_activity(rows.first()?)?;
        Some(ActivityInterval { activity, rows })
    })
}

/// Returns a row's activity, unless it is `not_moving` or `moving`.
pub(crate) fn notable_activity(row: &TrackRow) -> Option<&str> {
    row.activity.as_deref().filter(|activity| !matches!(*activity, "not_moving" | "moving"))
}

/// Returns an activity's name as words.
pub(crate) fn words(activity: &str) -> String {
    activity.replace('_', " ")
}

/// Returns the colour of an activity.
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

/// Activities with a colour of their own, in the order of the legend.
pub(crate) const SHOWN: [&str; 6] =
    ["starting", "stopping", "turning_left", "turning_right", "u_turn", "reversing"];
