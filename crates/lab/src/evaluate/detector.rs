//! Evaluates the detector on pictures with true boxes, on data sets with truth, and on pictures without vehicles.

mod pictures;
mod score;
mod tables;

use std::path::{Path, PathBuf};

use image::RgbImage;
use roadplane_base::CarRecord;
use roadplane_detect::Detector;
use roadplane_infer::ProviderChoice;
use roadplane_pipeline::{Cancel, Config, PipelineError, Progress, open_detector};
use roadplane_tables::{Picture, Report};
use roadplane_view::{DetectionCase, detection_sheet};

use crate::LabError;
use crate::work::{read_picture, stopped};
use pictures::{LabelledPicture, PictureSet, read_set};
use score::{Scored, score};

/// Lowest threshold that the detector accepts. The detector merges boxes with scores of 0.1 and more, so the curves have
/// few boxes below.
const LEAST_SCORE: f64 = 0.05;

/// Options of the evaluation of the detector.
#[derive(Clone, Debug)]
pub struct DetectorOptions {
    /// Number formats that are compared: name and execution provider.
    pub formats: Vec<(&'static str, ProviderChoice)>,
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
    let runs = options.formats.len() * sets.iter().map(|set| set.pictures.len()).sum::<usize>();
    progress.expect(u64::try_from(runs).ok());
    let mut detectors = Vec::new();
    for (format, provider) in &options.formats {
        let mut config = config.clone();
        config.infer.provider = *provider;
        config.detect.min_score = LEAST_SCORE;
        config.detect.min_width_px = config.detect.min_width_px.min(options.min_width_px);
        detectors.push((*format, open_detector(models, &config)?));
    }
    let mut report = Report { title: "Detector".to_owned(), ..Report::default() };
    for set in &sets {
        let mut rows = Vec::new();
        for (format, detector) in &mut detectors {
            let found = run(set, detector, config, cancel, progress)?;
            rows.push((*format, score(set, &found, detector.classes(), options.min_width_px)));
        }
        report.tables.push(tables::curve_table(&set.name, &rows, config.detect.min_score));
        if let Some((_, first)) = rows.first() {
            report.tables.extend(tables::group_table(&set.name, set, first, config.detect.min_score));
            if let Some(sheet) = worst_sheet(set, first, config, options.worst)? {
                let caption = format!("{}: pictures with the most errors", set.name);
                report.pictures.push(Picture::new(caption, &sheet)?);
            }
        }
    }
    Ok(report)
}

/// Returns the detections of each picture, with low scores too.
fn run(
    set: &PictureSet,
    detector: &mut Detector,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Vec<Vec<CarRecord>>, LabError> {
    let mut all = Vec::with_capacity(set.pictures.len());
    for picture in &set.pictures {
        stopped(cancel)?;
        let frame = read_picture(&picture.path, config)?;
        all.push(detector.detect(&frame).map_err(PipelineError::from)?);
        progress.frame_done();
    }
    Ok(all)
}

/// Draws at most `count` pictures, those with the most errors at the product's threshold first. `None` if there is
/// nothing to draw.
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
