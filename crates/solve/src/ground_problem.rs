//! The joint problem of cars standing on the plane: parameters, cost, normal equations, step.

use nalgebra::{Matrix4, SMatrix, Vector2, Vector4};
use roadplane_base::{MODES, Shape, ShapeAtlas};

use crate::arrow::{GroupBlock, ViewBlock};
use crate::ground_residual::{COLUMNS, CameraFrame, PointModes, Standing, StandingFrame};
use crate::kernel::{OutlierModel, PreparedKernel};
use crate::lm::{Problem, Trial};
use crate::observation::{Observation, atlas_covariance};
use crate::options::ShapePrior;

/// One view of a car.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Position of its group in the problem.
    pub group: usize,
    /// Its observations: a range in the problem's list.
    pub observations: std::ops::Range<usize>,
}

/// A physical car: its views and what is known of its shape.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// Its views: a range in the problem's list.
    pub views: std::ops::Range<usize>,
    /// Mean and information of its shape.
    pub prior: ShapePrior,
}

/// What is known of the camera beforehand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraKnowledge {
    /// Mean of the prior.
    pub mean: Vector4<f64>,
    /// Information (1/sd²) per parameter; 0 where nothing is known.
    pub information: Vector4<f64>,
    /// Parameters that are not estimated.
    pub fixed: [bool; 4],
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
    view_blocks: Vec<ViewBlock>,
    group_blocks: Vec<GroupBlock>,
    camera_gradient: Vector4<f64>,
    camera_diagonal: Vector4<f64>,
    cost: f64,
}

/// Covariances at the current parameters.
pub(crate) struct Covariances {
    /// Information on the camera from the cars alone, without the camera prior.
    pub camera_information: Matrix4<f64>,
    /// Covariance of the camera, prior counted; zero rows where fixed.
    pub camera: Matrix4<f64>,
    /// Per view the covariance of (camera, shape, anchor, heading).
    pub views: Vec<SMatrix<f64, COLUMNS, COLUMNS>>,
}

impl<'a> GroundProblem<'a> {
    pub fn new(
        atlas: &'a ShapeAtlas,
        model: &'a PointModes,
        views: Vec<View>,
        groups: Vec<Group>,
        observations: Vec<Observation>,
        knowledge: CameraKnowledge,
        state: GroundState,
    ) -> Self {
        Self {
            atlas,
            model,
            view_blocks: vec![ViewBlock::zeros(); views.len()],
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
            cost: f64::INFINITY,
        }
    }

    /// Whitens every observation with its measured covariance, what the atlas leaves unexplained (`atlas_scale` × its sd)
    /// and `extra_m` metres in all directions, both seen at the current pose.
    pub fn whiten(&mut self, atlas_scale: f64, extra_m: f64) {
        let camera = CameraFrame::new(&self.state.camera);
        for (view, standing) in self.views.iter().zip(&self.state.standings) {
            let Some(frame) = StandingFrame::new(&camera, standing) else { continue };
            let extra_px = extra_m * camera.focal_px / frame.origin.z;
            for observation in &mut self.observations[view.observations.clone()] {
                let mut extra =
                    atlas_covariance(self.atlas, &frame, camera.focal_px, observation.index, atlas_scale);
                extra[(0, 0)] += extra_px * extra_px;
                extra[(1, 1)] += extra_px * extra_px;
                observation.whiten_with(&extra);
            }
        }
    }

    /// Pixel residual (predicted − measured) of one observation at the current parameters.
    pub fn residual_px(&self, view: usize, observation: &Observation) -> Option<Vector2<f64>> {
        let camera = CameraFrame::new(&self.state.camera);
        let frame = StandingFrame::new(&camera, &self.state.standings[view])?;
        let point = self.model.point(observation.index, &self.state.shapes[self.views[view].group]);
        Some(frame.project(camera.focal_px, &point)? - observation.pixel)
    }

    fn cost_of_view(
        &self,
        camera: &CameraFrame,
        view: &View,
        standing: &Standing,
        shape: &Shape,
    ) -> Option<f64> {
        let frame = StandingFrame::new(camera, standing)?;
        let kernel = PreparedKernel::new(&self.kernel);
        let mut cost = 0.0;
        for observation in &self.observations[view.observations.clone()] {
            let point = self.model.point(observation.index, shape);
            let residual = frame.project(camera.focal_px, &point)? - observation.pixel;
            let [rx, ry] = observation.whiten([residual.x, residual.y]);
            cost += 0.5 * observation.weight * kernel.evaluate(rx * rx + ry * ry).0;
        }
        Some(cost)
    }

