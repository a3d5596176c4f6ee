//! Effect of each step of the solve: pictures are solved with all steps, and again with one step left out at a time.

use std::time::Instant;

use roadplane_base::{GroundPlane, ImageSize, KeypointSet, ShapeAtlas, angle_difference};
use roadplane_solve::{CarView, SceneOptions, SceneStatus, Steps, solve_scene};
use roadplane_synth::{CarModel, SynthOptions, scene};
use roadplane_tables::{Cell, Column, Estimate, Table, bootstrap, bootstrap_scenes, mean, median};

use super::scenes::foreign_cars;
use crate::parallel::in_parallel;

/// Seed of the first synthetic scene.
const SEED: u64 = 3_000_000;
/// Least heading error at which a car counts as turned, rad.
const TURNED_RAD: f64 = 0.5;

/// The keypoints of the cars in a picture, and the true camera of the picture.
#[derive(Clone, Debug)]
pub struct ReferencePicture {
    /// Size of the picture.
    pub size: ImageSize,
    /// Keypoints of each car.
    pub cars: Vec<KeypointSet>,
    /// True focal length, px.
    pub focal_px: f64,
    /// True ground plane.
    pub plane: GroundPlane,
    /// sds of the true camera: log focal length, tilt (rad), roll (rad), log height; 0 if the truth is exact.
    pub sd: [f64; 4],
    /// True heading (rad) for each entry of `cars`; `None` if the heading is unknown or the entry is a false detection.
    pub headings: Vec<Option<f64>>,
}

/// Returns the rows of the tables: the name of the row, and the steps of the solve in that row.
fn variants() -> Vec<(&'static str, Steps)> {
    let all = Steps::default();
    vec![
        ("all steps", all),
        ("no rejection of cars", Steps { rejection: false, ..all }),
        ("no reclassified keypoints", Steps { reclassify: false, ..all }),
        ("no fine modes (nor types, trust)", Steps { all_modes: false, ..all }),
        ("no body types (nor unknown sizes)", Steps { body_types: false, ..all }),
        ("no trust", Steps { trust: false, ..all }),
        ("bias left in", Steps { bias: false, ..all }),
    ]
}

/// The errors of the solve of one picture, and the time that the solve took.
#[derive(Clone, Debug)]
struct Outcome {
    /// Errors of log focal length, tilt (rad) and log height.
    errors: [f64; 3],
    /// The same errors divided by their sds. An sd combines the reported sd and the sd of the truth.
    in_sds: [f64; 3],
    /// For each car with a true heading: 1 if the estimated heading is turned or missing, otherwise 0.
    turned: Vec<f64>,
    /// Time of the solve, ms.
    milliseconds: f64,
}

/// Returns synthetic pictures of three kinds, `scenes` pictures of each kind:
///
/// - Cars whose shapes differ from the shape atlas, with outliers and false detections.
/// - Cars whose shapes differ from the shape atlas, with little noise.
/// - Cars of models that were not used to build the shape atlas.
#[must_use]
pub fn synthetic_pictures(atlas: &ShapeAtlas, scenes: usize) -> Vec<(String, Vec<ReferencePicture>)> {
    let drawn = |noise: f64, spoilt: f64, models: Vec<CarModel>| {
        let asked = SynthOptions {
            cars: 10,
            noise,
            outliers: spoilt,
            wrong_cars: spoilt,
            off_atlas: 1.0,
            models,
            ..SynthOptions::default()
        };
        in_parallel(scenes, |i| {
            let truth = scene(atlas, &asked, SEED + i as u64);
            ReferencePicture {
                size: truth.size,
                focal_px: truth.params.focal_px(),
                plane: truth.params.plane(),
                sd: [0.0; 4],
                headings: truth.cars.iter().map(|car| (!car.wrong).then_some(car.pose.heading_rad)).collect(),
                cars: truth.cars.into_iter().map(|car| car.keypoints).collect(),
            }
        })
    };
    vec![
        ("synthetic, 2 % noise, 10 % wrong".to_owned(), drawn(0.02, 0.1, Vec::new())),
        ("synthetic, 0.5 % noise".to_owned(), drawn(0.005, 0.0, Vec::new())),
        ("synthetic, other models, 1 % noise".to_owned(), drawn(0.01, 0.0, foreign_cars())),
    ]
}

/// Returns one table for each source of pictures. A source is a name and a list of pictures.
#[must_use]
pub fn layers_tables(
    atlas: &ShapeAtlas,
    sources: &[(String, Vec<ReferencePicture>)],
    options: &SceneOptions,
) -> Vec<Table> {
    sources.iter().map(|(name, pictures)| table(atlas, name, pictures, options)).collect()
}

