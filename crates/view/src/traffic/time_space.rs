//! Time–space diagram: the distance of each vehicle from a gate over time, for one direction.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use nalgebra::Vector2;
use roadplane_traffic::{Direction, Site, SiteClip, TrafficFile, Vehicle};

/// Size of the diagram, px.
const SIZE_PX: [f64; 2] = [1040.0, 260.0];
/// Space for the labels, px.
const MARGIN_PX: f64 = 36.0;
/// Longest time in the diagram, s.
const LONGEST_S: f64 = 180.0;

/// Returns the diagram of the first minutes of the clip with the most crossings of the gate; `None` without crossings.
pub(super) fn time_space(
    site: &Site,
    file: &TrafficFile,
    gate: usize,
    direction: Direction,
) -> Option<String> {
    let (clip, passing) = site
        .clips
        .iter()
        .map(|clip| (clip, passing(site, file, clip, &clip.gates[gate].name, direction)))
        .max_by(|a, b| a.1.len().cmp(&b.1.len()))
        .filter(|(_, passing)| !passing.is_empty())?;
    let line = &clip.gates[gate].line;
    let along = (line[line.len() - 1] - line[0]).try_normalize(0.0)?;
    let sign = if direction == Direction::Forward { 1.0 } else { -1.0 };
    let ahead = Vector2::new(along.y, -along.x) * sign;
    let middle = line.iter().sum::<Vector2<f64>>() / line.len() as f64;
    let first = passing.iter().map(|vehicle| vehicle.span_s()[0]).fold(f64::INFINITY, f64::min);
    let end = passing.iter().map(|vehicle| vehicle.span_s()[1]).fold(0.0, f64::max);
    let span_s = (end - first).clamp(1.0, LONGEST_S);
    let mut paths: Vec<Vec<[f64; 2]>> = Vec::new();
    let (mut low, mut high) = (0.0_f64, 0.0_f64);
    for vehicle in &passing {
        let states = vehicle.states.iter().filter(|s| s.time_s - first <= span_s);
        let path: Vec<[f64; 2]> =
            states.map(|s| [s.time_s - first, (s.position() - middle).dot(&ahead)]).collect();
        for [_, place] in &path {
            (low, high) = (low.min(*place), high.max(*place));
        }
        paths.push(path);
    }
    let [width, height] = SIZE_PX;
    let x = |t: f64| MARGIN_PX + t / span_s * (width - MARGIN_PX);
    let y = |place: f64| (high - place) / (high - low).max(1.0) * (height - MARGIN_PX);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width} {height}\" width=\"{width}\" role=\"img\" aria-label=\"time–space diagram\" font-size=\"11\" \
         fill=\"var(--soft)\"><rect x=\"{MARGIN_PX}\" width=\"{:.0}\" height=\"{:.0}\" fill=\"var(--card)\"/>\
         <path d=\"M{MARGIN_PX} {:.1}H{width}\" stroke=\"#d9480f\" stroke-dasharray=\"6 4\"/>\
         <text x=\"0\" y=\"12\">{high:.0} m</text><text x=\"0\" y=\"{:.0}\">{low:.0} m</text>\
         <text x=\"{MARGIN_PX}\" y=\"{:.0}\">{first:.0} s</text>\
         <text x=\"{width}\" y=\"{:.0}\" text-anchor=\"end\">{:.0} s</text>",
        width - MARGIN_PX,
        height - MARGIN_PX,
        y(0.0),
        height - MARGIN_PX,
        height - MARGIN_PX + 16.0,
        height - MARGIN_PX + 16.0,
        first + span_s,
    );
    for path in paths {
        let _infallible = write!(svg, "<polyline fill=\"none\" stroke=\"var(--accent)\" points=\"");
        for [t, place] in path.iter().step_by(2).chain(path.last()) {
            let _infallible = write!(svg, "{:.1},{:.1} ", x(*t), y(*place));
        }
        svg.push_str("\"/>");
    }
    svg.push_str("</svg>\n");
    Some(svg)
}

/// Returns the vehicles of a clip that cross a gate in one direction.
fn passing<'a>(
    site: &Site,
    file: &TrafficFile,
    clip: &'a SiteClip,
    gate: &str,
    direction: Direction,
) -> Vec<&'a Vehicle> {
    let place = [&site.name, &clip.clip.name, gate, direction.name()];
    let crossings = file.figures.crossings.iter();
    let crossings = crossings.filter(|row| [&row.camera, &row.clip, &row.gate, &row.direction] == place);
    let tracks: BTreeSet<u64> = crossings.map(|row| row.track).collect();
    clip.clip.vehicles.iter().filter(|vehicle| tracks.contains(&vehicle.track)).collect()
}
