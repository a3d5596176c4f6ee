//! The joint problem of cars standing on the plane: parameters, cost, normal equations, step.

mod covariance;
mod step;

pub(crate) use covariance::Covariances;

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{MODES, Shape, ShapeAtlas};

use crate::arrow::{CAMERA, Gram, GroupBlock, PoseBlock, RESIDUAL, SHAPE, camera_system};
use crate::camera_knowledge::CameraKnowledge;
use crate::gram_sum::{Rows, WIDTH};
use crate::ground_residual::{CameraFrame, PointModes, Standing, StandingFrame};
use crate::ground_rows::{MAX_PACKS, NO_ROWS, Pack, linearise, pack, plain_rows, rewhiten};
use crate::kernel::{OutlierModel, PreparedKernel};
use crate::observation::{Observation, whiten_seen};
use crate::options::ShapePrior;

/// One view of a car.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Position of its group in the problem.
    pub group: usize,
    /// Its observations: a range in the problem's list.
    pub observations: std::ops::Range<usize>,
    /// The same as packs.
    packs: std::ops::Range<usize>,
}

impl View {
    pub fn new(group: usize, observations: std::ops::Range<usize>) -> Self {
        Self { group, observations, packs: 0..0 }
    }
}

/// A physical car: its views and what is known of its shape.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// Its views: a range in the problem's list.
    pub views: std::ops::Range<usize>,
    /// Mean and information of its shape.
    pub prior: ShapePrior,
}

/// Everything that is estimated.
#[derive(Clone, Debug)]
pub(crate) struct GroundState {
    pub camera: Vector4<f64>,
    pub standings: Vec<Standing>,
    pub shapes: Vec<Shape>,
}

/// See the module's head. `state` is current, `trial` the last step tried.
pub(crate) struct GroundProblem<'a> {
    atlas: &'a ShapeAtlas,
    model: &'a PointModes,
    pub views: Vec<View>,
    pub groups: Vec<Group>,
    pub observations: Vec<Observation>,
    pub knowledge: CameraKnowledge,
    pub kernel: OutlierModel,
    /// Factor on the information of shape priors.
    pub shape_prior_scale: f64,
    /// Shapes are held at their current values.
    pub shapes_fixed: bool,
    pub state: GroundState,
    trial: GroundState,
    /// Keypoints as the inner loop reads them.
    packs: Vec<Pack>,
    linearisation: Linearisation,
    trial_linearisation: Linearisation,
    scratch: Box<[Rows; MAX_PACKS]>,
    poses: Vec<PoseBlock>,
    group_blocks: Vec<GroupBlock>,
    camera_gradient: Vector4<f64>,
    camera_diagonal: Vector4<f64>,
}

/// Cost and every view's normal equations at a state.
#[derive(Clone, Debug)]
struct Linearisation {
    cost: f64,
    grams: Vec<Gram>,
}

/// One keypoint's whitened rows and residual, with the probability that it is right.
pub(crate) struct KeypointRows {
    /// Unknowns and residual, in the order of `ground_rows.rs`, times the root of the keypoint's weight.
    pub rows: [[f64; WIDTH]; 2],
    /// Its weight.
    pub weight: f64,
    /// ρ'.
    pub right: f64,
}

/// What a state costs by itself.
fn prior_cost(
    knowledge: &CameraKnowledge,
    groups: &[Group],
    shape_prior_scale: f64,
    state: &GroundState,
) -> f64 {
    let off = state.camera - knowledge.mean;
    let camera: f64 = (0..4)
        .filter(|i| knowledge.information[*i] > 0.0)
        .map(|i| 0.5 * knowledge.information[i] * off[i] * off[i])
        .sum();
    let shapes: f64 = groups.iter().zip(&state.shapes).map(|(group, shape)| group.prior.cost(shape)).sum();
    camera + shape_prior_scale * shapes
}

