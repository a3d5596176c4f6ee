//! Finds the edges of a vehicle's box at which the vehicle does not end, because another vehicle hides the rest.

use crate::edge::edge_sd_px;

/// Returns the edges that are in one set, in the other, or in both.
#[must_use]
pub fn either(a: [bool; 4], b: [bool; 4]) -> [bool; 4] {
    std::array::from_fn(|i| a[i] || b[i])
}

/// Returns whether the left, top, right and bottom edge lies where a nearer object begins.
///
/// On the ground, an object that reaches lower in the picture is nearer. It hides an edge if it covers most of it.
#[must_use]
pub fn hidden_edges<'a>(bbox_px: &[f64; 4], others: impl Iterator<Item = &'a [f64; 4]>) -> [bool; 4] {
    let [x0, y0, x1, y1] = *bbox_px;
    // Boxes whose edges are less than two sds apart touch each other.
    let touch = 2.0 * edge_sd_px((x1 - x0).min(y1 - y0));
    let mut hidden = [false; 4];
    for [a0, b0, a1, b1] in others.copied().filter(|other| other[3] > y1 + touch) {
        let wide = 2.0 * (a1.min(x1) - a0.max(x0)) > x1 - x0;
        let high = 2.0 * (b1.min(y1) - b0.max(y0)) > y1 - y0;
        hidden[0] |= high && a0 < x0 - touch && a1 > x0 - touch && a1 < x1;
        hidden[2] |= high && a1 > x1 + touch && a0 < x1 + touch && a0 > x0;
        hidden[3] |= wide && b0 < y1 + touch && b0 > y0;
    }
    hidden
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nearer_object_hides_edges() {
        let car = [100.0, 100.0, 180.0, 140.0];
        let edges = |other: [f64; 4]| hidden_edges(&car, [other].iter());
        // The cases are: a bus before its lower half, one before its left side, one behind it, one far away, one just
        // beside it.
        assert_eq!(edges([80.0, 138.0, 220.0, 260.0]), [false, false, false, true]);
        assert_eq!(edges([20.0, 40.0, 101.0, 180.0]), [true, false, false, false]);
        assert_eq!(edges([120.0, 40.0, 260.0, 120.0]), [false; 4]);
        assert_eq!(edges([400.0, 40.0, 560.0, 320.0]), [false; 4]);
        assert_eq!(edges([10.0, 90.0, 90.0, 160.0]), [false; 4]);
    }
}
