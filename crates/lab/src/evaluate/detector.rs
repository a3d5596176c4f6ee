//! Evaluates the detector on pictures with true boxes, on data sets with truth, and on pictures without vehicles.

mod pictures;
mod score;
mod tables;

use std::path::{Path, PathBuf};

use image::RgbImage;
use roadplane_base::{CarRecord, Frame, VehicleClass};
use roadplane_infer::ProviderChoice;
use roadplane_pipeline::{Cancel, Config, PipelineError, Progress, open_detector, open_input};
use roadplane_tables::{Picture, Report};
use roadplane_view::{DetectionCase, detection_sheet};

use crate::LabError;
use pictures::{LabelledPicture, PictureSet, read_set};
use score::{Scored, score};

/// Lowest threshold that the detector accepts. The detector merges boxes with scores of 0.1 and more, so the curves have
/// few boxes below.
const LEAST_SCORE: f64 = 0.05;

/// Options of the evaluation of the detector.
#[derive(Clone, Debug)]
pub struct DetectorOptions {
    /// Execution providers, so number formats, that are compared.
    pub providers: Vec<ProviderChoice>,
    /// Vehicles with a narrower box are ignored, px.
    pub min_width_px: f64,
    /// Number of pictures with the most errors to draw per set; 0 draws none.
    pub worst: usize,
}

/// Runs the detector on each set of pictures, and returns the tables.
///
/// An input is a JSON list of pictures with true boxes, the folder of a data set (`dataset.json`), or a folder of
/// pictures without vehicles.
///
/// # Errors
/// [`LabError`] if an input cannot be read, or if the net does not run.
pub fn evaluate_detector(
    inputs: &[PathBuf],
    models: &Path,
    config: &Config,
    options: &DetectorOptions,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let sets = inputs.iter().map(|input| read_set(input)).collect::<Result<Vec<_>, _>>()?;
    let runs = options.providers.len() * sets.iter().map(|set| set.pictures.len()).sum::<usize>();
    progress.expect(u64::try_from(runs).ok());
    let mut report = Report { title: "Detector".to_owned(), ..Report::default() };
    for set in &sets {
        let mut rows = Vec::new();
        for &provider in &options.providers {
            let (found, classes) = run(set, provider, models, config, options, cancel, progress)?;
            rows.push((name(provider), score(set, &found, &classes, options.min_width_px)));
        }
        report.tables.push(tables::curve_table(&set.name, &rows, config.detect.min_score));
        if let Some((_, first)) = rows.first() {
            report.tables.extend(tables::group_table(&set.name, set, first, config.detect.min_score));
            if options.worst > 0 {
                let caption = format!("{}: pictures with the most errors", set.name);
                if let Some(sheet) = worst_sheet(set, first, config, options.worst)? {
                    report.pictures.push(Picture::new(caption, &sheet)?);
                }
            }
        }
    }
    Ok(report)
}

fn name(provider: ProviderChoice) -> &'static str {
    match provider {
        ProviderChoice::Auto => "auto",
        ProviderChoice::Cpu => "f32",
        ProviderChoice::Int8 => "int8",
        ProviderChoice::Openvino => "bf16",
    }
}

/// Returns the detections of each picture, with low scores too, and the classes of the net.
fn run(
    set: &PictureSet,
    provider: ProviderChoice,
    models: &Path,
    config: &Config,
    options: &DetectorOptions,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<(Vec<Vec<CarRecord>>, Vec<VehicleClass>), LabError> {
    let mut config = config.clone();
    config.infer.provider = provider;
    config.detect.min_score = LEAST_SCORE;
    config.detect.min_width_px = config.detect.min_width_px.min(options.min_width_px);
    let mut detector = open_detector(models, &config)?;
    let mut all = Vec::with_capacity(set.pictures.len());
    for picture in &set.pictures {
        if let Some(signal) = cancel.signal() {
            return Err(PipelineError::Stopped { signal }.into());
        }
        let frame = read_picture(&picture.path, &config)?;
        all.push(detector.detect(&frame).map_err(PipelineError::from)?);
        progress.frame_done();
    }
    Ok((all, detector.classes().to_vec()))
}

fn read_picture(path: &Path, config: &Config) -> Result<Frame, LabError> {
    let frame = open_input(path, config)?.next_frame().map_err(PipelineError::from)?;
    frame.ok_or_else(|| LabError::malformed(path, "has no picture"))
}

/// Draws the pictures with the most errors at the product's threshold; `None` if no picture has errors.
fn worst_sheet(
    set: &PictureSet,
    scored: &Scored,
    config: &Config,
    count: usize,
) -> Result<Option<RgbImage>, LabError> {
    let errors = |i: &usize| {
        let (missed, wrong) = scored.errors(*i, config.detect.min_score);
        missed.len() + wrong.len()
    };
    let mut order: Vec<usize> = (0..set.pictures.len()).filter(|i| errors(i) > 0).collect();
    order.sort_by_key(|i| std::cmp::Reverse(errors(i)));
    let mut cases = Vec::new();
    for i in order.into_iter().take(count) {
        let picture: &LabelledPicture = &set.pictures[i];
        let frame = read_picture(&picture.path, config)?;
        let (missed, wrong) = scored.errors(i, config.detect.min_score);
        let file = picture.path.file_name().unwrap_or_default().to_string_lossy();
        cases.push(DetectionCase {
            picture: frame.image,
            title: format!("{file}: {} missed, {} false", missed.len(), wrong.len()),
            found: scored.found(i, config.detect.min_score),
            missed,
            wrong,
        });
    }
    if cases.is_empty() {
        return Ok(None);
    }
    Ok(Some(detection_sheet(&cases).map_err(PipelineError::from)?))
}
