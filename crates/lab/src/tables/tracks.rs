//! Tables and plots of tracks on the ground and of boxes in the picture.

use roadplane_tables::{Cell, Column, Mark, Plot, Table, bootstrap_scenes, median, quantile, share_within};

use super::{Scored, cell};
use roadplane_metrics::average_precision::{
    AveragePrecision, PictureBoxes, PictureMatch, Size, average_precision,
};
use roadplane_metrics::clear::Clear;
use roadplane_metrics::hota::{Hota, HotaCounts};
use roadplane_metrics::identity::Identity;
use roadplane_metrics::position::{PositionError, RANGES_M, in_range, range_name};
use roadplane_metrics::scoring::TrackScore;
use roadplane_metrics::sequence::ZERO_DISTANCE_M;

/// Least heading error at which a car counts as turned round, rad.
const TURNED_RAD: f64 = std::f64::consts::FRAC_PI_2;

/// Returns the table of HOTA, CLEAR MOT and IDF1 for tracks on the ground.
///
/// All clips of a system are scored together, as one long sequence.
#[must_use]
pub fn tracking_table(title: &str, systems: &[(&str, &[TrackScore])]) -> Table {
    let mut columns = vec![Column::new("system", 0), Column::new("clips", 0), Column::new("cars", 0)];
    columns.extend(["HOTA, %", "DetA, %", "AssA, %", "MOTA, %"].map(|head| Column::new(head, 1)));
    columns.extend([Column::new("MOTP, m", 2), Column::new("IDF1, %", 1), Column::new("switches", 0)]);
    columns.extend(["HOTA fitted, %", "IDF1 fitted, %"].map(|head| Column::new(head, 1)));
    columns.extend([Column::new("vehicles", 0), Column::new("switches a vehicle", 3)]);
    let note = "Similarity on the ground 1 − distance / 4 m. HOTA: Luiten 2021; MOTA, MOTP at similarity 0.5 (2 m): \
                Bernardin 2008; IDF1: Ristani 2016. Cars: vehicle and frame, of all classes. The columns \"fitted\" and \
                \"switches a vehicle\" are scored after one scale per clip, about the camera's foot, that fits the clip best.";
    let mut table = Table::new(title, note, columns);
    for (name, clips) in systems {
        let cars: usize = clips.iter().map(|clip| clip.true_cars).sum();
        let hotas: Vec<HotaCounts> = clips.iter().map(|clip| HotaCounts::of(&clip.sequence)).collect();
        let clears: Vec<Clear> = clips.iter().map(|clip| Clear::of(&clip.sequence)).collect();
        let identities: Vec<Identity> = clips.iter().map(|clip| Identity::of(&clip.sequence)).collect();
        let hota = |number: &dyn Fn(Hota) -> f64| -> Cell {
            let of = |chosen: &[&HotaCounts]| 100.0 * number(HotaCounts::sum(chosen.iter().copied()).score());
            bootstrap_scenes(&hotas, cars, of).into()
        };
        let clear = |number: &dyn Fn(Clear) -> f64| -> Cell {
            bootstrap_scenes(&clears, cars, |chosen| number(Clear::sum(chosen.iter().copied()))).into()
        };
        let idf1 = |chosen: &[&Identity]| 100.0 * Identity::sum(chosen.iter().copied()).idf1();
        let fitted: Vec<HotaCounts> = clips.iter().map(|clip| HotaCounts::of(&clip.fitted)).collect();
        let fitted_hota =
            |chosen: &[&HotaCounts]| 100.0 * HotaCounts::sum(chosen.iter().copied()).score().hota;
        let fitted_ids: Vec<Identity> = clips.iter().map(|clip| Identity::of(&clip.fitted)).collect();
        let vehicles: usize = clips.iter().map(|clip| clip.vehicles).sum();
        let switches: u64 = clips.iter().map(|clip| Clear::of(&clip.fitted).switches).sum();
        table.rows.push(vec![
            Cell::from(*name),
            clips.len().to_string().into(),
            cars.to_string().into(),
            hota(&|h| h.hota),
            hota(&|h| h.det_a),
            hota(&|h| h.ass_a),
            clear(&|c| 100.0 * c.mota()),
            clear(&|c| ZERO_DISTANCE_M * (1.0 - c.motp())),
            bootstrap_scenes(&identities, cars, idf1).into(),
            clear(&|c| c.switches as f64),
            bootstrap_scenes(&fitted, cars, fitted_hota).into(),
            bootstrap_scenes(&fitted_ids, cars, idf1).into(),
            vehicles.to_string().into(),
            (switches as f64 / vehicles.max(1) as f64).into(),
        ]);
    }
    table
}

