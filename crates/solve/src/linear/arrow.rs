//! Normal equations of a scene, and their solution by elimination.
//!
//! There are three kinds of unknowns:
//!
//! - v: the pose of a car in one view (N numbers);
//! - s: the shape of a group (M coefficients), where a group is all views of one physical car;
//! - c: the camera (4 numbers).
//!
//! A view depends only on its own pose, its group's shape and the camera. So the Hessian has the shape of an arrow with
//! two levels. Each view contributes a matrix with the columns (v, s, c, gradient), of which the upper triangle is
//! stored. The matrix is factorised as L D Lᵀ, and each step of the factorisation eliminates one unknown:
//!
//! ```text
//! for each view     eliminate v; add the remaining equations in (s, c) to those of the group
//! for each group    add the shape prior; eliminate s; add the remaining equations in c to those of the camera
//! ```
//!
//! Elimination takes time linear in the number of views and allocates nothing. The descent's step follows from the
//! eliminated rows by back substitution. If the damping was 0, all covariances follow from the same rows.

use nalgebra::{Matrix4, SMatrix, SVector, Vector4};

use crate::linear::gram::{Gram, MAX_UNKNOWNS, MAX_WIDTH, Row};

/// Joint covariance of (pose, shape, camera), stored in the first rows and columns of a matrix of fixed size.
pub(crate) type Joint = SMatrix<f64, MAX_UNKNOWNS, MAX_UNKNOWNS>;

/// Normal equations of the camera that remain after all poses and shapes are eliminated.
pub(crate) type CameraRows = [Row; 4];

/// Information of a shape prior, and the gradient of its cost at the current shape.
pub(crate) struct PriorTerms<const M: usize> {
    pub information: SMatrix<f64, M, M>,
    pub gradient: SVector<f64, M>,
}

/// The shape of one group (physical car) after its elimination from the normal equations.
#[derive(Clone, Debug)]
pub(crate) struct GroupBlock<const N: usize, const M: usize> {
    /// Whether each coefficient is fixed in this iteration: it is at a bound, or the caller fixed it.
    pub fixed: [bool; M],
    /// Gradient of the group's cost with respect to the shape.
    pub gradient: SVector<f64, M>,
    /// Diagonal of the shape's undamped Hessian.
    pub diagonal: SVector<f64, M>,
    rows: [Row; M],
}

/// The pose of one view after its elimination from the normal equations.
#[derive(Clone, Debug)]
pub(crate) struct PoseBlock<const N: usize, const M: usize> {
    rows: [Row; N],
}

/// Computes the values of eliminated unknowns by back substitution.
///
/// `x` must contain the values of all later unknowns. The eliminated unknowns have the indices from `from` on, one per
/// row. `residual` is the column of the right-hand side.
#[inline]
fn substitute(residual: usize, from: usize, rows: &[Row], x: &mut Row) {
    for (i, row) in rows.iter().enumerate().rev() {
        let sum: f64 = (from + i + 1..=residual).map(|j| row[j] * x[j]).sum();
        x[from + i] = -sum / row[from + i];
    }
}

/// Computes the rows and columns of eliminated unknowns in the covariance `joint`.
///
/// `joint` must contain the rows and columns of all later unknowns. The eliminated unknowns have the indices from
/// `from` on, one per row. An unknown whose `fixed` is true gets the variance 0.
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

    /// Computes the pose entries of a step from its shape and camera entries, which must be set.
    pub fn substitute(&self, step: &mut Row) {
        substitute(Gram::<N, M>::RESIDUAL, 0, &self.rows, step);
    }

    /// Computes the pose entries of a covariance from its shape and camera entries, which must be set.
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

    /// Eliminates the group's poses and shape, and adds the remaining equations to `camera_rows`.
    ///
    /// The added equations are multiplied by `weight`. Returns `None` if a block is not positive definite.
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

    /// Returns the sum of the views' equations in shape and camera, after the poses are eliminated.
    ///
    /// `see` is called with the index of each view and its equations after elimination.
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

    /// Returns the group's equations, including its shape prior, after poses and shape are eliminated.
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

    /// Returns the keypoints' information on the group's shape, and the gradient of the keypoints' cost.
    ///
    /// The shape prior is not included. Poses are eliminated and the camera is fixed. Returns `None` if the block of a
    /// pose is not positive definite.
    pub fn of_keypoints(views: &[Gram<N, M>]) -> Option<PriorTerms<M>> {
        let system = Self::views_system(views, 0.0, &mut |_, _| ())?;
        let entry = |i: usize, j: usize| system.rows[N + i.min(j)][N + i.max(j)];
        Some(PriorTerms {
            information: SMatrix::from_fn(entry),
            gradient: SVector::from_fn(|i, _| system.rows[N + i][Self::RESIDUAL]),
        })
    }

    /// Returns a row with the given step of the camera and the step of the shape that follows from it.
    ///
    /// The entries of the pose are not set. The gradient is multiplied by `gradient`, which is 1 for a step of the
    /// descent. With 0, the step only moves the shape to its minimum for the changed camera.
    pub fn step(&self, camera_step: &Vector4<f64>, gradient: f64) -> Row {
        let mut step = [0.0; MAX_WIDTH];
        step[Self::CAMERA..Self::RESIDUAL].copy_from_slice(camera_step.as_slice());
        step[Self::RESIDUAL] = gradient;
        substitute(Self::RESIDUAL, N, &self.rows, &mut step);
        step
    }

    /// Returns the d-th column of a matrix U, where U Uᵀ is the covariance of (pose, shape) for a fixed camera.
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

    /// Returns the joint covariance of (shape, camera) for the given covariance of the camera.
    ///
    /// The entries of the pose are not set.
    pub fn joint(&self, of_camera: &Matrix4<f64>) -> Joint {
        let mut joint = Joint::zeros();
        joint.view_mut((Self::CAMERA, Self::CAMERA), (4, 4)).copy_from(of_camera);
        spread(Self::RESIDUAL, N, &self.rows, &self.fixed, &mut joint);
        joint
    }
}

/// Returns the Hessian and the gradient that the camera's equations contain.
pub(crate) fn camera_system<const N: usize, const M: usize>(
    rows: &CameraRows,
) -> (Matrix4<f64>, Vector4<f64>) {
    let hessian = Matrix4::from_fn(|i, j| rows[i.min(j)][Gram::<N, M>::CAMERA + i.max(j)]);
    (hessian, Vector4::from_fn(|i, _| rows[i][Gram::<N, M>::RESIDUAL]))
}
