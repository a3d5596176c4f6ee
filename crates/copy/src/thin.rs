//! Thinning of trajectories to few vertices. The thinned trajectory stays within fixed error bounds of the full
//! trajectory.

use nalgebra::Vector2;
use roadplane_base::{GroundPose, wrap_angle};
use serde::Serialize;

/// Largest distance by which thinning moves any point of a car at the time of any row, m. Rounding and the time steps
/// of simulators add further errors. The total error stays within 2 cm.
const POSITION_M: f64 = 0.012;
/// Largest angle by which thinning turns a car at the time of any row, rad.
const HEADING_RAD: f64 = 0.004;

/// A vertex of a trajectory: the pose of a car at one time. Between two vertices, position and heading are interpolated
/// linearly in time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Vertex {
    /// Time from the start of the scene, s.
    pub time_s: f64,
    /// Position and heading of the car's origin on the ground.
    #[serde(flatten)]
    pub pose: GroundPose,
}

/// Points on the longitudinal axis of a car. Thinning limits the errors of these points.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Coordinate of the rear axle on the longitudinal axis, m, positive ahead of the origin. Some simulators move a
    /// car by its rear axle.
    pub rear_axle_m: f64,
    /// Coordinates of the rear end and the front end on the longitudinal axis, m, positive ahead of the origin. The
    /// errors of points between the ends are not larger than the errors of the ends.
    pub ends_m: [f64; 2],
}

/// Returns the vertices that remain after thinning. The method is that of Douglas and Peucker (1973), with distances
/// between points at equal times.
///
/// Headings do not jump by a full turn. So simulators turn the car by the smaller angle. Some simulators move a car by
/// its origin, and others move the car by its rear axle. In both cases, both ends of the body stay within the error
/// bounds.
#[must_use]
pub fn thinned(rows: &[Vertex], body: &Body) -> Vec<Vertex> {
    let rows = unwrapped(rows);
    if rows.len() < 2 {
        return rows;
    }
    let mut keep = vec![false; rows.len()];
    keep[0] = true;
    keep[rows.len() - 1] = true;
    let mut open = vec![(0, rows.len() - 1)];
    while let Some((first, last)) = open.pop() {
        let strays = (first + 1..last).map(|i| (i, stray(&rows[first], &rows[last], &rows[i], body)));
        let worst = strays.max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((i, _)) = worst.filter(|(_, stray)| *stray > 1.0) {
            keep[i] = true;
            open.extend([(first, i), (i, last)]);
        }
    }
    let kept: Vec<Vertex> = rows.iter().zip(&keep).filter(|(_, kept)| **kept).map(|(row, _)| *row).collect();
    // A stationary car needs no second vertex.
    let is_stationary = kept.len() == 2 && stray(&kept[0], &kept[0], &kept[1], body) <= 1.0;
    if is_stationary { kept[..1].to_vec() } else { kept }
}

/// Returns the pose on a trajectory at a time (s); `None` if the trajectory has no vertices.
///
/// The car is stationary before the first vertex and after the last vertex.
#[must_use]
pub fn at(vertices: &[Vertex], time_s: f64) -> Option<GroundPose> {
    let next = vertices.partition_point(|vertex| vertex.time_s <= time_s);
    match (next.checked_sub(1).and_then(|i| vertices.get(i)), vertices.get(next)) {
        (Some(a), Some(b)) => Some(between(a, b, time_s)),
        (Some(end), None) | (None, Some(end)) => Some(end.pose),
        (None, None) => None,
    }
}

/// Returns the vertices with headings that do not jump by a full turn.
fn unwrapped(rows: &[Vertex]) -> Vec<Vertex> {
    let mut rows = rows.to_vec();
    for i in 1..rows.len() {
        let before = rows[i - 1].pose.heading_rad;
        rows[i].pose.heading_rad = before + wrap_angle(rows[i].pose.heading_rad - before);
    }
    rows
}

/// Returns the pose at a time (s) by linear interpolation between two vertices.
fn between(a: &Vertex, b: &Vertex, time_s: f64) -> GroundPose {
    let span = b.time_s - a.time_s;
    let s = if span > 0.0 { ((time_s - a.time_s) / span).clamp(0.0, 1.0) } else { 0.0 };
    let mix = |from: f64, to: f64| from + s * (to - from);
    GroundPose {
        x_m: mix(a.pose.x_m, b.pose.x_m),
        y_m: mix(a.pose.y_m, b.pose.y_m),
        heading_rad: mix(a.pose.heading_rad, b.pose.heading_rad),
    }
}

