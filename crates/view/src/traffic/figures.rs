//! The diagrams of a camera, for the page and as files of their own.

use roadplane_traffic::{CountRow, Direction, Gate, Group, Site, TrafficFile};

use super::charts::{Bar, bars};
use super::plan::{heat_map, plan};
use super::time_space::time_space;
use super::{is_here, time_of_day};

/// A diagram.
pub(super) struct Figure {
    /// Its content, as part of a file name.
    name: String,
    pub(super) svg: String,
    pub(super) caption: String,
}

impl Figure {
    fn new(name: &str, caption: &str, svg: String) -> Self {
        Self { name: name.to_owned(), svg, caption: caption.to_owned() }
    }
}

/// Returns the diagrams of a whole camera.
pub(super) fn of_camera(file: &TrafficFile, site: &Site) -> Vec<Figure> {
    let volumes = "Gates and zones from above. An arrow is as wide as its number of vehicles.";
    let times =
        "Time that vehicles spend on each square metre, from blue (short) to red (long), logarithmic.";
    let plan = plan(site, file).map(|svg| Figure::new("volumes", volumes, svg));
    let heat = heat_map(site).map(|svg| Figure::new("heat_map", times, svg));
    plan.into_iter().chain(heat).collect()
}

/// Returns the diagrams of a gate in one direction.
pub(super) fn of_gate(file: &TrafficFile, site: &Site, gate: usize, direction: Direction) -> Vec<Figure> {
    let Some(place) = site.clips.first().map(|clip| clip.gates[gate].name.as_str()) else {
        return Vec::new();
    };
    let here = |group: &Group| is_here(group, site, place, direction.name());
    let counts: Vec<_> = file.figures.counts.iter().filter(|row| here(&row.group)).collect();
    let mut figures = Vec::new();
    if counts.len() > 1 {
        let caption = "Vehicles by period. A line is the interval of 95 %.";
        figures.push(Figure::new("periods", caption, periods(&counts)));
    }
    if let Some(svg) = histogram(file, &here) {
        let caption = format!("Vehicles by speed, {}.", file.units.name());
        figures.push(Figure::new("speeds", &caption, svg));
    }
    if let Some(svg) = time_space(site, file, gate, direction) {
        let caption = "Distance from the gate over time, one line per vehicle. The dashed line is the gate.";
        figures.push(Figure::new("time_space", caption, svg));
    }
    figures
}

fn periods(counts: &[&CountRow]) -> String {
    let bar = |row: &&CountRow| Bar {
        label: time_of_day(&row.group.from).to_owned(),
        value: row.vehicles.map(|n| n as f64),
        interval: row.vehicles_low.zip(row.vehicles_high).map(|(low, high)| [low as f64, high as f64]),
    };
    bars("vehicles by period", &counts.iter().map(bar).collect::<Vec<_>>())
}

/// Returns the histogram of speeds over all periods.
fn histogram(file: &TrafficFile, here: &dyn Fn(&Group) -> bool) -> Option<String> {
    let rows: Vec<_> = file.figures.speed_histogram.iter().filter(|row| here(&row.group)).collect();
    let most = rows.iter().map(|row| row.below_kmh).fold(0.0, f64::max);
    let width = rows.first().map(|row| row.below_kmh - row.least_kmh)?;
    let bar = |bin: usize| {
        let least = bin as f64 * width;
        let number: u64 = rows.iter().filter(|r| r.least_kmh == least).map(|r| r.vehicles).sum();
        Bar { label: format!("{:.0}", file.units.of_kmh(least)), value: Some(number as f64), interval: None }
    };
    let bins = (most / width).round() as usize;
    Some(bars("vehicles by speed", &(0..bins).map(bar).collect::<Vec<_>>()))
}

/// The colours of a page, for a file of its own.
const COLOURS: &str = "--card:#fff;--ink:#1b2026;--soft:#65707b;--line:#e2e5e9;--accent:#2a6fb0";

/// Returns all diagrams as pairs of a file name and an SVG file. `sites` are the cameras of the file.
#[must_use]
pub fn traffic_pictures(file: &TrafficFile, sites: &[Site]) -> Vec<(String, String)> {
    let mut pictures = Vec::new();
    let mut add = |words: &[&str], figures: Vec<Figure>| {
        for Figure { name, svg, .. } in figures.into_iter().filter(|figure| !figure.svg.is_empty()) {
            let stem =
                format!("{}-{name}", words.iter().map(|word| plain(word)).collect::<Vec<_>>().join("-"));
            // Two names may differ only in characters that file names cannot have.
            let numbered = (2..).map(|number| format!("{stem}-{number}.svg"));
            let mut names = std::iter::once(format!("{stem}.svg")).chain(numbered);
            let is_free = |name: &String| pictures.iter().all(|(other, _)| other != name);
            let Some(name) = names.find(is_free) else { continue };
            let head = format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" font-family=\"sans-serif\" style=\"{COLOURS}\" "
            );
            pictures.push((name, svg.replacen("<svg ", &head, 1)));
        }
    };
    for site in sites {
        add(&[&site.name], of_camera(file, site));
        for (gate, Gate { name, .. }) in site.clips.iter().take(1).flat_map(|clip| &clip.gates).enumerate() {
            for direction in Direction::ALL {
                add(&[&site.name, name, direction.name()], of_gate(file, site, gate, direction));
            }
        }
    }
    pictures
}

/// Returns a name without characters that file systems do not take.
fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::COLOURS;
    use crate::report::STYLE;

    #[test]
    fn pictures_have_the_colours_of_the_page() {
        let light = STYLE.lines().next().unwrap();
        assert!(COLOURS.split(';').all(|colour| light.contains(colour)), "{light}");
    }
}
