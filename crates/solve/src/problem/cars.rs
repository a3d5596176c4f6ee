//! The joint problem of one camera and its cars, with shapes of M modes: parameters, cost, normal equations, step.
//!
//! Cars are on the plane (N = 3), or they are free (N = 6) and may be drawn to the plane by the paper's soft terms.
//!
//! The scene is solved with the atlas' first modes, for which the fine modes are noise of single keypoints. In reality,
//! both sides of a car, many keypoints and all its views share most of that residual. So the last steps use all modes
//! ([`CarsProblem::with_modes`]).

mod bias;
mod covariance;
mod joint;
mod latent;
mod seen;
mod step;

use nalgebra::{Matrix4, SVector, Vector4};
use roadplane_base::{FactorTerms, MODES};

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

/// One view of a car.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Index of its group in the problem.
    pub group: usize,
    /// Range of its observations in the problem's list.
    pub observations: std::ops::Range<usize>,
    /// Range of its packs in the problem's list.
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
    /// Range of its views in the problem's list.
    pub views: std::ops::Range<usize>,
    /// Prior on its shape.
    pub prior: Gaussian<M>,
    /// Weight of its cost; 1 before cars are weighted (`trust.rs`).
    pub trust: f64,
}

impl<const M: usize> Group<M> {
    /// Creates a car of full weight from its views and its shape prior.
    pub fn new(views: std::ops::Range<usize>, prior: Gaussian<M>) -> Self {
        Self { views, prior, trust: 1.0 }
    }

    /// Returns the prior's terms in the equations of the shape, times `scale`.
    fn prior_terms(&self, shape: &SVector<f64, M>, scale: f64) -> PriorTerms<M> {
        PriorTerms {
            information: self.prior.information * scale,
            gradient: self.prior.gradient(shape) * scale,
        }
    }
}

/// All estimated parameters.
#[derive(Clone, Debug)]
pub(crate) struct State<P, const M: usize> {
    pub camera: Vector4<f64>,
    pub poses: Vec<P>,
    pub shapes: Vec<SVector<f64, M>>,
}

/// The joint problem of one camera and its cars. `state` is the current state, `trial` that after the last trial step.
pub(crate) struct CarsProblem<'a, P, const N: usize, const M: usize> {
    pub model: &'a PointModes<M>,
    pub views: Vec<View>,
    pub groups: Vec<Group<M>>,
    pub observations: Vec<Observation>,
    pub knowledge: CameraKnowledge,
    pub kernel: OutlierModel,
    /// Soft terms that draw free cars to the plane.
    pub plane: Option<PlaneTerms>,
    /// Factor on the information of shape priors.
    pub shape_prior_scale: f64,
    /// Whether shapes are fixed at their current values.
    pub shapes_fixed: bool,
    pub state: State<P, M>,
    trial: State<P, M>,
    /// Keypoints as the inner loop reads them.
    packs: Vec<Pack<M>>,
    linearisation: Linearisation<N, M>,
    trial_linearisation: Linearisation<N, M>,
    scratch: Box<[Rows; MAX_PACKS]>,
    pose_blocks: Vec<PoseBlock<N, M>>,
    group_blocks: Vec<GroupBlock<N, M>>,
    /// Terms of prior and factors on the camera at the current state.
    camera_terms: FactorTerms,
    camera_gradient: Vector4<f64>,
    camera_diagonal: Vector4<f64>,
}

/// The problem of cars on the plane.
pub(crate) type GroundProblem<'a, const M: usize> = CarsProblem<'a, PlanePose, ON_PLANE, M>;
/// The problem of free cars.
pub(crate) type FreeProblem<'a> = CarsProblem<'a, FreePose, FREE, MODES>;

/// Cost and normal equations of all views at a state.
#[derive(Clone, Debug)]
struct Linearisation<const N: usize, const M: usize> {
    cost: f64,
    /// Cost of the keypoints of each group, without its trust.
    keypoints: Vec<f64>,
    grams: Vec<Gram<N, M>>,
}

impl<'a, P: Pose<N>, const N: usize, const M: usize> CarsProblem<'a, P, N, M> {
    /// Creates a problem. Views of a group must follow each other.
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
            camera_terms: FactorTerms { gradient: Vector4::zeros(), information: Matrix4::zeros() },
            camera_gradient: Vector4::zeros(),
            camera_diagonal: Vector4::zeros(),
        }
    }

    /// Whitens every observation with its measured covariance, the atlas' residual and an error of `extra_m` metres.
    ///
    /// The residual's sd is multiplied by `atlas_scale`. Residual and extra error are projected at the current pose.
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

    /// Computes cost and normal equations of the current state (or the trial), and returns the cost.
    ///
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

    /// Eliminates views and shapes. Returns the camera's reduced Hessian and gradient, without prior and factors.
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

    /// Sums gradient and diagonal of shapes and camera over views, and decides which coefficients are fixed.
    ///
    /// Returns the largest scaled gradient.
    fn gather(&mut self) -> f64 {
        self.camera_terms = self.knowledge.terms(&self.state.camera);
        self.camera_gradient = self.camera_terms.gradient;
        self.camera_diagonal = self.camera_terms.information.diagonal();
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
            // Projected Newton (Bertsekas 1982): a coefficient at its bound with an outward descent direction is fixed.
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
