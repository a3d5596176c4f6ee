//! The usable part of a frame's input, and problems made of subsets of it.

use std::sync::Arc;

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

/// What keypoints of this weight together cost when none of them fits; finite without robustness, too.
pub(crate) fn cost_of_missing(kernel: &OutlierModel, weight: f64) -> f64 {
    0.5 * weight * kernel.cost_of_wrong().min(50.0)
}

/// A view with enough keypoints.
pub(crate) struct Sight {
    /// Its place in the caller's list.
    pub index: usize,
    /// Physical car.
    pub group: usize,
    /// Its keypoints.
    pub observations: Vec<Observation>,
}

/// Where a sight's car is, and its shape.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed<P> {
    pub pose: P,
    pub shape: Shape,
}

/// Input in the order in which problems have it: by group.
pub(crate) struct Setup<'a> {
    pub atlas: &'a ShapeAtlas,
    pub model: &'a PointModes,
    pub options: &'a SceneOptions,
    pub sights: Vec<Sight>,
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
        let sight = |(index, view): (usize, &CarView<'_>)| {
            let is_weighed = view.weight > 0.0 && view.weight.is_finite();
            let found = is_weighed.then(|| observations(view.keypoints, &camera, view.weight.min(1.0)))??;
            Some(Sight { index, group: view.group, observations: found })
        };
        let mut sights: Vec<Sight> = views.iter().enumerate().filter_map(sight).collect();
        sights.sort_by_key(|sight| sight.group);
        let mut mean = options.camera_prior.mean(size).to_vector();
        let mut information = options.camera_prior.information();
        let known = options.given_focal_px.filter(|f| f.is_finite() && *f > 0.0);
        if let Some(focal_px) = known {
            mean[0] = focal_px.ln();
            information[0] = 0.0;
        }
        let fixed = [known.is_some(), false, false, false];
        let knowledge = CameraKnowledge { mean, information, fixed, factors: Arc::clone(&options.factors) };
        Self { atlas, model, options, sights, knowledge, size }
    }

    /// The problem of all placed sights, with their positions in `sights`.
    pub fn problem<P: Pose<N>, const N: usize>(
        &self,
        camera: Vector4<f64>,
        placed: &[Option<Placed<P>>],
    ) -> (CarsProblem<'a, P, N, MODES>, Vec<usize>) {
        let mut views: Vec<View> = Vec::new();
        let mut groups: Vec<Group<MODES>> = Vec::new();
        let mut all = Vec::new();
        let mut state = State { camera, poses: Vec::new(), shapes: Vec::new() };
        let mut members = Vec::new();
        let mut last_group = None;
        for (s, (sight, place)) in self.sights.iter().zip(placed).enumerate() {
            let Some(place) = place else { continue };
            if last_group != Some(sight.group) {
                groups.push(Group::new(views.len()..views.len(), Gaussian::of_all_cars()));
                state.shapes.push(place.shape);
                last_group = Some(sight.group);
            }
            let first = all.len();
            all.extend_from_slice(&sight.observations);
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

    /// What the keypoints of all sights without a place cost: none of them fits.
    pub fn cost_of_missing<P>(&self, placed: &[Option<Placed<P>>]) -> f64 {
        let missing = self.sights.iter().zip(placed).filter(|(_, place)| place.is_none());
        let cost = |sight: &Sight| {
            cost_of_missing(&self.options.kernel, sight.observations.iter().map(|o| o.weight).sum())
        };
        missing.map(|(sight, _)| cost(sight)).sum()
    }

    /// Reads back where the cars of a problem are.
    pub fn read_back<P: Pose<N>, const N: usize>(
        &self,
        problem: &CarsProblem<'_, P, N, MODES>,
        members: &[usize],
    ) -> Vec<Option<Placed<P>>> {
        let mut placed = vec![None; self.sights.len()];
        for (k, s) in members.iter().enumerate() {
            placed[*s] = Some(problem.placed(k));
        }
        placed
    }
}

impl<'a, P: Pose<N>, const N: usize> CarsProblem<'a, P, N, MODES> {
    /// The problem of one view before a known camera.
    pub fn alone(
        model: &'a PointModes,
        camera: Vector4<f64>,
        observations: &[Observation],
        prior: Gaussian<MODES>,
        place: Placed<P>,
        kernel: OutlierModel,
    ) -> Self {
        let views = vec![View::new(0, 0..observations.len())];
        let state = State { camera, poses: vec![place.pose], shapes: vec![place.shape] };
        let (groups, knowledge) = (vec![Group::new(0..1, prior)], CameraKnowledge::given(camera));
        let mut problem = Self::new(model, views, groups, observations.to_vec(), knowledge, state);
        problem.kernel = kernel;
        problem
    }

    /// Takes the car of a problem of one view elsewhere.
    pub fn place(&mut self, place: Placed<P>) {
        (self.state.poses[0], self.state.shapes[0]) = (place.pose, place.shape);
    }

    /// Where a view's car is now.
    pub fn placed(&self, view: usize) -> Placed<P> {
        Placed { pose: self.state.poses[view], shape: self.state.shapes[self.views[view].group] }
    }
}
