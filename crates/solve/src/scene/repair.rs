//! Second thoughts about single cars before a camera that is about right: another heading, a shape on another path, left and
//! right confused by the keypoint net; and whether what was called a car is one.

use nalgebra::Vector4;
use roadplane_base::Shape;

use crate::model::ground::CameraFrame;
use crate::model::observation::Observation;
use crate::options::SceneOptions;
use crate::problem::ground::GroundProblem;
use crate::problem::setup::{MIN_KEYPOINTS, Placed, Setup, cost_of_missing};
use crate::scene::approach::{SHAPE_STAGES, SLOW_STAGES, approach_by};
use crate::start::standing::{rough_cost, standing_candidates};

/// Other headings that are tried.
const OTHER_HEADINGS: usize = 3;
/// A heading whose rough cost exceeds the current one's by this is not followed.
const HOPELESS: f64 = 12.0;
/// Cost per keypoint above which a car is tried once more (a right keypoint costs 1 on average, less what the fit takes up).
const SUSPICIOUS: f64 = 1.0;
/// Another heading must be better by this much to be taken.
const SWITCH_GAIN: f64 = 0.5;
/// Labels with left and right exchanged must be better by this much: more than one keypoint can cost.
const MIRROR_GAIN: f64 = 10.0;

/// Fits every car anew, from its pose and from other ideas of it. True when one came out better.
pub(crate) fn repair(setup: &mut Setup<'_>, camera: &Vector4<f64>, placed: &mut [Option<Placed>]) -> bool {
    let mut repaired = false;
    for (s, place) in placed.iter_mut().enumerate() {
        let attempt = Attempt { setup, camera, observations: &setup.sights[s].observations };
        let Some(better) = better(&attempt, *place) else { continue };
        *place = Some(better.place);
        if better.mirrored {
            setup.sights[s].observations.iter_mut().for_each(Observation::mirror);
        }
        repaired = true;
    }
    repaired
}

struct Better {
    place: Placed,
    mirrored: bool,
}

/// A car's keypoints before a camera.
struct Attempt<'s, 'a> {
    setup: &'s Setup<'a>,
    camera: &'s Vector4<f64>,
    observations: &'s [Observation],
}

impl Attempt<'_, '_> {
    /// Cost of a place as it is.
    fn cost(&self, place: Placed) -> Option<f64> {
        let mut problem = self.setup.problem_alone(*self.camera, self.observations, place);
        problem.whiten(self.setup.options.atlas_residual_scale, 0.0);
        problem.current_cost()
    }

    /// Minimum that stages lead to from a standing place, if it lies below `bar`.
    fn below(&self, bar: f64, place: Placed, stages: &[(f64, f64)]) -> Option<(f64, Placed)> {
        let start = Placed { shape: Shape::zeros(), ..place };
        let mut problem = self.setup.problem_alone(*self.camera, self.observations, start);
        approach_by(&mut problem, self.setup.options, stages);
        let cost = problem.current_cost()?;
        let place = Placed { standing: problem.state.standings[0], shape: problem.state.shapes[0] };
        (cost < bar).then_some((cost, place))
    }

    /// Places in closed form with their rough costs.
    fn candidates(&self, shape: &Shape) -> Vec<(f64, Placed)> {
        let points = self.setup.atlas.keypoints_in_car(shape);
        let frame = CameraFrame::new(self.camera);
        let found = standing_candidates(&frame, &points, self.observations, OTHER_HEADINGS);
        found.into_iter().map(|(cost, standing)| (cost, Placed { standing, shape: *shape })).collect()
    }
}

fn better(attempt: &Attempt<'_, '_>, place: Option<Placed>) -> Option<Better> {
    let setup = attempt.setup;
    let shape = place.map_or_else(Shape::zeros, |place| place.shape);
    let current = place.and_then(|place| attempt.cost(place)).unwrap_or(f64::INFINITY);
    let rough = place.and_then(|place| {
        let points = setup.atlas.keypoints_in_car(&shape);
        rough_cost(&CameraFrame::new(attempt.camera), &points, attempt.observations, &place.standing)
    });
    let hopeless = rough.unwrap_or(f64::INFINITY) + HOPELESS;
    let steps = setup.options.steps;
    let others =
        attempt.candidates(&shape).into_iter().filter(|(cost, _)| steps.other_headings && *cost < hopeless);
    let mut lowest = (current, place);
    for start in place.into_iter().chain(others.map(|(_, place)| place)) {
        if let Some((cost, place)) = attempt.below(lowest.0 - SWITCH_GAIN, start, &SHAPE_STAGES) {
            lowest = (cost, Some(place));
        }
    }
    // Above what right keypoints cost there may be a better shape on another path.
    let expected: f64 = attempt.observations.iter().map(|o| o.weight).sum();
    let suspicious = |cost: f64| cost > SUSPICIOUS * expected;
    if let Some(start) = lowest.1.filter(|_| steps.slow_stages && suspicious(lowest.0))
        && let Some((cost, place)) = attempt.below(lowest.0 - SWITCH_GAIN, start, &SLOW_STAGES)
    {
        lowest = (cost, Some(place));
    }
    let mut mirrored = false;
    if steps.exchanged_sides && suspicious(lowest.0) {
        let mut observations = attempt.observations.to_vec();
        observations.iter_mut().for_each(Observation::mirror);
        let exchanged = Attempt { observations: &observations, ..*attempt };
        for (_, start) in exchanged.candidates(&Shape::zeros()) {
            let gain = if mirrored { SWITCH_GAIN } else { MIRROR_GAIN };
            if let Some((cost, place)) = exchanged.below(lowest.0 - gain, start, &SHAPE_STAGES) {
                lowest = (cost, Some(place));
                mirrored = true;
            }
        }
    }
    let place = lowest.1.filter(|_| lowest.0 < current)?;
    Some(Better { place, mirrored })
}

/// Whether a view is of a car on this plane: enough of its keypoints fit, and they fit well enough with a shape that is
/// likely enough to explain much more than "all keypoints are wrong" does.
pub(crate) fn belongs(problem: &GroundProblem<'_>, k: usize, options: &SceneOptions) -> bool {
    let (mut right, mut all, mut count) = (0.0, 0.0, 0);
    let group = problem.views[k].group;
    let mut cost = problem.groups[group].prior.cost(&problem.state.shapes[group]);
    let seen = problem.each_residual(k, |observation, _, squared| {
        let probability = options.kernel.weight(squared);
        right += observation.weight * probability;
        all += observation.weight;
        count += usize::from(probability > 0.5);
        cost += 0.5 * observation.weight * options.kernel.cost(squared);
    });
    seen.is_some()
        && count >= options.min_inliers.min(MIN_KEYPOINTS + 1)
        && right >= options.min_inlier_share * all
        && cost <= options.max_cost_share * cost_of_missing(&options.kernel, all)
}
