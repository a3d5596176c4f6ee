//! Scores activities on clips with truth. The pipeline runs on the clips' pixels, and each car in each frame gets a
//! label.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_activity::{Event, Label, Motion};
use roadplane_base::TrackRow;
use roadplane_pipeline::{Cancel, Config, Progress, RunOptions, Silent, run_input, track_motion};
use roadplane_tables::Report;
use roadplane_write::{WriteError, read_jsonl};

use super::events::{self, ClipEvents, ReportedEvent};
use super::rows::{ActivityOptions, Row, Rows, Seen, VIDEO, picture_motion, predict};
use super::scores::{Case, differences, each_label, table};
use super::truths::{car_counts, cars_by_id, heading_of, true_events, true_intervals, true_labels};
use crate::LabError;
use roadplane_metrics::scoring::{most_frequent, pairs_by_box};
use roadplane_metrics::truth::{Kind, TrueCar, Truth, read_dataset, read_truth};

/// Time before and after a change of the true label in which both labels are right, s. The value is about the time
/// between two frames.
const EDGE_S: f64 = 0.25;
/// Standard deviation of the times at which different annotators place the start or end of an activity, s.
///
/// `roadplane-train activity spread` computes the value.
const SPREAD_S: f64 = 0.7;
/// The seven labels of the paper *Car Pose in Context*.
const PAPER: [Label; 7] = [
    Label::NotMoving,
    Label::Moving,
    Label::Starting,
    Label::Stopping,
    Label::TurningLeft,
    Label::TurningRight,
    Label::UTurn,
];
/// The labels whose events are scored: all labels of moving vehicles.
const EVENTS: [Label; 7] = [
    Label::Moving,
    Label::Starting,
    Label::Stopping,
    Label::TurningLeft,
    Label::TurningRight,
    Label::UTurn,
    Label::Reversing,
];

/// Runs the pipeline on the clips of a data set and returns the tables of scores.
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

/// The predictions of all systems for one clip, with the true labels.
struct Found {
    /// One case per car and frame. Within [`EDGE_S`] of a change of the true label, both labels are right.
    frames: Vec<Case>,
    /// One case per car and frame. Within [`SPREAD_S`] of a change of the true label, both labels are right.
    spread: Vec<Case>,
    /// One case per interval in which a car has one label.
    intervals: Vec<Case>,
    events: ClipEvents,
}

