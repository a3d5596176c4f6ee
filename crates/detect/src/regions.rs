//! Chooses the parts of the picture on which the net runs. Together they cover all areas that must be inspected.

use roadplane_base::{bbox_around, bbox_inside};

use crate::resample::{MULTIPLE_PX, Part};

/// Fixed cost of one run of the net, expressed as a number of input pixels with the same cost.
const OVERHEAD_PX: f64 = 12_000.0;
/// If the parts cost more than this share of the whole picture's cost, the net runs on the whole picture instead.
const WHOLE_SHARE: f64 = 0.7;

/// Smallest margin around an area, px of the net's input in the finest pass.
pub(crate) const MARGIN_PX: f64 = 64.0;
/// Margin around an area, as a share of its longer side.
const MARGIN_SHARE: f64 = 0.25;

/// A part of the picture on which the net runs. Only the areas `cores` in it count as inspected.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Region {
    pub part: Part,
    pub cores: Vec<[f64; 4]>,
}

/// Returns parts of the picture that cover all areas at a low cost. The areas are boxes in px of the frame.
///
/// Neighbouring areas are joined greedily if this saves cost. If the whole picture costs hardly more than the parts,
/// the whole picture is returned. `scales` are the scale factors of the detector's passes, coarsest first.
pub(crate) fn regions(areas: &[[f64; 4]], whole: Part, scales: &[f64]) -> Vec<Region> {
    let finest = scales.last().copied().unwrap_or(1.0);
    let everything = [0.0, 0.0, whole.width as f64, whole.height as f64];
    let mut open: Vec<([f64; 4], Vec<[f64; 4]>)> = areas
        .iter()
        .map(|area| {
            (bbox_inside(&with_margin(area, finest), &everything), vec![bbox_inside(area, &everything)])
        })
        .filter(|(bounds, _)| bounds[2] > bounds[0] && bounds[3] > bounds[1])
        .collect();
    // The pair with the largest saving is joined first. If several pairs save the same, the first of them is joined.
    loop {
        let mut best: Option<(f64, usize, usize)> = None;
        for i in 0..open.len() {
            for j in i + 1..open.len() {
                let joined = bbox_around(&open[i].0, &open[j].0);
                let gain = cost(&open[i].0, scales) + cost(&open[j].0, scales) - cost(&joined, scales);
                if gain > 0.0 && best.is_none_or(|(most, _, _)| gain > most) {
                    best = Some((gain, i, j));
                }
            }
        }
        let Some((_, i, j)) = best else { break };
        let (bounds, cores) = open.remove(j);
        open[i].0 = bbox_around(&open[i].0, &bounds);
        open[i].1.extend(cores);
    }
    let total: f64 = open.iter().map(|(bounds, _)| cost(bounds, scales)).sum();
    if total > WHOLE_SHARE * cost(&everything, scales) {
        return vec![Region { part: whole, cores: vec![everything] }];
    }
    let part = |[x0, y0, x1, y1]: [f64; 4]| {
        let (x, width) = filled(x0, x1, whole.width, finest);
        let (y, height) = filled(y0, y1, whole.height, finest);
        Part { x, y, width, height }
    };
    open.into_iter().map(|(bounds, cores)| Region { part: part(bounds), cores }).collect()
}

/// Returns an area with the margin around it that the net needs to find vehicles in the area.
fn with_margin([x0, y0, x1, y1]: &[f64; 4], finest: f64) -> [f64; 4] {
    let margin =
        (MARGIN_PX / finest).max(MARGIN_SHARE * (x1 - x0).max(y1 - y0)).min(2.5 * MARGIN_PX / finest);
    [x0 - margin, y0 - margin, x1 + margin, y1 + margin]
}

/// Returns the cost of a part over all passes, including the overhead of each run, px of the net's input.
fn cost([x0, y0, x1, y1]: &[f64; 4], scales: &[f64]) -> f64 {
    let padded = |length: f64, scale: f64| {
        let multiple = MULTIPLE_PX as f64;
        (length * scale / multiple).ceil().max(1.0) * multiple
    };
    scales.iter().map(|&scale| padded(x1 - x0, scale) * padded(y1 - y0, scale) + OVERHEAD_PX).sum()
}

/// Returns the start and the length of a part along one axis. The part is enlarged to a length that the finest pass
/// need not pad.
fn filled(from: f64, to: f64, length: usize, finest: f64) -> (usize, usize) {
    let multiple = MULTIPLE_PX as f64 / finest;
    let wanted = ((to - from) / multiple).ceil().max(1.0) * multiple;
    if wanted >= length as f64 {
        return (0, length);
    }
    let wanted = wanted.floor() as usize;
    let middle = (from + to) / 2.0;
    let start = (middle - wanted as f64 / 2.0).round().clamp(0.0, (length - wanted) as f64);
    (start as usize, wanted)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: Part = Part { x: 0, y: 0, width: 1920, height: 1080 };
    const SCALES: [f64; 3] = [1.0 / 3.0, 0.5, 2.0 / 3.0];

    #[test]
    fn neighbours_share_a_run_and_distant_areas_do_not() {
        let area = |x: f64, y: f64| [x, y, x + 80.0, y + 60.0];
        let found = regions(&[area(100.0, 500.0), area(1700.0, 200.0), area(190.0, 520.0)], WHOLE, &SCALES);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!(found[0].cores.len(), 2);
        for region in &found {
            let part = region.part;
            assert!(part.x + part.width <= 1920 && part.y + part.height <= 1080);
            for core in &region.cores {
                assert!(part.x as f64 <= core[0] && core[2] <= (part.x + part.width) as f64, "{region:?}");
                assert!(part.y as f64 <= core[1] && core[3] <= (part.y + part.height) as f64, "{region:?}");
            }
            // The finest pass pads nothing.
            assert!(
                (part.width as f64 * SCALES[2] % 32.0).min(32.0 - part.width as f64 * SCALES[2] % 32.0) < 1.0
            );
        }
    }

    #[test]
    fn many_areas_become_the_whole_picture() {
        let areas: Vec<[f64; 4]> =
            (0..8).map(|i| [f64::from(i) * 240.0, 0.0, f64::from(i) * 240.0 + 200.0, 1000.0]).collect();
        assert_eq!(regions(&areas, WHOLE, &SCALES).len(), 1);
        assert_eq!(regions(&areas, WHOLE, &SCALES)[0].part, WHOLE);
        assert!(regions(&[], WHOLE, &SCALES).is_empty());
    }
}
