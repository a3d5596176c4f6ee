//! The Levenberg–Marquardt step: solves the damped normal equations and evaluates the cost after the step.

use nalgebra::Matrix4;

use super::CarsProblem;
use crate::linear::lm::{Problem, Trial};
use crate::model::pose::Pose;

impl<P: Pose<N>, const N: usize, const M: usize> Problem for CarsProblem<'_, P, N, M> {
    fn linearise(&mut self) -> Option<f64> {
        self.evaluate(false)?;
        Some(self.gather())
    }

    fn cost(&self) -> f64 {
        self.linearisation.cost
    }

    fn try_step(&mut self, damping: f64) -> Option<Trial> {
        let (mut hessian, mut gradient) = self.eliminate(damping)?;
        gradient += self.knowledge.gradient(&self.state.camera);
        hessian += Matrix4::from_diagonal(&(self.knowledge.information + damping * self.camera_diagonal));
        self.knowledge.hold_fixed(&mut hessian, &mut gradient);
        let camera_step = -hessian.cholesky()?.solve(&gradient);
        let mut predicted = 0.0;
        let mut largest: f64 = 0.0;
        // The quadratic model predicts the decrease ½ stepᵀ (damping · D step − g), with diagonal D and gradient g.
        let mut see = |weight: f64, step: f64, gradient: f64, diagonal: f64| {
            predicted += 0.5 * weight * step * (damping * diagonal * step - gradient);
            largest = largest.max(step.abs() * diagonal.max(0.0).sqrt());
        };
        for i in (0..4).filter(|i| !self.knowledge.fixed[*i]) {
            see(1.0, camera_step[i], self.camera_gradient[i], self.camera_diagonal[i]);
        }
        self.trial.camera = self.state.camera + camera_step;
        for (g, group) in self.groups.iter().enumerate() {
            let block = &self.group_blocks[g];
            let mut step = block.step(&camera_step, 1.0);
            for j in (0..M).filter(|j| !block.fixed[*j]) {
                see(group.trust, step[N + j], block.gradient[j], block.diagonal[j]);
                let [low, high] = self.model.bounds[j];
                self.trial.shapes[g][j] = (self.state.shapes[g][j] + step[N + j]).clamp(low, high);
            }
            for j in (0..M).filter(|j| block.fixed[*j]) {
                self.trial.shapes[g][j] = self.state.shapes[g][j];
            }
            for k in group.views.clone() {
                self.pose_blocks[k].substitute(&mut step);
                for (i, step) in step[..N].iter().enumerate() {
                    let gram = &self.linearisation.grams[k];
                    see(group.trust, *step, gram.gradient(i), gram.diagonal(i));
                }
                self.trial.poses[k] = self.state.poses[k].moved(&step);
            }
        }
        let cost = self.evaluate(true)?;
        Some(Trial { cost, predicted_decrease: predicted, step_size: largest })
    }

    fn accept(&mut self) -> Option<f64> {
        std::mem::swap(&mut self.state, &mut self.trial);
        std::mem::swap(&mut self.linearisation, &mut self.trial_linearisation);
        Some(self.gather())
    }
}