fn report(dataset: &str, found: &[Found], systems: &[&str]) -> Report {
    let each = |of: fn(&Found) -> &Vec<Case>| found.iter().map(|clip| of(clip).clone()).collect::<Vec<_>>();
    let (frames, spread) = (each(|clip| &clip.frames), each(|clip| &clip.spread));
    let intervals = each(|clip| &clip.intervals);
    let events: Vec<ClipEvents> = found.iter().map(|clip| clip.events.clone()).collect();
    let count: usize = frames.iter().map(Vec::len).sum();
    let title = format!("Activities of {dataset}: {} clips, {count} cars in frames", found.len());
    let mut report = Report { title, ..Report::default() };
    let note = format!(
        "Cars that a track's box overlaps; precision and recall are the mean over the paper's seven labels. Within {EDGE_S} s of a \
        change both labels are right. The input of the 2D rows and of video is the boxes of our own tracks.{}",
        if systems.contains(&VIDEO) {
            ""
        } else {
            " Video: not measured, as its net is not in the models folder."
        }
    );
    let spread_note = format!(
        "Within {SPREAD_S} s of a change, both labels count as right, because annotators differ by that much."
    );
    let ours = systems.len() - 2;
    report.tables.push(table("Per frame, seven labels", &note, &frames, systems, &PAPER));
    report.tables.push(differences("Per frame: 3D against the others", &frames, systems, ours, &PAPER));
    report.tables.push(table("Per frame, with annotators' scatter", &spread_note, &spread, systems, &PAPER));
    report.tables.push(table("Per frame, with reversing", "", &frames, systems, &Label::ALL));
    let note =
        "Intervals of one label of one car. The predicted label is the most frequent one of its frames.";
    report.tables.push(table("Per instance, with reversing", note, &intervals, systems, &Label::ALL));
    report.tables.push(differences(
        "Per instance: 3D against the others",
        &intervals,
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

/// A row of our tracks, paired with the true car that the row's box overlaps.
struct Pair {
    /// Index of the row among all rows of the tracks.
    row: usize,
    car: u64,
    frame: u64,
    time_s: f64,
    /// Whether the car is scored in this frame: it is large enough, and enough of it is visible.
    counts: bool,
}

fn pairs(truth: &Truth, rows: &[TrackRow]) -> Vec<Pair> {
    let mut of_frame: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (index, row) in rows.iter().enumerate() {
        of_frame.entry(row.frame).or_default().push(index);
    }
    let mut pairs = Vec::new();
    for frame in &truth.frames {
        let indices = of_frame.get(&frame.frame).map_or(&[][..], Vec::as_slice);
        let cars: Vec<&TrueCar> = frame.cars.iter().collect();
        let boxes: Vec<[f64; 4]> = indices.iter().map(|index| rows[*index].bbox_px).collect();
        for (index, car) in indices.iter().zip(pairs_by_box(&boxes, &cars)) {
            let Some(car) = car.map(|c| cars[c]) else { continue };
            let counts = car_counts(truth, car);
            pairs.push(Pair { row: *index, car: car.id, frame: frame.frame, time_s: frame.time_s, counts });
        }
    }
    pairs
}

/// Predicts the activities of a clip's tracks and compares them with the truth.
fn clip_found(truth: &Truth, rows: &[TrackRow], systems: &mut Rows) -> Result<Found, LabError> {
    let from_truth = from_truth(truth, &mut systems.motion)?;
    let from_rows = from_rows(truth, rows, systems)?;
    let pairs = pairs(truth, rows);
    let (edge, spread) = (true_labels(truth, EDGE_S), true_labels(truth, SPREAD_S));
    let predicted = |pair: &Pair| {
        let mut labels = from_rows.labels[pair.row].clone();
        labels.extend(from_truth.labels.get(&(pair.car, pair.frame)));
        labels
    };
    let cases = |right: &BTreeMap<(u64, u64), Vec<Label>>| {
        let counted = pairs.iter().filter(|pair| pair.counts);
        let case = |pair: &Pair| {
            let truth = right.get(&(pair.car, pair.frame))?.clone();
            Some(Case { truth, predicted: predicted(pair) })
        };
        counted.filter_map(case).collect::<Vec<Case>>()
    };
    let intervals = true_intervals(truth, &edge)
        .iter()
        .filter(|event| event.counts)
        .filter_map(|event| {
            let inside = |pair: &&Pair| {
                pair.counts
                    && pair.car == event.car
                    && (event.span_s[0]..=event.span_s[1]).contains(&pair.time_s)
            };
            let frames: Vec<Vec<Label>> = pairs.iter().filter(inside).map(predicted).collect();
            let systems = frames.first()?.len();
            let most = |system| most_frequent(frames.iter().map(|labels| labels[system]));
            Some(Case { truth: vec![event.label], predicted: (0..systems).filter_map(most).collect() })
        })
        .collect();
    let on_car = |event: &Event| {
        let inside = |pair: &&Pair| {
            rows[pair.row].track == event.track && (event.from_s..=event.to_s).contains(&pair.time_s)
        };
        let car = most_frequent(pairs.iter().filter(inside).map(|pair| pair.car));
        reported_event(event, car)
    };
    let of_system = |events: &Vec<Event>| events.iter().map(on_car).collect();
    let mut reported: Vec<Vec<ReportedEvent>> = from_rows.events.iter().map(of_system).collect();
    reported.push(from_truth.events.iter().map(|event| reported_event(event, Some(event.track))).collect());
    let minutes = truth.frames.len() as f64 / truth.fps.unwrap_or(1.0) / 60.0;
    Ok(Found {
        frames: cases(&edge),
        spread: cases(&spread),
        intervals,
        events: ClipEvents::new(minutes, &true_events(truth, &edge), reported),
    })
}

fn reported_event(event: &Event, car: Option<u64>) -> ReportedEvent {
    let span_s = [event.from_s, event.to_s];
    ReportedEvent { car, label: event.activity, span_s, confidence: event.confidence }
}

/// Predictions of the net *3D* from the true tracks.
#[derive(Default)]
struct FromTruth {
    /// The predicted label, by id of the car and index of the frame.
    labels: BTreeMap<(u64, u64), Label>,
    /// The predicted events. The track id of an event is the id of the true car.
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
        let predicted = predict(&mut ground.net, &motion)?;
        found.events.extend(predicted.events(id));
        let labels = cars.iter().zip(predicted.samples);
        found.labels.extend(labels.map(|((frame, _, _), (label, _))| ((id, *frame), label)));
    }
    Ok(found)
}

/// Predictions of all systems from our tracks.
struct FromRows {
    /// For each row of the tracks, the label that each system predicts.
    labels: Vec<Vec<Label>>,
    /// For each system, the events that the system predicts.
    events: Vec<Vec<Event>>,
}

fn from_rows(truth: &Truth, rows: &[TrackRow], systems: &mut Rows) -> Result<FromRows, LabError> {
    let mut of_track: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (index, row) in rows.iter().enumerate() {
        of_track.entry(row.track).or_default().push(index);
    }
    let by_video = match (&mut systems.video, &truth.media) {
        (Some(net), Some(media)) => {
            let box_of = |index: &usize| (rows[*index].time_s, rows[*index].bbox_px);
            let tracks =
                of_track.iter().map(|(track, indices)| (*track, indices.iter().map(box_of).collect()));
            Some(net.predict(media, &tracks.collect())?)
        }
        _ => None,
    };
    let height = f64::from(truth.camera.image_size_px.height);
    let count = systems.motion.len() + usize::from(by_video.is_some());
    let mut found = FromRows { labels: vec![Vec::new(); rows.len()], events: vec![Vec::new(); count] };
    for (track, indices) in &of_track {
        let rows = indices.iter().map(|index| &rows[*index]);
        let time_s: Vec<f64> = rows.clone().map(|row| row.time_s).collect();
        let boxes: Vec<[f64; 4]> = rows.clone().map(|row| row.bbox_px).collect();
        let mut by_system = Vec::with_capacity(count);
        for system in &mut systems.motion {
            let motion = match system.seen {
                Seen::Ground => track_motion(rows.clone()),
                seen => picture_motion(&time_s, &boxes, height, seen),
            };
            by_system.push(predict(&mut system.net, &motion)?);
        }
        if let Some(by_video) = &by_video {
            by_system.insert(by_system.len() - 1, by_video.get(track).cloned().unwrap_or_default());
        }
        for (predicted, events) in by_system.into_iter().zip(&mut found.events) {
            events.extend(predicted.events(*track));
            let labels = indices.iter().zip(predicted.samples);
            labels.for_each(|(index, (label, _))| found.labels[*index].push(label));
        }
    }
    Ok(found)
}
