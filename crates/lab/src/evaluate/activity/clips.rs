//! Clips with truth: run from pixels, told frame by frame.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_activity::{Event, Label, Motion};
use roadplane_base::TrackRow;
use roadplane_pipeline::{Cancel, Config, Progress, RunOptions, Silent, run_input, track_motion};
use roadplane_tables::Report;
use roadplane_write::{WriteError, read_jsonl};

use super::events::{self, ClipEvents, ToldEvent};
use super::rows::{ActivityOptions, Row, Rows, Seen, VIDEO, picture_motion, told};
use super::scores::{Case, differences, each_label, table};
use super::truths::{car_counts, cars_by_id, heading_of, true_events, true_labels, true_stretches};
use crate::LabError;
use roadplane_metrics::scoring::pairs_by_box;
use roadplane_metrics::truth::{Kind, TrueCar, Truth, read_dataset, read_truth};

/// Within this of a change of the true label both labels are right, s: frames lie so far apart.
const EDGE_S: f64 = 0.25;
/// How far people's beginnings and ends of activities spread (1 sd, s): `python -m activity.spread`.
const SPREAD_S: f64 = 0.7;
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
/// Labels that events have.
const EVENTS: [Label; 7] = [
    Label::Moving,
    Label::Starting,
    Label::Stopping,
    Label::TurningLeft,
    Label::TurningRight,
    Label::UTurn,
    Label::Reversing,
];

/// The tables.
pub fn evaluate(
    folder: &Path,
    systems: &mut Rows,
    options: &ActivityOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let dataset = read_dataset(folder)?;
    let truths: Vec<Truth> = dataset.items.iter().map(|path| read_truth(path)).collect::<Result<_, _>>()?;
    let clips: Vec<&Truth> =
        truths.iter().filter(|truth| truth.kind == Kind::Clip && truth.media.is_some()).collect();
    if clips.is_empty() {
        let what = format!("{} has no clips with video", folder.display());
        return Err(LabError::unsuitable(what));
    }
    progress.expect(Some(clips.len() as u64));
    let temporary = tempfile::tempdir().map_err(|source| WriteError::Io {
        doing: "make the folder",
        source,
        path: "temporary".into(),
    })?;
    let runs = options.runs.as_deref().unwrap_or_else(|| temporary.path());
    let mut found = Vec::new();
    for truth in clips {
        let Some(media) = &truth.media else { continue };
        let run_options = RunOptions { resume: true, ..RunOptions::new(options.models.clone()) };
        let run = run_input(media, runs, &run_options, config, cancel, &Silent)?;
        let rows: Vec<TrackRow> = read_jsonl(&run.folder.join("tracks.jsonl"))?.collect::<Result<_, _>>()?;
        found.push(clip_found(truth, &rows, systems)?);
        progress.frame_done();
    }
    let mut names: Vec<&str> = systems.motion.iter().map(|system| system.name).collect();
    if systems.video.is_some() {
        names.insert(names.len() - 1, VIDEO);
    }
    names.push("3D from truth");
    Ok(report(&dataset.name, &found, &names))
}

/// What comes of a clip.
struct Found {
    /// Cars in frames, where both labels are right within [`EDGE_S`] of a change.
    frames: Vec<Case>,
    /// The same within [`SPREAD_S`].
    spread: Vec<Case>,
    /// Stretches of one label of one car.
    stretches: Vec<Case>,
    events: ClipEvents,
}

