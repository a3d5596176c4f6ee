//! `roadplane-lab eval solver` and `roadplane-lab eval camera-database`, on scenes with exact truth.
//!
//! They evaluate the joint solver, the effect of each of its steps, and cameras that are fused over many clips.

use crate::solver::{
    ablation_tables, camera_database_tables, exact_table, fusion_table, layers_tables, speed, speed_plot,
    speed_table, statistics_tables, synthetic_pictures,
};
use crate::{camera_pictures, dataset_pictures};
use roadplane_base::ShapeAtlas;
use roadplane_pipeline::{Cancel, PipelineError, find_models};
use roadplane_tables::Report;

use crate::args::eval::{EvalCameraDatabaseArgs, EvalSolverArgs};
use crate::commands::eval::show::show;
use roadplane_terminal::Outcome;

/// Number of frames that are fused into one camera.
const FRAMES: usize = 100;
/// Numbers of cars for which the time of a solve is measured.
const CARS: [usize; 9] = [1, 3, 5, 10, 20, 50, 100, 200, 300];

/// Prints the tables of the solver's accuracy and speed, or the tables that the options select.
pub fn solver(args: &EvalSolverArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let settings = &args.config;
    if !args.layers && (settings.config.is_some() || !settings.settings.is_empty()) {
        return Err(PipelineError::usage(
            "--config and --set are for --layers: the statistics are of the solver's own defaults",
        )
        .into());
    }
    let report = match (args.layers, args.fused) {
        (true, _) => layers(args, cancel)?,
        (_, true) => fused(args)?,
        _ => statistics(args)?,
    };
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}

fn statistics(args: &EvalSolverArgs) -> anyhow::Result<Report> {
    let atlas = ShapeAtlas::shipped()?;
    let scenes = args.scenes as usize;
    let mut tables = vec![exact_table(&atlas, 5 * scenes)];
    tables.extend(statistics_tables(&atlas, scenes));
    tables.extend(ablation_tables(&atlas, scenes));
    tables.push(fusion_table(&atlas, scenes.div_ceil(4), FRAMES));
    let points = speed(&atlas, &CARS);
    tables.push(speed_table(&points));
    let title = "The joint solver on scenes with exact truth".to_owned();
    Ok(Report { title, tables, plots: vec![speed_plot(&points)], ..Report::default() })
}

fn fused(args: &EvalSolverArgs) -> anyhow::Result<Report> {
    let tables = vec![fusion_table(&ShapeAtlas::shipped()?, (args.scenes as usize).div_ceil(4), FRAMES)];
    Ok(Report { title: "Frames of one camera, fused".to_owned(), tables, ..Report::default() })
}

fn layers(args: &EvalSolverArgs, cancel: &Cancel) -> anyhow::Result<Report> {
    let config = args.config.load()?;
    let atlas = ShapeAtlas::shipped()?;
    let mut sources = synthetic_pictures(&atlas, args.scenes as usize);
    if args.dataset.is_some() || args.cameras.is_some() {
        let models = find_models(config.models.folder.as_deref())?;
        if let Some(folder) = &args.dataset {
            sources.push(("rendered".to_owned(), dataset_pictures(folder, &models, &config, cancel)?));
        }
        if let Some(file) = &args.cameras {
            sources.push(("real cameras".to_owned(), camera_pictures(file, &models, &config, cancel)?));
        }
    }
    let tables = layers_tables(&atlas, &sources, &config.solve.scene_options(None));
    Ok(Report { title: "Worth of each step of the solve".to_owned(), tables, ..Report::default() })
}

/// Prints the table of stored cameras.
pub fn camera_database(args: &EvalCameraDatabaseArgs) -> anyhow::Result<Outcome> {
    let atlas = ShapeAtlas::shipped()?;
    let tables = camera_database_tables(&atlas, args.cameras as usize, args.clips as usize);
    let title = "Stored cameras on clips with exact truth".to_owned();
    show(&Report { title, tables, ..Report::default() }, args.out.as_deref())?;
    Ok(Outcome::Done)
}
