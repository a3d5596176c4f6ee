//! From places that want a look to the parts of the picture that the net is run on.

use roadplane_base::bbox_around;

use crate::resample::{MULTIPLE_PX, Part};

/// A run of the net costs as much as this many px of its input beside those of the picture.
const OVERHEAD_PX: f64 = 12_000.0;
/// Looking at parts that cost more than this share of the whole is not worth it.
const WHOLE_SHARE: f64 = 0.7;

/// Least surroundings, px of the net's input in the finest pass, and their share of the place's longer side.
const MARGIN_PX: f64 = 64.0;
const MARGIN_SHARE: f64 = 0.25;

/// A part to run the net on, and what of it counts as looked at.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Region {
    pub part: Part,
    pub cores: Vec<[f64; 4]>,
}

/// Parts that cover all places (boxes, px of the frame) at the least cost that joining neighbours finds; the whole picture where
/// that is hardly dearer. `scales` are those of the detector's passes, coarsest first.
pub(crate) fn regions(places: &[[f64; 4]], whole: Part, scales: &[f64]) -> Vec<Region> {
    let finest = scales.last().copied().unwrap_or(1.0);
    let everything = [0.0, 0.0, whole.width as f64, whole.height as f64];
    let inside =
        |[x0, y0, x1, y1]: [f64; 4]| [x0.max(0.0), y0.max(0.0), x1.min(everything[2]), y1.min(everything[3])];
    let mut open: Vec<([f64; 4], Vec<[f64; 4]>)> = places
        .iter()
        .map(|place| (inside(with_margin(place, finest)), vec![inside(*place)]))
        .filter(|(bounds, _)| bounds[2] > bounds[0] && bounds[3] > bounds[1])
        .collect();
    // The pair that gains most is joined first; ties go to the first in order.
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

/// A place and the surroundings that the net needs to judge it.
fn with_margin([x0, y0, x1, y1]: &[f64; 4], finest: f64) -> [f64; 4] {
    let margin =
        (MARGIN_PX / finest).max(MARGIN_SHARE * (x1 - x0).max(y1 - y0)).min(2.5 * MARGIN_PX / finest);
    [x0 - margin, y0 - margin, x1 + margin, y1 + margin]
}

/// Px of the net's input in all passes, what each run costs besides included.
fn cost([x0, y0, x1, y1]: &[f64; 4], scales: &[f64]) -> f64 {
    let padded = |length: f64, scale: f64| {
        let multiple = MULTIPLE_PX as f64;
        (length * scale / multiple).ceil().max(1.0) * multiple
    };
    scales.iter().map(|&scale| padded(x1 - x0, scale) * padded(y1 - y0, scale) + OVERHEAD_PX).sum()
}

/// Start and length along one axis, grown to what the finest pass would pad anyway.
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
    fn neighbours_share_a_run_and_strangers_do_not() {
        let place = |x: f64, y: f64| [x, y, x + 80.0, y + 60.0];
        let found =
            regions(&[place(100.0, 500.0), place(1700.0, 200.0), place(190.0, 520.0)], WHOLE, &SCALES);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!(found[0].cores.len(), 2);
        for region in &found {
            let part = region.part;
            assert!(part.x + part.width <= 1920 && part.y + part.height <= 1080);
            for core in &region.cores {
                assert!(part.x as f64 <= core[0] && core[2] <= (part.x + part.width) as f64, "{region:?}");
                assert!(part.y as f64 <= core[1] && core[3] <= (part.y + part.height) as f64, "{region:?}");
            }
            // Nothing is padded in the finest pass.
            assert!(
                (part.width as f64 * SCALES[2] % 32.0).min(32.0 - part.width as f64 * SCALES[2] % 32.0) < 1.0
            );
        }
    }

    #[test]
    fn much_is_everything() {
        let places: Vec<[f64; 4]> =
            (0..8).map(|i| [f64::from(i) * 240.0, 0.0, f64::from(i) * 240.0 + 200.0, 1000.0]).collect();
        assert_eq!(regions(&places, WHOLE, &SCALES).len(), 1);
        assert_eq!(regions(&places, WHOLE, &SCALES)[0].part, WHOLE);
        assert!(regions(&[], WHOLE, &SCALES).is_empty());
    }
}
