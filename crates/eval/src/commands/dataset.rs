//! The paper's tables on a data set: every system on the same keypoints, those of our net and true ones with noise.

mod boxes;
mod clips;
mod evidence;
mod pictures;
mod real;
mod score;
mod tables;

use std::path::{Path, PathBuf};

use roadplane_base::ShapeAtlas;
use roadplane_detect::Detector;
use roadplane_keypoints::KeypointNet;
use roadplane_pipeline::{Cancel, Config, PipelineError, Progress, open_detector, open_keypoints};

use crate::EvalError;
use crate::parallel::{in_parallel, try_in_parallel};
use crate::systems::System;
use crate::tables::boxes_table;
use crate::truth::{Kind, Truth, read_dataset, read_truth};
use crate::workplace::Workplace;
pub use pictures::{camera_pictures, dataset_pictures};
use roadplane_tables::Report;

use evidence::SceneEvidence;
pub(crate) use evidence::noisy_keypoints;
use score::SystemScore;

/// Frames of a clip that the systems for single frames solve, at most: its cars stay much the same, and stills should
/// outweigh them.
const FRAMES_OF_CLIP: usize = 5;

/// What is evaluated, and how.
#[derive(Clone, Debug)]
pub struct DatasetOptions {
    /// Share of the items; 0.1 takes every tenth.
    pub part: f64,
    /// Keypoints of our net, in the true boxes.
    pub net: bool,
    /// True keypoints with noise of this sd as a share of the box's longer side.
    pub noise: Option<f64>,
    /// Every n-th frame of a clip is looked at.
    pub stride: u32,
    /// Folder of real stills with calibrated cameras beside them (`NAME.png` or `.jpg`, `NAME.krtd`).
    pub real: Option<PathBuf>,
    /// Folder of the models.
    pub models: PathBuf,
    /// Where finished runs of clips stay; without it they are thrown away. As many run at once as there are cores, so their
    /// `summary.json` says less than their speed alone.
    pub runs: Option<PathBuf>,
}

/// An item with its truth.
struct Item {
    name: String,
    path: PathBuf,
    truth: Truth,
}

