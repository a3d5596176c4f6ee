//! Assembly of the page from its sections.

use roadplane_traffic::{Direction, Group, SDS_95, Site, TrafficFile};

use super::figures::{Figure, of_camera, of_gate};
use super::volumes::on_picture;
use super::{RoadPicture, is_here, time_of_day};
use crate::ViewError;
use crate::report::{STYLE, escape, put};

/// Returns the page as HTML text. `sites` are the cameras of the file.
#[must_use]
pub fn traffic_html(file: &TrafficFile, sites: &[Site]) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>Traffic · roadplane</title>\n<style>\n{STYLE}\nsvg{{max-width:100%;height:auto}}</style>\n<main>\n<h1>Traffic</h1>\n"
    );
    for warning in &file.warnings {
        put(&mut page, format_args!("<p class=\"warning\">{}</p>\n", escape(warning)));
    }
    put(
        &mut page,
        format_args!(
            "<p class=\"hint\">Periods of {}, local time of {}. ± and intervals hold 95 % of the error of \
             measurement. A grey bar is time in which no vehicle could be followed.</p>\n",
            escape(&file.every),
            escape(&file.time_zone)
        ),
    );
    for site in sites {
        put(&mut page, format_args!("<h2>{}</h2>\n", escape(&site.name)));
        camera(&mut page, file, site);
    }
    page.push_str("</main></html>\n");
    page
}

/// Returns the sections of a run's report as HTML text; empty if no vehicle crosses a gate. `road` shows the road of the
/// first site.
///
/// # Errors
/// [`ViewError`] if the picture cannot be written.
pub fn traffic_sections(
    file: &TrafficFile,
    sites: &[Site],
    road: Option<&RoadPicture<'_>>,
) -> Result<String, ViewError> {
    let mut page = String::new();
    for (index, site) in sites.iter().enumerate() {
        let crossed =
            file.figures.counts.iter().any(|row| row.group.camera == site.name && row.vehicles > Some(0));
        if crossed || !file.figures.zones.is_empty() {
            let number = if sites.len() > 1 { format!(": {}", escape(&site.name)) } else { String::new() };
            put(&mut page, format_args!("<h2>Traffic{number}</h2>\n"));
            let road = road.filter(|_| index == 0).map(|road| on_picture(site, file, road)).transpose()?;
            if let Some(svg) = road.flatten() {
                let caption = "Gates and zones. An arrow is as wide as its number of vehicles.";
                put(&mut page, format_args!("<figure>{svg}<figcaption>{caption}</figcaption></figure>\n"));
            }
            camera(&mut page, file, site);
        }
    }
    Ok(page)
}

fn camera(page: &mut String, file: &TrafficFile, site: &Site) {
    let Some(described) = file.cameras.iter().find(|camera| camera.name == site.name) else { return };
    let sum = |f: &dyn Fn(&roadplane_traffic::TrafficClip) -> f64| described.clips.iter().map(f).sum::<f64>();
    put(
        page,
        format_args!(
            "<p>{} clips, {:.1} min in which vehicles were followed, {:.1} min in which they were not; {} vehicles.</p>\n",
            described.clips.len(),
            sum(&|clip| clip.followed_s) / 60.0,
            sum(&|clip| clip.not_followed_s) / 60.0,
            sum(&|clip| clip.vehicles as f64)
        ),
    );
    figures(page, &of_camera(file, site));
    let gates = site.clips.first().map_or(&[][..], |clip| &clip.gates);
    for (index, gate) in gates.iter().enumerate() {
        for direction in Direction::ALL {
            gate_section(page, file, site, index, &gate.name, direction);
        }
    }
    flows(page, file, site);
    zones(page, file, site);
    conflicts(page, file, site);
}

fn figures(page: &mut String, figures: &[Figure]) {
    for Figure { svg, caption, .. } in figures {
        put(page, format_args!("<figure>{svg}<figcaption>{}</figcaption></figure>\n", escape(caption)));
    }
}