fn report(dataset: &str, found: &[Found], systems: &[&str]) -> Report {
    let each = |of: fn(&Found) -> &Vec<Case>| found.iter().map(|clip| of(clip).clone()).collect::<Vec<_>>();
    let (frames, spread) = (each(|clip| &clip.frames), each(|clip| &clip.spread));
    let stretches = each(|clip| &clip.stretches);
    let events: Vec<ClipEvents> = found.iter().map(|clip| clip.events.clone()).collect();
    let count: usize = frames.iter().map(Vec::len).sum();
    let title = format!("Activities of {dataset}: {} clips, {count} cars in frames", found.len());
    let mut report = Report { title, ..Report::default() };
    let note = format!(
        "Cars that a track's box overlaps; precision and recall are the mean over the paper's seven labels. Within {EDGE_S} s of a \
         change both labels are right. 2D rows and video see the boxes of our own tracks.{}",
        if systems.contains(&VIDEO) {
            ""
        } else {
            " Video: not measured, as its net is not in the models folder."
        }
    );
    let spread_note =
        format!("Within {SPREAD_S} s of a change both labels are right: people differ by so much.");
    let ours = systems.len() - 2;
    report.tables.push(table("Per frame, seven labels", &note, &frames, systems, &PAPER));
    report.tables.push(differences("Per frame: 3D against the others", &frames, systems, ours, &PAPER));
    report.tables.push(table("Per frame, as people would agree", &spread_note, &spread, systems, &PAPER));
    report.tables.push(table("Per frame, with reversing", "", &frames, systems, &Label::ALL));
    let note = "Stretches of one label of one car, each told by what most of its frames are told.";
    report.tables.push(table("Per instance, with reversing", note, &stretches, systems, &Label::ALL));
    report.tables.push(differences(
        "Per instance: 3D against the others",
        &stretches,
        systems,
        ours,
        &Label::ALL,
    ));
    report.tables.push(events::table(&events, systems, &EVENTS));
    for (system, name) in systems.iter().enumerate() {
        report.tables.push(each_label(&format!("Per frame, label by label: {name}"), &frames, system));
    }
    for (system, name) in systems.iter().enumerate() {
        let title = format!("Events, label by label: {name}");
        report.tables.push(events::each_label(&title, &events, system, &EVENTS));
    }
    report
}

/// A row of our tracks that lies on a true car.
struct Pair {
    place: usize,
    car: u64,
    frame: u64,
    time_s: f64,
    /// Whether the car counts in this frame.
    counts: bool,
}

fn pairs(truth: &Truth, rows: &[TrackRow]) -> Vec<Pair> {
    let mut of_frame: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (place, row) in rows.iter().enumerate() {
        of_frame.entry(row.frame).or_default().push(place);
    }
    let mut pairs = Vec::new();
    for frame in &truth.frames {
        let places = of_frame.get(&frame.frame).map_or(&[][..], Vec::as_slice);
        let cars: Vec<&TrueCar> = frame.cars.iter().collect();
        let boxes: Vec<[f64; 4]> = places.iter().map(|place| rows[*place].bbox_px).collect();
        for (place, car) in places.iter().zip(pairs_by_box(&boxes, &cars)) {
            let Some(car) = car.map(|c| cars[c]) else { continue };
            let counts = car_counts(truth, car);
            pairs.push(Pair { place: *place, car: car.id, frame: frame.frame, time_s: frame.time_s, counts });
        }
    }
    pairs
}

/// Tells a clip's tracks and judges what is told.
fn clip_found(truth: &Truth, rows: &[TrackRow], systems: &mut Rows) -> Result<Found, LabError> {
    let from_truth = from_truth(truth, &mut systems.motion)?;
    let from_rows = from_rows(truth, rows, systems)?;
    let pairs = pairs(truth, rows);
    let (edge, spread) = (true_labels(truth, EDGE_S), true_labels(truth, SPREAD_S));
    let told = |pair: &Pair| {
        let mut told = from_rows.labels[pair.place].clone();
        told.extend(from_truth.labels.get(&(pair.car, pair.frame)));
        told
    };
    let cases = |right: &BTreeMap<(u64, u64), Vec<Label>>| {
        let counted = pairs.iter().filter(|pair| pair.counts);
        let case = |pair: &Pair| {
            let truth = right.get(&(pair.car, pair.frame))?.clone();
            Some(Case { truth, told: told(pair) })
        };
        counted.filter_map(case).collect::<Vec<Case>>()
    };
    let stretches = true_stretches(truth, &edge)
        .iter()
        .filter(|event| event.counts)
        .filter_map(|event| {
            let inside = |pair: &&Pair| {
                pair.counts
                    && pair.car == event.car
                    && (event.span_s[0]..=event.span_s[1]).contains(&pair.time_s)
            };
            let told: Vec<Vec<Label>> = pairs.iter().filter(inside).map(told).collect();
            let systems = told.first()?.len();
            let most = |system| most_frequent(told.iter().map(|told| told[system]));
            Some(Case { truth: vec![event.label], told: (0..systems).filter_map(most).collect() })
        })
        .collect();
    let on_car = |event: &Event| {
        let inside = |pair: &&Pair| {
            rows[pair.place].track == event.track && (event.from_s..=event.to_s).contains(&pair.time_s)
        };
        let car = most_frequent(pairs.iter().filter(inside).map(|pair| pair.car));
        told_event(event, car)
    };
    let of_system = |events: &Vec<Event>| events.iter().map(on_car).collect();
    let mut told: Vec<Vec<ToldEvent>> = from_rows.events.iter().map(of_system).collect();
    told.push(from_truth.events.iter().map(|event| told_event(event, Some(event.track))).collect());
    let minutes = truth.frames.len() as f64 / truth.fps.unwrap_or(1.0) / 60.0;
    Ok(Found {
        frames: cases(&edge),
        spread: cases(&spread),
        stretches,
        events: ClipEvents::new(minutes, &true_events(truth, &edge), told),
    })
}

