//! Normal equations of a scene and their elimination.
//!
//! Unknowns: per view of a car a pose v (3), per group (physical car) a shape s (6), one camera c (4). A view touches only its
//! own pose, its group's shape and the camera, so the Hessian is an arrow in two levels. Each view's share is the upper
//! triangle of a matrix over (v, s, c | gradient), and eliminating an unknown is one step of an L D Lᵀ factorisation of it:
//!
//! ```text
//! per view     eliminate v; what remains over (s, c | gradient) is summed over the group's views, plus the shape prior
//! per group    eliminate s; what remains over (c | gradient) is summed over groups, plus the camera prior
//! ```
//!
//! Elimination is linear in views; nothing is allocated. Eliminated rows give the step by substitution, and with damping 0
//! every covariance.

use nalgebra::{Matrix4, Matrix6, SMatrix, Vector4, Vector6};
use roadplane_base::MODES;

/// First column of the shape.
pub(crate) const SHAPE: usize = 3;
/// First column of the camera.
pub(crate) const CAMERA: usize = SHAPE + MODES;
/// Unknowns that a view touches, and the column of the gradient.
pub(crate) const RESIDUAL: usize = CAMERA + 4;

/// Information that every pose coordinate has at least: one that nobody sees gets an sd of 1e6, not a singular matrix.
pub(crate) const MIN_INFORMATION: f64 = 1e-12;

/// Diagonal entries are damped as if at least this large, so that unseen directions are held too.
const MIN_DIAGONAL: f64 = 1e-9;

/// A row, padded to whole SIMD registers; what lies left of the diagonal means nothing.
pub(crate) type Row = [f64; 16];

/// Covariance of (pose, shape, camera).
pub(crate) type Joint = SMatrix<f64, RESIDUAL, RESIDUAL>;

/// One view's share of Hessian and gradient.
#[derive(Clone, Debug)]
#[repr(align(32))]
pub(crate) struct Gram {
    pub rows: [Row; RESIDUAL],
}

/// The camera's system: what is left when all else is eliminated.
pub(crate) type CameraRows = [Row; 4];

/// One group's shape.
#[derive(Clone, Debug)]
pub(crate) struct GroupBlock {
    /// Coefficients held this iteration (at a bound, or fixed).
    pub held: [bool; MODES],
    /// Gradient by shape, all of it.
    pub gradient: Vector6<f64>,
    /// Diagonal of the undamped Hessian.
    pub diagonal: Vector6<f64>,
    rows: [Row; MODES],
}

/// A view's eliminated pose.
#[derive(Clone, Debug)]
pub(crate) struct PoseBlock {
    rows: [Row; SHAPE],
}

impl Gram {
    pub const fn zeros() -> Self {
        Self { rows: [[0.0; 16]; RESIDUAL] }
    }

    /// Diagonal entry of the Hessian.
    pub fn diagonal(&self, i: usize) -> f64 {
        self.rows[i][i]
    }

    /// Entry of the gradient.
    pub fn gradient(&self, i: usize) -> f64 {
        self.rows[i][RESIDUAL]
    }

    fn damp(&mut self, i: usize, damping: f64, diagonal: f64) {
        self.rows[i][i] += damping * diagonal.max(MIN_DIAGONAL) + MIN_INFORMATION;
    }

    /// Eliminates unknowns FROM … TO − 1. `None` when their block is not positive definite.
    #[inline]
    fn eliminate<const FROM: usize, const TO: usize>(&mut self) -> Option<()> {
        for i in FROM..TO {
            let own = self.rows[i];
            let inverse = 1.0 / own[i];
            if !(inverse > 0.0 && inverse.is_finite()) {
                return None;
            }
            for (j, row) in self.rows.iter_mut().enumerate().skip(i + 1) {
                let factor = own[j] * inverse;
                for register in j / 4..4 {
                    for c in 4 * register..4 * register + 4 {
                        row[c] -= factor * own[c];
                    }
                }
            }
        }
        Some(())
    }
}

/// From eliminated rows (unknowns FROM …) and the values of all later unknowns the values of these.
#[inline]
fn substitute<const FROM: usize, const COUNT: usize>(rows: &[Row; COUNT], x: &mut Row) {
    for (i, row) in rows.iter().enumerate().rev() {
        let sum: f64 = (FROM + i + 1..=RESIDUAL).map(|j| row[j] * x[j]).sum();
        x[FROM + i] = -sum / row[FROM + i];
    }
}

/// The same for covariances: fills in rows and columns FROM …; an unknown of which `held` is true is exactly known.
fn spread<const FROM: usize, const COUNT: usize>(
    rows: &[Row; COUNT],
    held: &[bool; COUNT],
    joint: &mut Joint,
) {
    for (i, row) in rows.iter().enumerate().rev() {
        let own = FROM + i;
        if held[i] {
            continue;
        }
        let pivot = row[own];
        for k in own + 1..RESIDUAL {
            let sum: f64 = (own + 1..RESIDUAL).map(|j| row[j] * joint[(j, k)]).sum();
            joint[(own, k)] = -sum / pivot;
            joint[(k, own)] = joint[(own, k)];
        }
        let sum: f64 = (own + 1..RESIDUAL).map(|j| row[j] * joint[(j, own)]).sum();
        joint[(own, own)] = (1.0 - sum) / pivot;
    }
}

impl PoseBlock {
    pub const fn zeros() -> Self {
        Self { rows: [[0.0; 16]; SHAPE] }
    }

