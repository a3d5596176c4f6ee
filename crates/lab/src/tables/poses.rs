//! Tables and plots of the errors of poses and cameras, among them Tables 1 and 2 of the paper *Car Pose in Context*.

use roadplane_tables::{Cell, Column, Mark, Plot, Table, bootstrap, mean, median, quantile, share_within};

use super::{Scored, cell};
use roadplane_metrics::camera::CameraError;
use roadplane_metrics::scoring::PoseScore;
use roadplane_metrics::{add, viewpoint};

/// Number of segments of a plotted curve.
const CURVE: usize = 60;

/// Returns the table of the shares of cars whose ADD (average distance of points) is within a threshold.
///
/// This is Table 1 of the paper *Car Pose in Context*, with stricter thresholds added. Thresholds are multiples of the
/// car's diameter.
#[must_use]
pub fn add_table(title: &str, systems: &[Scored<'_, PoseScore>]) -> Table {
    let mut columns = vec![Column::new("system", 0), Column::new("cars", 0)];
    columns.extend(add::THRESHOLDS.map(|limit| Column::new(format!("{limit} d, %"), 1)));
    columns.push(Column::new("median, d", 3));
    let note = "ADD (Hinterstoisser 2012) of the points that the system returns, within the given number of \
        diameters of the car. Cars without a pose count as wrong. 95 % intervals by resampling scenes.";
    let mut table = Table::new(title, note, columns);
    for (name, scenes) in systems {
        let mut row = vec![Cell::from(*name), cars(scenes)];
        let within = |limit: f64| cell(scenes, |s| s.add, |v| share_within(v, limit), 100.0);
        row.extend(add::THRESHOLDS.map(within));
        row.push(cell(scenes, |s| s.add, median, 1.0));
        table.rows.push(row);
    }
    table
}

/// Returns the table of the shares of cars whose rotation error is within a threshold (rad).
///
/// This is Table 2 of the paper *Car Pose in Context*.
#[must_use]
pub fn viewpoint_table(title: &str, systems: &[Scored<'_, PoseScore>]) -> Table {
    let mut columns = vec![Column::new("system", 0), Column::new("cars", 0)];
    columns.extend(viewpoint::THRESHOLDS_RAD.map(|limit| Column::new(format!("{limit} rad, %"), 1)));
    columns.push(Column::new("median, °", 2));
    let note = "Viewpoint precision (Xiang 2014): geodesic angle between the rotations. Cars without a pose count as wrong.";
    let mut table = Table::new(title, note, columns);
    for (name, scenes) in systems {
        let mut row = vec![Cell::from(*name), cars(scenes)];
        let within = |limit: f64| cell(scenes, |s| s.rotation_rad, |v| share_within(v, limit), 100.0);
        row.extend(viewpoint::THRESHOLDS_RAD.map(within));
        row.push(cell(scenes, |s| s.rotation_rad, median, 1f64.to_degrees()));
        table.rows.push(row);
    }
    table
}

/// Returns the table of the gain of each system over the previous system in the list, on the same cars.
///
/// The interval of a gain is narrower than the intervals of the two systems suggest, because a hard scene is hard for
/// both systems.
#[must_use]
pub fn steps_table(title: &str, systems: &[Scored<'_, PoseScore>]) -> Table {
    type Measure = (&'static str, fn(&PoseScore) -> f64, f64);
    const MEASURES: [Measure; 4] = [
        ("ADD ≤ 0.2 d, points", |score| score.add, 0.2),
        ("ADD ≤ 0.4 d, points", |score| score.add, 0.4),
        ("ADD ≤ 0.8 d, points", |score| score.add, 0.8),
        ("rotation ≤ 0.14 rad, points", |score| score.rotation_rad, 0.14),
    ];
    let mut columns = vec![Column::new("system", 0), Column::new("better than", 0)];
    columns.extend(MEASURES.map(|(name, _, _)| Column::new(name, 1)));
    let note = "Difference of the shares of cars in percentage points, with its 95 % interval by resampling scenes. \
        Above 0 the system is better on this data set; an interval that contains 0 does not decide.";
    let mut table = Table::new(title, note, columns);
    for pair in systems.windows(2) {
        let [(before, old), (name, new)] = [pair[0], pair[1]];
        let gain = |(_, number, limit): Measure| -> Cell {
            let won = |score: &PoseScore| f64::from(u8::from(number(score) <= limit));
            let of_scene = |(old, new): (&Vec<PoseScore>, &Vec<PoseScore>)| -> Vec<f64> {
                debug_assert_eq!(old.len(), new.len(), "systems are scored on the same cars");
                old.iter().zip(new).map(|(old, new)| won(new) - won(old)).collect()
            };
            let gains: Vec<Vec<f64>> = old.iter().zip(new).map(of_scene).collect();
            bootstrap(&gains, mean).scaled(100.0).into()
        };
        let mut row = vec![Cell::from(name), Cell::from(before)];
        row.extend(MEASURES.map(gain));
        table.rows.push(row);
    }
    table
}

fn cars<T>(scenes: &[Vec<T>]) -> Cell {
    scenes.iter().map(Vec::len).sum::<usize>().to_string().into()
}

/// Returns the table of camera errors: focal length, tilt, ground normal and height, each with one row per system.
#[must_use]
pub fn camera_table(title: &str, systems: &[Scored<'_, CameraError>]) -> Table {
    let columns = vec![
        Column::new("system", 0),
        Column::new("pictures", 0),
        Column::new("focal, median %", 2),
        Column::new("focal, 90 % within %", 2),
        Column::new("focal, mean signed %", 2),
        Column::new("tilt, median °", 2),
        Column::new("tilt, 90 % within °", 2),
        Column::new("plane's normal, median °", 2),
        Column::new("height, median %", 2),
        Column::new("height, 90 % within %", 2),
        Column::new("height, mean signed %", 2),
        Column::new("focal, normalised error", 2),
        Column::new("tilt, normalised error", 2),
        Column::new("height, normalised error", 2),
    ];
    let note = "Relative errors of focal length and height, angles of tilt and normal. Normalised error: root mean \
        square of the errors in claimed sds, if any are claimed; 1 is calibrated. For clips, the claimed \
        sds of heights include the difference of a site's cars from the atlas.";
    let mut table = Table::new(title, note, columns);
    let most = |v: &[f64]| quantile(v, 0.9);
    let degrees = 1f64.to_degrees();
    for (name, scenes) in systems {
        table.rows.push(vec![
            Cell::from(*name),
            cars(scenes),
            cell(scenes, |e| e.focal_relative.abs(), median, 100.0),
            cell(scenes, |e| e.focal_relative.abs(), most, 100.0),
            cell(scenes, |e| e.focal_relative, mean, 100.0),
            cell(scenes, |e| e.tilt_rad.abs(), median, degrees),
            cell(scenes, |e| e.tilt_rad.abs(), most, degrees),
            cell(scenes, |e| e.normal_rad, median, degrees),
            cell(scenes, |e| e.height_relative.abs(), median, 100.0),
            cell(scenes, |e| e.height_relative.abs(), most, 100.0),
            cell(scenes, |e| e.height_relative, mean, 100.0),
            normalised_error(scenes, 0),
            normalised_error(scenes, 1),
            normalised_error(scenes, 2),
        ]);
    }
    table
}

/// Returns the root mean square of errors divided by their reported sds. Pictures without a reported sd are left out.
///
/// `number` selects the error: 0 for log focal length, 1 for tilt, 2 for log height.
fn normalised_error(scenes: &[Vec<CameraError>], number: usize) -> Cell {
    let of = |scene: &Vec<CameraError>| {
        scene.iter().map(|error| error.in_sds[number].powi(2)).filter(|squared| !squared.is_nan()).collect()
    };
    bootstrap(&scenes.iter().map(of).collect::<Vec<Vec<f64>>>(), |squared| mean(squared).sqrt()).into()
}

/// Returns the plot of the share of cars (%) whose ADD is within a threshold, against the threshold (car diameters).
#[must_use]
pub fn add_plot(systems: &[Scored<'_, PoseScore>]) -> Plot {
    curves("ADD", "threshold, diameters", 2.0, systems, |score| score.add)
}

/// Returns the plot of the share of cars (%) whose rotation error is within a threshold, against the threshold (rad).
#[must_use]
pub fn viewpoint_plot(systems: &[Scored<'_, PoseScore>]) -> Plot {
    curves("Viewpoint", "threshold, rad", 0.42, systems, |score| score.rotation_rad)
}

fn curves(
    title: &str,
    x_label: &str,
    end: f64,
    systems: &[Scored<'_, PoseScore>],
    number: impl Fn(&PoseScore) -> f64,
) -> Plot {
    let mut plot = Plot { y_range: Some([0.0, 100.0]), ..Plot::new(title, x_label, "cars within, %") };
    for (name, scenes) in systems {
        let values: Vec<f64> = scenes.iter().flatten().map(&number).collect();
        let point = |i: usize| {
            // Points are denser at small thresholds, where today's methods differ.
            let x = end * (i as f64 / CURVE as f64).powi(2);
            (x, 100.0 * share_within(&values, x))
        };
        plot = plot.with(*name, Mark::Curve, (0..=CURVE).map(point).collect());
    }
    plot
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_the_difference_on_the_same_cars() {
        let car = |add: f64| PoseScore { distance_m: 30.0, add, add_of_pose: add, rotation_rad: add };
        // The second system finds a car that the first system misses, improves a second car, and gets a third car
        // wrong.
        let old = [vec![car(0.1), car(f64::INFINITY)], vec![car(0.3), car(0.1)]];
        let new = [vec![car(0.1), car(0.1)], vec![car(0.15), car(0.5)]];
        let table = steps_table("t", &[("old", &old), ("new", &new)]);
        let gains: Vec<f64> = table.rows[0][2..]
            .iter()
            .map(|cell| match cell {
                Cell::Number(estimate) => estimate.value,
                Cell::Text(text) => panic!("{text}"),
            })
            .collect();
        assert_eq!(gains, [25.0, 0.0, 25.0, 0.0]);
    }
}