fn gate_section(
    page: &mut String,
    file: &TrafficFile,
    site: &Site,
    index: usize,
    place: &str,
    direction: Direction,
) {
    let here = |group: &Group| is_here(group, site, place, direction.name());
    let counts: Vec<_> = file.figures.counts.iter().filter(|row| here(&row.group)).collect();
    let total: u64 = counts.iter().filter_map(|row| row.vehicles).sum();
    if total == 0 {
        return;
    }
    put(page, format_args!("<h3>{}, {}: {total} vehicles</h3>\n", escape(place), direction.name()));
    let (unit, in_units) = (file.units.name(), |kmh: f64| file.units.of_kmh(kmh));
    page.push_str("<div class=\"scroll\"><table><thead><tr><th>from</th><th>vehicles</th><th>per hour</th>");
    put(
        page,
        format_args!(
            "<th>mean {unit}</th><th>V15</th><th>V50</th><th>V85</th><th>headway s</th></tr></thead>\n"
        ),
    );
    for row in &counts {
        let same = |group: &Group| here(group) && group.from == row.group.from;
        let speeds = file.figures.speeds.iter().find(|speeds| same(&speeds.group));
        let headways = file.figures.headways.iter().find(|headways| same(&headways.group));
        let range = match (row.vehicles_low, row.vehicles_high) {
            (Some(low), Some(high)) if low < high => format!(" ({low}–{high})"),
            _ => String::new(),
        };
        put(
            page,
            format_args!(
                "<tr><td>{}</td><td>{}{range}</td><td>{}</td>",
                escape(time_of_day(&row.group.from)),
                row.vehicles.map_or_else(|| "no data".to_owned(), |n| n.to_string()),
                row.flow_per_h.map_or_else(String::new, |flow| format!("{flow:.0}")),
            ),
        );
        let speed = |value: f64, sd: Option<f64>| {
            let sd = sd.map_or_else(String::new, |sd| format!(" ± {:.1}", in_units(SDS_95 * sd)));
            format!("<td>{:.1}{sd}</td>", in_units(value))
        };
        match speeds {
            Some(s) => {
                for (value, sd) in [
                    (s.mean_kmh, s.mean_sd_kmh),
                    (s.v15_kmh, s.v15_sd_kmh),
                    (s.v50_kmh, s.v50_sd_kmh),
                    (s.v85_kmh, s.v85_sd_kmh),
                ] {
                    page.push_str(&speed(value, sd));
                }
            }
            None => page.push_str("<td></td><td></td><td></td><td></td>"),
        }
        let headway = headways.map_or_else(String::new, |h| format!("{:.1}", h.headway_mean_s));
        put(page, format_args!("<td>{headway}</td></tr>\n"));
    }
    page.push_str("</table></div>\n");
    lanes(page, file, &here);
    figures(page, &of_gate(file, site, index, direction));
}

/// Appends the figures of a gate by lane, if the lanes are known.
fn lanes(page: &mut String, file: &TrafficFile, here: &dyn Fn(&Group) -> bool) {
    let rows: Vec<_> = file.figures.lanes.iter().filter(|row| here(&row.group)).collect();
    if rows.is_empty() {
        return;
    }
    let unit = file.units.name();
    put(
        page,
        format_args!(
            "<div class=\"scroll\"><table><thead><tr><th>lane</th><th>from</th><th>vehicles</th><th>mean {unit}</th>\
             <th>V85</th><th>headway s</th><th>gap s</th></tr></thead>\n"
        ),
    );
    for row in rows.iter().filter(|row| row.vehicles > Some(0)) {
        let speed =
            |kmh: Option<f64>| kmh.map_or_else(String::new, |kmh| format!("{:.1}", file.units.of_kmh(kmh)));
        let time = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.1}"));
        put(
            page,
            format_args!(
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                row.lane,
                escape(time_of_day(&row.group.from)),
                row.vehicles.unwrap_or(0),
                speed(row.mean_kmh),
                speed(row.v85_kmh),
                time(row.headway_mean_s),
                time(row.gap_mean_s)
            ),
        );
    }
    page.push_str("</table></div>\n");
}

