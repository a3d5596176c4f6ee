//! Tables of keypoint errors: overall, per keypoint, per size of the car, per body type.

use std::collections::BTreeMap;

use roadplane_base::{KEYPOINTS, keypoint_names};
use roadplane_tables::SD_FROM_MEDIAN;
use roadplane_tables::{Cell, Column, Estimate, Table, bootstrap, bootstrap_scenes, median, share_within};

use super::measure::{CarErrors, Confusion, auc};

/// Limits between the size classes of cars: longer side of the box, px.
const SIZES_PX: [f64; 6] = [0.0, 40.0, 60.0, 100.0, 200.0, f64::INFINITY];

/// Returns the tables of keypoint errors. `groups` are the names and cars of groups, such as the cars of one image.
///
/// With several groups, the last row of the first table is for all cars.
#[must_use]
pub fn keypoint_tables(groups: &[(String, Vec<CarErrors>)]) -> Vec<Table> {
    let all: Vec<&CarErrors> = groups.iter().flat_map(|(_, cars)| cars).collect();
    let mut overall = overall_table();
    for (name, cars) in groups {
        overall.rows.push(overall_row(name, &cars.iter().collect::<Vec<_>>()));
    }
    if groups.len() > 1 {
        overall.rows.push(overall_row("all", &all));
    }
    vec![overall, by_keypoint(&all), by_size(&all), by_body(&all)]
}

/// Returns the indices of the cars, the worst first. Cars without clear keypoints are left out.
///
/// Cars with exchanged names come first. Otherwise the car with the larger median error comes first.
#[must_use]
pub fn worst_first(cars: &[&CarErrors]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..cars.len()).filter(|i| !cars[*i].points.is_empty()).collect();
    order.sort_by(|a, b| {
        let key = |i: &usize| (cars[*i].confusion.is_some(), cars[*i].median());
        let ((x, p), (y, q)) = (key(b), key(a));
        x.cmp(&y).then(p.total_cmp(&q)).then(a.cmp(b))
    });
    order
}

fn overall_table() -> Table {
    Table::new(
        "Keypoints",
        "Clear keypoints; error in % of the longer side of the true box; 95 % intervals by resampling cars. AUC: \
         score of clear against hidden or blurred. Normalised error: robust sd of the error in units of the \
         predicted sd; 1 is calibrated.",
        vec![
            Column::new("image", 0),
            Column::new("cars", 0),
            Column::new("points", 0),
            Column::new("median, %", 2),
            Column::new("PCK@0.05, %", 1),
            Column::new("PCK@0.1, %", 1),
            Column::new("AUC", 3),
            Column::new("normalised error", 2),
            Column::new("left/right", 0),
            Column::new("front/back", 0),
            Column::new("turned round", 0),
        ],
    )
}

fn overall_row(name: &str, cars: &[&CarErrors]) -> Vec<Cell> {
    let points: usize = cars.iter().map(|car| car.points.len()).sum();
    let mut row: Vec<Cell> = vec![name.into(), (cars.len() as f64).into(), (points as f64).into()];
    row.extend(accuracy(cars, |_| true).map(Cell::from));
    row.push(
        bootstrap_scenes(cars, points, |chosen| {
            let seen: Vec<f64> = chosen.iter().flat_map(|c| c.points.iter().map(|p| p.score)).collect();
            let hidden: Vec<f64> = chosen.iter().flat_map(|c| c.hidden_scores.iter().copied()).collect();
            auc(&seen, &hidden)
        })
        .into(),
    );
    row.push(
        bootstrap_scenes(cars, points, |chosen| {
            let sizes = chosen.iter().flat_map(|c| c.points.iter().flat_map(|p| p.normalised));
            SD_FROM_MEDIAN * median(&sizes.map(f64::abs).collect::<Vec<_>>())
        })
        .into(),
    );
    for kind in Confusion::ALL {
        row.push((cars.iter().filter(|car| car.confusion == Some(kind)).count() as f64).into());
    }
    row
}

/// Returns the median error, PCK (share of correct keypoints) at 0.05 and PCK at 0.1, all in %.
///
/// Only keypoints for which `wanted` is true take part.
fn accuracy(cars: &[&CarErrors], wanted: impl Fn(usize) -> bool) -> [Estimate; 3] {
    let errors: Vec<Vec<f64>> = cars
        .iter()
        .map(|car| car.points.iter().filter(|p| wanted(p.index)).map(|p| p.of_box).collect())
        .collect();
    [
        bootstrap(&errors, median).scaled(100.0),
        bootstrap(&errors, |e| share_within(e, 0.05)).scaled(100.0),
        bootstrap(&errors, |e| share_within(e, 0.1)).scaled(100.0),
    ]
}

