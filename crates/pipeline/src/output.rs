//! Output of a clip after estimation: result files, report and video.

pub(crate) mod draw;
pub(crate) mod finish;
pub(crate) mod losses;
pub(crate) mod track_rows;
