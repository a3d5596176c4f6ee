//! Normal equations of a scene and their elimination.
//!
//! Unknowns: per view of a car a pose v (N), per group (physical car) a shape s (M modes), one camera c (4). A view touches only
//! its own pose, its group's shape and the camera, so the Hessian is an arrow in two levels. Each view's share is the upper
//! triangle of a matrix over (v, s, c | gradient), and eliminating an unknown is one step of an L D Lᵀ factorisation of it:
//!
//! ```text
//! per view     eliminate v; what remains over (s, c | gradient) is summed over the group's views, plus the shape prior
//! per group    eliminate s; what remains over (c | gradient) is summed over groups, plus the camera prior
//! ```
//!
//! Elimination is linear in views; nothing is allocated. Eliminated rows give the step by substitution, and with damping 0
//! every covariance.

use nalgebra::{Matrix4, SMatrix, SVector, Vector4};

use crate::linear::gram::{Gram, MAX_UNKNOWNS, MAX_WIDTH, Row};

/// Covariance of (pose, shape, camera), in its first rows and columns.
pub(crate) type Joint = SMatrix<f64, MAX_UNKNOWNS, MAX_UNKNOWNS>;

/// The camera's system: what is left when all else is eliminated.
pub(crate) type CameraRows = [Row; 4];

/// What is known of a shape at its current value: information, and gradient of the prior's cost.
pub(crate) struct PriorTerms<const M: usize> {
    pub information: SMatrix<f64, M, M>,
    pub gradient: SVector<f64, M>,
}

/// One group's shape.
#[derive(Clone, Debug)]
pub(crate) struct GroupBlock<const N: usize, const M: usize> {
    /// Coefficients held this iteration (at a bound, or fixed).
    pub held: [bool; M],
    /// Gradient by shape, all of it.
    pub gradient: SVector<f64, M>,
    /// Diagonal of the undamped Hessian.
    pub diagonal: SVector<f64, M>,
    rows: [Row; M],
}

/// A view's eliminated pose.
#[derive(Clone, Debug)]
pub(crate) struct PoseBlock<const N: usize, const M: usize> {
    rows: [Row; N],
}

/// From eliminated rows (unknowns `from` …) and the values of all later unknowns, up to the `residual`, the values of these.
#[inline]
fn substitute(residual: usize, from: usize, rows: &[Row], x: &mut Row) {
    for (i, row) in rows.iter().enumerate().rev() {
        let sum: f64 = (from + i + 1..=residual).map(|j| row[j] * x[j]).sum();
        x[from + i] = -sum / row[from + i];
    }
}

/// The same for covariances: fills in rows and columns `from` …; an unknown of which `held` is true is exactly known.
fn spread(residual: usize, from: usize, rows: &[Row], held: &[bool], joint: &mut Joint) {
    for (i, row) in rows.iter().enumerate().rev() {
        let own = from + i;
        if held[i] {
            continue;
        }
        let pivot = row[own];
        for k in own + 1..residual {
            let sum: f64 = (own + 1..residual).map(|j| row[j] * joint[(j, k)]).sum();
            joint[(own, k)] = -sum / pivot;
            joint[(k, own)] = joint[(own, k)];
        }
        let sum: f64 = (own + 1..residual).map(|j| row[j] * joint[(j, own)]).sum();
        joint[(own, own)] = (1.0 - sum) / pivot;
    }
}

impl<const N: usize, const M: usize> PoseBlock<N, M> {
    pub const fn zeros() -> Self {
        Self { rows: [[0.0; MAX_WIDTH]; N] }
    }

    /// Completes a step of (shape, camera) with this pose's.
    pub fn substitute(&self, step: &mut Row) {
        substitute(Gram::<N, M>::RESIDUAL, 0, &self.rows, step);
    }

    /// Completes the covariance of (shape, camera) with this pose's.
    pub fn spread(&self, joint: &mut Joint) {
        spread(Gram::<N, M>::RESIDUAL, 0, &self.rows, &[false; N], joint);
    }
}

impl<const N: usize, const M: usize> GroupBlock<N, M> {
    const CAMERA: usize = Gram::<N, M>::CAMERA;
    const RESIDUAL: usize = Gram::<N, M>::RESIDUAL;

    pub fn zeros() -> Self {
        Self {
            held: [false; M],
            gradient: SVector::zeros(),
            diagonal: SVector::zeros(),
            rows: [[0.0; MAX_WIDTH]; M],
        }
    }

