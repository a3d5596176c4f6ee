//! Preparation of a frame's input: selects usable views and builds least-squares problems from some or all of them.

use nalgebra::Vector4;
use roadplane_base::{Camera, ImageSize, MODES, Shape, ShapeAtlas};

use crate::model::camera_prior::CameraKnowledge;
use crate::model::kernel::OutlierModel;
use crate::model::latent::body_types::Gaussian;
use crate::model::observation::{Observation, observations};
use crate::model::points::PointModes;
use crate::model::pose::Pose;
use crate::options::SceneOptions;
use crate::problem::cars::{CarsProblem, Group, State, View};
use crate::solution::CarView;

/// Returns the cost of keypoints with this total weight if all of them are outliers.
///
/// It is finite even if the outlier model is switched off.
pub(crate) fn cost_of_missing(kernel: &OutlierModel, weight: f64) -> f64 {
    0.5 * weight * kernel.cost_of_wrong().min(50.0)
}

/// A view (a car's keypoints in one frame) with enough usable keypoints.
pub(crate) struct UsableView {
    /// Index of the view in the caller's list.
    pub index: usize,
    /// Number of the physical car.
    pub group: usize,
    /// Usable keypoints of the view.
    pub observations: Vec<Observation>,
}

/// Pose and shape of the car in a view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PoseAndShape<P> {
    pub pose: P,
    pub shape: Shape,
}

/// A frame's usable input, in which the views of each physical car are consecutive.
pub(crate) struct Setup<'a> {
    pub atlas: &'a ShapeAtlas,
    pub model: &'a PointModes,
    pub options: &'a SceneOptions,
    pub usable_views: Vec<UsableView>,
    pub knowledge: CameraKnowledge,
    pub size: ImageSize,
}

impl<'a> Setup<'a> {
    pub fn new(
        atlas: &'a ShapeAtlas,
        model: &'a PointModes,
        size: ImageSize,
        views: &[CarView<'_>],
        options: &'a SceneOptions,
    ) -> Self {
        let camera = Camera { lens: options.lens, ..Camera::centred(1.0, size) };
        let usable_view = |(index, view): (usize, &CarView<'_>)| {
            let is_weighed = view.weight > 0.0 && view.weight.is_finite();
            let found = is_weighed.then(|| observations(view.keypoints, &camera, view.weight.min(1.0)))??;
            Some(UsableView { index, group: view.group, observations: found })
        };
        let mut usable_views: Vec<UsableView> = views.iter().enumerate().filter_map(usable_view).collect();
        usable_views.sort_by_key(|usable_view| usable_view.group);
        let mut mean = options.camera_prior.mean(size).to_vector();
        let mut information = options.camera_prior.information();
        let given = options.given_focal_px.filter(|f| f.is_finite() && *f > 0.0);
        if let Some(focal_px) = given {
            mean[0] = focal_px.ln();
            information[0] = 0.0;
        }
        let fixed = [given.is_some(), false, false, false];
        let knowledge = CameraKnowledge { mean, information, fixed };
        Self { atlas, model, options, usable_views, knowledge, size }
    }

    /// Builds the problem of all views that have a pose in `placed`.
    ///
    /// `placed` has one entry per usable view. The second result lists the problem's views by their index in
    /// `usable_views`.
    pub fn problem<P: Pose<N>, const N: usize>(
        &self,
        camera: Vector4<f64>,
        placed: &[Option<PoseAndShape<P>>],
    ) -> (CarsProblem<'a, P, N, MODES>, Vec<usize>) {
        let mut views: Vec<View> = Vec::new();
        let mut groups: Vec<Group<MODES>> = Vec::new();
        let mut all = Vec::new();
        let mut state = State { camera, poses: Vec::new(), shapes: Vec::new() };
        let mut members = Vec::new();
        let mut last_group = None;
        for (s, (usable_view, place)) in self.usable_views.iter().zip(placed).enumerate() {
            let Some(place) = place else { continue };
            if last_group != Some(usable_view.group) {
                groups.push(Group::new(views.len()..views.len(), Gaussian::of_all_cars()));
                state.shapes.push(place.shape);
                last_group = Some(usable_view.group);
            }
            let first = all.len();
            all.extend_from_slice(&usable_view.observations);
            views.push(View::new(groups.len() - 1, first..all.len()));
            if let Some(group) = groups.last_mut() {
                group.views.end = views.len();
            }
            state.poses.push(place.pose);
            members.push(s);
        }
        let mut problem = CarsProblem::new(self.model, views, groups, all, self.knowledge.clone(), state);
        problem.kernel = self.options.kernel;
        (problem, members)
    }

    /// Returns the cost of all views without a pose in `placed`: all their keypoints count as outliers.
    pub fn cost_of_missing<P>(&self, placed: &[Option<PoseAndShape<P>>]) -> f64 {
        let missing = self.usable_views.iter().zip(placed).filter(|(_, place)| place.is_none());
        let cost = |usable_view: &UsableView| {
            cost_of_missing(&self.options.kernel, usable_view.observations.iter().map(|o| o.weight).sum())
        };
        missing.map(|(usable_view, _)| cost(usable_view)).sum()
    }

    /// Returns pose and shape of the car in each usable view; `None` for views that are not in the problem.
    ///
    /// `members` lists the problem's views by their index in `usable_views`.
    pub fn read_back<P: Pose<N>, const N: usize>(
        &self,
        problem: &CarsProblem<'_, P, N, MODES>,
        members: &[usize],
    ) -> Vec<Option<PoseAndShape<P>>> {
        let mut placed = vec![None; self.usable_views.len()];
        for (k, s) in members.iter().enumerate() {
            placed[*s] = Some(problem.pose_and_shape(k));
        }
        placed
    }
}

impl<'a, P: Pose<N>, const N: usize> CarsProblem<'a, P, N, MODES> {
    /// Creates the problem of one view, with a fixed camera.
    pub fn alone(
        model: &'a PointModes,
        camera: Vector4<f64>,
        observations: &[Observation],
        prior: Gaussian<MODES>,
        place: PoseAndShape<P>,
        kernel: OutlierModel,
    ) -> Self {
        let views = vec![View::new(0, 0..observations.len())];
        let state = State { camera, poses: vec![place.pose], shapes: vec![place.shape] };
        let (groups, knowledge) = (vec![Group::new(0..1, prior)], CameraKnowledge::given(camera));
        let mut problem = Self::new(model, views, groups, observations.to_vec(), knowledge, state);
        problem.kernel = kernel;
        problem
    }

    /// Sets pose and shape of the only car, in a problem of one view.
    pub fn set_pose_and_shape(&mut self, place: PoseAndShape<P>) {
        (self.state.poses[0], self.state.shapes[0]) = (place.pose, place.shape);
    }

    /// Returns the current pose and shape of the car in a view.
    pub fn pose_and_shape(&self, view: usize) -> PoseAndShape<P> {
        PoseAndShape { pose: self.state.poses[view], shape: self.state.shapes[self.views[view].group] }
    }
}
