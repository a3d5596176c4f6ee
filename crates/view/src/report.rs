//! `report.html`: one page that needs no other file. All facts are text and tables. Only the player of
//! tracks and the drawing part use scripts.

mod camera;
mod doubts;
mod drawing;
mod gaps;
mod html;
mod input;
mod page;
mod pictures;
mod place;
mod player;
mod thin;
mod tracks;

pub(crate) use html::{escape, put};
pub use input::{PlainFrame, ReportInput, Still, TrackStill};
pub(crate) use page::STYLE;
pub use page::report_html;
pub(crate) use pictures::data_uri;
