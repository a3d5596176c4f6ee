//! MOT Challenge: one line per row of the run, and the file `seqinfo.ini` for the program TrackEval.
//!
//! A line has the fields `frame, id, left, top, width, height, confidence, -1, -1, -1`. Frames are numbered from 1. The
//! corner of the top left pixel is at (1, 1).

use std::fmt::Write as _;
use std::path::Path;

use roadplane_write::WriteError;

use super::files::write_text;
use crate::Run;

/// Writes all rows. Rows that are filled in between detections have confidence 0.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let mut text = String::new();
    for (_, row) in run.rows() {
        let [x0, y0, x1, y1] = row.bbox_px;
        let (left, top, width, height) = (x0 + 1.0, y0 + 1.0, x1 - x0, y1 - y0);
        let _infallible = writeln!(
            text,
            "{},{},{left:.2},{top:.2},{width:.2},{height:.2},{:.4},-1,-1,-1",
            row.frame + 1,
            row.track,
            row.score
        );
    }
    write_text(&folder.join(format!("{}.txt", run.name)), &text)?;
    let size = run.segments.first().map_or([0, 0], |segment| segment.camera.image_size_px.into());
    let info = format!(
        "[Sequence]\nname={}\nimDir=img1\nframeRate={:.3}\nseqLength={}\nimWidth={}\nimHeight={}\nimExt=.jpg\n",
        run.name, run.frames_per_s, run.frames, size[0], size[1]
    );
    write_text(&folder.join("seqinfo.ini"), &info)
}