/// Returns the table of position errors on the ground.
///
/// Each system has one row for each range of true distance that contains cars.
#[must_use]
pub fn position_table(title: &str, systems: &[Scored<'_, PositionError>]) -> Table {
    let columns = vec![
        Column::new("system", 0),
        Column::new("distance", 0),
        Column::new("cars", 0),
        Column::new("median, m", 2),
        Column::new("90 % within, m", 2),
        Column::new("median, % of the distance", 1),
        Column::new("aligned, median m", 2),
    ];
    let note = "Error of the position on the ground in the camera's own world, so errors of the estimated camera \
        count. Aligned: after the turn, shift and scale that align the cars of a picture (in row 6: of a clip) with \
        the true ones (Umeyama 1991; five cars or more). 30–50 m overlaps its neighbours.";
    let mut table = Table::new(title, note, columns);
    for (name, scenes) in systems {
        for range in RANGES_M {
            let here = |e: &&PositionError| in_range(range, e.distance_m);
            let chosen: Vec<Vec<PositionError>> =
                scenes.iter().map(|scene| scene.iter().filter(here).copied().collect()).collect();
            let cars: usize = chosen.iter().map(Vec::len).sum();
            if cars == 0 {
                continue;
            }
            table.rows.push(vec![
                Cell::from(*name),
                range_name(range).into(),
                cars.to_string().into(),
                cell(&chosen, |e| e.error_m, median, 1.0),
                cell(&chosen, |e| e.error_m, |v| quantile(v, 0.9), 1.0),
                cell(&chosen, |e| e.error_m / e.distance_m, median, 100.0),
                cell(&chosen, |e| e.aligned_m, median, 1.0),
            ]);
        }
    }
    table
}

/// Returns the table of normalised position errors on the ground, by true distance.
///
/// A normalised error is the root mean square of errors divided by their reported sds.
#[must_use]
pub fn calibration_table(title: &str, systems: &[(&str, &[TrackScore])]) -> Table {
    let columns = ["system", "distance", "cars"].map(|head| Column::new(head, 0)).into_iter();
    let heads = ["normalised error, x", "normalised error, y"].map(|head| Column::new(head, 2));
    let columns = columns.chain(heads).collect();
    let note = "Root mean squares; 1 is calibrated. sds include the camera's errors, which all cars of a clip share.";
    let mut table = Table::new(title, note, columns);
    for (name, clips) in systems {
        for range in RANGES_M {
            let here = |score: &TrackScore| -> Vec<[f64; 2]> {
                let near = score.whitened.iter().filter(|(distance_m, _)| in_range(range, *distance_m));
                near.map(|(_, error)| *error).collect()
            };
            let chosen: Vec<Vec<[f64; 2]>> = clips.iter().map(here).collect();
            let cars: usize = chosen.iter().map(Vec::len).sum();
            if cars == 0 {
                continue;
            }
            let rms = |values: &[f64]| roadplane_tables::mean(values).sqrt();
            table.rows.push(vec![
                Cell::from(*name),
                range_name(range).into(),
                cars.to_string().into(),
                cell(&chosen, |error| error[0] * error[0], rms, 1.0),
                cell(&chosen, |error| error[1] * error[1], rms, 1.0),
            ]);
        }
    }
    table
}

/// Returns the table of the errors of speed and heading, the jitter of parked cars, and the share of true cars that
/// were found.
#[must_use]
pub fn motion_table(title: &str, systems: &[(&str, &[TrackScore])]) -> Table {
    let columns = vec![
        Column::new("system", 0),
        Column::new("cars", 0),
        Column::new("found, %", 1),
        Column::new("speed, median m/s", 2),
        Column::new("speed, 90 % within m/s", 2),
        Column::new("heading, median °", 1),
        Column::new("heading, 90 % within °", 1),
        Column::new("turned round, %", 1),
        Column::new("parked cars", 0),
        Column::new("jitter, median m", 3),
    ];
    let note = "Found: a track's box overlaps the car's by half. Jitter: RMS step of a parked car from frame to frame.";
    let mut table = Table::new(title, note, columns);
    let most = |v: &[f64]| quantile(v, 0.9);
    for (name, clips) in systems {
        let cars: usize = clips.iter().map(|clip| clip.true_cars).sum();
        let motions: Vec<_> = clips.iter().map(|clip| clip.motions.clone()).collect();
        let jitters: Vec<_> = clips.iter().map(|clip| clip.jitters_m.clone()).collect();
        let found = |chosen: &[&TrackScore]| {
            let sum =
                |count: &dyn Fn(&TrackScore) -> usize| chosen.iter().map(|c| count(c)).sum::<usize>() as f64;
            100.0 * sum(&|clip| clip.motions.len()) / sum(&|clip| clip.true_cars)
        };
        table.rows.push(vec![
            Cell::from(*name),
            cars.to_string().into(),
            bootstrap_scenes(clips, cars, found).into(),
            cell(&motions, |m| m.speed_mps, median, 1.0),
            cell(&motions, |m| m.speed_mps, most, 1.0),
            cell(&motions, |m| m.heading_rad, median, 1f64.to_degrees()),
            cell(&motions, |m| m.heading_rad, most, 1f64.to_degrees()),
            cell(&motions, |m| m.heading_rad, |v| 1.0 - share_within(v, TURNED_RAD), 100.0),
            jitters.iter().map(Vec::len).sum::<usize>().to_string().into(),
            cell(&jitters, |j| *j, median, 1.0),
        ]);
    }
    table
}

/// Returns the table of the average precision (AP, as in COCO) of boxes: over all sizes, and by size.
#[must_use]
pub fn boxes_table(title: &str, systems: &[Scored<'_, PictureBoxes>]) -> Table {
    let mut columns = vec![Column::new("system", 0), Column::new("pictures", 0)];
    columns.extend(
        ["AP, %", "AP50, %", "AP small, %", "AP medium, %", "AP large, %"].map(|head| Column::new(head, 1)),
    );
    let note = "COCO's average precision over IoU 0.50–0.95; small below 32² px, large above 96² px.";
    let mut table = Table::new(title, note, columns);
    for (name, scenes) in systems {
        let pictures: usize = scenes.iter().map(Vec::len).sum();
        let mut row = vec![Cell::from(*name), pictures.to_string().into()];
        for size in Size::EACH {
            let matched = |scene: &Vec<PictureBoxes>| -> Vec<PictureMatch> {
                scene.iter().map(|picture| PictureMatch::of(picture, size)).collect()
            };
            let scenes: Vec<Vec<PictureMatch>> = scenes.iter().map(matched).collect();
            let number = |number: &dyn Fn(AveragePrecision) -> f64| -> Cell {
                let of = |chosen: &[&Vec<PictureMatch>]| {
                    let all: Vec<&PictureMatch> = chosen.iter().copied().flatten().collect();
                    100.0 * average_precision(&all).map_or(f64::NAN, number)
                };
                bootstrap_scenes(&scenes, pictures, of).into()
            };
            row.push(number(&|ap| ap.ap));
            if size == Size::All {
                row.push(number(&|ap| ap.ap50));
            }
        }
        table.rows.push(row);
    }
    table
}

/// Returns the plot of position errors (m) against true distance (m), with one dot per car and frame.
#[must_use]
pub fn position_plot(systems: &[Scored<'_, PositionError>]) -> Plot {
    let mut plot = Plot::new("Position", "true distance, m", "error on the ground, m");
    for (name, scenes) in systems {
        let points = scenes.iter().flatten().map(|e| (e.distance_m, e.error_m)).collect();
        plot = plot.with(*name, Mark::Dots, points);
    }
    plot
}
