//! The joint least-squares problem of one camera and all its cars: parameters, cost, normal equations, step.
//!
//! A pose has N parameters. Cars are on the ground plane (N = 3) or have free poses (N = 6). Soft terms can pull free
//! cars towards the plane.
//!
//! A shape has M parameters, the coefficients of the shape atlas' modes. The scene is first solved with few modes. The
//! remaining (fine) modes then count as independent noise of each keypoint. In reality, keypoints on both sides of a
//! car, and all views of the car, share most of this residual. So the last steps use all modes
//! ([`CarsProblem::with_modes`]).

mod bias;
mod covariance;
mod joint;
mod latent;
mod seen;
mod step;

use nalgebra::{Matrix4, SVector, Vector4};
use roadplane_base::MODES;

use crate::linear::arrow::{GroupBlock, PoseBlock, PriorTerms, camera_system};
use crate::linear::gram::{Gram, MAX_WIDTH, Rows};
use crate::model::camera_prior::CameraKnowledge;
use crate::model::free::{FREE, FreePose, PlaneTerms};
use crate::model::kernel::{OutlierModel, PreparedKernel};
use crate::model::latent::body_types::Gaussian;
use crate::model::observation::{Observation, whiten_view};
use crate::model::on_plane::{ON_PLANE, PlanePose};
use crate::model::pack::{Pack, pack, rewhiten};
use crate::model::points::PointModes;
use crate::model::pose::{CameraFrame, Pose};
use crate::model::rows::{MAX_PACKS, NO_ROWS, linearise};

/// One view of a car: its keypoints in one frame.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Index of the view's group (physical car) in the problem.
    pub group: usize,
    /// Indices of the view's keypoints in the problem's `observations`.
    pub observations: std::ops::Range<usize>,
    /// Indices of the view's packs (four keypoints each) in the problem's `packs`.
    packs: std::ops::Range<usize>,
}

impl View {
    pub fn new(group: usize, observations: std::ops::Range<usize>) -> Self {
        Self { group, observations, packs: 0..0 }
    }
}

/// A physical car: its views and its shape prior.
#[derive(Clone, Debug)]
pub(crate) struct Group<const M: usize> {
    /// Indices of the car's views in the problem's `views`.
    pub views: std::ops::Range<usize>,
    /// Prior on the car's shape.
    pub prior: Gaussian<M>,
    /// Weight of the car's cost (`trust.rs`). It is 1 until the weights are first updated.
    pub trust: f64,
}

impl<const M: usize> Group<M> {
    /// Creates a car with weight 1 from its views and its shape prior.
    pub fn new(views: std::ops::Range<usize>, prior: Gaussian<M>) -> Self {
        Self { views, prior, trust: 1.0 }
    }

    /// Returns the terms that the prior adds to the normal equations of the shape, multiplied by `scale`.
    fn prior_terms(&self, shape: &SVector<f64, M>, scale: f64) -> PriorTerms<M> {
        PriorTerms {
            information: self.prior.information * scale,
            gradient: self.prior.gradient(shape) * scale,
        }
    }
}

/// Values of all estimated parameters.
#[derive(Clone, Debug)]
pub(crate) struct State<P, const M: usize> {
    pub camera: Vector4<f64>,
    pub poses: Vec<P>,
    pub shapes: Vec<SVector<f64, M>>,
}

/// The joint problem of one camera and its cars.
///
/// `state` contains the current parameters, and `trial` the parameters after the last trial step.
pub(crate) struct CarsProblem<'a, P, const N: usize, const M: usize> {
    pub model: &'a PointModes<M>,
    pub views: Vec<View>,
    pub groups: Vec<Group<M>>,
    pub observations: Vec<Observation>,
    pub knowledge: CameraKnowledge,
    pub kernel: OutlierModel,
    /// Soft cost terms that pull cars with free poses towards the ground plane.
    pub plane: Option<PlaneTerms>,
    /// Number by which the information of all shape priors is multiplied.
    pub shape_prior_scale: f64,
    /// Whether shapes are fixed at their current values.
    pub shapes_fixed: bool,
    pub state: State<P, M>,
    trial: State<P, M>,
    /// Keypoints in groups of four, as the inner loop reads them.
    packs: Vec<Pack<M>>,
    linearisation: Linearisation<N, M>,
    trial_linearisation: Linearisation<N, M>,
    scratch: Box<[Rows; MAX_PACKS]>,
    pose_blocks: Vec<PoseBlock<N, M>>,
    group_blocks: Vec<GroupBlock<N, M>>,
    camera_gradient: Vector4<f64>,
    camera_diagonal: Vector4<f64>,
}

