//! Summarises the watcher's results over a clip: camera moves, shake and unusable pictures.

use roadplane_base::{CameraMove, FrameRecord, MoveKind, NotFollowedReason, PictureVerdict};
use roadplane_write::{WatchInterval, WatchSummary};

/// Collects the watcher's results from the records of frames, in the order of time.
#[derive(Debug, Default)]
pub struct Watched {
    summary: WatchSummary,
}

impl Watched {
    /// Adds the record of the next frame.
    pub fn push(&mut self, record: &FrameRecord) {
        let Some(watch) = &record.watch else { return };
        if let Some(moved) = watch.moved {
            tracing::info!("{}", move_in_words(&moved));
            self.summary.moves.push(moved);
        }
        let [dx, dy] = watch.offset_px;
        self.summary.farthest_shake_px = self.summary.farthest_shake_px.max(dx.hypot(dy));
        match self.summary.stretches.last_mut() {
            Some(last) if last.verdict == watch.verdict => last.to_s = record.time_s,
            last => {
                let is_news = last.is_some() || is_doubt(watch.verdict);
                if is_news {
                    tracing::info!("from {:.1} s on: {}", record.time_s, verdict_in_words(watch.verdict));
                }
                let (from_s, to_s) = (record.time_s, record.time_s);
                self.summary.stretches.push(WatchInterval { verdict: watch.verdict, from_s, to_s });
            }
        }
    }

    /// Returns the summary for `summary.json`.
    #[must_use]
    pub fn finish(self) -> WatchSummary {
        self.summary
    }
}

fn is_doubt(verdict: PictureVerdict) -> bool {
    verdict != PictureVerdict::Rest
}

/// Returns notes about the camera for the report, one line each. The notes name intervals of unusable pictures and
/// camera shake. If there is nothing to report, the only note is that the camera was at rest.
#[must_use]
pub fn in_words(watch: &WatchSummary) -> Vec<String> {
    let doubts = watch.stretches.iter().filter(|interval| is_doubt(interval.verdict));
    let in_words = |interval: &WatchInterval| {
        format!("{:.1} – {:.1} s: {}", interval.from_s, interval.to_s, verdict_in_words(interval.verdict))
    };
    let mut lines: Vec<String> = doubts.map(in_words).collect();
    lines.extend(watch.not_followed.iter().map(|interval| {
        let why = match interval.reason {
            NotFollowedReason::Travelling => "the camera is carried along",
            NotFollowedReason::NotRegistered => "the motion of the camera could not be measured",
        };
        format!("{:.1} – {:.1} s: {why}, and vehicles are not followed", interval.from_s, interval.to_s)
    }));
    if watch.farthest_shake_px > 0.0 {
        lines.push(format!(
            "the picture shakes by up to {:.1} px; the shake is removed",
            watch.farthest_shake_px
        ));
    }
    if lines.is_empty() && watch.moves.is_empty() {
        lines.push("the camera was at rest".to_owned());
    }
    lines
}

fn move_in_words(moved: &CameraMove) -> String {
    let at = format!("frame {} ({:.2} s)", moved.since_frame, moved.since_s);
    let shift = moved
        .shift_px
        .map_or_else(String::new, |[x, y]| format!(", which shifted the picture by {x:.0}, {y:.0} px"));
    match moved.kind {
        MoveKind::Turned => format!("{at}: the camera was turned{shift}"),
        MoveKind::Zoomed => {
            let growth = moved.log_scale.map_or(0.0, |log_scale| (log_scale.exp() - 1.0) * 100.0);
            format!("{at}: the camera was zoomed by {growth:+.1} %{shift}")
        }
        MoveKind::Cut => format!("{at}: the picture is of another scene"),
        MoveKind::Moving => format!("{at}: the camera starts to move"),
    }
}

fn verdict_in_words(verdict: PictureVerdict) -> &'static str {
    match verdict {
        PictureVerdict::Rest => "the camera is at rest",
        PictureVerdict::Moving => "the camera is moving",
        PictureVerdict::Unsettled => "the picture has shifted and has not settled yet",
        PictureVerdict::Black => "the picture is black",
        PictureVerdict::White => "the picture is white",
        PictureVerdict::Covered => "something covers the lens",
        PictureVerdict::Frozen => "the picture is frozen",
        PictureVerdict::Unknown => {
            "the picture has too little structure to decide whether the camera is at rest"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{ImageSize, WatchRecord};
    use roadplane_write::NotFollowedInterval;

    #[test]
    fn intervals_and_moves_are_reported_once() {
        let mut watched = Watched::default();
        for frame in 0..30_u64 {
            let verdict =
                if (10..20).contains(&frame) { PictureVerdict::Black } else { PictureVerdict::Rest };
            let moved = (frame == 25).then_some(CameraMove {
                kind: MoveKind::Zoomed,
                since_frame: 22,
                since_s: 2.2,
                shift_px: Some([3.0, -4.0]),
                log_scale: Some(0.05),
            });
            let watch = Some(WatchRecord { looked: true, verdict, moved, ..WatchRecord::default() });
            let size = ImageSize { width: 640, height: 360 };
            watched.push(&FrameRecord { watch, ..FrameRecord::empty(frame, frame as f64 * 0.1, size) });
        }
        let mut summary = watched.finish();
        let interval = NotFollowedInterval { reason: NotFollowedReason::Travelling, from_s: 2.0, to_s: 2.9 };
        summary.not_followed.push(interval);
        let carried = "2.0 – 2.9 s: the camera is carried along, and vehicles are not followed";
        assert_eq!(in_words(&summary), ["1.0 – 1.9 s: the picture is black", carried]);
        assert_eq!(
            move_in_words(&summary.moves[0]),
            "frame 22 (2.20 s): the camera was zoomed by +5.1 %, which shifted the picture by 3, -4 px"
        );
        assert_eq!(in_words(&WatchSummary::default()), ["the camera was at rest"]);
    }
}
