//! Command `roadplane doctor`: checks that all parts needed for a run are installed and work.

use image::RgbImage;
use roadplane_activity::Motion;
use roadplane_base::{Frame, FrameStamp, ShapeAtlas};

use crate::stream::nets::{open_activity, open_detector, open_keypoints};
use crate::{Config, PipelineError, find_models};

/// Result of one check.
#[derive(Debug)]
pub struct Check {
    /// Name of the checked part.
    pub name: &'static str,
    /// A description of the part, or the error.
    pub result: Result<String, PipelineError>,
}

/// Checks the processor, OpenCV, ONNX Runtime, the shape atlas and the models, and runs each net once.
#[must_use]
pub fn check_up(config: &Config) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut note = |name, result| checks.push(Check { name, result });
    note("processor", Ok(processor()));
    note("opencv", Ok(format!("{} ({})", roadplane_decode::library_version(), roadplane_decode::backends())));
    let runtime = roadplane_infer::find_library(None)
        .and_then(|path| Ok(format!("{} at {}", roadplane_infer::runtime_version(None)?, path.display())));
    note("onnx runtime", runtime.map_err(PipelineError::from));
    let atlas = ShapeAtlas::shipped().map(|atlas| format!("version {}", atlas.version));
    note("shape atlas", atlas.map_err(PipelineError::from));
    match find_models(config.models.folder.as_deref()) {
        Err(error) => note("models", Err(error)),
        Ok(models) => {
            note("models", Ok(models.display().to_string()));
            let picture = Frame {
                stamp: FrameStamp { index: 0, pts_nanos: 0 },
                image: RgbImage::from_pixel(640, 360, image::Rgb([110, 110, 110])),
            };
            let detector = open_detector(&models, config).and_then(|mut detector| {
                let found = detector.detect(&picture)?.len();
                Ok(format!("{}; {found} cars in an empty picture", described(detector.session())))
            });
            note("detector", detector);
            let keypoints = open_keypoints(&models, config).and_then(|mut net| {
                let mut cars = vec![roadplane_base::CarRecord::boxed([200.0, 100.0, 300.0, 160.0])];
                net.locate(&picture, &mut cars)?;
                Ok(format!("{}; runs", described(net.session())))
            });
            note("keypoints", keypoints);
            let activity = open_activity(&models, config).and_then(|mut net| {
                let stationary =
                    Motion { time_s: vec![0.0, 1.0], xy_m: vec![[0.0; 2]; 2], ..Motion::default() };
                net.label(&stationary)?;
                Ok(format!("{}; runs", described(net.session())))
            });
            note("activity", activity);
        }
    }
    checks
}

fn described(session: &roadplane_infer::Session) -> String {
    let card = session.card();
    let hash = card.sha256.get(..12).unwrap_or_default();
    format!("{} {} (sha256 {hash}…) on {}", card.name, card.version_text(), session.provider())
}

fn processor() -> String {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let roadplane_infer::Processor { int8, bf16_matrices } = roadplane_infer::Processor::here();
    let has = |yes: bool, name: &str| format!("{}{name}", if yes { "" } else { "no " });
    format!("{cores} cores, {}, {}", has(int8, "VNNI (int8)"), has(bf16_matrices, "AMX (bf16)"))
}