    fn prior_cost(&self, state: &GroundState) -> f64 {
        let off = state.camera - self.knowledge.mean;
        let camera: f64 = (0..4)
            .filter(|i| self.knowledge.information[*i] > 0.0)
            .map(|i| 0.5 * self.knowledge.information[i] * off[i] * off[i])
            .sum();
        let shapes: f64 =
            self.groups.iter().zip(&state.shapes).map(|(group, shape)| group.prior.cost(shape)).sum();
        camera + self.shape_prior_scale * shapes
    }

    /// True cost of a state; `None` when a keypoint cannot be projected.
    pub fn cost_of(&self, state: &GroundState) -> Option<f64> {
        let camera = CameraFrame::new(&state.camera);
        let mut cost = self.prior_cost(state);
        for (view, standing) in self.views.iter().zip(&state.standings) {
            cost += self.cost_of_view(&camera, view, standing, &state.shapes[view.group])?;
        }
        cost.is_finite().then_some(cost)
    }

    /// Adds one view's keypoints to its block; returns their cost.
    fn linearise_view(&mut self, camera: &CameraFrame, k: usize) -> Option<f64> {
        let kernel = PreparedKernel::new(&self.kernel);
        let view = &self.views[k];
        let block = &mut self.view_blocks[k];
        block.clear();
        let frame = StandingFrame::new(camera, &self.state.standings[k])?;
        let shape = &self.state.shapes[view.group];
        let mut cost = 0.0;
        for observation in &self.observations[view.observations.clone()] {
            let modes = &self.model.modes[observation.index];
            let point = self.model.point(observation.index, shape);
            let (pixel, rows) = frame.project_with_jacobian(camera.focal_px, &point, modes)?;
            let residual = pixel - observation.pixel;
            let [rx, ry] = observation.whiten([residual.x, residual.y]);
            let squared = rx * rx + ry * ry;
            let (loss, right) = kernel.evaluate(squared);
            cost += 0.5 * observation.weight * loss;
            let weight = observation.weight * right;
            if weight < 1e-12 {
                continue;
            }
            let [w00, w10, w11] = observation.whitening;
            let whitened = [
                std::array::from_fn(|i| w00 * rows[0][i]),
                std::array::from_fn(|i| w10 * rows[0][i] + w11 * rows[1][i]),
            ];
            block.add(&whitened, [rx, ry], weight);
        }
        Some(cost)
    }

    /// Eliminates views and shapes; returns the camera's reduced Hessian and gradient, prior not yet added.
    fn eliminate(&mut self, damping: f64) -> Option<(Matrix4<f64>, Vector4<f64>)> {
        let mut hessian = Matrix4::zeros();
        let mut gradient = Vector4::zeros();
        for (g, group) in self.groups.iter().enumerate() {
            self.group_blocks[g].eliminate(
                &mut self.view_blocks[group.views.clone()],
                damping,
                &(group.prior.information * self.shape_prior_scale),
                &(group.prior.gradient(&self.state.shapes[g]) * self.shape_prior_scale),
                &mut hessian,
                &mut gradient,
            )?;
        }
        Some((hessian, gradient))
    }

    fn hold_fixed(&self, hessian: &mut Matrix4<f64>, gradient: &mut Vector4<f64>) {
        for i in (0..4).filter(|i| self.knowledge.fixed[*i]) {
            hessian.row_mut(i).fill(0.0);
            hessian.column_mut(i).fill(0.0);
            hessian[(i, i)] = 1.0;
            gradient[i] = 0.0;
        }
    }

    fn prior_gradient(&self) -> Vector4<f64> {
        (self.state.camera - self.knowledge.mean).component_mul(&self.knowledge.information)
    }

    /// Covariances at the current parameters, from the same elimination with damping 0. Call after `linearise`.
    pub fn covariances(&mut self) -> Option<Covariances> {
        let (information, _) = self.eliminate(0.0)?;
        let mut total = information + Matrix4::from_diagonal(&self.knowledge.information);
        self.hold_fixed(&mut total, &mut Vector4::zeros());
        let mut camera = total.cholesky()?.inverse();
        for i in (0..4).filter(|i| self.knowledge.fixed[*i]) {
            camera[(i, i)] = 0.0;
        }
        let shared: Vec<_> = self.group_blocks.iter().map(|block| block.shared_covariance(&camera)).collect();
        let views = self
            .views
            .iter()
            .zip(&self.view_blocks)
            .map(|(view, block)| block.joint_covariance(&shared[view.group]))
            .collect();
        Some(Covariances { camera_information: information, camera, views })
    }
}

