//! Normal equations of a scene and their elimination.
//!
//! The unknowns are a pose v (N) for each view of a car, a shape s (M modes) for each group, and one camera c (4). A
//! group is one physical car. A view depends only on its own pose, its group's shape and the camera, so the Hessian is
//! an arrow of two levels. Each view contributes the upper triangle of a matrix over (v, s, c | gradient). Eliminating
//! an unknown is one step of its L D Lᵀ factorisation:
//!
//! ```text
//! per view     eliminate v; sum the rest over (s, c | gradient) over the group's views, plus the shape prior
//! per group    eliminate s; sum the rest over (c | gradient) over the groups, plus the camera prior
//! ```
//!
//! Elimination takes time linear in the number of views and allocates nothing. The eliminated rows give the step by
//! substitution, and with damping 0 all covariances.

use nalgebra::{Matrix4, SMatrix, SVector, Vector4};

use crate::linear::gram::{Gram, MAX_UNKNOWNS, MAX_WIDTH, Row};

/// Covariance of (pose, shape, camera), in its first rows and columns.
pub(crate) type Joint = SMatrix<f64, MAX_UNKNOWNS, MAX_UNKNOWNS>;

/// Normal equations of the camera, after all poses and shapes are eliminated.
pub(crate) type CameraRows = [Row; 4];

/// Information of a shape prior, and the gradient of its cost at the current shape.
pub(crate) struct PriorTerms<const M: usize> {
    pub information: SMatrix<f64, M, M>,
    pub gradient: SVector<f64, M>,
}

/// The eliminated shape of one group.
#[derive(Clone, Debug)]
pub(crate) struct GroupBlock<const N: usize, const M: usize> {
    /// Coefficients that do not move in this iteration: at a bound, or fixed by the caller.
    pub fixed: [bool; M],
    /// Gradient of the whole cost by the shape.
    pub gradient: SVector<f64, M>,
    /// Diagonal of the undamped Hessian.
    pub diagonal: SVector<f64, M>,
    rows: [Row; M],
}

/// The eliminated pose of one view.
#[derive(Clone, Debug)]
pub(crate) struct PoseBlock<const N: usize, const M: usize> {
    rows: [Row; N],
}

/// Computes the values of eliminated unknowns (from index `from` on) from the values of all later ones, by
/// substitution.
#[inline]
fn substitute(residual: usize, from: usize, rows: &[Row], x: &mut Row) {
    for (i, row) in rows.iter().enumerate().rev() {
        let sum: f64 = (from + i + 1..=residual).map(|j| row[j] * x[j]).sum();
        x[from + i] = -sum / row[from + i];
    }
}

/// Computes rows and columns of a covariance (from index `from` on) from those of all later unknowns.
///
/// An unknown whose `fixed` is true has no variance.
fn spread(residual: usize, from: usize, rows: &[Row], fixed: &[bool], joint: &mut Joint) {
    for (i, row) in rows.iter().enumerate().rev() {
        let own = from + i;
        if fixed[i] {
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

    /// Adds this pose's step to a step of (shape, camera).
    pub fn substitute(&self, step: &mut Row) {
        substitute(Gram::<N, M>::RESIDUAL, 0, &self.rows, step);
    }

    /// Adds this pose's rows and columns to the covariance of (shape, camera).
    pub fn spread(&self, joint: &mut Joint) {
        spread(Gram::<N, M>::RESIDUAL, 0, &self.rows, &[false; N], joint);
    }
}

impl<const N: usize, const M: usize> GroupBlock<N, M> {
    const CAMERA: usize = Gram::<N, M>::CAMERA;
    const RESIDUAL: usize = Gram::<N, M>::RESIDUAL;

    pub fn zeros() -> Self {
        Self {
            fixed: [false; M],
            gradient: SVector::zeros(),
            diagonal: SVector::zeros(),
            rows: [[0.0; MAX_WIDTH]; M],
        }
    }

    /// Eliminates the group's views and shape, and adds the rest, times `weight`, to the camera's equations.
    ///
    /// Returns `None` if a block is not positive definite.
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

    /// Returns the views' equations over shape and camera with their poses eliminated.
    ///
    /// `see` is called with each view's index and its equations after elimination.
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

    /// Returns the group's equations with the shape prior added, and poses and shape eliminated.
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
        for own in (0..M).filter(|j| self.fixed[*j]).map(|j| N + j) {
            for row in &mut system.rows[N..own] {
                row[own] = 0.0;
            }
            system.rows[own].fill(0.0);
            system.rows[own][own] = 1.0;
        }
        system.eliminate(N, Self::CAMERA)?;
        Some(system)
    }

    /// Returns the information of the group's keypoints alone on its shape, and the gradient of their cost.
    ///
    /// Poses are eliminated and the camera is fixed.
    pub fn of_keypoints(views: &[Gram<N, M>]) -> Option<PriorTerms<M>> {
        let system = Self::views_system(views, 0.0, &mut |_, _| ())?;
        let entry = |i: usize, j: usize| system.rows[N + i.min(j)][N + i.max(j)];
        Some(PriorTerms {
            information: SMatrix::from_fn(entry),
            gradient: SVector::from_fn(|i, _| system.rows[N + i][Self::RESIDUAL]),
        })
    }

    /// Returns the step of (shape, camera) that belongs to a camera step; the entries of the pose are not set.
    ///
    /// `gradient` scales the gradient: 1 for a step of the descent, 0 to move shapes (and poses) along with the camera.
    pub fn step(&self, camera_step: &Vector4<f64>, gradient: f64) -> Row {
        let mut step = [0.0; MAX_WIDTH];
        step[Self::CAMERA..Self::RESIDUAL].copy_from_slice(camera_step.as_slice());
        step[Self::RESIDUAL] = gradient;
        substitute(Self::RESIDUAL, N, &self.rows, &mut step);
        step
    }

    /// Returns column d of U, where U Uᵀ is the covariance of (pose, shape) given the camera.
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

    /// Returns the covariance of (shape, camera), given that of the camera; the entries of the pose are not set.
    pub fn joint(&self, of_camera: &Matrix4<f64>) -> Joint {
        let mut joint = Joint::zeros();
        joint.view_mut((Self::CAMERA, Self::CAMERA), (4, 4)).copy_from(of_camera);
        spread(Self::RESIDUAL, N, &self.rows, &self.fixed, &mut joint);
        joint
    }
}

/// Returns Hessian and gradient of the camera's equations.
pub(crate) fn camera_system<const N: usize, const M: usize>(
    rows: &CameraRows,
) -> (Matrix4<f64>, Vector4<f64>) {
    let hessian = Matrix4::from_fn(|i, j| rows[i.min(j)][Gram::<N, M>::CAMERA + i.max(j)]);
    (hessian, Vector4::from_fn(|i, _| rows[i][Gram::<N, M>::RESIDUAL]))
}
