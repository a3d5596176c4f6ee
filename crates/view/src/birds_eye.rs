//! The view of the scene from above as SVG, to scale. Equal input gives equal text.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use roadplane_base::{Camera, ImageSize, TrackRow};

use crate::activities::{SHOWN, activity_colour, activity_intervals, words};
use crate::overlay::track_colour;

/// Width of the drawing, px.
const WIDTH_PX: f64 = 900.0;
/// Possible distances between grid lines, m.
const GRIDS_M: [f64; 4] = [5.0, 10.0, 20.0, 50.0];
/// Smallest distance between two grid lines in the drawing, px.
const GRID_ROOM_PX: f64 = 45.0;
/// Margin around the tracks, m.
const MARGIN_M: f64 = 6.0;
/// Ratio of the drawing's radius to the 90 % quantile of track distances. Each distance is measured from the camera.
///
/// Tracks beyond this radius are not drawn. Otherwise a single far track would make all other tracks very small.
const REACH: f64 = 1.6;

/// The transformation from world coordinates (m) to coordinates in the drawing (px).
struct Sheet {
    left_m: f64,
    top_m: f64,
    px_per_m: f64,
}

impl Sheet {
    fn at(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        ((x_m - self.left_m) * self.px_per_m, (self.top_m - y_m) * self.px_per_m)
    }
}

/// Returns the view from above as SVG. `rows` contains the rows of all tracks, sorted by frame.
///
/// The drawing shows a grid, the camera with its field of view, and the trajectories. It also shows each vehicle at its
/// last position, to scale, with its heading and an ellipse of 2 standard deviations.
#[must_use]
pub fn birds_eye(rows: &[TrackRow], camera: &Camera, size: ImageSize) -> String {
    let mut tracks: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        tracks.entry(row.track).or_default().push(row);
    }
    let reach_m = reach_m(&tracks);
    let beyond = tracks.values().filter(|rows| rows.iter().all(|row| distance_m(row) > reach_m)).count();
    let [left, right, bottom, top] = bounds_within(rows, reach_m);
    let px_per_m = (WIDTH_PX / (right - left)).min(1.2 * WIDTH_PX / (top - bottom));
    let sheet = Sheet { left_m: left, top_m: top, px_per_m };
    let (width, height) = ((right - left) * px_per_m, (top - bottom) * px_per_m);
    let mut svg = format!(
        "<svg class=\"birdseye\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" \
         role=\"img\" aria-label=\"bird's-eye view\" font-family=\"sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#22262b\"/>\n"
    );
    grid(&mut svg, &sheet, [left, right, bottom, top]);
    field_of_view(&mut svg, &sheet, camera, size, top);
    for (track, rows) in &tracks {
        trajectory(&mut svg, &sheet, *track, rows);
    }
    for rows in tracks.values() {
        activities(&mut svg, &sheet, rows);
    }
    if tracks.values().any(|rows| activity_intervals(rows).next().is_some()) {
        legend(&mut svg);
    }
    for (track, rows) in &tracks {
        if let Some(last) = rows.last() {
            footprint(&mut svg, &sheet, *track, last);
        }
    }
    if beyond > 0 {
        put(
            &mut svg,
            format_args!(
                "<text x=\"{:.1}\" y=\"16\" fill=\"#8a929c\" font-size=\"12\" text-anchor=\"end\">not shown: {beyond} \
                 farther than {reach_m:.0} m</text>\n",
                width - 8.0
            ),
        );
    }
    svg.push_str("</svg>\n");
    svg
}

/// Returns the left, right, bottom and top edges of the drawing in world coordinates, m.
pub(crate) fn bounds(rows: &[TrackRow]) -> [f64; 4] {
    let mut tracks: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        tracks.entry(row.track).or_default().push(row);
    }
    bounds_within(rows, reach_m(&tracks))
}

fn bounds_within(rows: &[TrackRow], reach_m: f64) -> [f64; 4] {
    let (mut left, mut right, mut bottom, mut top) = (-MARGIN_M, MARGIN_M, -MARGIN_M / 2.0, 20.0);
    for row in rows.iter().filter(|row| distance_m(row) <= reach_m) {
        left = f64::min(left, row.x_m - MARGIN_M);
        right = f64::max(right, row.x_m + MARGIN_M);
        bottom = f64::min(bottom, row.y_m - MARGIN_M);
        top = f64::max(top, row.y_m + MARGIN_M);
    }
    [left, right, bottom, top]
}

