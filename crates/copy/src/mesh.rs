//! The mesh of a car body, built from the car's 36 keypoints. The mesh consists of panels between keypoints, and its
//! two sides are symmetric.

use nalgebra::{Point3, Vector3};
use roadplane_base::{KEYPOINTS, keypoint_names};

/// Material of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Painted sheet metal.
    Paint,
    /// Windows.
    Glass,
    /// Tyres, the underside, and the lower edges of the bumpers.
    Rubber,
    /// Spokes of a wheel.
    Rim,
}

/// A triangle: its material and its three corners, m. Seen from outside, the corners are in counter-clockwise order.
pub type Triangle = (Part, [Point3<f64>; 3]);

/// The mesh of a car body: triangles in the car frame.
#[derive(Clone, Debug, Default)]
pub struct CarMesh {
    triangles: Vec<Triangle>,
}

/// Panels of the car's left side. Each panel has a material and a list of named points.
///
/// Most names are names of keypoints without the prefix `left_`. The function `corner` defines the other names. A `+`
/// before a name moves the point to the plane midway between the two sides.
///
/// Seen from outside, the points are in clockwise order. A panel is divided into triangles that all have the first
/// point as a corner.
const PANELS: [(Part, &[&str]); 22] = [
    (Part::Paint, &["headlight_inner", "+headlight_inner", "+windscreen_bottom", "windscreen_bottom"]),
    (Part::Paint, &["headlight_outer", "headlight_inner", "windscreen_bottom", "side_window_front"]),
    (Part::Rubber, &["bumper_front", "+bumper_front", "+nose", "nose"]),
    (Part::Paint, &["nose", "+nose", "+headlight_inner", "headlight_inner"]),
    (Part::Paint, &["nose", "headlight_inner", "headlight_outer"]),
    (Part::Glass, &["windscreen_bottom", "+windscreen_bottom", "+windscreen_top", "windscreen_top"]),
    (Part::Paint, &["windscreen_top", "+windscreen_top", "+roof", "rear_window_top"]),
    (Part::Paint, &["rear_window_top", "+roof", "+rear_window_top"]),
    (Part::Glass, &["rear_window_top", "+rear_window_top", "+rear_window_bottom", "rear_window_bottom"]),
    (Part::Paint, &["rear_window_bottom", "+rear_window_bottom", "+taillight_inner", "taillight_inner"]),
    (Part::Paint, &["side_window_rear", "rear_window_bottom", "taillight_inner", "taillight_outer"]),
    (Part::Paint, &["tail", "taillight_outer", "taillight_inner", "+taillight_inner", "+tail"]),
    (Part::Rubber, &["tail", "+tail", "+bumper_rear", "bumper_rear"]),
    (Part::Paint, &["side_window_front", "windscreen_bottom", "windscreen_top"]),
    (
        Part::Glass,
        &["b_pillar_bottom", "side_window_front", "windscreen_top", "rear_window_top", "side_window_rear"],
    ),
    (Part::Paint, &["side_window_rear", "rear_window_top", "rear_window_bottom"]),
    (Part::Paint, &["sill_front", "nose", "headlight_outer", "side_window_front", "b_pillar_bottom"]),
    (Part::Paint, &["sill_rear", "sill_front", "b_pillar_bottom"]),
    (Part::Paint, &["tail", "sill_rear", "b_pillar_bottom", "side_window_rear", "taillight_outer"]),
    (Part::Rubber, &["sill_front", "bumper_front", "nose"]),
    (Part::Rubber, &["tail", "bumper_rear", "sill_rear"]),
    (
        Part::Rubber,
        &["+bumper_front", "bumper_front", "sill_front", "sill_rear", "bumper_rear", "+bumper_rear"],
    ),
];

impl CarMesh {
    /// Builds the mesh from a car's keypoints (car frame, m).
    ///
    /// The bumpers and the roof bulge in the middle. So the mesh has the length and height in `dims_m` (length, width,
    /// height). `centre_m` is the distance from the origin forward to the centre of the body.
    #[must_use]
    pub fn new(points: &[Vector3<f64>; KEYPOINTS], dims_m: [f64; 3], centre_m: f64) -> Self {
        let mut mesh = Self::default();
        for (part, names) in PANELS {
            let left: Vec<Point3<f64>> =
                names.iter().map(|name| corner(points, name, dims_m, centre_m)).collect();
            let right: Vec<Point3<f64>> = left.iter().map(|p| Point3::new(p.x, -p.y, p.z)).collect();
            for corners in left.windows(2).skip(1) {
                mesh.triangles.push((part, [left[0], corners[1], corners[0]]));
            }
            for corners in right.windows(2).skip(1) {
                mesh.triangles.push((part, [right[0], corners[0], corners[1]]));
            }
        }
        mesh
    }