fn part_table(title: &str, first: &str) -> Table {
    let columns = [("points", 0), ("median, %", 2), ("PCK@0.05, %", 1), ("PCK@0.1, %", 1)];
    let mut all = vec![Column::new(first, 0)];
    all.extend(columns.map(|(title, decimals)| Column::new(title, decimals)));
    Table::new(title, "", all)
}

fn part_row(table: &mut Table, name: &str, cars: &[&CarErrors], wanted: impl Fn(usize) -> bool) {
    let estimates = accuracy(cars, wanted);
    if estimates[0].n > 0 {
        let mut row: Vec<Cell> = vec![name.into(), (estimates[0].n as f64).into()];
        row.extend(estimates.map(Cell::from));
        table.rows.push(row);
    }
}

fn by_keypoint(cars: &[&CarErrors]) -> Table {
    let half = KEYPOINTS / 2;
    let mut table = part_table("By keypoint (both sides)", "keypoint");
    for (k, name) in keypoint_names().iter().take(half).enumerate() {
        part_row(&mut table, name.trim_start_matches("left_"), cars, |index| index % half == k);
    }
    table
}

fn by_size(cars: &[&CarErrors]) -> Table {
    let mut table = part_table("By size of the car", "longer side of the box");
    for limits in SIZES_PX.windows(2) {
        let chosen: Vec<&CarErrors> =
            cars.iter().copied().filter(|car| (limits[0]..limits[1]).contains(&car.box_px)).collect();
        let name = if limits[1].is_finite() {
            format!("{}–{} px", limits[0], limits[1])
        } else {
            format!("over {} px", limits[0])
        };
        part_row(&mut table, &name, &chosen, |_| true);
    }
    table
}

fn by_body(cars: &[&CarErrors]) -> Table {
    let mut bodies: BTreeMap<&str, Vec<&CarErrors>> = BTreeMap::new();
    for car in cars {
        bodies.entry(if car.body.is_empty() { "unknown" } else { &car.body }).or_default().push(car);
    }
    let mut table = part_table("By body type", "body");
    for (body, chosen) in bodies {
        part_row(&mut table, body, &chosen, |_| true);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::super::measure::PointError;
    use super::*;

    fn car(of_box: f64, box_px: f64, body: &str, confusion: Option<Confusion>) -> CarErrors {
        let point = |index| PointError { index, of_box, normalised: [1.0, -1.0], score: 0.9 };
        CarErrors {
            box_px,
            body: body.to_owned(),
            points: vec![point(0), point(18), point(5)],
            hidden_scores: vec![0.1],
            confusion,
        }
    }

    #[test]
    fn tables_count_cars_and_points() {
        let groups = [
            ("a".to_owned(), vec![car(0.01, 50.0, "suv", None), car(0.2, 150.0, "", None)]),
            ("b".to_owned(), vec![car(0.06, 500.0, "suv", Some(Confusion::FrontBack))]),
        ];
        let tables = keypoint_tables(&groups);
        let value = |cell: &Cell| match cell {
            Cell::Number(estimate) => estimate.value,
            Cell::Text(_) => f64::NAN,
        };
        let all: Vec<f64> = tables[0].rows[2].iter().map(value).collect();
        assert_eq!(&all[1..4], [3.0, 9.0, 6.0]);
        assert!((all[4] - 100.0 / 3.0).abs() < 1e-9 && (all[5] - 200.0 / 3.0).abs() < 1e-9);
        assert_eq!(&all[6..], [1.0, SD_FROM_MEDIAN, 0.0, 1.0, 0.0]);
        // Keypoints 0 and 18 are the same point of the car, on the left and the right side.
        let points: Vec<f64> = tables[1].rows.iter().map(|row| value(&row[1])).collect();
        assert_eq!(points, [6.0, 3.0]);
        assert_eq!(tables[2].rows.len(), 3);
        assert_eq!(tables[3].rows.len(), 2);
    }

    #[test]
    fn the_worst_come_first() {
        let cars = [
            car(0.01, 50.0, "", None),
            car(0.3, 50.0, "", None),
            car(0.02, 50.0, "", Some(Confusion::LeftRight)),
        ];
        assert_eq!(worst_first(&cars.iter().collect::<Vec<_>>()), [2, 1, 0]);
    }
}
