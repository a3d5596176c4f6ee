//! Output of a solved clip: files, report, video.

pub(crate) mod draw;
pub(crate) mod finish;
pub(crate) mod losses;
pub(crate) mod track_rows;
