//! `traffic.html`: one page with the figures of traffic, as tables and pictures.
//!
//! - `page.rs`: the page, from its sections
//! - `figures.rs`: the diagrams of a camera, also as files
//! - `volumes.rs`: gates and zones with their volumes, from above or on a picture
//! - `plan.rs`: plan from above; heat map
//! - `time_space.rs`: time–space diagram of a gate's direction
//! - `charts.rs`: bars over time and over speed

mod charts;
mod figures;
mod page;
mod plan;
mod time_space;
mod volumes;

pub use figures::traffic_pictures;
pub use page::{traffic_html, traffic_sections};
pub use volumes::RoadPicture;

use roadplane_traffic::{Group, Site};

fn is_here(group: &Group, site: &Site, place: &str, direction: &str) -> bool {
    group.camera == site.name && group.place == place && group.direction == direction && group.class == "all"
}

/// The time of day in a label such as `2026-01-31T22:00:00+01:00`; another label stays whole.
fn time_of_day(label: &str) -> &str {
    label.split_once('T').and_then(|(_, time)| time.get(..5)).unwrap_or(label)
}
