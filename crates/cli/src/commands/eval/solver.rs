//! `roadplane eval solver`: the joint solver on scenes with exact truth.

use roadplane_base::ShapeAtlas;
use roadplane_eval::Report;
use roadplane_eval::solver::{
    ablation_tables, exact_table, fusion_table, remembered_tables, speed, speed_plot, speed_table,
    statistics_tables,
};

use crate::Outcome;
use crate::args::eval::{EvalCamerasArgs, EvalSolverArgs};

/// Frames that are fused.
const FRAMES: usize = 100;
/// Numbers of cars whose solves are timed.
const CARS: [usize; 9] = [1, 3, 5, 10, 20, 50, 100, 200, 300];

/// Prints the tables.
pub fn solver(args: &EvalSolverArgs) -> anyhow::Result<Outcome> {
    let atlas = ShapeAtlas::shipped()?;
    let scenes = args.scenes as usize;
    let mut tables = vec![exact_table(&atlas, 5 * scenes)];
    tables.extend(statistics_tables(&atlas, scenes));
    tables.extend(ablation_tables(&atlas, scenes));
    tables.push(fusion_table(&atlas, FRAMES));
    let points = speed(&atlas, &CARS);
    tables.push(speed_table(&points));
    let title = "The joint solver on scenes with exact truth".to_owned();
    super::show(&Report { title, tables, plots: vec![speed_plot(&points)] }, args.out.as_deref())?;
    Ok(Outcome::Done)
}

/// Prints the table of remembered cameras.
pub fn cameras(args: &EvalCamerasArgs) -> anyhow::Result<Outcome> {
    let atlas = ShapeAtlas::shipped()?;
    let tables = remembered_tables(&atlas, args.cameras as usize, args.clips as usize);
    let title = "Remembered cameras on clips with exact truth".to_owned();
    super::show(&Report { title, tables, plots: Vec::new() }, args.out.as_deref())?;
    Ok(Outcome::Done)
}