/// Returns the error at the time of `row` if the poses between `a` and `b` are interpolated.
///
/// The value 1 is the largest allowed error: [`POSITION_M`] for positions or [`HEADING_RAD`] for headings.
fn stray(a: &Vertex, b: &Vertex, row: &Vertex, body: &Body) -> f64 {
    let found = between(a, b, row.time_s);
    // Some simulators interpolate the position of the rear axle. In a curve, this shifts the whole car by `elsewhere`.
    let span = b.time_s - a.time_s;
    let s = if span > 0.0 { (row.time_s - a.time_s) / span } else { 0.0 };
    let rear = ahead_of(&a.pose, body.rear_axle_m).lerp(&ahead_of(&b.pose, body.rear_axle_m), s);
    let elsewhere = rear - ahead_of(&found, body.rear_axle_m);
    let apart = body.ends_m.map(|end| {
        let apart = ahead_of(&found, end) - ahead_of(&row.pose, end);
        apart.norm().max((apart + elsewhere).norm())
    });
    let turned = (found.heading_rad - row.pose.heading_rad).abs();
    (apart[0].max(apart[1]) / POSITION_M).max(turned / HEADING_RAD)
}

/// Returns the point that is `metres` ahead of the car's origin along its heading: world x and y, m.
pub(crate) fn ahead_of(pose: &GroundPose, metres: f64) -> Vector2<f64> {
    let (sin, cos) = pose.heading_rad.sin_cos();
    Vector2::new(pose.x_m + metres * cos, pose.y_m + metres * sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::angle_difference;

    const BODY: Body = Body { rear_axle_m: -1.4, ends_m: [-2.3, 2.4] };

    /// Returns the drive of a car: a straight line, then a curve in which the heading passes π, then a stop.
    fn drive() -> Vec<Vertex> {
        let pose = |t: f64| {
            let driven = 8.0 * t.min(9.0);
            let turned = ((driven - 24.0) / 12.0).clamp(0.0, 2.5);
            let straight = 24f64.min(driven);
            let heading = 1.5 + turned;
            let start = Vector2::new(1.5f64.cos(), 1.5f64.sin()) * straight;
            let arc = Vector2::new(heading.sin() - 1.5f64.sin(), 1.5f64.cos() - heading.cos()) * 12.0;
            let rest = Vector2::new(heading.cos(), heading.sin()) * (driven - straight - 12.0 * turned);
            let at = start + arc + rest;
            GroundPose { x_m: at.x, y_m: at.y, heading_rad: wrap_angle(heading) }
        };
        (0..360).map(|i| f64::from(i) / 30.0).map(|t| Vertex { time_s: t, pose: pose(t) }).collect()
    }

    #[test]
    fn a_thinned_drive_stays_within_its_bounds() {
        let rows = drive();
        let kept = thinned(&rows, &BODY);
        assert!(kept.len() < rows.len() / 4, "{}", kept.len());
        for row in &rows {
            let found = at(&kept, row.time_s).unwrap();
            for part_m in [-2.3, 0.0, 2.4] {
                assert!((ahead_of(&found, part_m) - ahead_of(&row.pose, part_m)).norm() <= POSITION_M);
            }
            assert!(angle_difference(found.heading_rad, row.pose.heading_rad).abs() <= HEADING_RAD);
        }
        assert!(
            kept.windows(2).all(|w| (w[1].pose.heading_rad - w[0].pose.heading_rad).abs() < 1.0),
            "no jump at π"
        );
    }

    #[test]
    fn stationary_cars_have_one_vertex_and_empty_tracks_none() {
        let still: Vec<Vertex> =
            (0..50).map(|i| Vertex { time_s: f64::from(i), pose: drive()[0].pose }).collect();
        assert_eq!(thinned(&still, &BODY).len(), 1);
        assert_eq!(at(&thinned(&still, &BODY), 20.0), Some(still[0].pose));
        assert!(thinned(&[], &BODY).is_empty() && at(&[], 0.0).is_none());
    }
}
