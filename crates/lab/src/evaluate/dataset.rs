//! The tables of the paper *Car Pose in Context* on a data set.
//!
//! Every system solves the same keypoints: those of our net, and then the true keypoints with noise.

mod boxes;
mod clips;
mod evidence;
mod items;
mod pictures;
mod real;
mod score;
mod tables;

use std::path::Path;

use roadplane_base::ShapeAtlas;
use roadplane_detect::Detector;
use roadplane_keypoints::KeypointNet;
use roadplane_pipeline::{Cancel, Config, PipelineError, Progress, open_detector, open_keypoints};
use roadplane_tables::Report;

use crate::LabError;
use crate::parallel::{in_parallel, try_in_parallel};
use crate::systems::System;
use crate::tables::boxes_table;
use crate::work::{of_simulated_keypoints, stopped};
use crate::workplace::Workplace;
use roadplane_metrics::truth::{Kind, read_dataset};

pub(crate) use evidence::noisy_keypoints;
pub use items::DatasetOptions;
pub use pictures::{camera_pictures, dataset_pictures};

use evidence::SceneEvidence;
use items::{FRAMES_OF_CLIP, Item, item};
use score::SystemScore;

/// Evaluates all systems, the detector and runs from video on a data set with truth.
///
/// # Errors
/// [`LabError`] if a file cannot be read, a net fails, or the user stops the work.
pub fn evaluate_dataset(
    folder: &Path,
    options: &DatasetOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
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
    let predicted = if options.net { items.len() } else { 0 };
    progress.expect(Some((predicted + items.len() + real.len()) as u64));
    let title = format!("Data set {} ({} of {} items)", dataset.name, items.len(), dataset.items.len());
    let mut report = Report { title, ..Report::default() };

    if options.net {
        progress.phase("keypoints");
        let open = || open_keypoints(&options.models, &config).map_err(LabError::from);
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
        let config = of_simulated_keypoints(&config);
        tables_of(&mut report, &what, &items, &scenes, &atlas, &config, cancel, progress)?;
    }
    progress.phase("boxes");
    if stills.iter().any(|item| item.truth.media.is_some()) {
        let open = || open_detector(&options.models, &config).map_err(LabError::from);
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

/// Runs all systems on one kind of keypoints, and adds the tables to the report. `what` names the kind in the titles.
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
) -> Result<(), LabError> {
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