fn told_event(event: &Event, car: Option<u64>) -> ToldEvent {
    let span_s = [event.from_s, event.to_s];
    ToldEvent { car, label: event.activity, span_s, confidence: event.confidence }
}

/// The first of the most frequent ones.
fn most_frequent<T: Ord + Copy>(values: impl Iterator<Item = T>) -> Option<T> {
    let mut counts: BTreeMap<T, usize> = BTreeMap::new();
    values.for_each(|value| *counts.entry(value).or_default() += 1);
    counts.into_iter().rev().max_by_key(|(_, count)| *count).map(|(value, _)| value)
}

/// What the net tells of the true tracks.
#[derive(Default)]
struct FromTruth {
    /// By car and frame.
    labels: BTreeMap<(u64, u64), Label>,
    /// Their tracks are the cars.
    events: Vec<Event>,
}

fn from_truth(truth: &Truth, systems: &mut [Row]) -> Result<FromTruth, LabError> {
    let mut found = FromTruth::default();
    let Some(ground) = systems.iter_mut().find(|system| system.seen == Seen::Ground) else {
        return Ok(found);
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
        found.events.extend(told.events(id));
        let labels = cars.iter().zip(told.samples);
        found.labels.extend(labels.map(|((frame, _, _), (label, _))| ((id, *frame), label)));
    }
    Ok(found)
}

/// What the systems tell of our tracks.
struct FromRows {
    /// By row, a label a system.
    labels: Vec<Vec<Label>>,
    /// By system.
    events: Vec<Vec<Event>>,
}

fn from_rows(truth: &Truth, rows: &[TrackRow], systems: &mut Rows) -> Result<FromRows, LabError> {
    let mut of_track: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (place, row) in rows.iter().enumerate() {
        of_track.entry(row.track).or_default().push(place);
    }
    let by_video = match (&mut systems.video, &truth.media) {
        (Some(net), Some(media)) => {
            let box_of = |place: &usize| (rows[*place].time_s, rows[*place].bbox_px);
            let tracks = of_track.iter().map(|(track, places)| (*track, places.iter().map(box_of).collect()));
            Some(net.tell(media, &tracks.collect())?)
        }
        _ => None,
    };
    let height = f64::from(truth.camera.image_size_px.height);
    let count = systems.motion.len() + usize::from(by_video.is_some());
    let mut found = FromRows { labels: vec![Vec::new(); rows.len()], events: vec![Vec::new(); count] };
    for (track, places) in &of_track {
        let rows = places.iter().map(|place| &rows[*place]);
        let time_s: Vec<f64> = rows.clone().map(|row| row.time_s).collect();
        let boxes: Vec<[f64; 4]> = rows.clone().map(|row| row.bbox_px).collect();
        let mut by_system = Vec::with_capacity(count);
        for system in &mut systems.motion {
            let motion = match system.seen {
                Seen::Ground => track_motion(rows.clone()),
                seen => picture_motion(&time_s, &boxes, height, seen),
            };
            by_system.push(told(&mut system.net, &motion)?);
        }
        if let Some(by_video) = &by_video {
            by_system.insert(by_system.len() - 1, by_video.get(track).cloned().unwrap_or_default());
        }
        for (told, events) in by_system.into_iter().zip(&mut found.events) {
            events.extend(told.events(*track));
            places.iter().zip(told.samples).for_each(|(place, (label, _))| found.labels[*place].push(label));
        }
    }
    Ok(found)
}
