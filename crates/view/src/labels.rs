//! The texts of vehicle labels, and the positions of the labels in the picture.

use roadplane_base::{TrackRow, VehicleClass};

use crate::activities::{notable_activity, words};

/// Returns the label of a vehicle: its track number, class, speed and activity.
///
/// The label of a car contains no class. The label of a stationary vehicle contains no speed.
pub(crate) fn label(row: &TrackRow) -> String {
    let mut label = row.track.to_string();
    if row.class != VehicleClass::Car {
        label = format!("{label} {}", row.class.name());
    }
    if row.speed_mps.abs() >= 0.3 {
        // A vehicle that reverses has a negative speed.
        label = format!("{label} {:.1} m/s", row.speed_mps);
    }
    if let Some(activity) = notable_activity(row) {
        label = format!("{label} {}", words(activity));
    }
    label
}

/// Returns a free rectangle for the label of the box with index `own`; `None` if there is no room.
///
/// The rectangle is above, below or inside the box. It is inside only if it covers at most a quarter of the box. It
/// overlaps no other box and no label in `placed`.
///
/// The label has the size `[width, height]`, and the picture has the size `[right, bottom]`. All values are in px.
pub(crate) fn free_rectangle(
    own: usize,
    boxes: &[[f64; 4]],
    placed: &[[f64; 4]],
    [width, height]: [f64; 2],
    [right, bottom]: [f64; 2],
) -> Option<[f64; 4]> {
    let [x0, y0, x1, y1] = boxes[own];
    let inside = 4.0 * width * height <= (x1 - x0) * (y1 - y0) && width <= x1 - x0;
    let left = x0.clamp(0.0, (right - width).max(0.0));
    let tops = [Some(y0 - height), Some(y1), inside.then_some(y0.max(0.0))];
    let plate = |top: f64| [left, top, left + width, top + height];
    let apart = |a: &[f64; 4], b: &[f64; 4]| a[0] >= b[2] || b[0] >= a[2] || a[1] >= b[3] || b[1] >= a[3];
    tops.into_iter().flatten().filter(|top| *top >= 0.0 && top + height <= bottom).map(plate).find(|plate| {
        let others = boxes.iter().enumerate().filter(|(i, _)| *i != own).map(|(_, other)| other);
        others.chain(placed).all(|other| apart(plate, other))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_cover_no_other_car() {
        // Three far cars, one behind the other, and a near car.
        let boxes = [
            [100.0, 100.0, 130.0, 115.0],
            [105.0, 84.0, 135.0, 99.0],
            [110.0, 68.0, 140.0, 83.0],
            [300.0, 0.0, 500.0, 150.0],
        ];
        let size = [640.0, 360.0];
        let mut placed: Vec<[f64; 4]> = Vec::new();
        for own in 0..4 {
            placed.extend(free_rectangle(own, &boxes, &placed, [60.0, 14.0], size));
        }
        assert_eq!(placed.len(), 3, "{placed:?}");
        assert!((placed[0][1] - 115.0).abs() < 1e-9, "below the nearest of the three");
        assert!((placed[1][3] - 68.0).abs() < 1e-9, "above the farthest");
        assert!((placed[2][1] - 150.0).abs() < 1e-9, "below the car at the upper edge");
        assert_eq!(
            free_rectangle(0, &boxes[..1], &[], [60.0, 14.0], [110.0, 116.0]),
            Some([50.0, 86.0, 110.0, 100.0])
        );
    }
}
