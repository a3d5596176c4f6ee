//! The tables of a data set. One table shows the errors of row 4 by groups of cars.

use roadplane_tables::{Cell, Column, Report, Table, bootstrap, median, quantile, share_within};

use super::clips::ClipScore;
use super::score::{CarScore, PictureScore, SystemScore};
use crate::systems::System;
use crate::tables::{
    Scored, add_plot, add_table, boxes_table, camera_table, motion_table, position_plot, position_table,
    steps_table, tracking_table, viewpoint_plot, viewpoint_table,
};
use roadplane_metrics::average_precision::PictureBoxes;
use roadplane_metrics::camera::CameraError;
use roadplane_metrics::position::{ALL_M, AT_40_M, PositionError, in_range, range_name};
use roadplane_metrics::scoring::{PoseScore, TrackScore};

/// Least number of cars at which a single picture is expected to determine the focal length.
const MANY_CARS: usize = 5;
/// Systems that the paper ranks, the worst first. All of these systems get the true focal length.
const RANKED: [System; 4] = [System::Pavlakos, System::KrishnaMurthy, System::FreePoses, System::Plane];
/// Name of the row of our solver on whole clips, from given keypoints.
const FUSED: &str = "6 ours, fused over the clip";
/// Name of the row of our solver on whole clips, from the video alone.
const RUN: &str = "6 from the video alone";

/// Scores of one kind: for each system its name, and one list of scores per item.
type ByName<T> = Vec<(String, Vec<Vec<T>>)>;

fn of_cars<T>(systems: &[(System, Vec<SystemScore>)], number: impl Fn(&CarScore) -> T) -> ByName<T> {
    let items =
        |scores: &[SystemScore]| scores.iter().map(|s| s.cars.iter().map(&number).collect()).collect();
    systems.iter().map(|(system, scores)| (system.name().to_owned(), items(scores))).collect()
}

fn scored<T>(by_name: &ByName<T>) -> Vec<Scored<'_, T>> {
    by_name.iter().map(|(name, items)| (name.as_str(), items.as_slice())).collect()
}

/// Adds the tables of the systems that solve single frames, on all items.
pub(super) fn add_single_frames(report: &mut Report, what: &str, systems: &[(System, Vec<SystemScore>)]) {
    let poses = of_cars(systems, |car| car.pose);
    let positions = of_cars(systems, |car| car.position);
    let mut add = add_table(&format!("Table 1, ADD: {what}"), &scored(&poses));
    add.note += " Systems 1–4 get the true focal length. The last row also gets the true ground. So its lead over \
        row 4 is the error of the ground, which all cars of a picture share.";
    report.tables.push(add);
    report.tables.push(viewpoint_table(&format!("Table 2, viewpoint: {what}"), &scored(&poses)));
    let ranked: Vec<_> = systems.iter().filter(|(system, _)| RANKED.contains(system)).cloned().collect();
    let ranked = of_cars(&ranked, |car| car.pose);
    report.tables.push(steps_table(&format!("Gain over the row before: {what}"), &scored(&ranked)));
    report
        .tables
        .push(camera_table(&format!("Camera from single frames: {what}"), &scored(&cameras(systems))));
    let mut position = position_table(&format!("Position: {what}"), &scored(&positions));
    position.note +=
        " Systems 1–3 find no ground; positions of their cars are computed on the true ground here.";
    report.tables.push(position);
    report.tables.push(reprojection_table(&format!("Reprojection: {what}"), systems));
    if let Some((system, items)) = systems.iter().find(|(system, _)| *system == System::Plane) {
        report.tables.push(kinds_table(&format!("{}, by car: {what}", system.name()), items));
    }
    for mut plot in [add_plot(&scored(&poses)), viewpoint_plot(&scored(&poses))] {
        plot.title = format!("{}: {what}", plot.title);
        report.plots.push(plot);
    }
}

/// Returns the camera errors of each system that estimates the ground.
///
/// Each system has two entries: for all pictures, and for pictures with at least [`MANY_CARS`] cars.
fn cameras(systems: &[(System, Vec<SystemScore>)]) -> ByName<CameraError> {
    let mut rows = Vec::new();
    for (system, items) in systems.iter().filter(|(system, _)| system.finds_ground()) {
        for fewest in [0, MANY_CARS] {
            let errors = |score: &SystemScore| -> Vec<CameraError> {
                let enough = |picture: &&PictureScore| picture.cars >= fewest;
                score.cameras.iter().filter(enough).map(|picture| picture.error).collect()
            };
            let cars = if fewest > 0 { format!(", ≥ {fewest} cars") } else { String::new() };
            rows.push((format!("{}{cars}", system.name()), items.iter().map(errors).collect()));
        }
    }
    rows
}

