//! What was only half seen, in words.

use roadplane_base::{ImageSize, TrackRow};

use super::input::by_track;
use super::look::hidden;

/// A box so near the picture's edge is cut by it, px.
const EDGE_PX: f64 = 2.0;
/// A vehicle seen for less is hardly known, s.
const SHORT_S: f64 = 1.0;
/// Places known worse than this are worth a word: sd, m.
const VAGUE_M: f64 = 2.0;
/// Most tracks that a sentence names; of more it counts them.
const NAMED: usize = 12;

/// A sentence for each kind of doubt that tracks are under.
pub(super) fn doubts(rows: &[TrackRow], size: ImageSize) -> Vec<String> {
    let (mut short, mut cut, mut vague, mut unseen) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
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
        let longest = hidden(&rows).into_iter().max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        if let Some([from_s, to_s]) = longest {
            unseen.push(format!("{name} (for {:.1} s from {from_s:.1} s)", to_s - from_s));
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
            "is cut by the edge of the picture most of the time: its size and place are less sure",
            "are cut by the edge of the picture most of the time: their sizes and places are less sure",
        ),
        sentence(
            unseen,
            "was not seen for a while and is filled in there",
            "were not seen for a while and are filled in there",
        ),
        sentence(short, "was seen for less than a second", "were seen for less than a second each"),
        sentence(
            vague,
            "is placed no better than to two metres (1 sd)",
            "are placed no better than to two metres (1 sd)",
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn is_cut(row: &TrackRow, size: ImageSize) -> bool {
    let [x0, y0, x1, y1] = row.bbox_px;
    let (right, bottom) = (f64::from(size.width) - 1.0, f64::from(size.height) - 1.0);
    x0 <= EDGE_PX || y0 <= EDGE_PX || x1 >= right - EDGE_PX || y1 >= bottom - EDGE_PX
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_synth::standing as row;

    #[test]
    fn each_doubt_is_told_of_those_it_is_about() {
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
        let told = doubts(&rows, size);
        assert_eq!(told.len(), 4, "{told:?}");
        assert!(told[0].starts_with("Track 2 is cut"));
        assert!(told[1].starts_with("Track 3 (for 2.6 s from 1.9 s) was not seen"), "{}", told[1]);
        assert!(told[2].starts_with("Tracks 4, 5 were seen"));
        assert!(told[3].starts_with("Track 4 is placed"));
    }
}