    /// Returns the triangles of the mesh.
    #[must_use]
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }
}

/// Returns the position of the keypoint with a given name in the car frame, m.
pub(crate) fn point(points: &[Vector3<f64>; KEYPOINTS], name: &str) -> Vector3<f64> {
    let index = keypoint_names().iter().position(|keypoint| keypoint == name);
    index.map_or_else(Vector3::zeros, |i| points[i])
}

/// Returns the position of a point on the left side in the car frame, m. `name` is a name as in [`PANELS`].
fn corner(points: &[Vector3<f64>; KEYPOINTS], name: &str, dims_m: [f64; 3], centre_m: f64) -> Point3<f64> {
    let [length, _, height] = dims_m;
    let (in_middle, bare) = name.strip_prefix('+').map_or((false, name), |bare| (true, bare));
    let of = |name: &str| point(points, &format!("left_{name}"));
    let between = |a: &str, b: &str, s: f64| of(a).lerp(&of(b), s);
    let sill = |wheel: f64| {
        let tyre = if wheel > 0.0 { of("tyre_front") } else { of("tyre_rear") };
        let radius = of("wheel_front").z;
        Vector3::new(tyre.x - wheel * 1.1 * radius, tyre.y, 0.6 * radius)
    };
    let mut at = match bare {
        "nose" => between("bumper_front", "headlight_outer", 0.35),
        "tail" => between("bumper_rear", "taillight_outer", 0.35),
        "sill_front" => sill(1.0),
        "sill_rear" => sill(-1.0),
        "roof" => between("windscreen_top", "rear_window_top", 0.45),
        keypoint => of(keypoint),
    };
    if in_middle {
        at.y = 0.0;
        match bare {
            "roof" => at.z = height,
            "windscreen_top" | "rear_window_top" => at.z += 0.5 * (height - at.z).max(0.0),
            "nose" => at.x = centre_m + length / 2.0,
            "tail" => at.x = centre_m - length / 2.0,
            "bumper_front" => at.x = centre_m + length / 2.0 - 0.08,
            "bumper_rear" => at.x = centre_m - length / 2.0 + 0.08,
            _ => {}
        }
    }
    Point3::from(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{Shape, ShapeAtlas};

    fn mesh(shape: &Shape) -> (CarMesh, [f64; 3], f64) {
        let atlas = ShapeAtlas::shipped().unwrap();
        let points = atlas.keypoints_in_car(shape);
        let dims: [f64; 3] = atlas.dims_m(shape).into();
        let x = points.map(|p| p.x);
        let centre = x.iter().copied().fold(f64::MIN, f64::max) / 2.0
            + x.iter().copied().fold(f64::MAX, f64::min) / 2.0;
        (CarMesh::new(&points, dims, centre), dims, centre)
    }

    #[test]
    fn the_body_has_the_cars_dimensions_and_clears_the_ground() {
        for shape in [Shape::zeros(), Shape::from([1.0, -1.0, 0.5, 0.0, 0.3, 0.0]), Shape::repeat(-0.8)] {
            let (mesh, dims, centre) = mesh(&shape);
            let corners = || mesh.triangles().iter().flat_map(|(_, corners)| corners);
            let low = corners().fold(Point3::from([f64::MAX; 3]), |a, b| a.inf(b));
            let high = corners().fold(Point3::from([f64::MIN; 3]), |a, b| a.sup(b));
            assert!((high.x - low.x - dims[0]).abs() < 0.02 && (high.x + low.x - 2.0 * centre).abs() < 0.02);
            assert!((high.y - low.y - dims[1]).abs() < 0.12, "{} {}", high.y - low.y, dims[1]);
            assert!((high.z - dims[2]).abs() < 1e-9 && (0.1..0.4).contains(&low.z), "{} {}", high.z, low.z);
        }
    }

    #[test]
    fn faces_point_outwards() {
        let (mesh, dims, centre) = mesh(&Shape::zeros());
        let middle = Point3::new(centre, 0.0, dims[2] / 2.0);
        for (part, [a, b, c]) in mesh.triangles() {
            let normal = (b - a).cross(&(c - a));
            let out = Point3::from((a.coords + b.coords + c.coords) / 3.0) - middle;
            assert!(normal.dot(&out) > 0.0, "{part:?} {a} {b} {c}");
        }
    }

    #[test]
    fn the_volume_is_that_of_a_car() {
        let (mesh, dims, _) = mesh(&Shape::zeros());
        let signed = |[a, b, c]: &[Point3<f64>; 3]| a.coords.dot(&b.coords.cross(&c.coords)) / 6.0;
        let volume: f64 = mesh.triangles().iter().map(|(_, triangle)| signed(triangle)).sum();
        let share = volume / (dims[0] * dims[1] * dims[2]);
        assert!((0.45..0.85).contains(&share), "{share}");
    }
}
