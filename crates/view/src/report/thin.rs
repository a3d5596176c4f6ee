//! Thinning of trajectories to the few vertices that the report's interactive player needs.

use roadplane_base::{TrackRow, wrap_angle};

/// Largest error of a position on the ground that a viewer does not notice, m.
const POSITION_M: f64 = 0.05;
/// Largest error of a box that a viewer does not notice, as a share of the picture's width.
const BOX: f64 = 0.002;
/// Largest error of a heading that a viewer does not notice, rad.
const HEADING_RAD: f64 = 0.03;
/// Largest error of a speed that a viewer does not notice, m/s.
const SPEED_MPS: f64 = 0.15;

/// A row of a track with an unwrapped heading. The heading does not jump by a full turn, so interpolation turns the
/// vehicle by the smaller angle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex<'a> {
    pub row: &'a TrackRow,
    pub heading_rad: f64,
}

/// Returns the rows of one track that remain after thinning. Linear interpolation between them gives the removed rows
/// with small errors.
///
/// The method is that of Douglas and Peucker (1973), with distances between points at equal times. The errors are at
/// most `slack` times the largest errors that a viewer does not notice. A row with a new activity or segment always
/// remains. `width_px` is the width of the picture.
pub(super) fn thinned<'a>(rows: &[&'a TrackRow], width_px: f64, slack: f64) -> Vec<Vertex<'a>> {
    let rows = unwrapped(rows);
    let mut keep: Vec<bool> = (0..rows.len())
        .map(|i| i == 0 || i + 1 == rows.len() || is_new(rows[i - 1].row, rows[i].row))
        .collect();
    let fixed: Vec<usize> = (0..rows.len()).filter(|i| keep[*i]).collect();
    let mut open: Vec<(usize, usize)> = fixed.windows(2).map(|pair| (pair[0], pair[1])).collect();
    while let Some((first, last)) = open.pop() {
        let errors =
            (first + 1..last).map(|i| (i, error_of(&rows[first], &rows[last], &rows[i], width_px) / slack));
        let worst = errors.max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((i, _)) = worst.filter(|(_, error)| *error > 1.0) {
            keep[i] = true;
            open.extend([(first, i), (i, last)]);
        }
    }
    rows.iter().zip(&keep).filter(|(_, kept)| **kept).map(|(row, _)| *row).collect()
}

/// Whether `row` and the row before differ in their activity or segment.
fn is_new(before: &TrackRow, row: &TrackRow) -> bool {
    before.activity != row.activity || before.segment != row.segment
}

/// Returns the rows with headings that do not jump by a full turn.
fn unwrapped<'a>(rows: &[&'a TrackRow]) -> Vec<Vertex<'a>> {
    let mut heading_rad = rows.first().map_or(0.0, |row| row.heading_rad);
    let vertex = |row: &&'a TrackRow| {
        heading_rad += wrap_angle(row.heading_rad - heading_rad);
        Vertex { row, heading_rad }
    };
    rows.iter().map(vertex).collect()
}

/// Returns the error of linear interpolation between `a` and `b` at the time of `at`.
///
/// The value 1 is the largest error that a viewer does not notice.
fn error_of(a: &Vertex<'_>, b: &Vertex<'_>, at: &Vertex<'_>, width_px: f64) -> f64 {
    let span = b.row.time_s - a.row.time_s;
    let s = if span > 0.0 { (at.row.time_s - a.row.time_s) / span } else { 0.0 };
    let error = |of: &dyn Fn(&Vertex<'_>) -> f64| (of(a) + s * (of(b) - of(a)) - of(at)).abs();
    let position = error(&|v| v.row.x_m).hypot(error(&|v| v.row.y_m)) / POSITION_M;
    let edges = (0..4).map(|i| error(&|v| v.row.bbox_px[i]) / (BOX * width_px)).fold(0.0, f64::max);
    let turn = error(&|v| v.heading_rad) / HEADING_RAD;
    let speed = error(&|v| v.row.speed_mps) / SPEED_MPS;
    position.max(edges).max(turn).max(speed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_synth::stationary_row as row;

    #[test]
    fn few_vertices_keep_all_visible_detail() {
        let rows: Vec<TrackRow> = (0..300_u64)
            .map(|i| {
                let t = i as f64 / 30.0;
                let turned = (0.8 * t).min(4.0);
                TrackRow {
                    x_m: 5.0 * turned.sin(),
                    y_m: 20.0 - 5.0 * turned.cos() + 4.0 * (t - 5.0).max(0.0),
                    heading_rad: wrap_angle(turned),
                    activity: Some(if i < 100 { "turning_left" } else { "moving" }.to_owned()),
                    ..row(1, i, t)
                }
            })
            .collect();
        let rows: Vec<&TrackRow> = rows.iter().collect();
        let kept = thinned(&rows, 1280.0, 1.0);
        assert!((8..100).contains(&kept.len()), "{}", kept.len());
        for vertex in unwrapped(&rows) {
            let next = kept.partition_point(|k| k.row.time_s < vertex.row.time_s).max(1);
            assert!(error_of(&kept[next - 1], &kept[next], &vertex, 1280.0) <= 1.0 + 1e-9);
        }
        assert!(kept.windows(2).all(|w| (w[1].heading_rad - w[0].heading_rad).abs() < 1.0), "no jump at π");
        assert!(kept.iter().any(|vertex| vertex.row.frame == 100), "the activity changes here");
        assert!(thinned(&rows, 1280.0, 8.0).len() < kept.len());
        assert!(thinned(&[], 1280.0, 1.0).is_empty());
    }
}
