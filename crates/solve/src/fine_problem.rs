//! The joint problem with all modes of the atlas.
//!
//! `ground_problem.rs` takes what six modes leave unexplained for noise of single keypoints. In truth most of it is common to
//! both sides of a car, to many keypoints and to all views of the car: the fine modes. Unknowns per view are pose v (3), per
//! car shape s (6 + 6; the prior, without which this is not solved, holds it instead of bounds), and one camera c (4), as there;
//! here in small dense matrices, for the last steps only.

use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, Vector2, Vector3, Vector4};
use roadplane_base::{ALL_MODES, FullShape, MODES, Shape, ShapeAtlas};

use crate::arrow::MIN_INFORMATION;
use crate::body_types::{BodyTypes, Gaussian};
use crate::camera_knowledge::CameraKnowledge;
use crate::ground_problem::{GroundProblem, Group, View};
use crate::ground_residual::{CameraFrame, MIN_DEPTH_M, Standing, StandingFrame};
use crate::kernel::PreparedKernel;
use crate::observation::{Observation, whiten_seen};
use crate::options::SceneOptions;
use crate::trust::{Misfit, trust};

const POSE: usize = 3;
const CAMERA: usize = POSE + ALL_MODES;
const RESIDUAL: usize = CAMERA + 4;

/// Factor on the sd of what the modes leave unexplained of a keypoint: a car is off by the same on both sides and in all its
/// views, while keypoints are taken for independent. Measured on cars of makes that the atlas had been built without.
pub(crate) const SHARED: f64 = std::f64::consts::SQRT_2;

/// Derivatives by (pose, shape, camera) and residual.
type Row = SVector<f64, { RESIDUAL + 1 }>;
/// `Σ row rowᵀ`: Hessian and gradient.
type Gram = SMatrix<f64, { RESIDUAL + 1 }, { RESIDUAL + 1 }>;
/// The same without the pose, and what of it a pose is given by.
type ShapeGram = SMatrix<f64, { RESIDUAL + 1 - POSE }, { RESIDUAL + 1 - POSE }>;
type PoseRows = SMatrix<f64, POSE, { RESIDUAL + 1 - POSE }>;
/// The same for a shape.
type CameraGram = SMatrix<f64, 5, 5>;
type ShapeRows = SMatrix<f64, ALL_MODES, 5>;

/// Everything that is estimated.
#[derive(Clone, Debug)]
pub(crate) struct FineState {
    pub camera: Vector4<f64>,
    standings: Vec<Standing>,
    shapes: Vec<FullShape>,
}

impl FineState {
    /// Where `problem` is; no car has fine shape yet.
    pub fn of(problem: &GroundProblem<'_>) -> Self {
        let all = |shape: &Shape| {
            let mut all = FullShape::zeros();
            all.fixed_rows_mut::<MODES>(0).copy_from(shape);
            all
        };
        Self {
            camera: problem.state.camera,
            standings: problem.state.standings.clone(),
            shapes: problem.state.shapes.iter().map(all).collect(),
        }
    }
}

/// See the module's head.
pub(crate) struct FineProblem<'a> {
    atlas: &'a ShapeAtlas,
    views: &'a [View],
    groups: &'a [Group],
    observations: Vec<Observation>,
    knowledge: CameraKnowledge,
    kernel: PreparedKernel,
    /// Factor on the sd of what is unexplained.
    scale: f64,
    /// What is known of each car's shape.
    priors: Vec<Gaussian<ALL_MODES>>,
    types: BodyTypes<ALL_MODES>,
    /// Weight of each car's cost.
    trust: Vec<f64>,
}

/// Cost and every view's normal equations at a state.
#[derive(Clone, Debug, Default)]
pub(crate) struct Linearisation {
    pub cost: f64,
    /// What the keypoints of each car cost.
    of_cars: Vec<f64>,
    grams: Vec<Gram>,
}

/// Cars eliminated: what is left over the camera, and how cars follow it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Eliminated {
    /// Information of the cars on the camera, no prior counted.
    pub information: Matrix4<f64>,
    gradient: Vector4<f64>,
    /// ½ Σ log det of the Hessians of poses and shapes.
    pub half_log_determinant: f64,
    /// Of each car's keypoints on shape and camera, poses eliminated.
    of_shapes: Vec<ShapeGram>,
    poses: Vec<PoseRows>,
    shapes: Vec<ShapeRows>,
}

