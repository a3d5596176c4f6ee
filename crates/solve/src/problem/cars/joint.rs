//! The Fisher information that cars give about the camera, if keypoint errors are correlated within a car and between
//! cars.
//!
//! The error model has three parts:
//!
//! - Errors of a car's keypoints are correlated, so m keypoints count as one (`ViewErrors::keypoints_as_one`). Some
//!   cars also have larger errors than others, so each car has a weight w from its misfit (`Misfit::weight`). The cost
//!   of the car's keypoints is multiplied by w / m.
//! - A neural net may place the keypoints of all cars as if each car were seen from a slightly wrong direction. The
//!   model is a rotation R(b) of all cars by two small angles b. One axis is horizontal and perpendicular to the line
//!   of sight, and the other is the line of sight. The first angle also has a given mean, which depends on the side of
//!   the car that the camera sees (`ViewErrors::mean_elevation`).
//! - Errors λ of the lens distortion and the principal point shift the undistorted keypoints x of all cars.
//!
//! The cost of car k is
//!
//! ```text
//! cost_k = w_k / m · ½ |W (π(T_k + R(b) R_k X) − x(λ))|²
//! ```
//!
//! `(T_k, R_k)` is the pose of the car in the camera frame, X a keypoint in the car frame, π the projection and W the
//! whitening. The cost is linearised in b and λ at the minimum for b = 0 and λ = 0. The sds of b and λ change the
//! camera's covariance, and the mean of b changes its estimate. Poses and shapes are eliminated, but b and λ are kept,
//! because all frames of a scene share them (`base/src/shared.rs`).

use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, SMatrix, Vector2, Vector3};
use roadplane_base::{JointInformation, SHARED_ERRORS};

use super::{GroundProblem, View};
use crate::linear::gram::{Gram, MIN_INFORMATION};
use crate::model::observation::Observation;
use crate::model::on_plane::ON_PLANE;
use crate::model::pose::{CameraFrame, Pose as _};
use crate::options::ViewErrors;
use crate::solution::PlaneEvidence;

/// Number of unknowns that all cars share: the camera (4) and the shared errors.
const SHARED: usize = 4 + SHARED_ERRORS;
/// Number of columns of the cars' information: the unknowns that all cars share, and the mean error of the elevation.
const COLUMNS: usize = SHARED + 1;