impl<'a> GroundProblem<'a> {
    /// `views`: per view its group's position and its observations; views of a group follow each other.
    pub fn new(
        atlas: &'a ShapeAtlas,
        model: &'a PointModes,
        views: Vec<View>,
        groups: Vec<Group>,
        observations: Vec<Observation>,
        knowledge: CameraKnowledge,
        state: GroundState,
    ) -> Self {
        let mut packs = Vec::with_capacity(observations.len() / 3);
        let mut views = views;
        for view in &mut views {
            let first = packs.len();
            pack(model, &observations[view.observations.clone()], &mut packs);
            view.packs = first..packs.len();
        }
        let linearisation = Linearisation { cost: f64::INFINITY, grams: vec![Gram::zeros(); views.len()] };
        Self {
            atlas,
            model,
            packs,
            trial_linearisation: linearisation.clone(),
            linearisation,
            scratch: Box::new([NO_ROWS; MAX_PACKS]),
            poses: vec![PoseBlock::zeros(); views.len()],
            group_blocks: vec![GroupBlock::zeros(); groups.len()],
            views,
            groups,
            observations,
            knowledge,
            kernel: OutlierModel::default(),
            shape_prior_scale: 1.0,
            shapes_fixed: false,
            trial: state.clone(),
            state,
            camera_gradient: Vector4::zeros(),
            camera_diagonal: Vector4::zeros(),
        }
    }

    /// Whitens every observation with its measured covariance, what the atlas leaves unexplained (`atlas_scale` × its sd)
    /// and `extra_m` metres in all directions, both seen at the current pose.
    pub fn whiten(&mut self, atlas_scale: f64, extra_m: f64) {
        let camera = CameraFrame::new(&self.state.camera);
        for (view, standing) in self.views.iter().zip(&self.state.standings) {
            let Some(frame) = StandingFrame::new(&camera, standing) else { continue };
            let extra_px = extra_m * camera.focal_px / frame.origin.z;
            let seen = &mut self.observations[view.observations.clone()];
            whiten_seen(seen, &frame, self.atlas, &self.atlas.residual_sd_m, atlas_scale, extra_px);
            rewhiten(seen, &mut self.packs[view.packs.clone()]);
        }
    }

    /// Bounds of the shape coefficients.
    pub fn shape_bounds(&self) -> [[f64; 2]; MODES] {
        self.atlas.bounds
    }

    /// Calls with the rows of every observation of a view. `None` when a keypoint cannot be projected.
    pub fn each_row(&self, view: usize, mut see: impl FnMut(KeypointRows)) -> Option<()> {
        let camera = CameraFrame::new(&self.state.camera);
        let frame = StandingFrame::new(&camera, &self.state.standings[view])?;
        let view = &self.views[view];
        let observations = &self.observations[view.observations.clone()];
        plain_rows(&self.packs[view.packs.clone()], &frame, &self.state.shapes[view.group], |i, rows| {
            let weight = observations[i].weight;
            let squared = (rows[0][RESIDUAL].powi(2) + rows[1][RESIDUAL].powi(2)) / weight;
            see(KeypointRows { rows: *rows, weight, right: self.kernel.weight(squared) });
        })
    }

    /// Calls with every observation of a view, its pixel residual (predicted − measured) and the square of the whitened one.
    /// `None` when a keypoint cannot be projected.
    pub fn each_residual(
        &self,
        view: usize,
        mut see: impl FnMut(&Observation, Vector2<f64>, f64),
    ) -> Option<()> {
        let camera = CameraFrame::new(&self.state.camera);
        let frame = StandingFrame::new(&camera, &self.state.standings[view])?;
        let shape = &self.state.shapes[self.views[view].group];
        for observation in &self.observations[self.views[view].observations.clone()] {
            let point = self.model.point(observation.index, shape);
            let off = frame.project(&point)? - observation.pixel;
            let [rx, ry] = observation.whiten([off.x, off.y]);
            see(observation, off, rx * rx + ry * ry);
        }
        Some(())
    }