impl<'a> FineProblem<'a> {
    /// Of the cars of `problem` with its whitening, for an `atlas_residual_scale` other than 0.
    pub fn new(atlas: &'a ShapeAtlas, problem: &'a GroundProblem<'_>, options: &SceneOptions) -> Self {
        let scale = options.atlas_residual_scale;
        let fine_information = options.shape_prior_weight / (scale * scale);
        let prior = |group: &Group| Gaussian::of_all_modes(&group.prior, fine_information);
        Self {
            atlas,
            views: &problem.views,
            groups: &problem.groups,
            observations: problem.observations.clone(),
            scale: SHARED * scale,
            knowledge: problem.knowledge,
            kernel: PreparedKernel::new(&problem.kernel),
            priors: problem.groups.iter().map(prior).collect(),
            types: BodyTypes::new(atlas, options),
            trust: vec![1.0; problem.groups.len()],
        }
    }

    /// Weighs the cars by how they fit at a state, whose cost becomes that of the new weights.
    pub fn weigh(&mut self, at: &mut Linearisation, state: &FineState, freedom: f64) {
        let misfit = |(group, cost): (&Group, f64)| {
            let observations = group.views.clone().flat_map(|k| self.views[k].observations.clone());
            let weight: f64 = observations.map(|i| self.observations[i].weight).sum();
            Misfit { squared: 2.0 * cost, numbers: 2.0 * weight }
        };
        let misfits: Vec<Misfit> =
            self.groups.iter().zip(self.costs_of_cars(at, state)).map(misfit).collect();
        self.trust = trust(&misfits, freedom);
        at.cost = self.cost(at, state);
    }

    /// Takes for each car's prior that of the body types it may have, by what was eliminated at a state, whose cost becomes
    /// that of the new priors.
    pub fn tell_types(&mut self, at: &mut Linearisation, eliminated: &Eliminated, state: &FineState) {
        for ((prior, sum), shape) in self.priors.iter_mut().zip(&eliminated.of_shapes).zip(&state.shapes) {
            let information = sum.fixed_view::<ALL_MODES, ALL_MODES>(0, 0).into_owned();
            let gradient = sum.fixed_view::<ALL_MODES, 1>(0, ALL_MODES + 4).into_owned();
            self.types.tell(prior, shape, &information, &gradient);
        }
        at.cost = self.cost(at, state);
    }

