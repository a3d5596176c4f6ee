//! `report.html`: one self-contained page. Its facts are text and tables; scripts only play the tracks.

mod camera;
mod doubts;
mod gaps;
mod html;
mod input;
mod page;
mod pictures;
mod player;
mod thin;
mod tracks;

pub use input::{ReportInput, Still, TrackStill};
pub use page::report_html;
