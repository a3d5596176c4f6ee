//! The problem with more modes, and what is latent in it: body types and trust.

use nalgebra::SVector;

use super::{CarsProblem, Group, State};
use crate::linear::arrow::GroupBlock;
use crate::model::latent::body_types::{BodyTypes, Gaussian};
use crate::model::latent::trust::{Misfit, trust};
use crate::model::points::PointModes;
use crate::model::pose::Pose;

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// The same scene at its state with the K modes of another model, of which `model`'s first are these; their coefficients begin
    /// at 0. `priors`: what is known of each car's shape.
    pub fn with_modes<'b, const K: usize>(
        &self,
        model: &'b PointModes<K>,
        priors: impl Fn(&Gaussian<M>) -> Gaussian<K>,
    ) -> CarsProblem<'b, P, N, K> {
        let longer = |shape: &SVector<f64, M>| SVector::from_fn(|j, _| if j < M { shape[j] } else { 0.0 });
        let state = State {
            camera: self.state.camera,
            poses: self.state.poses.clone(),
            shapes: self.state.shapes.iter().map(longer).collect(),
        };
        let groups =
            self.groups.iter().map(|group| Group::new(group.views.clone(), priors(&group.prior))).collect();
        let (views, observations) = (self.views.clone(), self.observations.clone());
        let mut problem = CarsProblem::new(model, views, groups, observations, self.knowledge.clone(), state);
        problem.kernel = self.kernel;
        problem
    }

    /// How well the car of the g-th group fits at the current state. After it was linearised.
    pub(super) fn misfit(&self, g: usize, group: &Group<M>) -> Misfit {
        let observations = group.views.clone().flat_map(|k| self.views[k].observations.clone());
        let weight: f64 = observations.map(|i| self.observations[i].weight).sum();
        let cost = self.linearisation.keypoints[g] + group.prior.cost(&self.state.shapes[g]);
        Misfit { squared: 2.0 * cost, numbers: 2.0 * weight }
    }

    /// Weighs the cars by how they fit at the current state (`trust.rs`). After it was linearised.
    pub fn weigh(&mut self) {
        let misfits: Vec<Misfit> =
            self.groups.iter().enumerate().map(|(g, group)| self.misfit(g, group)).collect();
        for (group, trust) in self.groups.iter_mut().zip(trust(&misfits)) {
            group.trust = trust;
        }
    }

    /// Takes for each car's prior that of the body types it may have (`body_types.rs`), by what its keypoints say of its shape at
    /// the current state. After it was linearised. `None` when a view's pose is not determined.
    pub fn tell_types(&mut self, types: &BodyTypes<M>) -> Option<()> {
        for (group, shape) in self.groups.iter_mut().zip(&self.state.shapes) {
            let told = GroupBlock::of_keypoints(&self.linearisation.grams[group.views.clone()])?;
            types.tell(&mut group.prior, shape, &told.information, &told.gradient);
        }
        Some(())
    }
}