fn reprojection_table(title: &str, systems: &[(System, Vec<SystemScore>)]) -> Table {
    let columns = vec![
        Column::new("system", 0),
        Column::new("median, % of the box", 2),
        Column::new("90 % within, % of the box", 2),
    ];
    let note = "Root mean square distance between a car's projected and true keypoints, including hidden ones. Unit: \
        the longer side of the box of its visible part.";
    let mut table = Table::new(title, note, columns);
    for (name, items) in of_cars(systems, |car| car.reprojection) {
        table.rows.push(vec![
            Cell::from(name),
            bootstrap(&items, median).scaled(100.0).into(),
            bootstrap(&items, |v| quantile(v, 0.9)).scaled(100.0).into(),
        ]);
    }
    table
}

/// The name of a group of cars, and the function that decides whether a car belongs to the group.
type Group = (&'static str, fn(&CarScore) -> bool);

/// Groups of cars by size, distance, visible share and rotation error.
const GROUPS: [Group; 14] = [
    ("box 24–40 px", |c| c.side_px < 40.0),
    ("box 40–64 px", |c| (40.0..64.0).contains(&c.side_px)),
    ("box 64–96 px", |c| (64.0..96.0).contains(&c.side_px)),
    ("box ≥ 96 px", |c| c.side_px >= 96.0),
    ("up to 40 m away", |c| c.position.distance_m < 40.0),
    ("40–60 m", |c| (40.0..60.0).contains(&c.position.distance_m)),
    ("60–80 m", |c| (60.0..80.0).contains(&c.position.distance_m)),
    ("80 m and more", |c| c.position.distance_m >= 80.0),
    ("30–60 % seen", |c| c.visible_share < 0.6),
    ("60–90 % seen", |c| (0.6..0.9).contains(&c.visible_share)),
    ("≥ 90 % seen", |c| c.visible_share >= 0.9),
    ("turned round (> 90°)", |c| c.pose.rotation_rad > std::f64::consts::FRAC_PI_2),
    ("not turned round", |c| c.pose.rotation_rad <= std::f64::consts::FRAC_PI_2),
    ("all", |_| true),
];

fn kinds_table(title: &str, items: &[SystemScore]) -> Table {
    let columns = vec![
        Column::new("cars", 0),
        Column::new("number", 0),
        Column::new("ADD ≤ 0.2 d, %", 1),
        Column::new("ADD ≤ 0.4 d, %", 1),
        Column::new("ADD, median d", 3),
        Column::new("rotation ≤ 0.14 rad, %", 1),
        Column::new("rotation, median °", 2),
    ];
    let mut table = Table::new(title, "The same scores for groups of cars.", columns);
    for (name, belongs) in GROUPS {
        let chosen: Vec<Vec<PoseScore>> = items
            .iter()
            .map(|item| item.cars.iter().filter(|car| belongs(car)).map(|car| car.pose).collect())
            .collect();
        let number = |of: fn(&PoseScore) -> f64| -> Vec<Vec<f64>> {
            chosen.iter().map(|item| item.iter().map(of).collect()).collect()
        };
        let (add, rotation) = (number(|p| p.add), number(|p| p.rotation_rad));
        table.rows.push(vec![
            Cell::from(name),
            chosen.iter().map(Vec::len).sum::<usize>().to_string().into(),
            bootstrap(&add, |v| share_within(v, 0.2)).scaled(100.0).into(),
            bootstrap(&add, |v| share_within(v, 0.4)).scaled(100.0).into(),
            bootstrap(&add, median).into(),
            bootstrap(&rotation, |v| share_within(v, 0.14)).scaled(100.0).into(),
            bootstrap(&rotation, median).scaled(1f64.to_degrees()).into(),
        ]);
    }
    table
}

/// Adds the tables of the clips: the systems that solve single frames, and our solver on whole clips.
pub(super) fn add_clips(
    report: &mut Report,
    what: &str,
    systems: &[(System, Vec<SystemScore>)],
    fused: &[ClipScore],
) {
    let mut poses = of_cars(systems, |car| car.pose);
    poses.push((FUSED.to_owned(), fused.iter().map(|clip| clip.poses.clone()).collect()));
    let mut positions = of_cars(systems, |car| car.position);
    positions.push((FUSED.to_owned(), fused.iter().map(|clip| clip.tracks.positions.clone()).collect()));
    let mut cameras = cameras(systems);
    cameras.push((FUSED.to_owned(), fused.iter().map(|clip| clip.camera.into_iter().collect()).collect()));
    report.tables.push(add_table(&format!("Clips, ADD: {what}"), &scored(&poses)));
    report.tables.push(viewpoint_table(&format!("Clips, viewpoint: {what}"), &scored(&poses)));
    report.tables.push(camera_table(&format!("Clips, camera: {what}"), &scored(&cameras)));
    report.tables.push(position_table(&format!("Clips, position: {what}"), &scored(&positions)));
    report.tables.push(one_by_one_table(&format!("Clips one by one, {FUSED}: {what}"), fused));
    add_tracks(report, &format!("{FUSED}, {what}"), fused);
}

/// Returns the table of camera and position errors, with one row per clip.
///
/// All cars of a clip share one error of scale and focal length. Therefore a clip with many cars is still only one
/// sample.
fn one_by_one_table(title: &str, clips: &[ClipScore]) -> Table {
    let heads = ["focal, %", "tilt, °", "height, %", "focal, normalised error", "tilt, normalised error"];
    let ranges = [AT_40_M, ALL_M];
    let mut columns = vec![Column::new("clip", 0), Column::new("cars", 0)];
    columns.extend(heads.map(|head| Column::new(head, 2)));
    columns.extend(ranges.map(|range| Column::new(format!("position {}, median m", range_name(range)), 2)));
    let note = "Signed errors of the camera, and the error of positions on the ground. The last row is the median of \
        each column's absolute values. For normalised errors (here: error / its sd per clip) it is 0.67 if the sds \
        are calibrated.";
    let mut table = Table::new(title, note, columns);
    let numbers = |clip: &ClipScore| -> Vec<f64> {
        let camera = clip.camera.map_or([f64::NAN; 5], |error| {
            let [focal_sds, tilt_sds, _] = error.in_sds;
            let [focal, height] = [error.focal_relative, error.height_relative].map(|share| 100.0 * share);
            [focal, error.tilt_rad.to_degrees(), height, focal_sds, tilt_sds]
        });
        let position = |range| {
            let here = clip.tracks.positions.iter().filter(|e| in_range(range, e.distance_m));
            median(&here.map(|e| e.error_m).collect::<Vec<f64>>())
        };
        camera.into_iter().chain(ranges.map(position)).collect()
    };
    let rows: Vec<Vec<f64>> = clips.iter().map(numbers).collect();
    let median_of = |column: usize| {
        let determined = rows.iter().map(|row| row[column].abs()).filter(|number| !number.is_nan());
        median(&determined.collect::<Vec<f64>>())
    };
    let last: Vec<f64> = (0..table.columns.len() - 2).map(median_of).collect();
    let names = clips.iter().map(|clip| [clip.name.clone(), clip.cars.to_string()]);
    let names = names.chain([["median".to_owned(), String::new()]]);
    for (name, numbers) in names.zip(rows.iter().chain([&last])) {
        table
            .rows
            .push(name.map(Cell::from).into_iter().chain(numbers.iter().map(|n| Cell::from(*n))).collect());
    }
    table
}

/// Adds the tables and the plot of the runs from the video alone.
pub(super) fn add_runs(report: &mut Report, runs: &[ClipScore]) {
    if runs.is_empty() {
        return;
    }
    fn of<T>(runs: &[ClipScore], part: impl Fn(&ClipScore) -> Vec<T>) -> ByName<T> {
        vec![(RUN.to_owned(), runs.iter().map(part).collect())]
    }
    let poses: ByName<PoseScore> = of(runs, |run| run.poses.clone());
    let positions: ByName<PositionError> = of(runs, |run| run.tracks.positions.clone());
    let cameras: ByName<CameraError> = of(runs, |run| run.camera.into_iter().collect());
    let boxes: ByName<PictureBoxes> = of(runs, |run| run.boxes.clone());
    report.tables.push(add_table("Video alone: ADD", &scored(&poses)));
    report.tables.push(viewpoint_table("Video alone: viewpoint", &scored(&poses)));
    report.tables.push(camera_table("Video alone: camera", &scored(&cameras)));
    report.tables.push(position_table("Video alone: position", &scored(&positions)));
    report.tables.push(one_by_one_table("Video alone: clips one by one", runs));
    add_tracks(report, RUN, runs);
    report.tables.push(boxes_table("Video alone: boxes of cars that got a pose", &scored(&boxes)));
    report.plots.push(position_plot(&scored(&positions)));
}

fn add_tracks(report: &mut Report, name: &str, clips: &[ClipScore]) {
    let tracks: Vec<TrackScore> = clips.iter().map(|clip| clip.tracks.clone()).collect();
    report.tables.push(tracking_table(&format!("Tracks: {name}"), &[(name, &tracks)]));
    report.tables.push(motion_table(&format!("Motion: {name}"), &[(name, &tracks)]));
}