/// Returns the distance between a vehicle's position and the point on the ground below the camera, m.
fn distance_m(row: &TrackRow) -> f64 {
    row.x_m.hypot(row.y_m)
}

/// Returns the radius of the drawing around the point on the ground below the camera, m.
fn reach_m(tracks: &BTreeMap<u64, Vec<&TrackRow>>) -> f64 {
    let nearest =
        |rows: &Vec<&TrackRow>| rows.iter().map(|row| distance_m(row)).fold(f64::INFINITY, f64::min);
    let mut distances: Vec<f64> = tracks.values().map(nearest).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len().saturating_sub(1) * 9 / 10).map_or(0.0, |distance| distance * REACH)
}

/// Appends formatted text to the SVG. Writing to a string cannot fail.
fn put(svg: &mut String, text: std::fmt::Arguments<'_>) {
    let _infallible = svg.write_fmt(text);
}

fn grid(svg: &mut String, sheet: &Sheet, [left, right, bottom, top]: [f64; 4]) {
    let roomy = |grid_m: &f64| grid_m * sheet.px_per_m >= GRID_ROOM_PX;
    let grid_m = GRIDS_M.into_iter().find(roomy).unwrap_or(GRIDS_M[GRIDS_M.len() - 1]);
    let first = |from: f64| (from / grid_m).ceil() as i32;
    let last = |to: f64| (to / grid_m).floor() as i32;
    for i in first(left)..=last(right) {
        let x_m = f64::from(i) * grid_m;
        let ((x, y0), (_, y1)) = (sheet.at(x_m, top), sheet.at(x_m, bottom));
        put(svg, format_args!("<path d=\"M{x:.1} {y0:.1}V{y1:.1}\" stroke=\"#3a4048\"/>\n"));
        put(
            svg,
            format_args!(
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#8a929c\" font-size=\"11\">{x_m:.0} m</text>\n",
                x + 3.0,
                y1 - 4.0
            ),
        );
    }
    for i in first(bottom)..=last(top) {
        let y_m = f64::from(i) * grid_m;
        let ((x0, y), (x1, _)) = (sheet.at(left, y_m), sheet.at(right, y_m));
        put(svg, format_args!("<path d=\"M{x0:.1} {y:.1}H{x1:.1}\" stroke=\"#3a4048\"/>\n"));
        put(
            svg,
            format_args!(
                "<text x=\"3\" y=\"{:.1}\" fill=\"#8a929c\" font-size=\"11\">{y_m:.0} m</text>\n",
                y - 3.0
            ),
        );
    }
}

