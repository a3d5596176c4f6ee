//! The usable part of a frame's input, and problems made of subsets of it.

use std::sync::Arc;

use nalgebra::Vector4;
use roadplane_base::{Camera, ImageSize, MIN_KEYPOINTS, MODES, Shape, ShapeAtlas};

use crate::model::camera_prior::CameraKnowledge;
use crate::model::ground::{PointModes, Standing};
use crate::model::kernel::OutlierModel;
use crate::model::latent::body_types::Gaussian;
use crate::model::observation::{Observation, observations};
use crate::options::SceneOptions;
use crate::problem::ground::{GroundProblem, GroundState, Group, View};
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

/// Where a sight's car stands, and its shape.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    pub standing: Standing,
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
        let mut sights: Vec<Sight> = Vec::new();
        let camera = Camera { lens: options.lens, ..Camera::centred(1.0, size) };
        for (index, view) in views.iter().enumerate() {
            let mut found = Vec::new();
            if view.weight > 0.0 && view.weight.is_finite() {
                observations(view.keypoints, &camera, view.weight.min(1.0), &mut found);
            }
            if found.len() >= MIN_KEYPOINTS {
                sights.push(Sight { index, group: view.group, observations: found });
            }
        }
        sights.sort_by_key(|sight| sight.group);
        let mut mean = options.camera_prior.mean(size).to_vector();
        let mut information = options.camera_prior.information();
        let known = options.known_focal_px.filter(|f| f.is_finite() && *f > 0.0);
        if let Some(focal_px) = known {
            mean[0] = focal_px.ln();
            information[0] = 0.0;
        }
        let fixed = [known.is_some(), false, false, false];
        let knowledge = CameraKnowledge { mean, information, fixed, clues: Arc::clone(&options.clues) };
        Self { atlas, model, options, sights, knowledge, size }
    }

    fn shape_prior(&self) -> Gaussian<MODES> {
        Gaussian::of_all_cars(self.options.shape_prior_weight)
    }

    /// The problem of all placed sights, with their positions in `sights`.
    pub fn problem(
        &self,
        camera: Vector4<f64>,
        placed: &[Option<Placed>],
    ) -> (GroundProblem<'a>, Vec<usize>) {
        let mut views: Vec<View> = Vec::new();
        let mut groups: Vec<Group> = Vec::new();
        let mut all = Vec::new();
        let mut state = GroundState { camera, standings: Vec::new(), shapes: Vec::new() };
        let mut members = Vec::new();
        let mut last_group = None;
        for (s, (sight, place)) in self.sights.iter().zip(placed).enumerate() {
            let Some(place) = place else { continue };
            if last_group != Some(sight.group) {
                groups.push(Group::new(views.len()..views.len(), self.shape_prior()));
                state.shapes.push(place.shape);
                last_group = Some(sight.group);
            }
            let first = all.len();
            all.extend_from_slice(&sight.observations);
            views.push(View::new(groups.len() - 1, first..all.len()));
            if let Some(group) = groups.last_mut() {
                group.views.end = views.len();
            }
            state.standings.push(place.standing);
            members.push(s);
        }
        let mut problem = GroundProblem::new(self.model, views, groups, all, self.knowledge.clone(), state);
        problem.kernel = self.options.kernel;
        (problem, members)
    }

    /// The problem of one view before a known camera.
    pub fn problem_alone(
        &self,
        camera: Vector4<f64>,
        observations: &[Observation],
        place: Placed,
    ) -> GroundProblem<'a> {
        let observations = observations.to_vec();
        let views = vec![View::new(0, 0..observations.len())];
        let groups = vec![Group::new(0..1, self.shape_prior())];
        let state = GroundState { camera, standings: vec![place.standing], shapes: vec![place.shape] };
        let mut problem = GroundProblem::new(
            self.model,
            views,
            groups,
            observations,
            CameraKnowledge::given(camera),
            state,
        );
        problem.kernel = self.options.kernel;
        problem
    }

    /// What all keypoints of a sight cost when none of them fits.
    pub fn cost_of_missing(&self, sight: usize) -> f64 {
        cost_of_missing(&self.options.kernel, self.sights[sight].observations.iter().map(|o| o.weight).sum())
    }

    /// Reads back where the cars of a problem are.
    pub fn read_back(&self, problem: &GroundProblem<'_>, members: &[usize]) -> Vec<Option<Placed>> {
        let mut placed = vec![None; self.sights.len()];
        for (k, s) in members.iter().enumerate() {
            placed[*s] = Some(Placed {
                standing: problem.state.standings[k],
                shape: problem.state.shapes[problem.views[k].group],
            });
        }
        placed
    }
}
