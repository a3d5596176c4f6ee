//! Vehicles in the report: a table of tracks, a table of their activities, and their best pictures.

use roadplane_base::TrackRow;

use super::html::{escape, put};
use super::input::{ReportInput, by_track};
use super::pictures::data_uri;

use crate::ViewError;
use crate::activities::activity_intervals;
use crate::crops::best_views;
use crate::overlay::track_colour;

/// Top speed below which a track counts as stationary, m/s.
const STATIONARY_MPS: f64 = 0.3;
/// Largest number of points in the small curve of speed over time.
const CURVE_POINTS: usize = 200;

/// Appends the table of tracks to the page, with one row per track.
pub(super) fn tracks(page: &mut String, rows: &[TrackRow]) {
    let tracks = by_track(rows);
    put(page, format_args!("<h2>{} tracks</h2>\n<div class=\"scroll\"><table><thead><tr>", tracks.len()));
    for head in [
        "track",
        "class",
        "a vehicle, %",
        "same vehicle, %",
        "from – to, s",
        "detected",
        "length × width × height, m",
        "path, m",
        "top speed, m/s",
        "heading, °",
        "sd x, y, m",
        "sd heading, °",
        "speed over time",
    ] {
        put(page, format_args!("<th>{head}</th>"));
    }
    page.push_str("</tr></thead>\n");
    for (track, rows) in &tracks {
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { continue };
        let detected = rows.iter().filter(|row| row.observed).count();
        let top = top_mps(rows);
        put(
            page,
            format_args!(
                "<tr><th>{}{track}</th><td>{}</td><td>{}</td><td>{}</td><td>{:.1} – {:.1}</td><td>{:.0} %</td><td>{:.2} × {:.2} × {:.2}</td>\
                 <td>{:.1}</td><td>{top:.1}</td><td>{:.0}</td><td>{:.2}, {:.2}</td><td>{:.1}</td><td>{}</td></tr>\n",
                dot(*track),
                last.class.name(),
                last.exists_p.map(percent).unwrap_or_default(),
                least_same_vehicle_p(rows).map(percent).unwrap_or_default(),
                first.time_s,
                last.time_s,
                100.0 * detected as f64 / rows.len() as f64,
                last.length_m,
                last.width_m,
                last.height_m,
                path_m(rows),
                last.heading_rad.to_degrees(),
                last.x_sd_m,
                last.y_sd_m,
                last.heading_sd_rad.to_degrees(),
                if top < STATIONARY_MPS { "stationary".to_owned() } else { sparkline(rows, top) },
            ),
        );
    }
    page.push_str("</table></div>\n");
}

/// Returns a probability as a whole percentage.
fn percent(p: f64) -> String {
    format!("{:.0}", 100.0 * p)
}

/// Returns the least probability, over all joins of a track, that both sides of the gap show the same vehicle; `None` for a
/// track without joins.
fn least_same_vehicle_p(rows: &[&TrackRow]) -> Option<f64> {
    rows.iter().filter_map(|row| row.same_vehicle_p).min_by(f64::total_cmp)
}

/// Returns the length of a track's path, m.
pub(super) fn path_m(rows: &[&TrackRow]) -> f64 {
    // The sum of an empty list is −0. The addition of 0 changes it to 0.
    0.0 + rows.windows(2).map(|w| (w[1].x_m - w[0].x_m).hypot(w[1].y_m - w[0].y_m)).sum::<f64>()
}

/// Returns the top speed of a track, m/s.
pub(super) fn top_mps(rows: &[&TrackRow]) -> f64 {
    rows.iter().map(|row| row.speed_mps.abs()).fold(0.0, f64::max)
}

/// Appends the activities of each track to the page. `not_moving` and `moving` are left out.
pub(super) fn activities(page: &mut String, rows: &[TrackRow]) {
    let mut lines = String::new();
    for (track, rows) in by_track(rows) {
        let intervals: Vec<String> = activity_intervals(&rows).map(|interval| interval.in_words()).collect();
        if !intervals.is_empty() {
            put(
                &mut lines,
                format_args!(
                    "<tr><th>{}{track}</th><td class=\"words\">{}</td></tr>\n",
                    dot(track),
                    escape(&intervals.join(" · "))
                ),
            );
        }
    }
    if !lines.is_empty() {
        put(
            page,
            format_args!(
                "<h2>Activities</h2>\n<div class=\"scroll\"><table>\n{lines}</table></div>\n<p class=\"hint\">Each entry gives \
                 its start and end and its probability. Times at which a vehicle is stationary or drives on are left out here. \
                 The track files contain them.</p>\n"
            ),
        );
    }
}

/// Appends an enlarged picture of each track to the page. The picture shows how well the wireframe fits the car.
pub(super) fn cars(page: &mut String, input: &ReportInput<'_>) -> Result<(), ViewError> {
    let crops = best_views(input.rows, input.samples);
    if crops.is_empty() {
        return Ok(());
    }
    page.push_str("<h2>Car by car</h2>\n<div class=\"cars\">\n");
    for crop in crops {
        put(
            page,
            format_args!(
                "<figure><img alt=\"track {0}\" src=\"{1}\"><figcaption>{2}track {0}, frame {3}</figcaption></figure>\n",
                crop.track,
                data_uri(&crop.picture)?,
                dot(crop.track),
                crop.frame
            ),
        );
    }
    page.push_str("</div>\n");
    Ok(())
}

/// Returns the HTML of a dot in the track's colour.
fn dot(track: u64) -> String {
    let [r, g, b] = track_colour(track);
    format!("<span class=\"dot\" style=\"background:rgb({r},{g},{b})\"></span>")
}

/// Returns a small curve of the speed over time as SVG. `top_mps` is the speed at the top of the curve, m/s.
fn sparkline(rows: &[&TrackRow], top_mps: f64) -> String {
    let span = rows.last().map_or(0.0, |row| row.time_s) - rows.first().map_or(0.0, |row| row.time_s);
    let points: Vec<String> = rows
        .iter()
        .step_by(rows.len().div_ceil(CURVE_POINTS).max(1))
        .map(|row| {
            let t = if span > 0.0 { (row.time_s - rows[0].time_s) / span } else { 0.0 };
            format!("{:.1},{:.1}", 1.0 + 98.0 * t, 23.0 - 22.0 * row.speed_mps.abs() / top_mps)
        })
        .collect();
    format!(
        "<svg width=\"100\" height=\"24\"><polyline points=\"{}\" fill=\"none\" stroke=\"#2a6fb0\" stroke-width=\"1.5\"/></svg>",
        points.join(" ")
    )
}
