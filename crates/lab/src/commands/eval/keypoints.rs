//! `roadplane-lab eval keypoints`: the keypoint net on labelled images.

use std::io::Cursor;
use std::path::Path;

use crate::keypoints::{
    CarErrors, LabelledCar, LabelledImage, keypoint_tables, measure, predict, worst_first,
};
use image::{ImageFormat, RgbImage};
use roadplane_base::KeypointSet;
use roadplane_pipeline::{
    Cancel, Config, PipelineError, find_models, open_detector, open_input, open_keypoints,
};
use roadplane_tables::Report;
use roadplane_view::{KeypointCase, keypoint_sheet};
use roadplane_write::OutFile;

use crate::args::eval::{Boxes, EvalKeypointsArgs};
use crate::commands::eval::show::show;
use roadplane_terminal::Outcome;

/// A labelled car with the net's keypoints and their errors.
struct Measured {
    image: usize,
    labelled: LabelledCar,
    found: KeypointSet,
    errors: CarErrors,
}

/// Prints the tables, and draws the worst cars if a folder is given.
pub fn keypoints(args: &EvalKeypointsArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let mut net = open_keypoints(&models, &config)?;
    let mut detector = match args.boxes {
        Boxes::True => None,
        Boxes::Detected => Some(open_detector(&models, &config)?),
    };
    let mut pictures = Vec::new();
    let mut measured = Vec::new();
    let mut groups = Vec::new();
    let mut without = 0;
    for (image, path) in args.truth.iter().enumerate() {
        if let Some(signal) = cancel.signal() {
            return Err(PipelineError::Stopped { signal }.into());
        }
        let labels = LabelledImage::read(path)?;
        let picture = read_picture(&args.images.join(&labels.image), &config)?;
        let found = predict(picture.clone(), &labels.cars, &mut net, detector.as_mut())?;
        pictures.push(picture);
        let mut errors = Vec::new();
        for (labelled, found) in labels.cars.into_iter().zip(found) {
            let Some(found) = found else {
                without += 1;
                continue;
            };
            let car = measure(&labelled, &found);
            errors.push(car.clone());
            measured.push(Measured { image, labelled, found, errors: car });
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        groups.push((name, errors));
    }
    let mut tables = keypoint_tables(&groups);
    if let (Some(overall), 1..) = (tables.first_mut(), without) {
        overall.note +=
            &format!(" {without} cars were not found, or are too small for the net; no row counts them.");
    }
    let report = Report { title: "Keypoints on labelled images".to_owned(), tables, ..Report::default() };
    show(&report, args.out.as_deref())?;
    if let Some(folder) = &args.out {
        write_picture(&folder.join("worst.png"), &worst(&measured, &pictures, args.worst)?)?;
    }
    Ok(Outcome::Done)
}

/// Returns the first picture of an input.
fn read_picture(path: &Path, config: &Config) -> Result<RgbImage, PipelineError> {
    let mut input = open_input(path, config)?;
    let frame = input.next_frame()?;
    frame
        .map(|frame| frame.image)
        .ok_or_else(|| PipelineError::usage(&format!("no picture in {}", path.display())))
}

fn write_picture(path: &Path, picture: &RgbImage) -> anyhow::Result<()> {
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, ImageFormat::Png)?;
    let mut file = OutFile::create(path)?;
    file.write_bytes(png.get_ref())?;
    Ok(file.finish()?)
}

fn worst(measured: &[Measured], pictures: &[RgbImage], count: usize) -> anyhow::Result<RgbImage> {
    let errors: Vec<&CarErrors> = measured.iter().map(|car| &car.errors).collect();
    let case = |i: usize| {
        let car = &measured[i];
        let pairs = car.labelled.labels.iter().zip(&car.found);
        let pairs =
            pairs.filter_map(|(label, found)| Some((label.filter(|l| l.clear)?.pixel, (*found)?.pixel)));
        let confused = car.errors.confusion.map_or(String::new(), |kind| format!(" {kind:?}"));
        KeypointCase {
            picture: &pictures[car.image],
            bbox_px: car.labelled.bbox_px,
            pairs: pairs.collect(),
            title: format!("{:.1} % {}{confused}", 100.0 * car.errors.median(), car.errors.body),
        }
    };
    let cases: Vec<KeypointCase<'_>> = worst_first(&errors).into_iter().take(count).map(case).collect();
    Ok(keypoint_sheet(&cases)?)
}