    /// Of each car's keypoints and shape, before it is weighed.
    fn costs_of_cars<'b>(
        &'b self,
        at: &'b Linearisation,
        state: &'b FineState,
    ) -> impl Iterator<Item = f64> + 'b {
        let shapes = self.priors.iter().zip(&state.shapes).map(|(prior, shape)| prior.cost(shape));
        at.of_cars.iter().zip(shapes).map(|(keypoints, shape)| keypoints + shape)
    }

    /// Of the camera and the weighed cars.
    fn cost(&self, at: &Linearisation, state: &FineState) -> f64 {
        let camera = 0.5 * self.knowledge.gradient(&state.camera).dot(&(state.camera - self.knowledge.mean));
        camera + self.costs_of_cars(at, state).zip(&self.trust).map(|(cost, trust)| trust * cost).sum::<f64>()
    }

    /// Whitens every keypoint with its measured covariance and what the fine modes leave unexplained, seen at a state.
    pub fn whiten(&mut self, state: &FineState) {
        let camera = CameraFrame::new(&state.camera);
        for (view, standing) in self.views.iter().zip(&state.standings) {
            let Some(frame) = StandingFrame::new(&camera, standing) else { continue };
            let seen = &mut self.observations[view.observations.clone()];
            whiten_seen(seen, &frame, self.atlas, &self.atlas.fine_residual_sd_m, self.scale, 0.0);
        }
    }

    fn modes(&self, index: usize) -> impl Iterator<Item = &Vector3<f64>> {
        self.atlas.modes.iter().chain(&self.atlas.fine_modes).map(move |mode| &mode[index])
    }

    /// `None` when a keypoint cannot be projected.
    pub fn linearise(&self, state: &FineState, into: &mut Linearisation) -> Option<()> {
        let camera = CameraFrame::new(&state.camera);
        into.of_cars.clear();
        into.of_cars.resize(self.groups.len(), 0.0);
        into.grams.clear();
        for (view, standing) in self.views.iter().zip(&state.standings) {
            let frame = StandingFrame::new(&camera, standing)?;
            let mut gram = Gram::zeros();
            for observation in &self.observations[view.observations.clone()] {
                let rows = self.rows(observation, &frame, &state.shapes[view.group])?;
                let squared = rows[0][RESIDUAL].powi(2) + rows[1][RESIDUAL].powi(2);
                let (loss, right) = self.kernel.evaluate_one(squared);
                into.of_cars[view.group] += 0.5 * observation.weight * loss;
                for row in &rows {
                    gram.ger(observation.weight * right, row, row, 1.0);
                }
            }
            into.grams.push(gram);
        }
        into.cost = self.cost(into, state);
        into.cost.is_finite().then_some(())
    }

    /// Whitened rows of a keypoint, its weight not yet counted (`ground_residual.rs` has the model).
    fn rows(&self, observation: &Observation, frame: &StandingFrame, shape: &FullShape) -> Option<[Row; 2]> {
        let point = self.atlas.keypoint_of_all_modes(observation.index, shape);
        let offset = frame.camera_from_car * point;
        let p = frame.origin + offset;
        if p.z.is_nan() || p.z <= MIN_DEPTH_M {
            return None;
        }
        let scale = frame.focal_px / p.z;
        let pixel = p.xy() * scale;
        let [w00, w10, w11] = observation.whitening;
        let (x, y) = (p.x / p.z, p.y / p.z);
        let by_point =
            [Vector3::new(w00, 0.0, -w00 * x) * scale, Vector3::new(w10, w11, -(w10 * x + w11 * y)) * scale];
        let by_focal = observation.whiten(pixel.into());
        let residual = observation.whiten((pixel - observation.pixel).into());
        let [focal, tilt, roll, height, u, v] = &frame.origin_by;
        let tilt = tilt + frame.camera_from_car_by_tilt * point;
        let roll = roll + Vector3::new(-offset.y, offset.x, 0.0);
        Some([0, 1].map(|k: usize| {
            let by = &by_point[k];
            let in_car = frame.camera_from_car.tr_mul(by);
            let mut row = Row::zeros();
            row[0] = by.dot(u);
            row[1] = by.dot(v);
            row[2] = in_car.dot(&Vector3::new(-point.y, point.x, 0.0));
            for (entry, mode) in row.rows_mut(POSE, ALL_MODES).iter_mut().zip(self.modes(observation.index)) {
                *entry = in_car.dot(mode);
            }
            row[CAMERA] = by.dot(focal) + by_focal[k];
            row[CAMERA + 1] = by.dot(&tilt);
            row[CAMERA + 2] = by.dot(&roll);
            row[CAMERA + 3] = by.dot(height);
            row[RESIDUAL] = residual[k];
            row
        }))
    }

    /// `None` when a car's block is not positive definite.
    pub fn eliminate(&self, at: &Linearisation, state: &FineState, into: &mut Eliminated) -> Option<()> {
        let mut camera = CameraGram::zeros();
        into.of_shapes.clear();
        into.poses.clear();
        into.shapes.clear();
        into.half_log_determinant = 0.0;
        let priors = self.priors.iter().zip(&state.shapes);
        for ((group, (prior, shape)), trust) in self.groups.iter().zip(priors).zip(&self.trust) {
            let mut sum = ShapeGram::zeros();
            for gram in &at.grams[group.views.clone()] {
                let own = gram.fixed_view::<POSE, POSE>(0, 0) + Matrix3::identity() * MIN_INFORMATION;
                let rest = gram.fixed_view::<POSE, { RESIDUAL + 1 - POSE }>(0, POSE);
                let factor = own.cholesky()?;
                let rows = factor.solve(&rest.into_owned());
                sum += gram.fixed_view::<{ RESIDUAL + 1 - POSE }, { RESIDUAL + 1 - POSE }>(POSE, POSE)
                    - rest.tr_mul(&rows);
                into.half_log_determinant += factor.l_dirty().diagonal().map(f64::ln).sum();
                into.poses.push(rows);
            }
            let mut own = sum.fixed_view::<ALL_MODES, ALL_MODES>(0, 0).into_owned();
            let mut rest = sum.fixed_view::<ALL_MODES, 5>(0, ALL_MODES).into_owned();
            own += prior.information;
            let mut gradient = rest.column_mut(4);
            gradient += prior.gradient(shape);
            let factor = own.cholesky()?;
            let rows = factor.solve(&rest);
            camera += (sum.fixed_view::<5, 5>(ALL_MODES, ALL_MODES) - rest.tr_mul(&rows)) * *trust;
            // The weight would only add a constant.
            into.half_log_determinant += factor.l_dirty().diagonal().map(f64::ln).sum();
            into.shapes.push(rows);
            into.of_shapes.push(sum);
        }
        into.information.copy_from(&camera.fixed_view::<4, 4>(0, 0));
        into.gradient.copy_from(&camera.fixed_view::<4, 1>(0, 4));
        Some(())
    }

    /// Covariance of the camera, prior counted; zero rows where fixed.
    pub fn covariance(&self, eliminated: &Eliminated) -> Option<Matrix4<f64>> {
        self.knowledge.covariance(&eliminated.information)
    }

    /// A Gauss–Newton step of the camera towards the minimum.
    pub fn camera_step(&self, eliminated: &Eliminated, state: &FineState) -> Option<Vector4<f64>> {
        let gradient = eliminated.gradient + self.knowledge.gradient(&state.camera);
        Some(-(self.covariance(eliminated)? * gradient))
    }

    /// The state with the camera changed, cars following along the valley of the minimum, and `share` (0–1) of the cars' own
    /// step to it.
    pub fn moved(
        &self,
        eliminated: &Eliminated,
        from: &FineState,
        camera: &Vector4<f64>,
        share: f64,
        into: &mut FineState,
    ) {
        into.camera = from.camera + camera;
        into.standings.clone_from(&from.standings);
        into.shapes.clone_from(&from.shapes);
        let mut step = SVector::<f64, { RESIDUAL + 1 - POSE }>::zeros();
        step.fixed_rows_mut::<4>(ALL_MODES).copy_from(camera);
        step[ALL_MODES + 4] = share;
        for (g, group) in self.groups.iter().enumerate() {
            let shape = -(eliminated.shapes[g] * step.fixed_rows::<5>(ALL_MODES));
            step.fixed_rows_mut::<ALL_MODES>(0).copy_from(&shape);
            into.shapes[g] += shape;
            for k in group.views.clone() {
                let pose = -(eliminated.poses[k] * step);
                into.standings[k].anchor += Vector2::new(pose[0], pose[1]);
                into.standings[k].heading += pose[2];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fine::tests::at_truth;
    use roadplane_synth::Rng;

    #[test]
    fn rows_are_the_derivatives() {
        let mut rng = Rng::new(8);
        at_truth(4, |atlas, problem, options| {
            let fine = FineProblem::new(atlas, problem, options);
            let shape = FullShape::from_fn(|_, _| rng.normal());
            let standing = problem.state.standings[0];
            let observation = &fine.observations[problem.views[0].observations.clone()][2];
            // Pose, shape, camera.
            let rows = |change: &Row| {
                let camera = CameraFrame::new(&(problem.state.camera + change.fixed_rows::<4>(CAMERA)));
                let anchor = standing.anchor + change.fixed_rows::<2>(0);
                let standing = Standing { anchor, heading: standing.heading + change[2] };
                let frame = StandingFrame::new(&camera, &standing).unwrap();
                fine.rows(observation, &frame, &(shape + change.fixed_rows::<ALL_MODES>(POSE))).unwrap()
            };
            let here = rows(&Row::zeros());
            for i in 0..RESIDUAL {
                let mut step = Row::zeros();
                step[i] = if i < 2 { 1e-3 } else { 1e-6 };
                let (plus, minus) = (rows(&step), rows(&-step));
                for k in 0..2 {
                    let numeric = (plus[k][RESIDUAL] - minus[k][RESIDUAL]) / (2.0 * step[i]);
                    let off = (numeric - here[k][i]).abs();
                    assert!(off < 1e-5 * (1.0 + numeric.abs()), "{i}: {} against {numeric}", here[k][i]);
                }
            }
        });
    }
}
