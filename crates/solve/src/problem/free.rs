//! Cars with free poses, each drawn to the plane by the paper's two terms (Eq. 6, 7):
//!
//! ```text
//! E = Σ_k [ ½ D_p2p² / σ_p² + ½ ‖D_v2v‖² / σ_v² + Σ_i ½ s_i ρ(‖W_i r_ki‖²) + ½ ‖λ_k − μ_k‖²_Λ ] + ½ ‖c − c₀‖²_P
//! ```
//!
//! Shapes have the prior of all cars, N(0, I), or that of their body types. The paper's μ₁ and μ₂ are `1/σ_p²` and `1/σ_v²` (m and rad). Cars couple through the camera alone: arrow, one level.

mod block;

use nalgebra::{Matrix2, Matrix4, SMatrix, Vector4};
use roadplane_base::{ClueTerms, MODES, ShapeAtlas};

use crate::linear::lm::{Problem, Trial};
use crate::model::camera_prior::CameraKnowledge;
use crate::model::free::{FreeCar, FreeFrame};
use crate::model::ground::{CameraFrame, PointModes};
use crate::model::kernel::OutlierModel;
use crate::model::latent::body_types::{BodyTypes, Gaussian};
use crate::model::observation::Observation;
use block::{Block, CarMatrix, CarVector};

/// How strongly cars are drawn to the plane: the sd of their distance and of their angle; `None`: not at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneTerms {
    /// σ_p, m.
    pub distance_sd_m: f64,
    /// σ_v, rad.
    pub angle_sd: f64,
}

/// See the module's head.
pub(crate) struct FreeProblem<'a> {
    atlas: &'a ShapeAtlas,
    model: &'a PointModes,
    /// Per car.
    pub observations: Vec<Vec<Observation>>,
    /// What is known of each car's shape.
    pub priors: Vec<Gaussian<MODES>>,
    pub knowledge: CameraKnowledge,
    pub kernel: OutlierModel,
    pub plane: Option<PlaneTerms>,
    pub shapes_fixed: bool,
    pub camera: Vector4<f64>,
    pub cars: Vec<FreeCar>,
    trial_camera: Vector4<f64>,
    trial_cars: Vec<FreeCar>,
    blocks: Vec<Block>,
    known: ClueTerms,
    camera_gradient: Vector4<f64>,
    camera_diagonal: Vector4<f64>,
    cost: f64,
}

impl<'a> FreeProblem<'a> {
    pub fn new(
        atlas: &'a ShapeAtlas,
        model: &'a PointModes,
        observations: Vec<Vec<Observation>>,
        knowledge: CameraKnowledge,
        camera: Vector4<f64>,
        cars: Vec<FreeCar>,
    ) -> Self {
        let block = Block {
            sum: [[0.0; 16]; 16],
            gradient: [0.0; 16],
            held: [false; MODES],
            gain: SMatrix::zeros(),
            offset: CarVector::zeros(),
            inverse: CarMatrix::zeros(),
        };
        Self {
            atlas,
            model,
            blocks: vec![block; cars.len()],
            observations,
            priors: vec![Gaussian::of_all_cars(1.0); cars.len()],
            knowledge,
            kernel: OutlierModel::default(),
            plane: None,
            shapes_fixed: false,
            camera,
            trial_camera: camera,
            trial_cars: cars.clone(),
            cars,
            known: ClueTerms { gradient: Vector4::zeros(), information: Matrix4::zeros() },
            camera_gradient: Vector4::zeros(),
            camera_diagonal: Vector4::zeros(),
            cost: f64::INFINITY,
        }
    }

    /// Whitens with the measured covariance plus `extra_m` metres, seen at the car's depth.
    pub fn whiten(&mut self, atlas_scale: f64, extra_m: f64) {
        for (car, observations) in self.cars.iter().zip(&mut self.observations) {
            let px_per_m = (-car.log_depth_ratio).exp();
            for o in observations {
                // The atlas' own residual as the same in all directions: free poses are the coarse path.
                let atlas =
                    atlas_scale * atlas_scale * self.atlas.residual_sd_m[o.index].norm_squared() / 3.0;
                o.whiten_with(&(Matrix2::identity() * ((extra_m * extra_m + atlas) * px_per_m * px_per_m)));
            }
        }
    }

