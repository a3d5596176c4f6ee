//! What tracks do, as drawings need it: stretches of rows with one activity, its colour, its words.

use roadplane_base::TrackRow;

use crate::canvas::Rgb;

/// Rows of a track with one activity.
#[derive(Debug)]
pub(crate) struct Stretch<'a, 'b> {
    pub activity: &'a str,
    pub rows: &'b [&'a TrackRow],
}

impl Stretch<'_, '_> {
    /// As a reader sees it: `turning left 3.1–6.0 s (0.93)`, with the mean probability.
    pub(crate) fn in_words(&self) -> String {
        let time = |row: Option<&&TrackRow>| row.map_or(0.0, |row| row.time_s);
        let p =
            self.rows.iter().filter_map(|row| row.activity_p).sum::<f64>() / self.rows.len().max(1) as f64;
        let (from, to) = (time(self.rows.first()), time(self.rows.last()));
        format!("{} {from:.1}–{to:.1} s ({p:.2})", words(self.activity))
    }
}

/// The stretches of one track's rows, by time, in which it does something to speak of: not those in which it stands or
/// drives on.
pub(crate) fn stretches<'a, 'b>(rows: &'b [&'a TrackRow]) -> impl Iterator<Item = Stretch<'a, 'b>> {
    rows.chunk_by(|a, b| a.activity == b.activity).filter_map(|rows| {
        let activity = told(rows.first()?)?;
        Some(Stretch { activity, rows })
    })
}

/// A row's activity, unless it only stands or drives on.
pub(crate) fn told(row: &TrackRow) -> Option<&str> {
    row.activity.as_deref().filter(|activity| !matches!(*activity, "not_moving" | "moving"))
}

/// An activity's name as words.
pub(crate) fn words(activity: &str) -> String {
    activity.replace('_', " ")
}

/// The colour of an activity, and of the legend's words.
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

/// Activities with a colour of their own, in the legend's order.
pub(crate) const SHOWN: [&str; 6] =
    ["starting", "stopping", "turning_left", "turning_right", "u_turn", "reversing"];
