//! The boxes of a vehicle in frames in which it is not detected.
//!
//! A projected box differs from a measured one, because bodies are no boxes and poses have errors. The difference
//! changes slowly. So each edge of a projected box is moved by the difference at the nearest detections before and after
//! it, interpolated over time. The difference is a share of the projected box's width or height.

use roadplane_base::{bbox_cut, interpolated};

/// The boxes of a vehicle in a frame, px.
#[derive(Clone, Copy, Debug)]
pub struct FrameBoxes {
    /// Time of the frame, s.
    pub time_s: f64,
    /// The whole picture.
    pub picture_px: [f64; 4],
    /// Projected box of the vehicle; `None` if the vehicle is not in front of the camera.
    pub projected_px: Option<[f64; 4]>,
    /// Box of the detection.
    pub measured_px: Option<[f64; 4]>,
}

impl FrameBoxes {
    /// Returns the difference at an edge (left, top, right, bottom); `None` without a detection, or where the picture
    /// cuts the vehicle.
    fn difference(&self, edge: usize) -> Option<f64> {
        let (projected, measured) = (self.projected_px?, self.measured_px?);
        let is_cut = bbox_cut(&measured, &self.picture_px)[edge];
        (!is_cut).then(|| (measured[edge] - projected[edge]) / side(&projected, edge))
    }
}

/// Returns the width of a box for its left and right edge, and the height for the others.
fn side(bbox: &[f64; 4], edge: usize) -> f64 {
    bbox[edge % 2 + 2] - bbox[edge % 2]
}

/// Returns the projected boxes of a vehicle, px, corrected by its measured boxes. The frames are in the order of time.
/// A box may reach beyond the picture.
#[must_use]
pub fn filled_boxes(frames: &[FrameBoxes]) -> Vec<Option<[f64; 4]>> {
    let differences: [Vec<(f64, f64)>; 4] = std::array::from_fn(|edge| {
        frames.iter().filter_map(|frame| Some((frame.time_s, frame.difference(edge)?))).collect()
    });
    let filled = |frame: &FrameBoxes| {
        let projected = frame.projected_px?;
        let difference = |edge: usize| interpolated(&differences[edge], frame.time_s);
        Some(std::array::from_fn(|edge| projected[edge] + difference(edge) * side(&projected, edge)))
    };
    frames.iter().map(filled).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns frames 0.1 s apart of a vehicle that drives to the right and grows. Its projected boxes are 10 % too far
    /// left and 20 % too low.
    fn frames(measured: &[usize]) -> (Vec<FrameBoxes>, Vec<[f64; 4]>) {
        let truth = |i: usize| {
            let (x, size) = (20.0 * i as f64, 100.0 + 10.0 * i as f64);
            [x, 50.0, x + size, 50.0 + size]
        };
        let frame = |i: usize| {
            let [x0, y0, x1, y1] = truth(i);
            let (dx, dy) = (0.1 * (x1 - x0), 0.2 * (y1 - y0));
            FrameBoxes {
                time_s: 0.1 * i as f64,
                picture_px: [0.0, 0.0, 640.0, 480.0],
                projected_px: Some([x0 - dx, y0 + dy, x1 - dx, y1 + dy]),
                measured_px: measured.contains(&i).then(|| truth(i)),
            }
        };
        ((0..10).map(frame).collect(), (0..10).map(truth).collect())
    }

    #[test]
    fn measured_boxes_correct_the_projected_ones() {
        let (frames, truth) = frames(&[3, 6]);
        for (filled, truth) in filled_boxes(&frames).iter().zip(&truth) {
            let filled = filled.expect("the vehicle is in front of the camera");
            assert!(filled.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-9), "{filled:?} {truth:?}");
        }
    }

    #[test]
    fn differences_are_interpolated() {
        let (mut frames, truth) = frames(&[2, 6]);
        frames[6].projected_px = frames[6].measured_px;
        let middle = filled_boxes(&frames)[4].expect("in front of the camera");
        // Half of the correction of 10 % and 20 %.
        let expected = [truth[4][0] - 0.05 * 140.0, truth[4][1] + 0.1 * 140.0];
        assert!((middle[0] - expected[0]).abs() < 1e-9 && (middle[1] - expected[1]).abs() < 1e-9);
    }

    #[test]
    fn edges_at_the_border_and_vehicles_never_measured_correct_nothing() {
        let (frames, truth) = frames(&[0]);
        let of_last = filled_boxes(&frames)[9].expect("in front of the camera");
        // The left edge of the only detection is at the picture's border.
        assert!((of_last[0] - frames[9].projected_px.expect("projected")[0]).abs() < 1e-9);
        assert!((of_last[3] - truth[9][3]).abs() < 1e-9);
        let (unseen, _) = self::frames(&[]);
        assert_eq!(filled_boxes(&unseen)[5], unseen[5].projected_px);
    }
}
