//! `report.html`: one page that needs no other file. All facts are text and tables. Only the player of tracks uses
//! scripts.

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

pub(crate) use html::{escape, put};
pub use input::{ReportInput, Still, TrackStill};
pub(crate) use page::STYLE;
pub use page::report_html;
