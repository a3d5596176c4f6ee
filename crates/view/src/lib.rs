//! Pictures of a result: overlays, the view from above, the report and annotated video.
//!
//! # Contents
//! - drawings in the picture: `overlay.rs`, `video.rs` (`labels.rs`, `canvas.rs`, `ground_cells.rs`)
//! - the view from above: `birds_eye.rs` (`sheet.rs`)
//! - the report: `report.rs`, `report/` (`crops.rs`, `histogram.rs`, `activities.rs`)
//! - the page of traffic: `traffic.rs`, `traffic/`
//! - warped pictures: `warp.rs`
//! - pictures of detections, keypoints and edges: `detection_sheet.rs`, `keypoint_sheet.rs`, `lines.rs`

mod activities;
mod birds_eye;
mod canvas;
mod crops;
mod detection_sheet;
mod error;
mod ground_cells;
mod histogram;
mod keypoint_sheet;
mod labels;
mod lines;
mod overlay;
mod report;
mod sheet;
mod traffic;
mod video;
mod warp;

pub use birds_eye::birds_eye;
pub use canvas::Rgb;
pub use detection_sheet::{DetectionCase, detection_sheet};
pub use error::ViewError;
pub use ground_cells::GroundCells;
pub use keypoint_sheet::{KeypointCase, keypoint_sheet};
pub use lines::with_lines;
pub use overlay::{DrawnCar, Overlay, horizon_y_px, track_colour};
pub use report::{PlainFrame, ReportInput, Still, TrackStill, report_html};
pub use traffic::{RoadPicture, traffic_html, traffic_pictures, traffic_sections};
pub use video::VideoSink;
pub use warp::warped;