impl Problem for GroundProblem<'_> {
    fn linearise(&mut self) -> Option<f64> {
        let camera = CameraFrame::new(&self.state.camera);
        let mut cost = self.prior_cost(&self.state);
        for k in 0..self.views.len() {
            cost += self.linearise_view(&camera, k)?;
        }
        self.cost = cost;
        self.camera_gradient = self.prior_gradient();
        self.camera_diagonal = self.knowledge.information;
        let mut largest: f64 = 0.0;
        let mut see = |gradient: f64, diagonal: f64| {
            if diagonal > 0.0 {
                largest = largest.max(gradient.abs() / diagonal.sqrt());
            }
        };
        for (g, group) in self.groups.iter().enumerate() {
            let shape = &self.state.shapes[g];
            let block = &mut self.group_blocks[g];
            block.gradient = group.prior.gradient(shape) * self.shape_prior_scale;
            block.diagonal = group.prior.information.diagonal() * self.shape_prior_scale;
            for view in &self.view_blocks[group.views.clone()] {
                let (gradient, diagonal) = (view.shared_gradient(), view.shared_diagonal());
                block.gradient += gradient.fixed_rows::<MODES>(4);
                block.diagonal += diagonal.fixed_rows::<MODES>(4);
                self.camera_gradient += gradient.fixed_rows::<4>(0);
                self.camera_diagonal += diagonal.fixed_rows::<4>(0);
                for i in 0..3 {
                    see(view.pose_gradient()[i], view.pose_diagonal()[i]);
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
        cost.is_finite().then_some(largest)
    }

    fn cost(&self) -> f64 {
        self.cost
    }

    fn try_step(&mut self, damping: f64) -> Option<Trial> {
        let (mut hessian, mut gradient) = self.eliminate(damping)?;
        gradient += self.prior_gradient();
        hessian += Matrix4::from_diagonal(&(self.knowledge.information + damping * self.camera_diagonal));
        self.hold_fixed(&mut hessian, &mut gradient);
        let camera_step = -hessian.cholesky()?.solve(&gradient);
        let mut predicted = 0.0;
        let mut largest: f64 = 0.0;
        // ½ stepᵀ (damping · D step − g): the quadratic model's decrease for a solution of the damped equations.
        let mut see = |step: f64, gradient: f64, diagonal: f64| {
            predicted += 0.5 * step * (damping * diagonal * step - gradient);
            largest = largest.max(step.abs() * diagonal.max(0.0).sqrt());
        };
        for i in (0..4).filter(|i| !self.knowledge.fixed[*i]) {
            see(camera_step[i], self.camera_gradient[i], self.camera_diagonal[i]);
        }
        self.trial.camera = self.state.camera + camera_step;
        for (g, group) in self.groups.iter().enumerate() {
            let block = &self.group_blocks[g];
            let shared = block.shared_step(&camera_step);
            for j in (0..MODES).filter(|j| !block.held[*j]) {
                see(shared[4 + j], block.gradient[j], block.diagonal[j]);
                let [low, high] = self.atlas.bounds[j];
                self.trial.shapes[g][j] = (self.state.shapes[g][j] + shared[4 + j]).clamp(low, high);
            }
            for j in (0..MODES).filter(|j| block.held[*j]) {
                self.trial.shapes[g][j] = self.state.shapes[g][j];
            }
            for k in group.views.clone() {
                let view = &self.view_blocks[k];
                let step = view.pose_step(&shared);
                for i in 0..3 {
                    see(step[i], view.pose_gradient()[i], view.pose_diagonal()[i]);
                }
                self.trial.standings[k].anchor = self.state.standings[k].anchor + step.xy();
                self.trial.standings[k].heading = self.state.standings[k].heading + step.z;
            }
        }
        let cost = self.cost_of(&self.trial)?;
        Some(Trial { cost, predicted_decrease: predicted, step_size: largest })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.state, &mut self.trial);
    }
}