    /// Eliminates the group's views and shape; adds what remains, times `weight`, to the camera's system.
    pub fn eliminate(
        &mut self,
        views: &[Gram<N, M>],
        poses: &mut [PoseBlock<N, M>],
        damping: f64,
        prior: &PriorTerms<M>,
        weight: f64,
        camera_rows: &mut CameraRows,
    ) -> Option<()> {
        let mut keep = |k: usize, view: &Gram<N, M>| poses[k].rows.copy_from_slice(&view.rows[..N]);
        let system = self.shape_system(views, damping, prior, &mut keep)?;
        self.rows.copy_from_slice(&system.rows[N..Self::CAMERA]);
        for (sum, row) in camera_rows.iter_mut().zip(&system.rows[Self::CAMERA..]) {
            for (sum, entry) in sum.iter_mut().zip(row) {
                *sum += weight * entry;
            }
        }
        Some(())
    }

    /// The views' system over shape and camera, their poses eliminated; `see` gets every view's with its pose eliminated.
    #[inline]
    fn views_system(
        views: &[Gram<N, M>],
        damping: f64,
        see: &mut impl FnMut(usize, &Gram<N, M>),
    ) -> Option<Gram<N, M>> {
        let mut system = Gram::<N, M>::zeros();
        for (k, view) in views.iter().enumerate() {
            let mut work = view.clone();
            for i in 0..N {
                work.damp(i, damping, view.diagonal(i));
            }
            work.eliminate(0, N)?;
            see(k, &work);
            system.add_shape_and_camera(&work);
        }
        Some(system)
    }

    /// The same with the prior, and the shape eliminated.
    #[inline]
    fn shape_system(
        &self,
        views: &[Gram<N, M>],
        damping: f64,
        prior: &PriorTerms<M>,
        see: &mut impl FnMut(usize, &Gram<N, M>),
    ) -> Option<Gram<N, M>> {
        let mut system = Self::views_system(views, damping, see)?;
        for i in 0..M {
            for j in i..M {
                system.rows[N + i][N + j] += prior.information[(i, j)];
            }
            system.rows[N + i][Self::RESIDUAL] += prior.gradient[i];
            system.damp(N + i, damping, self.diagonal[i]);
        }
        for own in (0..M).filter(|j| self.held[*j]).map(|j| N + j) {
            for row in &mut system.rows[N..own] {
                row[own] = 0.0;
            }
            system.rows[own].fill(0.0);
            system.rows[own][own] = 1.0;
        }
        system.eliminate(N, Self::CAMERA)?;
        Some(system)
    }

    /// What the group's keypoints alone say of its shape, poses eliminated and the camera held: information, and gradient of
    /// their cost.
    pub fn of_keypoints(views: &[Gram<N, M>]) -> Option<PriorTerms<M>> {
        let system = Self::views_system(views, 0.0, &mut |_, _| ())?;
        let entry = |i: usize, j: usize| system.rows[N + i.min(j)][N + i.max(j)];
        Some(PriorTerms {
            information: SMatrix::from_fn(entry),
            gradient: SVector::from_fn(|i, _| system.rows[N + i][Self::RESIDUAL]),
        })
    }

    /// Step of (shape, camera) that belongs to a camera step; the place of the pose is open. With so much of the gradient: 0 from a
    /// minimum, where shapes (and poses) follow the camera whatever is left of it.
    pub fn step(&self, camera_step: &Vector4<f64>, gradient: f64) -> Row {
        let mut step = [0.0; MAX_WIDTH];
        step[Self::CAMERA..Self::RESIDUAL].copy_from_slice(camera_step.as_slice());
        step[Self::RESIDUAL] = gradient;
        substitute(Self::RESIDUAL, N, &self.rows, &mut step);
        step
    }

    /// Column d of U, where U Uᵀ is the covariance of (pose, shape) given the camera.
    pub fn column(&self, pose: &PoseBlock<N, M>, d: usize) -> Row {
        let mut step = [0.0; MAX_WIDTH];
        let (from, rows) = if d < N { (0, &pose.rows[..]) } else { (N, &self.rows[..]) };
        step[d] = 1.0 / rows[d - from][d].sqrt();
        substitute(Self::RESIDUAL, from, &rows[..d - from], &mut step);
        if from == N {
            pose.substitute(&mut step);
        }
        step
    }

    /// Covariance of (shape, camera) from that of the camera; the place of the pose is open.
    pub fn joint(&self, of_camera: &Matrix4<f64>) -> Joint {
        let mut joint = Joint::zeros();
        joint.view_mut((Self::CAMERA, Self::CAMERA), (4, 4)).copy_from(of_camera);
        spread(Self::RESIDUAL, N, &self.rows, &self.held, &mut joint);
        joint
    }
}

/// Hessian and gradient of the camera's system.
pub(crate) fn camera_system<const N: usize, const M: usize>(
    rows: &CameraRows,
) -> (Matrix4<f64>, Vector4<f64>) {
    let hessian = Matrix4::from_fn(|i, j| rows[i.min(j)][Gram::<N, M>::CAMERA + i.max(j)]);
    (hessian, Vector4::from_fn(|i, _| rows[i][Gram::<N, M>::RESIDUAL]))
}