fn flows(page: &mut String, file: &TrafficFile, site: &Site) {
    let mut sums = std::collections::BTreeMap::<[&str; 4], u64>::new();
    for row in file.figures.flows.iter().filter(|r| r.group.camera == site.name && r.group.class == "all") {
        let key: [&str; 4] = [&row.group.place, &row.group.direction, &row.to_place, &row.to_direction];
        *sums.entry(key).or_default() += row.vehicles;
    }
    if sums.is_empty() {
        return;
    }
    page.push_str("<h3>From gate to gate</h3>\n<div class=\"scroll\"><table><thead><tr><th>from</th><th>to</th><th>vehicles</th></tr></thead>\n");
    for ([from, from_direction, to, to_direction], vehicles) in sums {
        let to = if [from, from_direction] == [to, to_direction] {
            "no other gate".to_owned()
        } else {
            format!("{}, {to_direction}", escape(to))
        };
        put(
            page,
            format_args!(
                "<tr><td class=\"words\">{}, {from_direction}</td><td class=\"words\">{to}</td><td>{vehicles}</td></tr>\n",
                escape(from)
            ),
        );
    }
    page.push_str("</table></div>\n");
}

fn zones(page: &mut String, file: &TrafficFile, site: &Site) {
    let rows: Vec<_> =
        file.figures.zones.iter().filter(|r| r.group.camera == site.name && r.group.class == "all").collect();
    if rows.is_empty() {
        return;
    }
    page.push_str(
        "<h3>Zones</h3>\n<div class=\"scroll\"><table><thead><tr><th>zone</th><th>from</th><th>entered</th><th>time s</th>\
         <th>stationary s</th><th>delay s</th><th>occupancy</th><th>vehicles, mean</th><th>most</th><th>per km</th>\
         <th>queue, most</th><th>queue m</th></tr></thead>\n",
    );
    for row in rows {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.1}"));
        put(
            page,
            format_args!(
                "<tr><td class=\"words\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
                 <td>{}</td><td>{}</td><td>{}</td><td>{:.0}</td></tr>\n",
                escape(&row.group.place),
                escape(time_of_day(&row.group.from)),
                row.entered,
                number(row.time_mean_s),
                number(row.stationary_mean_s),
                number(row.delay_mean_s),
                row.occupancy.map_or_else(String::new, |share| format!("{:.0} %", share * 100.0)),
                number(row.vehicles_mean),
                row.vehicles_max,
                number(row.density_per_km),
                row.queue_max_vehicles,
                row.queue_max_m
            ),
        );
    }
    page.push_str("</table></div>\n");
}

/// Largest number of conflicts in the table of the page.
const MOST_CONFLICTS: usize = 20;

/// Appends the conflicts with the shortest times.
fn conflicts(page: &mut String, file: &TrafficFile, site: &Site) {
    let mut rows: Vec<_> = file.figures.conflicts.iter().filter(|row| row.camera == site.name).collect();
    if rows.is_empty() {
        return;
    }
    let shortest = |row: &roadplane_traffic::ConflictRow| {
        let c = &row.conflict;
        c.pet_s.unwrap_or(f64::INFINITY).min(c.min_ttc_s.unwrap_or(f64::INFINITY))
    };
    rows.sort_by(|a, b| shortest(a).total_cmp(&shortest(b)));
    put(page, format_args!("<h3>Conflicts: {}</h3>\n", rows.len()));
    page.push_str(
        "<div class=\"scroll\"><table><thead><tr><th>tracks</th><th>kind</th><th>time s</th><th>PET s</th>\
         <th>shortest TTC s</th><th>P(TTC &lt; limit)</th><th>DRAC m/s²</th></tr></thead>\n",
    );
    for row in rows.iter().take(MOST_CONFLICTS) {
        let c = &row.conflict;
        let value = |value: Option<f64>, sd: Option<f64>| {
            let sd = sd.map_or_else(String::new, |sd| format!(" ± {:.1}", SDS_95 * sd));
            value.map_or_else(String::new, |value| format!("{value:.1}{sd}"))
        };
        put(
            page,
            format_args!(
                "<tr><td>{}, {}</td><td class=\"words\">{}</td><td>{:.1}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                c.first,
                c.second,
                format!("{:?}", c.kind).to_lowercase(),
                c.at_s,
                value(c.pet_s, c.pet_sd_s),
                value(c.min_ttc_s, c.min_ttc_sd_s),
                c.min_ttc_below_p.map_or_else(String::new, |p| format!("{p:.2}")),
                value(c.max_drac_mps2, c.max_drac_sd_mps2),
            ),
        );
    }
    page.push_str("</table></div>\n");
    if rows.len() > MOST_CONFLICTS {
        let more = rows.len() - MOST_CONFLICTS;
        put(page, format_args!("<p class=\"hint\">{more} more are in the table conflicts.</p>\n"));
    }
}