    /// Completes a step of (shape, camera) with this pose's.
    pub fn substitute(&self, step: &mut Row) {
        substitute::<0, SHAPE>(&self.rows, step);
    }

    /// Completes the covariance of (shape, camera) with this pose's.
    pub fn spread(&self, joint: &mut Joint) {
        spread::<0, SHAPE>(&self.rows, &[false; SHAPE], joint);
    }
}

impl GroupBlock {
    pub fn zeros() -> Self {
        Self {
            held: [false; MODES],
            gradient: Vector6::zeros(),
            diagonal: Vector6::zeros(),
            rows: [[0.0; 16]; MODES],
        }
    }

    /// Eliminates the group's views and shape; adds what remains to the camera's system.
    pub fn eliminate(
        &mut self,
        views: &[Gram],
        poses: &mut [PoseBlock],
        damping: f64,
        prior_information: &Matrix6<f64>,
        prior_gradient: &Vector6<f64>,
        camera: &mut CameraRows,
    ) -> Option<()> {
        let mut keep = |k: usize, rows: &[Row; RESIDUAL]| poses[k].rows.copy_from_slice(&rows[..SHAPE]);
        let system = self.shape_system(views, damping, prior_information, prior_gradient, &mut keep)?;
        self.rows.copy_from_slice(&system.rows[SHAPE..CAMERA]);
        for (sum, row) in camera.iter_mut().zip(&system.rows[CAMERA..]) {
            for (sum, entry) in sum.iter_mut().zip(row) {
                *sum += entry;
            }
        }
        Some(())
    }

    /// The group's system with poses and shape eliminated; `see` gets the rows of every view with its pose eliminated.
    #[inline]
    fn shape_system(
        &self,
        views: &[Gram],
        damping: f64,
        prior_information: &Matrix6<f64>,
        prior_gradient: &Vector6<f64>,
        see: &mut impl FnMut(usize, &[Row; RESIDUAL]),
    ) -> Option<Gram> {
        let mut system = Gram::zeros();
        for (k, view) in views.iter().enumerate() {
            let mut work = view.clone();
            for i in 0..SHAPE {
                work.damp(i, damping, view.diagonal(i));
            }
            work.eliminate::<0, SHAPE>()?;
            see(k, &work.rows);
            for (sum, row) in system.rows.iter_mut().zip(&work.rows).skip(SHAPE) {
                for (sum, entry) in sum.iter_mut().zip(row) {
                    *sum += entry;
                }
            }
        }
        for i in 0..MODES {
            for j in i..MODES {
                system.rows[SHAPE + i][SHAPE + j] += prior_information[(i, j)];
            }
            system.rows[SHAPE + i][RESIDUAL] += prior_gradient[i];
            system.damp(SHAPE + i, damping, self.diagonal[i]);
        }
        for own in (0..MODES).filter(|j| self.held[*j]).map(|j| SHAPE + j) {
            for row in &mut system.rows[SHAPE..own] {
                row[own] = 0.0;
            }
            system.rows[own].fill(0.0);
            system.rows[own][own] = 1.0;
        }
        system.eliminate::<SHAPE, CAMERA>()?;
        Some(system)
    }

    /// `log det` of the Hessian of the group's shape and poses, nothing damped.
    pub fn log_determinant(&self, views: &[Gram], prior_information: &Matrix6<f64>) -> Option<f64> {
        let mut sum = 0.0;
        let mut see =
            |_: usize, rows: &[Row; RESIDUAL]| sum += (0..SHAPE).map(|i| rows[i][i].ln()).sum::<f64>();
        let no_gradient = Vector6::zeros();
        let system = self.shape_system(views, 0.0, prior_information, &no_gradient, &mut see)?;
        Some(sum + (SHAPE..CAMERA).map(|i| system.rows[i][i].ln()).sum::<f64>())
    }

    /// Step of (shape, camera) that belongs to a camera step; the place of the pose is open.
    pub fn step(&self, camera: &Vector4<f64>) -> Row {
        self.step_with(camera, 1.0)
    }

    /// The same from a minimum: how shapes (and poses) follow the camera, whatever is left of the gradient.
    pub fn follow(&self, camera: &Vector4<f64>) -> Row {
        self.step_with(camera, 0.0)
    }

    fn step_with(&self, camera: &Vector4<f64>, gradient: f64) -> Row {
        let mut step = [0.0; 16];
        step[CAMERA..RESIDUAL].copy_from_slice(camera.as_slice());
        step[RESIDUAL] = gradient;
        substitute::<SHAPE, MODES>(&self.rows, &mut step);
        step
    }

    /// Covariance of (shape, camera) from that of the camera; the place of the pose is open.
    pub fn joint(&self, camera: &Matrix4<f64>) -> Joint {
        let mut joint = Joint::zeros();
        joint.fixed_view_mut::<4, 4>(CAMERA, CAMERA).copy_from(camera);
        spread::<SHAPE, MODES>(&self.rows, &self.held, &mut joint);
        joint
    }
}

/// Hessian and gradient of the camera's system.
pub(crate) fn camera_system(rows: &CameraRows) -> (Matrix4<f64>, Vector4<f64>) {
    let hessian = Matrix4::from_fn(|i, j| rows[i.min(j)][CAMERA + i.max(j)]);
    (hessian, Vector4::from_fn(|i, _| rows[i][RESIDUAL]))
}