    /// Cost of one car before a camera; `None` behind it.
    fn car_cost(&self, camera: &CameraFrame, k: usize, car: &FreeCar) -> Option<f64> {
        let frame = FreeFrame::new(camera.focal_px, car);
        let mut cost = self.priors[k].cost(&car.shape);
        for o in &self.observations[k] {
            let off = frame.project(&self.model.point(o.index, &car.shape))? - o.pixel;
            let [rx, ry] = o.whiten([off.x, off.y]);
            cost += 0.5 * o.weight * self.kernel.cost(rx * rx + ry * ry);
        }
        if let Some(plane) = self.plane {
            let (terms, _) = frame.plane_terms(camera);
            cost += 0.5 * (terms[0] / plane.distance_sd_m).powi(2);
            cost += 0.5 * terms[1..].iter().map(|t| (t / plane.angle_sd).powi(2)).sum::<f64>();
        }
        Some(cost)
    }

    /// Takes for each car's prior that of the body types it may have. After `linearise`.
    pub fn tell_types(&mut self, types: &BodyTypes<MODES>) {
        for ((block, prior), car) in self.blocks.iter().zip(&mut self.priors).zip(&self.cars) {
            if let Some((information, gradient)) = block.of_shape(prior, &car.shape) {
                types.tell(prior, &car.shape, &information, &gradient);
            }
        }
    }

    fn camera_cost(&self, camera: &Vector4<f64>) -> f64 {
        self.knowledge.cost(camera)
    }

    fn linearise_car(&mut self, camera: &CameraFrame, k: usize) -> Option<f64> {
        let car = self.cars[k];
        let cost = self.car_cost(camera, k, &car)?;
        let frame = FreeFrame::new(camera.focal_px, &car);
        let block = &mut self.blocks[k];
        block.sum = [[0.0; 16]; 16];
        block.gradient = [0.0; 16];
        for o in &self.observations[k] {
            let modes = &self.model.modes[o.index];
            let (pixel, rows) = frame.project_with_jacobian(&self.model.point(o.index, &car.shape), modes)?;
            let off = pixel - o.pixel;
            let [rx, ry] = o.whiten([off.x, off.y]);
            let weight = o.weight * self.kernel.weight(rx * rx + ry * ry);
            let [w00, w10, w11] = o.whitening;
            block.add(&std::array::from_fn(|i| w00 * rows[0][i]), rx, weight);
            block.add(&std::array::from_fn(|i| w10 * rows[0][i] + w11 * rows[1][i]), ry, weight);
        }
        if let Some(plane) = self.plane {
            let (terms, rows) = frame.plane_terms(camera);
            for (i, (term, row)) in terms.iter().zip(&rows).enumerate() {
                let sd = if i == 0 { plane.distance_sd_m } else { plane.angle_sd };
                block.add(row, *term, 1.0 / (sd * sd));
            }
        }
        let prior = &self.priors[k];
        let gradient = prior.gradient(&car.shape);
        for j in 0..MODES {
            block.gradient[4 + j] += gradient[j];
            for i in 0..MODES {
                block.sum[4 + i][4 + j] += prior.information[(i, j)];
            }
            let [low, high] = self.atlas.bounds[j];
            let gradient = block.gradient[4 + j];
            let outward = (car.shape[j] <= low && gradient > 0.0) || (car.shape[j] >= high && gradient < 0.0);
            block.held[j] = self.shapes_fixed || outward;
        }
        Some(cost)
    }

    fn eliminate(&mut self, damping: f64) -> Option<(Matrix4<f64>, Vector4<f64>)> {
        let (mut hessian, mut gradient) = (Matrix4::zeros(), Vector4::zeros());
        for block in &mut self.blocks {
            block.eliminate(damping, &mut hessian, &mut gradient)?;
        }
        Some((hessian, gradient))
    }

