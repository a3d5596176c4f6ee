//! Sentences in the report about tracks with weak evidence.

use roadplane_base::{ImageSize, TrackRow};

use super::gaps::hidden_intervals;
use super::input::by_track;

/// Largest distance between a box and the edge of the picture at which the box counts as cut off, px.
const EDGE_PX: f64 = 2.0;
/// Duration below which a track is reported as short, s.
const SHORT_S: f64 = 1.0;
/// Standard deviation above which a position is uncertain, m. A track is reported if most of its detected positions are
/// uncertain.
const VAGUE_M: f64 = 2.0;
/// Largest number of tracks that a sentence lists. With more tracks, the sentence contains only the number of tracks.
const NAMED: usize = 12;

/// Returns one sentence for each kind of weakness that at least one track has.
pub(super) fn doubts(rows: &[TrackRow], size: ImageSize) -> Vec<String> {
    let (mut short, mut cut, mut vague, mut filled) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let tracks = by_track(rows);
    let count = tracks.len();
    for (track, rows) in tracks {
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { continue };
        let seen: Vec<&TrackRow> = rows.iter().copied().filter(|row| row.observed).collect();
        let most =
            |is: &dyn Fn(&TrackRow) -> bool| 2 * seen.iter().filter(|row| is(row)).count() > seen.len();
        let name = track.to_string();
        if last.time_s - first.time_s < SHORT_S {
            short.push(name.clone());
        }
        if most(&|row| is_cut(row, size)) {
            cut.push(name.clone());
        }
        if most(&|row| row.x_sd_m.hypot(row.y_sd_m) > VAGUE_M) {
            vague.push(name.clone());
        }
        let longest =
            hidden_intervals(&rows).into_iter().max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        if let Some([from_s, to_s]) = longest {
            filled.push(format!("{name} (for {:.1} s from {from_s:.1} s)", to_s - from_s));
        }
    }
    let sentence = |tracks: Vec<String>, one: &str, many: &str| match tracks.as_slice() {
        [] => None,
        [track] => Some(format!("Track {track} {one}.")),
        tracks if tracks.len() > NAMED => Some(format!("{} of {count} tracks {many}.", tracks.len())),
        tracks => Some(format!("Tracks {} {many}.", tracks.join(", "))),
    };
    [
        sentence(
            cut,
            "is cut off by the edge of the picture most of the time: its size and position are less certain",
            "are cut off by the edge of the picture most of the time: their sizes and positions are less certain",
        ),
        sentence(
            filled,
            "was not detected for some time and is filled in there",
            "were not detected for some time and are filled in there",
        ),
        sentence(short, "lasts less than a second", "last less than a second each"),
        sentence(
            vague,
            "has a position sd above two metres",
            "have position sds above two metres",
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Whether the edge of the picture cuts off the box of a row.
fn is_cut(row: &TrackRow, size: ImageSize) -> bool {
    let [x0, y0, x1, y1] = row.bbox_px;
    let (right, bottom) = (f64::from(size.width) - 1.0, f64::from(size.height) - 1.0);
    x0 <= EDGE_PX || y0 <= EDGE_PX || x1 >= right - EDGE_PX || y1 >= bottom - EDGE_PX
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_synth::stationary_row as row;

    #[test]
    fn each_weakness_is_reported_for_its_tracks() {
        let size = ImageSize { width: 640, height: 360 };
        let inside = [100.0, 100.0, 160.0, 140.0];
        let mut rows = Vec::new();
        for i in 0..60_u64 {
            let t = 0.1 * i as f64;
            rows.push(TrackRow { bbox_px: inside, ..row(1, i, t) });
            rows.push(TrackRow { bbox_px: [0.0, 100.0, 60.0, 140.0], ..row(2, i, t) });
            rows.push(TrackRow { bbox_px: inside, observed: !(20..45).contains(&i), ..row(3, i, t) });
            if i < 5 {
                rows.push(TrackRow { bbox_px: inside, y_sd_m: 3.0, ..row(4, i, t) });
                rows.push(TrackRow { bbox_px: inside, ..row(5, i, t) });
            }
        }
        let lines = doubts(&rows, size);
        assert_eq!(lines.len(), 4, "{lines:?}");
        assert!(lines[0].starts_with("Track 2 is cut off"));
        assert!(lines[1].starts_with("Track 3 (for 2.6 s from 1.9 s) was not detected"), "{}", lines[1]);
        assert!(lines[2].starts_with("Tracks 4, 5 last"));
        assert!(lines[3].starts_with("Track 4 has"));
    }
}
