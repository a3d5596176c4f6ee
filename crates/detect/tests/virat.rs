//! Measures recall and precision of the detector on the three labelled frames of a real car park.

#![allow(clippy::unwrap_used)] // the helpers below are test code, too

use std::path::Path;
use std::time::Instant;

use roadplane_base::{CarRecord, Frame, FrameStamp, bbox_iou};
use roadplane_detect::{DetectOptions, Detector};
use roadplane_infer::{ProviderChoice, Session, SessionOptions};

/// The labelled box of a vehicle, px.
struct Label {
    bbox: [f64; 4],
}

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// Opens the detector with f32 arithmetic, whatever the machine supports.
fn detector(options: DetectOptions) -> Detector {
    detector_on(ProviderChoice::Cpu, options)
}

fn detector_on(provider: ProviderChoice, options: DetectOptions) -> Detector {
    let session = SessionOptions { provider, ..SessionOptions::default() };
    let session = Session::open(&root().join("models/detector.card.json"), &session).unwrap();
    Detector::new(session, options).unwrap()
}

fn read(path: &Path) -> Frame {
    let image = image::open(path).unwrap().into_rgb8();
    Frame { stamp: FrameStamp { index: 0, pts_nanos: 0 }, image }
}

/// Returns the text between `key` and the first of the characters `ends`.
fn after<'a>(line: &'a str, key: &str, ends: &[char]) -> Option<&'a str> {
    Some(line.split_once(key)?.1.trim_start().split(ends).next()?.trim())
}

/// Reads the labels of one frame's vehicles from files in the KPF format.
fn labels(folder: &Path, frame: &str) -> Vec<Label> {
    let text = |name| std::fs::read_to_string(folder.join(name)).unwrap();
    let types = text("types.yml");
    let is_vehicle =
        |id: &str| types.lines().any(|l| after(l, "id1:", &[',']) == Some(id) && l.contains("{ Vehicle:"));
    let boxes = text("boxes.geom.yml");
    let of_frame = boxes.lines().filter(|l| after(l, " ts0:", &[',']) == Some(frame));
    of_frame
        .filter(|l| after(l, "id1:", &[',']).is_some_and(is_vehicle))
        .filter_map(|l| {
            let numbers = after(l, "g0:", &[','])?;
            let sides: Vec<f64> = numbers.split_whitespace().map(|n| n.parse().unwrap()).collect();
            Some(Label { bbox: sides.try_into().ok()? })
        })
        .collect()
}

fn width(bbox: &[f64; 4]) -> f64 {
    bbox[2] - bbox[0]
}