/// The problem of cars on the ground plane.
pub(crate) type GroundProblem<'a, const M: usize> = CarsProblem<'a, PlanePose, ON_PLANE, M>;
/// The problem of cars with free poses (6 degrees of freedom).
pub(crate) type FreeProblem<'a> = CarsProblem<'a, FreePose, FREE, MODES>;

/// Cost and normal equations of all views for one set of parameters.
#[derive(Clone, Debug)]
struct Linearisation<const N: usize, const M: usize> {
    cost: f64,
    /// Cost of the keypoints of each group, before multiplication by the group's weight.
    keypoints: Vec<f64>,
    grams: Vec<Gram<N, M>>,
}

impl<'a, P: Pose<N>, const N: usize, const M: usize> CarsProblem<'a, P, N, M> {
    /// Creates a problem. The views of each group must be consecutive in `views`.
    pub fn new(
        model: &'a PointModes<M>,
        mut views: Vec<View>,
        groups: Vec<Group<M>>,
        observations: Vec<Observation>,
        knowledge: CameraKnowledge,
        state: State<P, M>,
    ) -> Self {
        let mut packs = Vec::with_capacity(observations.len() / 3);
        for view in &mut views {
            let first = packs.len();
            pack(model, &observations[view.observations.clone()], &mut packs);
            view.packs = first..packs.len();
        }
        let linearisation = Linearisation {
            cost: f64::INFINITY,
            keypoints: vec![0.0; groups.len()],
            grams: vec![Gram::zeros(); views.len()],
        };
        Self {
            model,
            packs,
            trial_linearisation: linearisation.clone(),
            linearisation,
            scratch: Box::new([NO_ROWS; MAX_PACKS]),
            pose_blocks: vec![PoseBlock::zeros(); views.len()],
            group_blocks: vec![GroupBlock::zeros(); groups.len()],
            views,
            groups,
            observations,
            knowledge,
            kernel: OutlierModel::default(),
            plane: None,
            shape_prior_scale: 1.0,
            shapes_fixed: false,
            trial: state.clone(),
            state,
            camera_gradient: Vector4::zeros(),
            camera_diagonal: Vector4::zeros(),
        }
    }

    /// Updates the whitening of every keypoint, for the current camera and poses.
    ///
    /// Three covariances add up: the measured covariance, the covariance of the atlas' residual, and that of an extra
    /// error. The residual's sd is multiplied by `atlas_scale`. The extra error has the sd `extra_m`, m. Residual and
    /// extra error are projected into the image.
    pub fn whiten(&mut self, atlas_scale: f64, extra_m: f64) {
        let camera = CameraFrame::new(&self.state.camera);
        for (view, pose) in self.views.iter().zip(&self.state.poses) {
            let Some(frame) = pose.frame(&camera) else { continue };
            let extra_px = extra_m * camera.focal_px / frame.origin.z;
            let seen = &mut self.observations[view.observations.clone()];
            let PointModes { mean, residual_sd_m, .. } = self.model;
            whiten_view(seen, &frame, mean, residual_sd_m, atlas_scale, extra_px);
            rewhiten(seen, &mut self.packs[view.packs.clone()]);
        }
    }

