//! Pictures of a result: overlays, the view from above, the report, annotated video.

mod birds_eye;
mod crops;
mod error;
mod histogram;
mod overlay;
mod report;
mod video;

pub use birds_eye::birds_eye;
pub use error::ViewError;
pub use overlay::{DrawnCar, Overlay, Rgb, track_colour};
pub use report::{ReportInput, report_html};
pub use video::VideoSink;