fn field_of_view(svg: &mut String, sheet: &Sheet, camera: &Camera, size: ImageSize, reach_m: f64) {
    let (x, y) = sheet.at(0.0, 0.0);
    let half = f64::from(size.width) / 2.0 / camera.focal_px;
    for side in [-half, half] {
        let (to_x, to_y) = sheet.at(side * reach_m, reach_m);
        put(
            svg,
            format_args!(
                "<path d=\"M{x:.1} {y:.1}L{to_x:.1} {to_y:.1}\" stroke=\"#59626d\" stroke-dasharray=\"5 5\"/>\n"
            ),
        );
    }
    put(svg, format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#e8ecf0\"/>\n"));
    put(
        svg,
        format_args!(
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#e8ecf0\" font-size=\"12\">camera</text>\n",
            x + 9.0,
            y + 4.0
        ),
    );
}

pub(crate) fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn trajectory(svg: &mut String, sheet: &Sheet, track: u64, rows: &[&TrackRow]) {
    let (colour, points) = (hex(track_colour(track)), points(sheet, rows));
    put(
        svg,
        format_args!(
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" opacity=\"0.8\"/>\n"
        ),
    );
}

/// Draws each interval with an activity as a path in the activity's colour, with a dot at the start.
///
/// Intervals of `not_moving` and `moving` are left out.
fn activities(svg: &mut String, sheet: &Sheet, rows: &[&TrackRow]) {
    for interval in activity_intervals(rows) {
        let colour = hex(activity_colour(interval.activity));
        let points = points(sheet, interval.rows);
        let (x, y) = interval.rows.first().map_or((0.0, 0.0), |row| sheet.at(row.x_m, row.y_m));
        put(
            svg,
            format_args!(
                "<g stroke=\"{colour}\" fill=\"none\"><title>{}</title><polyline points=\"{points}\" stroke-width=\"5\" \
                 stroke-linecap=\"round\" opacity=\"0.75\"/><circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\"/></g>\n",
                interval.in_words()
            ),
        );
    }
}

fn legend(svg: &mut String) {
    for (line, activity) in SHOWN.iter().enumerate() {
        let y = 18.0 + 16.0 * line as f64;
        put(
            svg,
            format_args!(
                "<path d=\"M40 {y:.0}h16\" stroke=\"{}\" stroke-width=\"5\"/><text x=\"62\" y=\"{:.0}\" fill=\"#c8ced4\" \
                 font-size=\"12\">{}</text>\n",
                hex(activity_colour(activity)),
                y + 4.0,
                words(activity)
            ),
        );
    }
}

fn points(sheet: &Sheet, rows: &[&TrackRow]) -> String {
    let point = |row: &&TrackRow| {
        let (x, y) = sheet.at(row.x_m, row.y_m);
        format!("{x:.1},{y:.1}")
    };
    let mut points: Vec<String> = rows.iter().map(point).collect();
    // A car that is stationary for hours gives one point.
    points.dedup();
    if points.len() == 1 {
        points.push(points[0].clone());
    }
    points.join(" ")
}

fn footprint(svg: &mut String, sheet: &Sheet, track: u64, row: &TrackRow) {
    let colour = hex(track_colour(track));
    let (sin, cos) = row.heading_rad.sin_cos();
    let corner = |forward: f64, left: f64| {
        let (x, y) = sheet.at(row.x_m + forward * cos - left * sin, row.y_m + forward * sin + left * cos);
        format!("{x:.1},{y:.1}")
    };
    let (l, w) = (row.length_m / 2.0, row.width_m / 2.0);
    let body = [corner(l, w), corner(l, -w), corner(-l, -w), corner(-l, w)].join(" ");
    let bonnet = [corner(l, w * 0.8), corner(l * 1.0, -w * 0.8), corner(l * 0.45, 0.0)].join(" ");
    let (x, y) = sheet.at(row.x_m, row.y_m);
    let (rx, ry) = (2.0 * row.x_sd_m * sheet.px_per_m, 2.0 * row.y_sd_m * sheet.px_per_m);
    put(
        svg,
        format_args!(
            "<polygon points=\"{body}\" fill=\"{colour}\" fill-opacity=\"0.35\" stroke=\"{colour}\"/>\n"
        ),
    );
    put(svg, format_args!("<polygon points=\"{bonnet}\" fill=\"{colour}\"/>\n"));
    put(
        svg,
        format_args!(
            "<ellipse cx=\"{x:.1}\" cy=\"{y:.1}\" rx=\"{rx:.1}\" ry=\"{ry:.1}\" fill=\"none\" stroke=\"#ffffff\" stroke-opacity=\"0.7\"/>\n"
        ),
    );
    put(
        svg,
        format_args!(
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#ffffff\" font-size=\"13\">{track}</text>\n",
            x + 6.0,
            y - 6.0
        ),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_track_is_drawn_and_the_text_is_deterministic() {
        let row = |track: u64, frame: u64| TrackRow {
            x_m: track as f64 * 3.0,
            y_m: 20.0 + frame as f64,
            heading_rad: 1.0,
            speed_mps: 1.0,
            ..roadplane_synth::stationary_row(track, frame, 0.1 * frame as f64)
        };
        let rows: Vec<TrackRow> = (0..3).flat_map(|frame| [row(1, frame), row(2, frame)]).collect();
        let size = ImageSize { width: 640, height: 480 };
        let draw = || birds_eye(&rows, &Camera::centred(700.0, size), size);
        assert_eq!(draw(), draw());
        assert_eq!(draw().matches("<polyline").count(), 2);
        assert_eq!(draw().matches("<ellipse").count(), 2);
        let far: Vec<TrackRow> =
            (1..=20).map(|i| TrackRow { y_m: if i == 20 { 900.0 } else { 30.0 }, ..row(i, 0) }).collect();
        assert!(birds_eye(&far, &Camera::centred(700.0, size), size).contains("not shown: 1 farther"));
        assert!(!draw().contains("not shown"));
        assert!(birds_eye(&[], &Camera::centred(700.0, size), size).ends_with("</svg>\n"));
    }
}
