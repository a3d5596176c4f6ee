//! Plans from above: paths, gates and zones with the volumes of traffic; and a heat map of the time that vehicles spend.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use roadplane_traffic::{Site, TrafficFile, Vehicle};

use super::volumes::{Ink, places_with_volumes};
use crate::sheet::Sheet;

/// Largest width and height of a plan, px.
const MOST_PX: [f64; 2] = [1080.0, 560.0];
/// Margin around the paths, m.
const MARGIN_M: f64 = 3.0;
/// Largest number of paths in a plan.
const MOST_PATHS: usize = 300;
/// Size of a cell of the heat map, m.
const CELL_M: f64 = 1.0;

/// Returns the sheet that shows the central part of the paths: 1 % of the points on each side may lie outside. The longer
/// side of the ground is horizontal.
fn sheet_of(site: &Site) -> Option<Sheet> {
    let (mut xs, mut ys): (Vec<f64>, Vec<f64>) =
        vehicles(site).flat_map(|v| &v.states).step_by(7).map(|s| (s.x_m, s.y_m)).unzip();
    let range = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let skipped = values.len() / 100;
        Some([values.get(skipped)? - MARGIN_M, values.get(values.len() - 1 - skipped)? + MARGIN_M])
    };
    let ([left, right], [bottom, top]) = (range(&mut xs)?, range(&mut ys)?);
    Some(Sheet::fitted([left, right, bottom, top], top - bottom > right - left, MOST_PX))
}

/// Returns places in the drawing as the points of a line.
fn points(sheet: &Sheet, points: impl Iterator<Item = [f64; 2]>) -> String {
    let mut text = String::new();
    for [x_m, y_m] in points {
        let (x, y) = sheet.at(x_m, y_m);
        let _infallible = write!(text, "{x:.1},{y:.1} ");
    }
    text
}

/// Begins a drawing with its background and a scale bar.
fn begin(sheet: &Sheet, name: &str) -> String {
    let (width, height) = sheet.size_px();
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" role=\"img\" aria-label=\"{name}\" font-size=\"13\">\
         <rect width=\"{width:.0}\" height=\"{height:.0}\" fill=\"var(--card)\"/>"
    );
    let bar_m = [50.0, 20.0, 10.0, 5.0].into_iter().find(|m| m * sheet.px_per_m < width / 4.0).unwrap_or(5.0);
    let (x, y) = (10.0, height - 10.0);
    let _infallible = write!(
        svg,
        "<path d=\"M{x} {y:.0}h{:.1}\" stroke=\"var(--ink)\" stroke-width=\"2\"/>\
         <text x=\"{x}\" y=\"{:.0}\" fill=\"var(--ink)\">{bar_m} m</text>",
        bar_m * sheet.px_per_m,
        y - 6.0
    );
    svg
}

fn vehicles(site: &Site) -> impl Iterator<Item = &Vehicle> {
    site.clips.iter().flat_map(|clip| &clip.clip.vehicles)
}

/// Returns the plan with paths, gates, zones and volumes.
pub(super) fn plan(site: &Site, file: &TrafficFile) -> Option<String> {
    let sheet = sheet_of(site)?;
    let mut svg = begin(&sheet, "gates and volumes from above");
    let mut put = |text: std::fmt::Arguments<'_>| {
        let _infallible = svg.write_fmt(text);
    };
    let every = vehicles(site).count().div_ceil(MOST_PATHS).max(1);
    for vehicle in vehicles(site).step_by(every) {
        let states = vehicle.states.iter().step_by(3).chain(vehicle.states.last());
        let points = points(&sheet, states.map(|s| [s.x_m, s.y_m]));
        put(format_args!(
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"var(--soft)\" stroke-opacity=\".35\"/>"
        ));
    }
    let at = |[x_m, y_m]: [f64; 2]| Some(<[f64; 2]>::from(sheet.at(x_m, y_m)));
    svg.push_str(&places_with_volumes(site, file, &at, &Ink { text: "fill=\"var(--ink)\"", scale: 1.0 })?);
    svg.push_str("</svg>\n");
    Some(svg)
}

/// Returns the heat map: the time that vehicles spend in each cell of the ground.
pub(super) fn heat_map(site: &Site) -> Option<String> {
    let sheet = sheet_of(site)?;
    let mut cells: BTreeMap<(i64, i64), f64> = BTreeMap::new();
    for (a, b) in vehicles(site).flat_map(Vehicle::steps) {
        let cell = |v: f64| (v / CELL_M).floor() as i64;
        *cells.entry((cell((a.x_m + b.x_m) / 2.0), cell((a.y_m + b.y_m) / 2.0))).or_default() +=
            b.time_s - a.time_s;
    }
    let mut times: Vec<f64> = cells.values().copied().collect();
    times.sort_by(f64::total_cmp);
    // One parked vehicle must not hide the traffic, so the scale is logarithmic.
    let (least, most) = (times.first()?.ln(), times.last()?.ln());
    let mut svg = begin(&sheet, "time that vehicles spend on each square metre");
    let (side, (width, height)) = (CELL_M * sheet.px_per_m, sheet.size_px());
    for ((i, j), time_s) in cells {
        let share = if most > least { (time_s.ln() - least) / (most - least) } else { 1.0 };
        let (x, y) = sheet.at((i as f64 + 0.5) * CELL_M, (j as f64 + 0.5) * CELL_M);
        if !(0.0..width).contains(&x) || !(0.0..height).contains(&y) {
            continue;
        }
        let hue = 240.0 * (1.0 - share);
        let _infallible = write!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{side:.1}\" height=\"{side:.1}\" fill=\"hsl({hue:.0} 85% 50%)\" fill-opacity=\".8\"/>",
            x - side / 2.0,
            y - side / 2.0
        );
    }
    svg.push_str("</svg>\n");
    Some(svg)
}