impl<const M: usize> GroundProblem<'_, M> {
    /// Returns the cars' information on the camera, and the cross information of camera and shared errors.
    ///
    /// The mean of the information is the camera of the problem, corrected for the mean error of the elevation. The
    /// problem must be at its minimum. Returns `None` if a car cannot be evaluated.
    pub fn joint_information(&self, errors: &ViewErrors) -> Option<JointInformation> {
        let mut all = SMatrix::<f64, COLUMNS, COLUMNS>::zeros();
        for (g, group) in self.groups.iter().enumerate() {
            let weight = self.misfit(g, group).weight() / errors.keypoints_as_one;
            let shape_at = ON_PLANE * group.views.len();
            let shared_at = shape_at + M;
            let size = shared_at + COLUMNS;
            let mut sum = DMatrix::<f64>::zeros(size, size);
            let mut row = DVector::<f64>::zeros(size);
            for (place, k) in group.views.clone().enumerate() {
                let view_at = ON_PLANE * place;
                let by_shared_errors = self.by_shared_errors(&self.views[k], k)?;
                let mean_elevation = errors.mean_elevation * self.seen_along(k)?;
                let mut o = 0;
                self.each_row(k, |keypoint| {
                    let root = (keypoint.right * weight).sqrt();
                    for (rows, by_turn) in keypoint.rows.iter().zip(&by_shared_errors[o]) {
                        row.fill(0.0);
                        row.rows_mut(view_at, 3).copy_from_slice(&rows[..3]);
                        row.rows_mut(shape_at, M + 4).copy_from_slice(&rows[3..3 + M + 4]);
                        row.rows_mut(shared_at + 4, SHARED_ERRORS).copy_from_slice(by_turn);
                        row[shared_at + SHARED] = by_turn[0] * mean_elevation;
                        row *= root;
                        sum.syger(1.0, &row, &row, 1.0);
                    }
                    o += 1;
                })?;
                for i in 0..ON_PLANE {
                    sum[(view_at + i, view_at + i)] += MIN_INFORMATION;
                }
            }
            let prior = group.prior_terms(&self.state.shapes[g], self.shape_prior_scale);
            for i in 0..M {
                for j in 0..=i {
                    sum[(shape_at + i, shape_at + j)] += prior.information[(i, j)];
                }
            }
            // Until here, only the lower triangle is filled.
            sum.fill_upper_triangle_with_lower_triangle();
            let own = sum.view((0, 0), (shared_at, shared_at)).into_owned().cholesky()?;
            let cross = sum.view((0, shared_at), (shared_at, COLUMNS)).into_owned();
            let of_shared = sum.fixed_view::<COLUMNS, COLUMNS>(shared_at, shared_at)
                - cross.transpose() * own.solve(&cross);
            all += of_shared;
        }
        let information = all.fixed_view::<4, 4>(0, 0).into_owned();
        let information = (information + information.transpose()) / 2.0;
        let cross = all.fixed_view::<4, SHARED_ERRORS>(0, 4).into_owned();
        let by_mean = all.fixed_view::<4, 1>(0, SHARED);
        let joint =
            JointInformation { information, cross, vector: information * self.state.camera - by_mean };
        joint.vector.iter().chain(cross.iter()).all(|v| v.is_finite()).then_some(joint)
    }

    /// Returns the evidence of each view alone on the plane below its car, for the focal length and shapes of the
    /// problem.
    ///
    /// Call after `linearise`. An entry is `None` if the block of the pose is not positive definite.
    pub fn plane_evidence(&self, keypoints_as_one: f64) -> Vec<Option<PlaneEvidence>> {
        let plane = Gram::<ON_PLANE, M>::CAMERA + 1;
        let evidence = |(view, gram): (&View, &Gram<ON_PLANE, M>)| {
            let weight = self.misfit(view.group, &self.groups[view.group]).weight() / keypoints_as_one;
            let mut work = gram.clone();
            work.eliminate(0, ON_PLANE)?;
            let entry = |i: usize, j: usize| weight * work.rows[plane + i.min(j)][plane + i.max(j)];
            let gradient = Vector3::from_fn(|i, _| weight * work.gradient(plane + i));
            Some(PlaneEvidence { information: Matrix3::from_fn(entry), gradient })
        };
        self.views.iter().zip(&self.linearisation.grams).map(evidence).collect()
    }

    /// Returns cos² of the angle on the ground between the heading of view `k`'s car and the line of sight.
    ///
    /// It is 1 for a car seen from the front or rear, and 0 for one seen from the side. `None` if the camera is
    /// straight above the car.
    fn seen_along(&self, k: usize) -> Option<f64> {
        let camera = CameraFrame::new(&self.state.camera);
        let frame = self.state.poses[k].frame(&camera)?;
        let up = camera.up();
        let level = (frame.origin - up * frame.origin.dot(&up)).try_normalize(1e-9)?;
        let forward: Vector3<f64> = frame.camera_from_car * Vector3::x();
        Some(forward.dot(&level).powi(2))
    }

    /// Returns the derivatives of a view's residuals with respect to the shared errors.
    ///
    /// There is one 2 × 5 matrix per keypoint, whitened and multiplied by the root of the keypoint's weight.
    fn by_shared_errors(&self, view: &View, k: usize) -> Option<Vec<[[f64; SHARED_ERRORS]; 2]>> {
        let camera = CameraFrame::new(&self.state.camera);
        let frame = self.state.poses[k].frame(&camera)?;
        let ray = frame.origin.try_normalize(1e-9)?;
        let axes = [ray.cross(&camera.up()).try_normalize(1e-9)?, ray];
        let shape = &self.state.shapes[view.group];
        let of_one = |observation: &Observation| {
            let offset: Vector3<f64> = frame.camera_from_car * self.model.point(observation.index, shape);
            let p = frame.origin + offset;
            let projection =
                Matrix2x3::new(1.0, 0.0, -p.x / p.z, 0.0, 1.0, -p.y / p.z) * (frame.focal_px / p.z);
            let root = observation.weight.sqrt();
            let root_whitened = |v: Vector2<f64>| observation.whiten([v.x, v.y]).map(|v| v * root);
            let by = axes.map(|axis| {
                let moved: Vector2<f64> = projection * axis.cross(&offset);
                root_whitened(moved)
            });
            let by_lens = root_whitened(-observation.by_lens);
            // A shift of the principal point, together with a rotation of the camera. The rotation keeps the ray
            // through the middle of the image fixed.
            let pixel = observation.pixel;
            let by_point =
                [pixel.x, pixel.y].map(|along| root_whitened(pixel * (along / frame.focal_px.powi(2))));
            [0, 1].map(|axis| [by[0][axis], by[1][axis], by_lens[axis], by_point[0][axis], by_point[1][axis]])
        };
        Some(self.observations[view.observations.clone()].iter().map(of_one).collect())
    }
}
