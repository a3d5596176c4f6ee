//! `traffic.html`: one page with the figures of traffic, as tables and pictures.
//!
//! - `page.rs`: the page, from its sections
//! - `plan.rs`: gates with their volumes from above; heat map
//! - `time_space.rs`: time–space diagram of a gate's direction
//! - `charts.rs`: bars over time and over speed

mod charts;
mod page;
mod plan;
mod time_space;

pub use page::{traffic_html, traffic_sections};
