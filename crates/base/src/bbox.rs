//! Geometry of boxes in the image. A box is `[left, top, right, bottom]`, px.

use nalgebra::Vector2;

/// Returns the centre of a box, px.
#[must_use]
pub fn bbox_centre(bbox_px: &[f64; 4]) -> Vector2<f64> {
    let [x0, y0, x1, y1] = bbox_px;
    Vector2::new((x0 + x1) / 2.0, (y0 + y1) / 2.0)
}

/// Returns the longer side of a box, px.
#[must_use]
pub fn bbox_longer_side([x0, y0, x1, y1]: &[f64; 4]) -> f64 {
    (x1 - x0).max(y1 - y0)
}

/// Returns the middle of a box's lower edge, px. There a vehicle meets the ground.
#[must_use]
pub fn bbox_foot(bbox_px: &[f64; 4]) -> Vector2<f64> {
    Vector2::new((bbox_px[0] + bbox_px[2]) / 2.0, bbox_px[3])
}

/// Returns the box shifted by a vector, px.
#[must_use]
pub fn bbox_moved([x0, y0, x1, y1]: &[f64; 4], by: &Vector2<f64>) -> [f64; 4] {
    [x0 + by.x, y0 + by.y, x1 + by.x, y1 + by.y]
}

/// Returns the mapping of a box: the middles of its edges are mapped. A rotation does not enlarge the box.
#[must_use]
pub fn bbox_mapped(bbox_px: &[f64; 4], map: impl Fn(&Vector2<f64>) -> Vector2<f64>) -> [f64; 4] {
    let [x0, y0, x1, y1] = bbox_px;
    let middle = Vector2::new(0.5 * (x0 + x1), 0.5 * (y0 + y1));
    let at = |x: f64, y: f64| map(&Vector2::new(x, y));
    let (left, right) = (at(*x0, middle.y).x, at(*x1, middle.y).x);
    let (top, bottom) = (at(middle.x, *y0).y, at(middle.x, *y1).y);
    [left.min(right), top.min(bottom), left.max(right), top.max(bottom)]
}

/// Returns the smallest box that contains both boxes.
#[must_use]
pub fn bbox_around(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// Returns the part of a box that lies inside another box, px.
#[must_use]
pub fn bbox_inside(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
    [a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]
}

/// Returns the share of `bbox` that lies inside `outer`, 0–1. The share is 0 if `bbox` has no area.
#[must_use]
pub fn bbox_share_inside(bbox: &[f64; 4], outer: &[f64; 4]) -> f64 {
    intersection(bbox, outer) / area(bbox).max(1e-9)
}

/// Returns the part of a vehicle's whole box in which the vehicle is visible.
///
/// `whole_px` is the box of the whole vehicle, and `seen_px` is the box of its visible part. `hidden` marks the edges
/// of `seen_px` (left, top, right, bottom) at which another object hides the vehicle. At these edges, the whole box is
/// cut off at `seen_px`.
#[must_use]
pub fn bbox_part_seen(whole_px: &[f64; 4], seen_px: &[f64; 4], hidden: [bool; 4]) -> [f64; 4] {
    std::array::from_fn(|i| match (hidden[i], i < 2) {
        (false, _) => whole_px[i],
        (true, true) => whole_px[i].max(seen_px[i]),
        (true, false) => whole_px[i].min(seen_px[i]),
    })
}

/// An edge nearer than this to the picture's border is cut off by the picture, px.
const CUT_PX: f64 = 2.5;

/// Returns whether a box reaches the border of the picture `[left, top, right, bottom]`, edge by edge.
#[must_use]
pub fn bbox_cut([x0, y0, x1, y1]: &[f64; 4], [left, top, right, bottom]: &[f64; 4]) -> [bool; 4] {
    [*x0 < left + CUT_PX, *y0 < top + CUT_PX, *x1 > right - CUT_PX, *y1 > bottom - CUT_PX]
}

/// Returns the intersection over union of two boxes, 0–1. The result is 0 if a box has no area.
#[must_use]
pub fn bbox_iou(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let common = intersection(a, b);
    let union = area(a) + area(b) - common;
    if union > 0.0 { common / union } else { 0.0 }
}

/// Returns the share of the smaller box that lies inside the larger box, 0–1. The share is 0 if a box has no area.
#[must_use]
pub fn bbox_covered(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let smaller = area(a).min(area(b));
    if smaller > 0.0 { intersection(a, b) / smaller } else { 0.0 }
}

/// Returns a part of a box, px. `shares` are its left, top, right and bottom as shares of the box's width and height.
#[must_use]
pub fn bbox_part([x0, y0, x1, y1]: &[f64; 4], shares: &[f64; 4]) -> [f64; 4] {
    let ([left, top, right, bottom], w, h) = (shares, x1 - x0, y1 - y0);
    [x0 + left * w, y0 + top * h, x0 + right * w, y0 + bottom * h]
}

/// Returns a test whether a point (px) of a vehicle's box lies in the box of a nearer vehicle. A box that ends lower in
/// the picture is nearer to the camera.
pub fn bbox_hidden_by(bbox_px: &[f64; 4], others: &[[f64; 4]]) -> impl Fn(&Vector2<f64>) -> bool + use<> {
    let nearer: Vec<[f64; 4]> = others.iter().copied().filter(|other| other[3] > bbox_px[3]).collect();
    move |point_px| {
        nearer
            .iter()
            .any(|[x0, y0, x1, y1]| (*x0..=*x1).contains(&point_px.x) && (*y0..=*y1).contains(&point_px.y))
    }
}

fn area([x0, y0, x1, y1]: &[f64; 4]) -> f64 {
    (x1 - x0).max(0.0) * (y1 - y0).max(0.0)
}

fn intersection(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    area(&bbox_inside(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlaps_are_measured() {
        let a = [0.0, 0.0, 10.0, 10.0];
        let b = [5.0, 0.0, 15.0, 10.0];
        assert!((bbox_iou(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
        assert!((bbox_iou(&a, &a) - 1.0).abs() < 1e-12);
        assert!((bbox_covered(&a, &[2.0, 2.0, 4.0, 4.0]) - 1.0).abs() < 1e-12);
        assert!(bbox_iou(&a, &[20.0, 20.0, 30.0, 30.0]) < 1e-12);
        assert!(bbox_iou(&[1.0; 4], &[1.0; 4]) < 1e-12);
        assert_eq!(bbox_centre(&b), Vector2::new(10.0, 5.0));
        let (whole, seen) = ([60.0, 98.0, 182.0, 170.0], [100.0, 100.0, 180.0, 140.0]);
        assert_eq!(bbox_part_seen(&whole, &seen, [true, false, false, true]), [100.0, 98.0, 182.0, 140.0]);
        assert!((bbox_share_inside(&b, &[0.0, 0.0, 10.0, 100.0]) - 0.5).abs() < 1e-12);
        assert!(bbox_share_inside(&[1.0; 4], &a) < 1e-12);
        assert_eq!(bbox_inside(&a, &b), [5.0, 0.0, 10.0, 10.0]);
        assert_eq!(bbox_moved(&a, &Vector2::new(5.0, 0.0)), b);
        assert_eq!(bbox_around(&a, &[-1.0, 2.0, 3.0, 11.0]), [-1.0, 0.0, 10.0, 11.0]);
    }
}
