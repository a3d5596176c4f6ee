//! Tables and plots of the evaluation on reference cameras.

use std::collections::BTreeMap;

use roadplane_base::{KEYPOINTS, keypoint_names};
use roadplane_tables::SD_FROM_MEDIAN;
use roadplane_tables::{
    Cell, Column, Estimate, Mark, Plot, Report, Series, Table, bootstrap, bootstrap_scenes, mean, median,
};
use roadplane_write::CameraSegment;

use super::cars::{Aspect, SeenCar};
use super::measured::{ANOTHER_VIEW, LEAST_PX, Measured, counted};
use super::view_errors;

/// Largest reported sd of the log focal length in the table row "focal length claimed".
const CLAIMED: f64 = 0.12;
/// The four quantities of a camera: the column's title, and the factor that converts an error to the title's unit.
const NUMBERS: [(&str, f64); 4] = [
    ("focal, %", 100.0),
    ("tilt, °", 180.0 / std::f64::consts::PI),
    ("roll, °", 180.0 / std::f64::consts::PI),
    ("height, %", 100.0),
];

pub(super) fn report(measured: &[Measured]) -> Report {
    let straight: Vec<&Measured> = measured.iter().filter(|m| m.camera.is_straight()).collect();
    Report {
        title: "Reference cameras".to_owned(),
        tables: vec![
            each_camera(measured),
            all_cameras(&straight),
            cars_table(&straight),
            shared_table(&straight),
            view_errors::table(&straight),
            keypoints_table(&straight, "all", |_| true),
            keypoints_table(&straight, "hidden", |visible| !visible),
        ],
        plots: plots(&straight),
        ..Report::default()
    }
}

fn columns(titles: &[(&str, usize)]) -> Vec<Column> {
    titles.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect()
}

fn each_camera(measured: &[Measured]) -> Table {
    let mut table = Table::new(
        "Each camera",
        "Error: estimate minus truth (of logarithms for focal length and height). In sds: with the sd of the truth \
         included. Horizon: in the middle of the picture, down. k1: true distortion of the lens; ours: the estimate \
         with its sd, if the picture determined one.",
        columns(&[
            ("camera", 0),
            ("k1", 2),
            ("ours", 2),
            ("sd", 2),
            ("cars", 0),
            ("status", 0),
            ("focal, px", 0),
            ("truth, px", 0),
            ("focal, %", 1),
            ("sd, %", 1),
            ("tilt, °", 1),
            ("sd, °", 1),
            ("roll, °", 1),
            ("height, %", 1),
            ("horizon, px", 0),
            ("focal, sds", 1),
            ("tilt, sds", 1),
            ("roll, sds", 1),
            ("height, sds", 1),
        ]),
    );
    for Measured { camera, outcome, .. } in measured {
        let estimate = &outcome.estimate;
        let sd = |i: usize| estimate.covariance[(i, i)].sqrt() * NUMBERS[i].1;
        let error = |i: usize| outcome.errors[i] * NUMBERS[i].1;
        let lens = CameraSegment::new(estimate).lens;
        let mut row: Vec<Cell> = vec![
            camera.id.as_str().into(),
            camera.distortion[0].into(),
            lens.as_ref().map_or(f64::NAN, |lens| lens.k1).into(),
            lens.as_ref().map_or(f64::NAN, |lens| lens.k1_sd).into(),
            (estimate.cars_used as f64).into(),
            format!("{:?}", estimate.status).into(),
            estimate.params.focal_px().into(),
            camera.focal_px.into(),
        ];
        let numbers = [error(0), sd(0), error(1), sd(1), error(2), error(3), outcome.horizon_px];
        row.extend(numbers.into_iter().chain(outcome.in_sds.iter().copied()).map(Cell::from));
        table.rows.push(row);
    }
    table
}