    /// Covariance of the camera (prior counted, zero where fixed) and of each car's (shape, ω, u, v, ρ); information of the
    /// cars alone. After `linearise`.
    pub fn covariances(&mut self) -> Option<(Matrix4<f64>, Matrix4<f64>, Vec<CarMatrix>)> {
        let (information, _) = self.eliminate(0.0)?;
        let camera = self.knowledge.covariance(&information, &self.camera)?;
        let cars = self.blocks.iter().map(|b| b.inverse + b.gain * camera * b.gain.transpose()).collect();
        Some((information, camera, cars))
    }
}

impl Problem for FreeProblem<'_> {
    fn linearise(&mut self) -> Option<f64> {
        let camera = CameraFrame::new(&self.camera);
        let mut cost = self.camera_cost(&self.camera);
        for k in 0..self.cars.len() {
            cost += self.linearise_car(&camera, k)?;
        }
        self.cost = cost;
        self.known = self.knowledge.terms(&self.camera);
        self.camera_gradient = self.known.gradient;
        self.camera_diagonal = self.known.information.diagonal();
        let mut largest: f64 = 0.0;
        for block in &self.blocks {
            self.camera_gradient += Vector4::from_fn(|i, _| block.gradient[i]);
            self.camera_diagonal += Vector4::from_fn(|i, _| block.sum[i][i]);
            for i in (4..16).filter(|i| *i >= 10 || !block.held[*i - 4]) {
                largest = largest.max(block.gradient[i].abs() / block.sum[i][i].max(1e-300).sqrt());
            }
        }
        for i in (0..4).filter(|i| !self.knowledge.fixed[*i]) {
            largest = largest.max(self.camera_gradient[i].abs() / self.camera_diagonal[i].max(1e-300).sqrt());
        }
        cost.is_finite().then_some(largest)
    }

    fn cost(&self) -> f64 {
        self.cost
    }

    fn try_step(&mut self, damping: f64) -> Option<Trial> {
        let (mut hessian, mut gradient) = self.eliminate(damping)?;
        gradient += self.known.gradient;
        let damped = self.camera_diagonal.map(|d| damping * d.max(1e-9));
        hessian += self.known.information + Matrix4::from_diagonal(&damped);
        self.knowledge.hold_fixed(&mut hessian, &mut gradient);
        let camera_step = -hessian.cholesky()?.solve(&gradient);
        let (mut predicted, mut largest) = (0.0, 0.0_f64);
        let mut see = |step: f64, gradient: f64, diagonal: f64| {
            predicted += 0.5 * step * (damping * diagonal * step - gradient);
            largest = largest.max(step.abs() * diagonal.max(0.0).sqrt());
        };
        for i in (0..4).filter(|i| !self.knowledge.fixed[*i]) {
            see(camera_step[i], self.camera_gradient[i], self.camera_diagonal[i]);
        }
        self.trial_camera = self.camera + camera_step;
        for (k, block) in self.blocks.iter().enumerate() {
            let step = block.gain * camera_step + block.offset;
            for i in (0..12).filter(|i| *i >= MODES || !block.held[*i]) {
                see(step[i], block.gradient[4 + i], block.sum[4 + i][4 + i]);
            }
            self.trial_cars[k] = self.cars[k].moved(&step);
            self.trial_cars[k].shape = self.atlas.clamped(&self.trial_cars[k].shape);
        }
        let camera = CameraFrame::new(&self.trial_camera);
        let mut cost = self.camera_cost(&self.trial_camera);
        for (k, car) in self.trial_cars.iter().enumerate() {
            cost += self.car_cost(&camera, k, car)?;
        }
        cost.is_finite().then_some(Trial { cost, predicted_decrease: predicted, step_size: largest })
    }

    fn accept(&mut self) -> Option<f64> {
        std::mem::swap(&mut self.cars, &mut self.trial_cars);
        self.camera = self.trial_camera;
        self.linearise()
    }
}
