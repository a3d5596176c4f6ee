//! Clips with truth: run from pixels, told frame by frame.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_activity::{Label, Motion};
use roadplane_base::{TrackRow, angle_difference};
use roadplane_pipeline::{Cancel, Config, Progress, RunOptions, Silent, run_input, track_motion};
use roadplane_write::{WriteError, read_jsonl};

use super::scores::{Case, differences, each_label, table};
use super::{ActivityOptions, Row, Seen, picture_motion, told};
use crate::scoring::{counts, pairs_by_box};
use crate::truth::{Kind, TrueCar, Truth, read_dataset, read_truth};
use crate::{EvalError, Report};

/// Within this of a change of the true label both labels are right, s: people who label agree no better.
const FUZZY_S: f64 = 0.25;
/// The paper's seven labels.
const PAPER: [Label; 7] = [
    Label::NotMoving,
    Label::Moving,
    Label::Starting,
    Label::Stopping,
    Label::TurningLeft,
    Label::TurningRight,
    Label::UTurn,
];

/// The tables.
pub fn evaluate(
    folder: &Path,
    systems: &mut [Row],
    options: &ActivityOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, EvalError> {
    let dataset = read_dataset(folder)?;
    let truths: Vec<Truth> = dataset.items.iter().map(|path| read_truth(path)).collect::<Result<_, _>>()?;
    let clips: Vec<&Truth> =
        truths.iter().filter(|truth| truth.kind == Kind::Clip && truth.media.is_some()).collect();
    if clips.is_empty() {
        let what = format!("{} has no clips with video", folder.display());
        return Err(EvalError::Unsuitable { what });
    }
    progress.expect(Some(clips.len() as u64));
    let temporary = tempfile::tempdir().map_err(|source| WriteError::Io {
        doing: "make the folder",
        source,
        path: "temporary".into(),
    })?;
    let runs = options.runs.as_deref().unwrap_or_else(|| temporary.path());
    let mut cases = Vec::new();
    for truth in clips {
        let Some(media) = &truth.media else { continue };
        let run_options = RunOptions { resume: true, ..RunOptions::new(options.models.clone()) };
        let run = run_input(media, runs, &run_options, config, cancel, &Silent)?;
        let rows: Vec<TrackRow> = read_jsonl(&run.folder.join("tracks.jsonl"))?.collect::<Result<_, _>>()?;
        cases.push(clip_cases(truth, &rows, systems)?);
        progress.frame_done();
    }
    let ours = systems.len() - 1;
    let mut systems: Vec<&str> = systems.iter().map(|system| system.name).collect();
    systems.push("3D from truth");
    let frames: usize = cases.iter().map(Vec::len).sum();
    let title = format!("Activities of {}: {} clips, {frames} cars in frames", dataset.name, cases.len());
    let mut report = Report { title, ..Report::default() };
    let note = "Cars that a track's box overlaps; precision and recall are the mean over the paper's seven labels. 2D rows see the \
                boxes of our own tracks.";
    report.tables.push(table("Per frame, seven labels", note, &cases, &systems, &PAPER));
    report.tables.push(table("Per frame, with reversing", "", &cases, &systems, &Label::ALL));
    report.tables.push(differences("3D against the others, seven labels", &cases, &systems, ours, &PAPER));
    report.tables.push(each_label("Label by label: 3D", &cases, ours));
    report.tables.push(each_label("Label by label: 3D from truth", &cases, ours + 1));
    Ok(report)
}

/// Labels of all cars that are found and count, in all frames.
fn clip_cases(truth: &Truth, rows: &[TrackRow], systems: &mut [Row]) -> Result<Vec<Case>, EvalError> {
    let truth_labels = true_labels(truth);
    let told_from_truth = from_truth(truth, systems)?;
    let told_from_rows = from_rows(truth, rows, systems)?;
    let mut of_frame: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (place, row) in rows.iter().enumerate() {
        of_frame.entry(row.frame).or_default().push(place);
    }
    let mut cases = Vec::new();
    for frame in &truth.frames {
        let places = of_frame.get(&frame.frame).map_or(&[][..], Vec::as_slice);
        let counted = |car: &&TrueCar| truth.model(car.id).is_some_and(|model| counts(car, model));
        let cars: Vec<&TrueCar> = frame.cars.iter().filter(counted).collect();
        let boxes: Vec<[f64; 4]> = places.iter().map(|place| rows[*place].bbox_px).collect();
        for (place, car) in places.iter().zip(pairs_by_box(&boxes, &cars)) {
            let Some(car) = car.map(|c| cars[c]) else { continue };
            let key = (car.id, frame.frame);
            let (Some(right), Some(true_track)) = (truth_labels.get(&key), told_from_truth.get(&key)) else {
                continue;
            };
            let mut told = told_from_rows[*place].clone();
            told.push(*true_track);
            cases.push(Case { truth: right.clone(), told });
        }
    }
    Ok(cases)
}

/// Times and cars of each car, by its id.
fn cars_by_id(truth: &Truth) -> BTreeMap<u64, Vec<(u64, f64, &TrueCar)>> {
    let mut cars: BTreeMap<u64, Vec<(u64, f64, &TrueCar)>> = BTreeMap::new();
    for frame in &truth.frames {
        for car in &frame.cars {
            cars.entry(car.id).or_default().push((frame.frame, frame.time_s, car));
        }
    }
    cars
}

fn heading_of(car: &TrueCar) -> f64 {
    car.world_from_car[1][0].atan2(car.world_from_car[0][0])
}

/// By car and frame the labels that are right; the car's own first.
fn true_labels(truth: &Truth) -> BTreeMap<(u64, u64), Vec<Label>> {
    let mut labels = BTreeMap::new();
    for (id, cars) in cars_by_id(truth) {
        let own: Vec<Label> = (0..cars.len())
            .map(|i| {
                let (_, _, car) = cars[i];
                let (before, after) = (&cars[i.saturating_sub(1)], &cars[(i + 1).min(cars.len() - 1)]);
                let turned = angle_difference(heading_of(after.2), heading_of(before.2));
                let way = (after.1 - before.1) * car.speed_mps;
                let curvature = if way.abs() > 1e-3 { turned / way } else { 0.0 };
                Label::of_truth(car.activity, car.speed_mps, curvature)
            })
            .collect();
        for (i, (frame, time_s, _)) in cars.iter().enumerate() {
            let mut right = vec![own[i]];
            let near = |j: &usize| (cars[*j].1 - time_s).abs() <= FUZZY_S;
            let around = (0..i).rev().take_while(near).chain((i..cars.len()).take_while(near));
            right.extend(around.map(|j| own[j]).filter(|label| *label != own[i]));
            right.dedup();
            labels.insert((id, *frame), right);
        }
    }
    labels
}

/// By car and frame what the net tells of the true track.
fn from_truth(truth: &Truth, systems: &mut [Row]) -> Result<BTreeMap<(u64, u64), Label>, EvalError> {
    let mut labels = BTreeMap::new();
    let Some(ground) = systems.iter_mut().find(|system| system.seen == Seen::Ground) else {
        return Ok(labels);
    };
    for (id, cars) in cars_by_id(truth) {
        let motion = Motion {
            time_s: cars.iter().map(|(_, time_s, _)| *time_s).collect(),
            xy_m: cars
                .iter()
                .map(|(_, _, car)| [car.world_from_car[0][3], car.world_from_car[1][3]])
                .collect(),
            heading_rad: cars.iter().map(|(_, _, car)| heading_of(car)).collect(),
            sd_m: vec![[0.0; 2]; cars.len()],
            ..Motion::default()
        };
        let told = told(&mut ground.net, &motion)?;
        labels.extend(cars.iter().zip(told).map(|((frame, _, _), label)| ((id, *frame), label)));
    }
    Ok(labels)
}

/// By row of our tracks what each system tells.
fn from_rows(truth: &Truth, rows: &[TrackRow], systems: &mut [Row]) -> Result<Vec<Vec<Label>>, EvalError> {
    let mut of_track: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (place, row) in rows.iter().enumerate() {
        of_track.entry(row.track).or_default().push(place);
    }
    let height = f64::from(truth.camera.image_size_px.height);
    let mut labels = vec![Vec::new(); rows.len()];
    for places in of_track.values() {
        let rows = places.iter().map(|place| &rows[*place]);
        let time_s: Vec<f64> = rows.clone().map(|row| row.time_s).collect();
        let boxes: Vec<[f64; 4]> = rows.clone().map(|row| row.bbox_px).collect();
        for system in systems.iter_mut() {
            let motion = match system.seen {
                Seen::Ground => track_motion(rows.clone()),
                seen => picture_motion(&time_s, &boxes, height, seen),
            };
            let told = told(&mut system.net, &motion)?;
            places.iter().zip(told).for_each(|(place, label)| labels[*place].push(label));
        }
    }
    Ok(labels)
}