fn all_cameras(measured: &[&Measured]) -> Table {
    let mut titles = vec![("", 0), ("cameras", 0)];
    titles.extend(NUMBERS.map(|(name, _)| (name, 1)));
    titles.extend([
        ("focal, normalised error", 2),
        ("tilt, normalised error", 2),
        ("roll, normalised error", 2),
        ("height, normalised error", 2),
        ("all, normalised error", 2),
        ("above 3.5 sd", 0),
    ]);
    let mut table = Table::new(
        "All cameras",
        "Lenses without strong distortion. Error: median of its size. Normalised error: root mean square of errors \
         in sds, with the sd of the truth included; 1 is calibrated. 95 % intervals by resampling cameras.",
        columns(&titles),
    );
    let mut add = |name: String, chosen: Vec<&&Measured>| {
        let mut row: Vec<Cell> = vec![name.into(), (chosen.len() as f64).into()];
        for (i, (_, unit)) in NUMBERS.iter().enumerate() {
            let sizes: Vec<Vec<f64>> =
                chosen.iter().map(|m| vec![m.outcome.errors[i].abs() * unit]).collect();
            row.push(bootstrap(&sizes, median).into());
        }
        let normalised_error = |numbers: &[usize]| {
            let squares: Vec<Vec<f64>> = chosen
                .iter()
                .map(|m| numbers.iter().map(|i| m.outcome.in_sds[*i].powi(2)).collect())
                .collect();
            bootstrap(&squares, |squares| mean(squares).sqrt())
        };
        let errors = [&[0][..], &[1], &[2], &[3], &[0, 1, 2, 3]];
        row.extend(errors.map(|numbers| normalised_error(numbers).into()));
        let far = |m: &&&Measured| m.outcome.in_sds.iter().filter(|sds| sds.abs() > 3.5).count() as f64;
        row.push(chosen.iter().map(far).sum::<f64>().into());
        table.rows.push(row);
    };
    add(
        format!("focal length claimed to {:.0} %", 100.0 * CLAIMED),
        measured.iter().filter(|m| m.outcome.claims(CLAIMED)).collect(),
    );
    add(
        "focal length estimated".to_owned(),
        measured.iter().filter(|m| m.outcome.claims(f64::MAX)).collect(),
    );
    add("all".to_owned(), measured.iter().collect());
    table
}

fn cars_table(measured: &[&Measured]) -> Table {
    let mut table = Table::new(
        "Single cars, true camera, free pose",
        format!(
            "The pose that fits a car's keypoints without the ground, against the true ground: medians, cars of \
             {LEAST_PX} px and more. Views off by more than {:.0}° are left out. Turn: about the line of sight, \
             clockwise. Size: of the camera's height above the car's ground. 95 % intervals by resampling cameras.",
            ANOTHER_VIEW.to_degrees()
        ),
        columns(&[
            ("cars", 0),
            ("number", 0),
            ("elevation, °", 2),
            ("turn, °", 2),
            ("size, %", 2),
            ("elevation scatters, °", 2),
        ]),
    );
    let mut add = |name: &str, wanted: &dyn Fn(&SeenCar) -> bool| {
        let chosen: Vec<Vec<&SeenCar>> =
            measured.iter().map(|m| counted(m).filter(|car| wanted(car)).collect()).collect();
        let number: usize = chosen.iter().map(Vec::len).sum();
        let of = |i: usize, unit: f64| {
            let errors: Vec<Vec<f64>> =
                chosen.iter().map(|cars| cars.iter().map(|car| car.errors[i] * unit).collect()).collect();
            errors
        };
        let degrees = 1f64.to_degrees();
        table.rows.push(vec![
            name.into(),
            (number as f64).into(),
            bootstrap(&of(0, degrees), median).into(),
            bootstrap(&of(1, degrees), median).into(),
            bootstrap(&of(2, 100.0), median).into(),
            bootstrap(&of(0, degrees), robust_sd).into(),
        ]);
    };
    for aspect in Aspect::ALL {
        add(aspect.name(), &|car| car.aspect == aspect);
    }
    for [low, high] in [[0.0, 10.0], [10.0, 20.0], [20.0, 30.0], [30.0, 90.0]] {
        add(&format!("seen {low}–{high}° from above"), &|car| {
            (low..high).contains(&car.elevation.to_degrees())
        });
    }
    for [low, high] in [[40.0, 60.0], [60.0, 100.0], [100.0, f64::INFINITY]] {
        let name = if high.is_finite() { format!("{low}–{high} px") } else { format!("over {low} px") };
        add(&name, &|car| (low..high).contains(&car.box_px));
    }
    add("all", &|_| true);
    table
}

/// Returns a robust estimate of the sd, computed from the median absolute deviation.
fn robust_sd(values: &[f64]) -> f64 {
    let middle = median(values);
    SD_FROM_MEDIAN * median(&values.iter().map(|value| (value - middle).abs()).collect::<Vec<_>>())
}