fn table(atlas: &ShapeAtlas, name: &str, pictures: &[ReferencePicture], options: &SceneOptions) -> Table {
    let columns = [
        ("focal, median %", 2),
        ("mean |focal|, % more than with all", 2),
        ("tilt, median °", 2),
        ("mean |tilt|, ° more", 3),
        ("height, median %", 2),
        ("mean |height|, % more", 2),
        ("focal, normalised error", 2),
        ("tilt, normalised error", 2),
        ("height, normalised error", 2),
        ("cars turned, %", 1),
        ("median ms", 1),
    ];
    let mut table = Table::new(
        format!("Steps of the solve left out: {name} ({} pictures)", pictures.len()),
        "Single pictures, focal length estimated. More: mean size of the error, minus that with all steps in the \
         same picture; an interval above 0 shows that the step is worth its cost. Normalised error: root mean square \
         of errors in sds. Turned: heading off by more than 0.5 rad, or no pose. 95 % intervals by resampling \
         pictures.",
        std::iter::once(Column::new("", 0))
            .chain(columns.map(|(title, decimals)| Column::new(title, decimals)))
            .collect(),
    );
    let solved: Vec<Vec<Option<Outcome>>> = variants()
        .iter()
        .map(|(_, steps)| {
            let options = SceneOptions { steps: *steps, ..options.clone() };
            in_parallel(pictures.len(), |i| outcome(atlas, &pictures[i], &options))
        })
        .collect();
    for ((name, _), of_variant) in variants().into_iter().zip(&solved) {
        // Only pictures that were solved both with all steps and without the step are compared.
        let pairs: Vec<(&Outcome, &Outcome)> =
            of_variant.iter().zip(&solved[0]).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?))).collect();
        let mut row = vec![Cell::from(name)];
        for (number, unit) in [(0, 100.0), (1, 1f64.to_degrees()), (2, 100.0)] {
            let size: Vec<Vec<f64>> =
                pairs.iter().map(|(own, _)| vec![unit * own.errors[number].abs()]).collect();
            let more: Vec<Vec<f64>> = pairs
                .iter()
                .map(|(own, all)| vec![unit * (own.errors[number].abs() - all.errors[number].abs())])
                .collect();
            row.push(bootstrap(&size, median).into());
            row.push(bootstrap(&more, mean).into());
        }
        row.extend((0..3).map(|number| Cell::from(normalised_error(&pairs, number))));
        let turned: Vec<Vec<f64>> = pairs.iter().map(|(own, _)| own.turned.clone()).collect();
        row.push(bootstrap(&turned, mean).scaled(100.0).into());
        row.push(median(&pairs.iter().map(|(own, _)| own.milliseconds).collect::<Vec<_>>()).into());
        table.rows.push(row);
    }
    table
}

/// Returns the root mean square of the errors divided by their sds. `number` is the index of the quantity in `in_sds`.
fn normalised_error(pairs: &[(&Outcome, &Outcome)], number: usize) -> Estimate {
    bootstrap_scenes(pairs, pairs.len(), |chosen| {
        let squares: Vec<f64> = chosen.iter().map(|pair| pair.0.in_sds[number].powi(2)).collect();
        mean(&squares).sqrt()
    })
}

/// Solves a picture and measures the errors. Returns `None` if the solve fails or too few cars could be solved.
fn outcome(atlas: &ShapeAtlas, picture: &ReferencePicture, options: &SceneOptions) -> Option<Outcome> {
    let views = CarView::each(&picture.cars);
    let started = Instant::now();
    let found = solve_scene(atlas, picture.size, &views, options);
    let milliseconds = 1e3 * started.elapsed().as_secs_f64();
    if matches!(found.status, SceneStatus::TooFewCars | SceneStatus::Failed) {
        return None;
    }
    let errors = [
        found.params.log_focal - picture.focal_px.ln(),
        found.params.tilt - picture.plane.tilt(),
        found.params.log_height - picture.plane.height_m.ln(),
    ];
    let in_sds = std::array::from_fn(|k| {
        let i = [0, 1, 3][k];
        errors[k] / (found.covariance[(i, i)] + picture.sd[i] * picture.sd[i]).sqrt()
    });
    let turned = |(heading, car): (&Option<f64>, &Option<roadplane_solve::CarSolution>)| {
        let heading = (*heading)?;
        let off =
            |car: &roadplane_solve::CarSolution| angle_difference(car.ground.heading_rad, heading).abs();
        Some(f64::from(u8::from(car.as_ref().is_none_or(|car| off(car) > TURNED_RAD))))
    };
    Some(Outcome {
        errors,
        in_sds,
        turned: picture.headings.iter().zip(&found.cars).filter_map(turned).collect(),
        milliseconds,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_has_its_row() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let sources = synthetic_pictures(&atlas, 6);
        let tables = layers_tables(&atlas, &sources[..1], &SceneOptions::default());
        assert_eq!(tables[0].rows.len(), variants().len());
        let Cell::Number(all) = &tables[0].rows[0][2] else { panic!("a number") };
        assert!(all.value.abs() < 1e-12, "all steps against all steps");
    }
}