/// Evaluates all systems on a data set's folder.
///
/// # Errors
/// [`EvalError`] for files that cannot be read, nets that fail, or a stop.
pub fn evaluate_dataset(
    folder: &Path,
    options: &DatasetOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, EvalError> {
    let dataset = read_dataset(folder)?;
    let atlas = ShapeAtlas::shipped().map_err(PipelineError::from)?;
    let mut config = config.clone();
    config.decode.stride = options.stride.max(1);
    let step = (1.0 / options.part.clamp(1e-6, 1.0)).round() as usize;
    let items: Vec<Item> =
        dataset.items.iter().step_by(step).map(|path| item(path)).collect::<Result<_, _>>()?;
    let workplace = Workplace::new(options.runs.as_deref())?;
    let stills: Vec<&Item> = items.iter().filter(|item| item.truth.kind == Kind::Still).collect();
    let real = options.real.as_deref().map_or(Ok(Vec::new()), real::list)?;
    let looks = if options.net { items.len() } else { 0 };
    progress.expect(Some((looks + items.len() + real.len()) as u64));
    let title = format!("Data set {} ({} of {} items)", dataset.name, items.len(), dataset.items.len());
    let mut report = Report { title, ..Report::default() };

    if options.net {
        progress.phase("keypoints");
        let open = || open_keypoints(&options.models, &config).map_err(EvalError::from);
        let found = |net: &mut KeypointNet, i: usize| {
            stopped(cancel)?;
            let scene = evidence::from_net(&items[i].truth, &items[i].path, net, &config)?;
            progress.frame_done();
            Ok(scene)
        };
        let scenes: Vec<SceneEvidence> = try_in_parallel(items.len(), open, found)?;
        let what = "the net's keypoints";
        tables_of(&mut report, what, &items, &scenes, &atlas, &config, cancel, progress)?;
    }
    if let Some(noise) = options.noise {
        let seed = |i: usize| dataset.seed.wrapping_mul(1_000_003).wrapping_add(i as u64);
        let scenes: Vec<SceneEvidence> = items
            .iter()
            .enumerate()
            .map(|(i, item)| evidence::from_truth(&item.truth, noise, seed(i), options.stride))
            .collect();
        let what = format!("true keypoints, noise {:.1} %", 100.0 * noise);
        tables_of(&mut report, &what, &items, &scenes, &atlas, &config, cancel, progress)?;
    }
    progress.phase("boxes");
    if stills.iter().any(|item| item.truth.media.is_some()) {
        let open = || open_detector(&options.models, &config).map_err(EvalError::from);
        let found = |detector: &mut Detector, i: usize| {
            stopped(cancel)?;
            let boxes = boxes::detect(&stills[i].truth, detector, &config)?;
            progress.frame_done();
            Ok(boxes.into_iter().collect::<Vec<_>>())
        };
        let scenes = try_in_parallel(stills.len(), open, found)?;
        report.tables.push(boxes_table("Detector on the stills", &[("detector", &scenes)]));
    }
    progress.phase("runs");
    let runs = clips::run_all(&items, &atlas, &workplace, options, &config, cancel, progress)?;
    tables::add_runs(&mut report, &runs);
    if options.real.is_some() {
        progress.phase("real stills");
        let rows = real::evaluate(&real, &workplace, options, &config, cancel, progress)?;
        report.tables.push(real::table(&rows));
    }
    Ok(report)
}

fn item(path: &Path) -> Result<Item, EvalError> {
    Ok(Item { name: item_name(path), path: path.to_path_buf(), truth: read_truth(path)? })
}

/// `clip_0000` of `scenes/clip_0000.truth.json.gz`.
fn item_name(truth: &Path) -> String {
    let name = truth.file_name().unwrap_or(truth.as_os_str()).to_string_lossy();
    let plain = name.strip_suffix(".gz").unwrap_or(&name);
    plain.strip_suffix(".truth.json").unwrap_or(plain).to_owned()
}

fn stopped(cancel: &Cancel) -> Result<(), EvalError> {
    cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }.into()))
}

/// All systems on one kind of keypoints; adds the tables.
#[expect(clippy::too_many_arguments)]
fn tables_of(
    report: &mut Report,
    what: &str,
    items: &[Item],
    scenes: &[SceneEvidence],
    atlas: &ShapeAtlas,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<(), EvalError> {
    progress.phase("solving");
    let solved = in_parallel(items.len(), |i| {
        let (truth, scene) = (&items[i].truth, &scenes[i]);
        let sampled = scene.sample(FRAMES_OF_CLIP);
        System::ALL.map(|system| {
            if cancel.is_stopped() {
                SystemScore::default()
            } else {
                score::score(system, truth, scene, &sampled, atlas, config)
            }
        })
    });
    stopped(cancel)?;
    let of = |k: usize, clips_only: bool| -> Vec<SystemScore> {
        let chosen =
            items.iter().zip(&solved).filter(|(item, _)| !clips_only || item.truth.kind == Kind::Clip);
        chosen.map(|(_, scores)| scores[k].clone()).collect()
    };
    let named = |clips_only: bool| -> Vec<(System, Vec<SystemScore>)> {
        System::ALL.iter().enumerate().map(|(k, system)| (*system, of(k, clips_only))).collect()
    };
    tables::add_single_frames(report, what, &named(false));
    let clips: Vec<(&Item, &SceneEvidence)> =
        items.iter().zip(scenes).filter(|(item, _)| item.truth.kind == Kind::Clip).collect();
    let fuse = |(): &mut (), i: usize| {
        let (item, scene) = clips[i];
        clips::fused(item, scene, FRAMES_OF_CLIP, atlas, config, cancel)
    };
    let fused = try_in_parallel(clips.len(), || Ok(()), fuse)?;
    if !fused.is_empty() {
        tables::add_clips(report, what, &named(true), &fused);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_named_by_their_truth_files() {
        for file in ["clip_0001.truth.json.gz", "clip_0001.truth.json", "clip_0001"] {
            assert_eq!(item_name(&Path::new("scenes").join(file)), "clip_0001");
        }
    }
}