    /// Computes cost and normal equations, and returns the cost.
    ///
    /// The parameters are those of the trial state if `trial` is `true`, and those of the current state otherwise.
    /// Returns `None` if a keypoint cannot be projected.
    fn evaluate(&mut self, trial: bool) -> Option<f64> {
        let (state, into) = match trial {
            true => (&self.trial, &mut self.trial_linearisation),
            false => (&self.state, &mut self.linearisation),
        };
        let camera = CameraFrame::new(&state.camera);
        let kernel = PreparedKernel::new(&self.kernel);
        into.keypoints.fill(0.0);
        for ((view, pose), gram) in self.views.iter().zip(&state.poses).zip(&mut into.grams) {
            let frame = pose.frame(&camera)?;
            let shape = &state.shapes[view.group];
            let packs = &self.packs[view.packs.clone()];
            into.keypoints[view.group] += linearise(packs, &frame, shape, &kernel, &mut self.scratch, gram)?;
            for row in self.plane.iter().flat_map(|terms| terms.rows::<N, M>(&camera, &frame)) {
                into.keypoints[view.group] += 0.5 * row[Gram::<N, M>::RESIDUAL].powi(2);
                gram.add(&row);
            }
        }
        let cars = self.groups.iter().zip(&state.shapes).zip(&into.keypoints);
        let of_car = |((group, shape), keypoints): ((&Group<M>, &SVector<f64, M>), &f64)| {
            group.trust * (keypoints + self.shape_prior_scale * group.prior.cost(shape))
        };
        into.cost = self.knowledge.cost(&state.camera) + cars.map(of_car).sum::<f64>();
        into.cost.is_finite().then_some(into.cost)
    }

    /// Eliminates poses and shapes, and returns the Hessian and gradient that remain for the camera.
    ///
    /// The camera's prior is not included. Returns `None` if a car's block is not positive definite.
    fn eliminate(&mut self, damping: f64) -> Option<(Matrix4<f64>, Vector4<f64>)> {
        let mut rows = [[0.0; MAX_WIDTH]; 4];
        for (g, group) in self.groups.iter().enumerate() {
            let prior = group.prior_terms(&self.state.shapes[g], self.shape_prior_scale);
            self.group_blocks[g].eliminate(
                &self.linearisation.grams[group.views.clone()],
                &mut self.pose_blocks[group.views.clone()],
                damping,
                &prior,
                group.trust,
                &mut rows,
            )?;
        }
        Some(camera_system::<N, M>(&rows))
    }

    /// Sums the gradients and Hessian diagonals of shapes and camera over the views.
    ///
    /// It also decides which shape coefficients are fixed at their bounds. Returns the largest entry of the scaled
    /// gradient.
    fn gather(&mut self) -> f64 {
        self.camera_gradient = self.knowledge.gradient(&self.state.camera);
        self.camera_diagonal = self.knowledge.information;
        let mut largest: f64 = 0.0;
        let mut see = |weight: f64, gradient: f64, diagonal: f64| {
            if diagonal > 0.0 {
                largest = largest.max(weight * gradient * gradient / diagonal);
            }
        };
        for (g, group) in self.groups.iter().enumerate() {
            let shape = &self.state.shapes[g];
            let block = &mut self.group_blocks[g];
            block.gradient = group.prior.gradient(shape) * self.shape_prior_scale;
            block.diagonal = group.prior.information.diagonal() * self.shape_prior_scale;
            for view in &self.linearisation.grams[group.views.clone()] {
                for j in 0..M {
                    block.gradient[j] += view.gradient(N + j);
                    block.diagonal[j] += view.diagonal(N + j);
                }
                for i in 0..4 {
                    self.camera_gradient[i] += group.trust * view.gradient(Gram::<N, M>::CAMERA + i);
                    self.camera_diagonal[i] += group.trust * view.diagonal(Gram::<N, M>::CAMERA + i);
                }
                for i in 0..N {
                    see(group.trust, view.gradient(i), view.diagonal(i));
                }
            }
            // Projected Newton method (Bertsekas 1982): fixes a coefficient at its bound if descent would go beyond it.
            for j in 0..M {
                let [low, high] = self.model.bounds[j];
                let outward = (shape[j] <= low && block.gradient[j] > 0.0)
                    || (shape[j] >= high && block.gradient[j] < 0.0);
                block.fixed[j] = self.shapes_fixed || outward;
                if !block.fixed[j] {
                    see(group.trust, block.gradient[j], block.diagonal[j]);
                }
            }
        }
        for i in (0..4).filter(|i| !self.knowledge.fixed[*i]) {
            see(1.0, self.camera_gradient[i], self.camera_diagonal[i]);
        }
        largest.sqrt()
    }
}
