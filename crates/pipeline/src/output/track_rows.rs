//! Writes the track files of a result and collects the rows that are kept for drawing.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use roadplane_activity::{ActivityNet, Event};
use roadplane_base::TrackRow;
use roadplane_geo::Place;
use roadplane_write::TrackFiles;

use crate::PipelineError;
use crate::activities::{add_events, label_rows, write_events};
use crate::estimation::RowSink;
use crate::tracks::TimeChunk;

/// Least time between two rows of a track that are kept for drawing, s, if the vehicle is observed in the later row.
/// This limit applies only to long clips, which are split into several time chunks.
const NEXT_OBSERVED_S: f64 = 0.6;
/// Least time between two rows of a track that are kept for drawing, s, if the vehicle is not observed in the later
/// row.
const NEXT_S: f64 = 0.9;

/// Writes the track files of a clip. If there is an activity net, the activities of the vehicles are labelled and
/// written too.
pub(crate) struct TrackRows<'a> {
    folder: &'a Path,
    activity: Option<ActivityNet>,
    files: Option<TrackFiles>,
    events: Vec<Event>,
    shown: ShownRows,
}

impl<'a> TrackRows<'a> {
    /// Creates a writer of track files in the folder of a result. `shown` collects the rows that are kept for drawing.
    pub(crate) fn new(folder: &'a Path, activity: Option<ActivityNet>, shown: ShownRows) -> Self {
        Self { folder, activity, files: None, events: Vec::new(), shown }
    }

    /// Completes the files and returns the rows that are kept for drawing.
    pub(crate) fn finish(self) -> Result<ShownRows, PipelineError> {
        if let Some(files) = self.files {
            files.finish()?;
        }
        if self.activity.is_some() {
            write_events(&self.folder.join("activities.jsonl"), self.events)?;
        }
        Ok(self.shown)
    }
}

impl RowSink for TrackRows<'_> {
    fn take(
        &mut self,
        mut rows: Vec<TrackRow>,
        chunk: TimeChunk,
        place: Option<&Place>,
    ) -> Result<u64, PipelineError> {
        if let Some(net) = &mut self.activity {
            add_events(&mut self.events, label_rows(net, &mut rows)?, chunk);
        }
        rows.retain(|row| chunk.holds(row.time_s));
        let files = match &mut self.files {
            Some(files) => files,
            none => none.insert(TrackFiles::create(self.folder, place.is_some())?),
        };
        for row in &rows {
            files.write(row)?;
        }
        let count = rows.len() as u64;
        self.shown.add(rows, chunk);
        Ok(count)
    }
}

/// Track rows that are kept for drawing. All rows of a short clip, which is a single time chunk, are kept. A longer
/// clip has too many rows for a page, so only some of its rows are kept.
#[derive(Debug, Default)]
pub(crate) struct ShownRows {
    /// The kept rows, sorted by frame and then by track.
    pub rows: Vec<TrackRow>,
    /// Frames whose rows are all kept.
    frames: BTreeSet<u64>,
    is_thinned: bool,
}

impl ShownRows {
    /// Creates an empty collection. If the clip is long, the collection keeps all rows of `frames` and some rows of
    /// other frames.
    pub(crate) fn of(frames: BTreeSet<u64>) -> Self {
        Self { frames, ..Self::default() }
    }

    /// Whether some rows were left out.
    pub(crate) fn is_thinned(&self) -> bool {
        self.is_thinned
    }

    fn add(&mut self, mut rows: Vec<TrackRow>, chunk: TimeChunk) {
        if chunk != TimeChunk::ALL {
            self.is_thinned = true;
            thin(&mut rows, &self.frames);
        }
        if self.rows.is_empty() {
            self.rows = rows;
        } else {
            self.rows.append(&mut rows);
        }
    }
}

/// Thins out the rows of a long clip. The first and last rows of each track stay, and so do all rows of `frames` and
/// some of the other rows.
fn thin(rows: &mut Vec<TrackRow>, frames: &BTreeSet<u64>) {
    let last: BTreeMap<u64, u64> = rows.iter().map(|row| (row.track, row.frame)).collect();
    let mut kept_s: BTreeMap<u64, f64> = BTreeMap::new();
    rows.retain(|row| {
        let least_s = if row.observed { NEXT_OBSERVED_S } else { NEXT_S };
        let is_next = kept_s.get(&row.track).is_none_or(|kept_s| row.time_s - kept_s >= least_s);
        if is_next {
            kept_s.insert(row.track, row.time_s);
        }
        is_next || last.get(&row.track) == Some(&row.frame) || frames.contains(&row.frame)
    });
    rows.shrink_to_fit();
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_activity::Label;
    use roadplane_synth::stationary_row;

    fn row(frame: u64, track: u64) -> TrackRow {
        let row = stationary_row(track, frame, frame as f64 / 10.0);
        TrackRow { observed: frame.is_multiple_of(4), ..row }
    }

    #[test]
    fn some_rows_of_long_clips_are_kept_and_all_of_short_ones() {
        let of = |frames: std::ops::Range<u64>| frames.map(|frame| row(frame, 1)).collect::<Vec<_>>();
        let mut short = ShownRows::default();
        short.add(of(0..100), TimeChunk::ALL);
        assert_eq!((short.rows.len(), short.is_thinned()), (100, false));
        let seam_s = 10.0;
        let parts =
            [TimeChunk { to_s: seam_s, ..TimeChunk::ALL }, TimeChunk { from_s: seam_s, ..TimeChunk::ALL }];
        let mut shown = ShownRows::of(BTreeSet::from([131]));
        shown.add(of(0..100), parts[0]);
        shown.add(of(100..199), parts[1]);
        let kept: Vec<u64> = shown.rows.iter().map(|row| row.frame).collect();
        assert!(shown.is_thinned() && kept.is_sorted() && (22..40).contains(&kept.len()), "{kept:?}");
        assert!([0, 99, 100, 131, 198].iter().all(|frame| kept.contains(frame)), "{kept:?}");
        // Kept observed rows are close enough in time that the track is not drawn as hidden.
        let seen: Vec<u64> = kept.iter().copied().filter(|frame| frame % 4 == 0).collect();
        assert!(seen.windows(2).all(|pair| pair[1] - pair[0] <= 12), "{seen:?}");
    }

    #[test]
    fn an_activity_that_continues_over_a_seam_is_one_event() {
        let event = |track: u64, from_s: f64, to_s: f64, confidence: f64| Event {
            track,
            activity: Label::Moving,
            from_s,
            to_s,
            confidence,
        };
        let seam_s = 300.0;
        let (before, after) = (f64::NEG_INFINITY..seam_s, seam_s..f64::INFINITY);
        let [before, after] = [before, after].map(|s| TimeChunk { from_s: s.start, to_s: s.end });
        let mut events = Vec::new();
        add_events(&mut events, vec![event(1, 290.0, 305.0, 0.9), event(2, 310.0, 320.0, 0.8)], before);
        add_events(&mut events, vec![event(1, 280.0, 310.0, 0.6), event(2, 310.0, 320.0, 0.8)], after);
        assert_eq!(events, [event(1, 290.0, 310.0, 0.75), event(2, 310.0, 320.0, 0.8)]);
    }
}
