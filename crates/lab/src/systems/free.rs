//! Row 3 of the tables: our solver, where each car's pose has six degrees of freedom (paper §3.1, Eq. 2).

use roadplane_base::ShapeAtlas;
use roadplane_pipeline::Config;
use roadplane_solve::{CarView, solve_free_scene};

use super::answer::{CarAnswer, FrameAnswer, FrameInput};

pub(super) fn solve(atlas: &ShapeAtlas, input: &FrameInput<'_>, config: &Config) -> FrameAnswer {
    let options = config.solve.scene_options(Some(input.focal_px));
    let solution = solve_free_scene(atlas, input.size, &CarView::each(input.cars), None, &options);
    let answer = |car: &Option<roadplane_solve::FreeCarFit>| {
        car.as_ref().map(|car| CarAnswer { camera_from_car: car.camera_from_car, shape: car.shape })
    };
    FrameAnswer { cars: solution.cars.iter().map(answer).collect(), camera: None }
}