/// Returns for each label whether it was found, and for each detection whether it is right. Each label is used once,
/// and the best detections come first.
fn matched(cars: &[CarRecord], labels: &[Label], min_iou: f64) -> (Vec<bool>, Vec<bool>) {
    let (mut found, mut right) = (vec![false; labels.len()], vec![false; cars.len()]);
    for (i, car) in cars.iter().enumerate() {
        let overlap = |j: usize| bbox_iou(&car.bbox_px, &labels[j].bbox);
        let free = (0..labels.len()).filter(|&j| !found[j] && overlap(j) >= min_iou);
        if let Some(best) = free.max_by(|&a, &b| overlap(a).total_cmp(&overlap(b))) {
            (found[best], right[i]) = (true, true);
        }
    }
    (found, right)
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn labelled_cars_are_found() {
    let folder = root().join("../shared/data/virat/VIRAT_S_000206_04");
    let mut detector = detector(DetectOptions::default());
    let sizes = [(0.0, 40.0), (40.0, 80.0), (80.0, 1e9), (40.0, 1e9)];
    for min_iou in [0.5, 0.4] {
        let mut counts = [(0, 0, 0, 0); 4];
        for frame in ["25", "50", "75"] {
            let start = Instant::now();
            let cars = detector.detect(&read(&folder.join(format!("000{frame}.png")))).unwrap();
            println!("frame {frame}: {} vehicles, {:?}", cars.len(), start.elapsed());
            let labels = labels(&folder, frame);
            let (found, right) = matched(&cars, &labels, min_iou);
            for ((low, high), (labelled, hits, given, good)) in sizes.iter().zip(&mut counts) {
                let of_size = |bbox: &[f64; 4]| (*low..*high).contains(&width(bbox));
                for (label, found) in labels.iter().zip(&found).filter(|(label, _)| of_size(&label.bbox)) {
                    *labelled += 1;
                    *hits += usize::from(*found);
                    if !found && min_iou < 0.5 {
                        println!("  missed {:?}", label.bbox);
                    }
                }
                for (car, right) in cars.iter().zip(&right).filter(|(car, _)| of_size(&car.bbox_px)) {
                    *given += 1;
                    *good += usize::from(*right);
                    if !right && min_iou < 0.5 {
                        println!("  false {:?} {}", car.bbox_px, car.score);
                    }
                }
            }
        }
        for ((low, high), (labelled, hits, given, good)) in sizes.iter().zip(counts) {
            println!("IoU {min_iou}, {low}–{high} px: recall {hits}/{labelled}, precision {good}/{given}");
        }
        let (labelled, hits, given, good) = counts[3];
        // The labels are up to a third wider than the cars. So tight boxes of small cars have an IoU below 0.5.
        let least_recall = if min_iou > 0.4 { 80 } else { 88 };
        assert!(hits * 100 >= labelled * least_recall, "recall of at least {least_recall} %");
        assert!(good * 100 >= given * 88, "precision of at least 88 %");
    }
}

/// Checks that int8 arithmetic finds the vehicles that f32 finds. One in twenty may differ, if its score is near the
/// threshold.
#[test]
fn int8_finds_the_vehicles_of_f32() {
    let scenes = root().join("tests/data/lots/scenes");
    let (mut plain, mut fast) =
        (detector(DetectOptions::default()), detector_on(ProviderChoice::Int8, DetectOptions::default()));
    let (mut given, mut kept, mut overlaps) = (0, 0, Vec::new());
    let mut highest_lost: f64 = 0.0;
    for still in (0..50).step_by(5) {
        let frame = read(&scenes.join(format!("still_{still:04}.jpg")));
        let sure = plain.detect(&frame).unwrap();
        let wanted: Vec<Label> = sure.iter().map(|car| Label { bbox: car.bbox_px }).collect();
        let cars = fast.detect(&frame).unwrap();
        given += wanted.len();
        for (car, found) in sure.iter().zip(matched(&cars, &wanted, 0.5).0) {
            kept += usize::from(found);
            highest_lost = if found { highest_lost } else { highest_lost.max(car.score) };
        }
        overlaps.extend(
            wanted
                .iter()
                .map(|label| cars.iter().map(|car| bbox_iou(&car.bbox_px, &label.bbox)).fold(0.0, f64::max)),
        );
    }
    overlaps.sort_by(f64::total_cmp);
    println!(
        "int8 keeps {kept} of {given}, highest score lost {highest_lost}, median IoU {:.3}",
        overlaps[overlaps.len() / 2]
    );
    assert!(given > 80 && kept * 20 >= given * 19, "{kept} of {given}");
    assert!(highest_lost < 0.6, "{highest_lost}");
    assert!(overlaps[overlaps.len() / 2] > 0.95);
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn a_shuttle_bus_is_found_and_boxes_stay_inside() {
    let folder = root().join("../shared/data/virat/VIRAT_S_000206_04");
    let frame = read(&folder.join("00025.png"));
    let cars = detector(DetectOptions::default()).detect(&frame).unwrap();
    assert!(cars.iter().any(|car| bbox_iou(&car.bbox_px, &[881.0, 504.0, 1040.0, 657.0]) > 0.5));
    for car in &cars {
        let [x0, y0, x1, y1] = car.bbox_px;
        assert!(x0 >= -0.5 && y0 >= -0.5 && x1 <= 1279.5 && y1 <= 719.5 && x0 < x1 && y0 < y1);
    }
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn tiles_find_the_vehicles_of_the_whole_picture() {
    let path = root().join("../shared/data/keypoints/virat_0401.png");
    let frame = read(&path);
    let whole = detector(DetectOptions::default()).detect(&frame).unwrap();
    let tiled = DetectOptions { tile_px: 1024, tile_overlap_px: 384, ..DetectOptions::default() };
    let tiled = detector(tiled).detect(&frame).unwrap();
    println!("{} vehicles whole, {} in tiles", whole.len(), tiled.len());
    let sure = whole.iter().filter(|car| car.score > 0.5);
    for car in sure {
        let best = tiled.iter().map(|t| bbox_iou(&t.bbox_px, &car.bbox_px)).fold(0.0, f64::max);
        assert!(best > 0.8, "{:?} is found differently in tiles ({best:.2})", car.bbox_px);
    }
}

#[test]
fn an_empty_picture_has_no_cars() {
    let image = image::RgbImage::from_pixel(640, 360, image::Rgb([120, 130, 110]));
    let frame = Frame { stamp: FrameStamp { index: 0, pts_nanos: 0 }, image };
    assert!(detector(DetectOptions::default()).detect(&frame).unwrap().is_empty());
    let image = image::RgbImage::from_pixel(1, 1, image::Rgb([120, 130, 110]));
    let frame = Frame { image, ..frame };
    assert!(detector(DetectOptions::default()).detect(&frame).unwrap().is_empty());
}
