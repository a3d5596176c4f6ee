//! The view of the scene from above as SVG, to scale. Equal input gives equal text.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use roadplane_base::{Camera, ImageSize, TrackRow};

use crate::activities::{SHOWN, activity_colour, activity_intervals, words};
use crate::overlay::track_colour;
use crate::sheet::Sheet;

/// Largest width and height of the plan in the drawing, px.
const PLAN_PX: [f64; 2] = [1140.0, 760.0];
/// Ratio of height to width above which the plan is turned. The viewing direction then points to the right.
const TURN_RATIO: f64 = 1.2;
/// Smallest ratio of the plan's short side to its long side. A narrower plan gets a wider margin.
const LEAST_RATIO: f64 = 0.2;
/// Height of a line of the legend, px.
const LEGEND_LINE_PX: f64 = 20.0;
/// Width of an entry of the legend, px.
const LEGEND_ENTRY_PX: f64 = 120.0;
/// Height of the numbers of tracks, px.
const NUMBER_PX: f64 = 13.0;
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

/// Returns the sheet for a plan with these edges: left, right, bottom, top, m. A narrow plan gets wider.
fn sheet_of([mut left, mut right, bottom, top]: [f64; 4]) -> Sheet {
    let (wide_m, high_m) = (right - left, top - bottom);
    let turned = high_m > TURN_RATIO * wide_m;
    if turned {
        let more_m = (LEAST_RATIO * high_m - wide_m).max(0.0) / 2.0;
        (left, right) = (left - more_m, right + more_m);
    }
    Sheet::fitted([left, right, bottom, top], turned, PLAN_PX)
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
    let sheet = sheet_of(bounds_within(rows, reach_m));
    let (width, height) = sheet.size_px();
    let has_legend = tracks.values().any(|rows| activity_intervals(rows).next().is_some());
    let columns = if has_legend { ((width / LEGEND_ENTRY_PX) as usize).clamp(1, SHOWN.len()) } else { 1 };
    let lines = if has_legend { SHOWN.len().div_ceil(columns) } else { 0 };
    let full_height = height + LEGEND_LINE_PX * lines as f64;
    let mut svg = format!(
        "<svg class=\"birdseye\" viewBox=\"0 0 {width:.0} {full_height:.0}\" width=\"{width:.0}\" height=\"{full_height:.0}\" \
         role=\"img\" aria-label=\"bird's-eye view\" font-family=\"sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#22262b\"/>\n\
         <svg width=\"{width:.0}\" height=\"{height:.0}\">\n"
    );
    grid(&mut svg, &sheet);
    field_of_view(&mut svg, &sheet, camera, size);
    for (track, rows) in &tracks {
        trajectory(&mut svg, &sheet, *track, rows);
    }
    for rows in tracks.values() {
        activities(&mut svg, &sheet, rows);
    }
    let mut numbers = Numbers::default();
    for (track, rows) in &tracks {
        if let Some(last) = rows.last() {
            footprint(&mut svg, &sheet, *track, last);
            numbers.add(&sheet, *track, last);
        }
    }
    svg.push_str(&numbers.svg);
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
    if has_legend {
        legend(&mut svg, height, columns);
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

fn grid(svg: &mut String, sheet: &Sheet) {
    let [left, right, bottom, top] = sheet.edges_m;
    let roomy = |grid_m: &f64| grid_m * sheet.px_per_m >= GRID_ROOM_PX;
    let grid_m = GRIDS_M.into_iter().find(roomy).unwrap_or(GRIDS_M[GRIDS_M.len() - 1]);
    let inside = |from: f64, to: f64| {
        let numbers = (from / grid_m).ceil() as i32..=(to / grid_m).floor() as i32;
        numbers.map(|i| f64::from(i) * grid_m)
    };
    let across = inside(left, right).map(|x_m| (x_m, [(x_m, bottom), (x_m, top)]));
    let along = inside(bottom, top).map(|y_m| (y_m, [(left, y_m), (right, y_m)]));
    let height = sheet.size_px().1;
    for (metres, ends) in across.chain(along) {
        let [(x0, y0), (x1, y1)] = ends.map(|(x_m, y_m)| sheet.at(x_m, y_m));
        // The distance is written at the lower end or at the left end of the line.
        let (x, y) = if (x0 - x1).abs() < 0.5 { (x0 + 3.0, height - 4.0) } else { (3.0, y0 - 3.0) };
        put(
            svg,
            format_args!(
                "<path d=\"M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}\" stroke=\"#3a4048\"/>\n\
                 <text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"#8a929c\" font-size=\"11\">{metres:.0} m</text>\n"
            ),
        );
    }
}

fn field_of_view(svg: &mut String, sheet: &Sheet, camera: &Camera, size: ImageSize) {
    let (x, y) = sheet.at(0.0, 0.0);
    let half = f64::from(size.width) / 2.0 / camera.focal_px;
    let reach_m = sheet.edges_m[3];
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

/// Draws the colours of the activities below the plan, whose height is `below_px`.
fn legend(svg: &mut String, below_px: f64, columns: usize) {
    for (i, activity) in SHOWN.iter().enumerate() {
        let x = 10.0 + LEGEND_ENTRY_PX * (i % columns) as f64;
        let y = below_px + LEGEND_LINE_PX * ((i / columns) as f64 + 0.5);
        put(
            svg,
            format_args!(
                "<path d=\"M{x:.0} {y:.0}h16\" stroke=\"{}\" stroke-width=\"5\"/><text x=\"{:.0}\" y=\"{:.0}\" fill=\"#c8ced4\" \
                 font-size=\"12\">{}</text>\n",
                hex(activity_colour(activity)),
                x + 22.0,
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
    let [sd_right, sd_down] = if sheet.turned { [row.y_sd_m, row.x_sd_m] } else { [row.x_sd_m, row.y_sd_m] };
    let (rx, ry) = (2.0 * sd_right * sheet.px_per_m, 2.0 * sd_down * sheet.px_per_m);
    put(
        svg,
        format_args!(
            "<polygon points=\"{body}\" fill=\"{colour}\" fill-opacity=\"0.35\" stroke=\"{colour}\"><title>track {track}</title>\
             </polygon>\n"
        ),
    );
    put(svg, format_args!("<polygon points=\"{bonnet}\" fill=\"{colour}\"/>\n"));
    put(
        svg,
        format_args!(
            "<ellipse cx=\"{x:.1}\" cy=\"{y:.1}\" rx=\"{rx:.1}\" ry=\"{ry:.1}\" fill=\"none\" stroke=\"#ffffff\" stroke-opacity=\"0.45\"/>\n"
        ),
    );
}

/// The numbers of tracks in the drawing. A number is left out if it would cover another one.
#[derive(Default)]
struct Numbers {
    svg: String,
    /// Left, top, right and bottom edges of the numbers, px.
    taken: Vec<[f64; 4]>,
}

impl Numbers {
    /// Adds the number of a track beside its last position, at the first free one of four places.
    fn add(&mut self, sheet: &Sheet, track: u64, row: &TrackRow) {
        let (x, y) = sheet.at(row.x_m, row.y_m);
        let text = track.to_string();
        let wide = 0.62 * NUMBER_PX * text.len() as f64;
        let (width, height) = sheet.size_px();
        let places = [(6.0, -6.0), (6.0, 16.0), (-6.0 - wide, -6.0), (-6.0 - wide, 16.0)];
        for (left, base) in places.map(|(right, down)| (x + right, y + down)) {
            let [x0, y0, x1, y1] = [left, base - 0.8 * NUMBER_PX, left + wide, base];
            let is_inside = x0 >= 0.0 && y0 >= 0.0 && x1 <= width && y1 <= height;
            let is_free = self.taken.iter().all(|t| x1 < t[0] || x0 > t[2] || y1 < t[1] || y0 > t[3]);
            if is_inside && is_free {
                self.taken.push([x0, y0, x1, y1]);
                put(
                    &mut self.svg,
                    format_args!(
                        "<text x=\"{left:.1}\" y=\"{base:.1}\" fill=\"#ffffff\" font-size=\"{NUMBER_PX}\">{text}</text>\n"
                    ),
                );
                return;
            }
        }
    }
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

    #[test]
    fn a_long_plan_is_turned_to_the_right_without_mirroring() {
        let wide = sheet_of([-30.0, 30.0, -3.0, 40.0]);
        assert!(!wide.turned && wide.at(-30.0, 40.0) == (0.0, 0.0));
        let motorway = sheet_of([-10.0, 50.0, -3.0, 237.0]);
        assert!(motorway.turned);
        let (width, height) = motorway.size_px();
        assert!((width - PLAN_PX[0]).abs() < 1e-9 && (height - 285.0).abs() < 1e-9, "{width} {height}");
        let ((x, y), (ahead, level), (beside, lower)) =
            (motorway.at(0.0, 20.0), motorway.at(0.0, 30.0), motorway.at(5.0, 20.0));
        assert!(ahead > x && level == y, "ahead of the camera is to the right");
        assert!(lower > y && beside == x, "right of the camera is below");
        let lane = sheet_of([-6.0, 6.0, -3.0, 397.0]).size_px();
        assert!((lane.1 / lane.0 - LEAST_RATIO).abs() < 1e-9);
    }

    #[test]
    fn numbers_that_would_cover_each_other_are_left_out() {
        let rows: Vec<TrackRow> = (1..=9)
            .map(|track| TrackRow { y_m: 20.0, ..roadplane_synth::stationary_row(track, 0, 0.0) })
            .collect();
        let size = ImageSize { width: 640, height: 480 };
        let svg = birds_eye(&rows, &Camera::centred(700.0, size), size);
        assert_eq!(svg.matches("font-size=\"13\"").count(), 4);
        assert_eq!(svg.matches("<title>track").count(), 9);
    }
}