    /// True cost of the current state (or the trial) and each view's normal equations; `None` when a keypoint cannot be
    /// projected.
    fn evaluate(&mut self, trial: bool) -> Option<f64> {
        let (state, into) = match trial {
            true => (&self.trial, &mut self.trial_linearisation),
            false => (&self.state, &mut self.linearisation),
        };
        let camera = CameraFrame::new(&state.camera);
        let kernel = PreparedKernel::new(&self.kernel);
        let mut cost = prior_cost(&self.knowledge, &self.groups, self.shape_prior_scale, state);
        for ((view, standing), gram) in self.views.iter().zip(&state.standings).zip(&mut into.grams) {
            let frame = StandingFrame::new(&camera, standing)?;
            let shape = &state.shapes[view.group];
            let packs = &self.packs[view.packs.clone()];
            cost += linearise(packs, &frame, shape, &kernel, &mut self.scratch, gram)?;
        }
        into.cost = cost;
        cost.is_finite().then_some(cost)
    }

    /// True cost at the current parameters.
    pub fn current_cost(&mut self) -> Option<f64> {
        self.evaluate(false)
    }

    /// Eliminates views and shapes; returns the camera's reduced Hessian and gradient, prior not yet added.
    fn eliminate(&mut self, damping: f64) -> Option<(Matrix4<f64>, Vector4<f64>)> {
        let mut camera = [[0.0; 16]; 4];
        for (g, group) in self.groups.iter().enumerate() {
            self.group_blocks[g].eliminate(
                &self.linearisation.grams[group.views.clone()],
                &mut self.poses[group.views.clone()],
                damping,
                &(group.prior.information * self.shape_prior_scale),
                &(group.prior.gradient(&self.state.shapes[g]) * self.shape_prior_scale),
                &mut camera,
            )?;
        }
        Some(camera_system(&camera))
    }

    /// Sums up gradient and diagonal of what views share, decides which coefficients are held; returns the largest scaled
    /// gradient.
    fn gather(&mut self) -> f64 {
        self.camera_gradient = self.knowledge.gradient(&self.state.camera);
        self.camera_diagonal = self.knowledge.information;
        let mut largest: f64 = 0.0;
        let mut see = |gradient: f64, diagonal: f64| {
            if diagonal > 0.0 {
                largest = largest.max(gradient * gradient / diagonal);
            }
        };
        for (g, group) in self.groups.iter().enumerate() {
            let shape = &self.state.shapes[g];
            let block = &mut self.group_blocks[g];
            block.gradient = group.prior.gradient(shape) * self.shape_prior_scale;
            block.diagonal = group.prior.information.diagonal() * self.shape_prior_scale;
            for view in &self.linearisation.grams[group.views.clone()] {
                for j in 0..MODES {
                    block.gradient[j] += view.gradient(SHAPE + j);
                    block.diagonal[j] += view.diagonal(SHAPE + j);
                }
                for i in 0..4 {
                    self.camera_gradient[i] += view.gradient(CAMERA + i);
                    self.camera_diagonal[i] += view.diagonal(CAMERA + i);
                }
                for i in 0..SHAPE {
                    see(view.gradient(i), view.diagonal(i));
                }
            }
            // Projected Newton (Bertsekas 1982): a coefficient at its bound that wants to go on is held.
            for j in 0..MODES {
                let [low, high] = self.atlas.bounds[j];
                let outward = (shape[j] <= low && block.gradient[j] > 0.0)
                    || (shape[j] >= high && block.gradient[j] < 0.0);
                block.held[j] = self.shapes_fixed || outward;
                if !block.held[j] {
                    see(block.gradient[j], block.diagonal[j]);
                }
            }
        }
        for i in (0..4).filter(|i| !self.knowledge.fixed[*i]) {
            see(self.camera_gradient[i], self.camera_diagonal[i]);
        }
        largest.sqrt()
    }
}