/// Returns the table of the errors that all cars of one camera have in common.
fn shared_table(measured: &[&Measured]) -> Table {
    let mut table = Table::new(
        "Errors that the cars of one camera share",
        "Root mean square, over cameras, of the median of a camera's cars (four and more). Left: the remainder \
         without the sampling error of the cars and the sd of the truth.",
        columns(&[("", 0), ("cameras", 0), ("rms of medians", 2), ("left", 2)]),
    );
    let degrees = 1f64.to_degrees();
    for (i, name, unit) in [(0, "elevation, °", degrees), (1, "turn, °", degrees), (2, "size, %", 100.0)] {
        let of_cameras: Vec<[f64; 2]> = measured
            .iter()
            .filter_map(|m| {
                let errors: Vec<f64> = counted(m).map(|car| car.errors[i] * unit).collect();
                // The sd of a median is 1.25 times the sd of a mean.
                let sampling = 1.2533 * robust_sd(&errors) / (errors.len() as f64).sqrt();
                let truth = m.camera.sd[i + 1] * unit;
                (errors.len() >= 4).then(|| [median(&errors), sampling.powi(2) + truth.powi(2)])
            })
            .collect();
        let root = |chosen: &[&[f64; 2]], noise: f64| {
            let squares: Vec<f64> =
                chosen.iter().map(|[shift, variance]| shift * shift - noise * variance).collect();
            mean(&squares).max(0.0).sqrt()
        };
        let of = |noise: f64| -> Estimate {
            bootstrap_scenes(&of_cameras, of_cameras.len(), |chosen| root(chosen, noise))
        };
        table.rows.push(vec![name.into(), (of_cameras.len() as f64).into(), of(0.0).into(), of(1.0).into()]);
    }
    table
}

fn keypoints_table(measured: &[&Measured], which: &str, wanted: impl Fn(bool) -> bool) -> Table {
    let half = KEYPOINTS / 2;
    let mut titles = vec![("keypoint (both sides)", 0)];
    titles.extend(Aspect::ALL.map(|aspect| (aspect.name(), 1)));
    let mut table = Table::new(
        format!("Keypoints projected with the true camera: {which}"),
        "Upward offset of a found keypoint from its position on the car fitted on the true ground: median, % of the \
         box's longer side. Cars of 40 px and more, five points and more. 95 % intervals by resampling cameras.",
        columns(&titles),
    );
    for (k, name) in keypoint_names().iter().take(half).enumerate() {
        let mut row: Vec<Cell> = vec![name.trim_start_matches("left_").into()];
        for aspect in Aspect::ALL {
            let of_camera = |m: &&Measured| {
                let cars = counted(m).filter(|car| car.aspect == aspect);
                let points = cars.flat_map(|car| &car.points);
                let chosen = points.filter(|point| point.index % half == k && wanted(point.visible));
                chosen.map(|point| 100.0 * point.off.y).collect::<Vec<f64>>()
            };
            let offs: Vec<Vec<f64>> = measured.iter().map(of_camera).collect();
            let number: usize = offs.iter().map(Vec::len).sum();
            row.push(if number >= 5 { bootstrap(&offs, median).into() } else { "".into() });
        }
        table.rows.push(row);
    }
    table
}

fn plots(measured: &[&Measured]) -> Vec<Plot> {
    let mut focal = Plot::new("Focal length", "true focal length, px", "error, sds");
    let mut by_source: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
    for m in measured {
        let source = m.camera.id.split('/').next().unwrap_or_default();
        by_source.entry(source).or_default().push((m.camera.focal_px, m.outcome.in_sds[0]));
    }
    focal.series = by_source
        .into_iter()
        .map(|(name, points)| Series { name: name.to_owned(), points, mark: Mark::Dots })
        .collect();
    let mut elevation = Plot::new("Elevation of single cars", "true elevation, °", "found minus true, °");
    elevation.series = Aspect::ALL
        .iter()
        .map(|aspect| {
            let cars = measured.iter().flat_map(|m| counted(m)).filter(|car| car.aspect == *aspect);
            let points = cars.map(|car| (car.elevation.to_degrees(), car.errors[0].to_degrees())).collect();
            Series { name: aspect.name().to_owned(), points, mark: Mark::Dots }
        })
        .collect();
    vec![focal, elevation]
}
