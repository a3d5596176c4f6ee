//! Extension of the problem to more shape modes, and updates of each car's body types and weight.

use nalgebra::SVector;

use super::{CarsProblem, Group, State};
use crate::linear::arrow::GroupBlock;
use crate::model::latent::body_types::{BodyTypes, Gaussian};
use crate::model::latent::trust::{Misfit, trust};
use crate::model::points::PointModes;
use crate::model::pose::Pose;

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// Returns the same problem, at its current state, for a shape model with more modes (K instead of M).
    ///
    /// The first M modes of `model` must be those of this problem. The new coefficients start at 0. `priors` computes
    /// the new shape prior of a car from its old prior.
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

    /// Returns how badly the g-th group (physical car) fits at the current state. Call after `linearise`.
    pub(super) fn misfit(&self, g: usize, group: &Group<M>) -> Misfit {
        let observations = group.views.clone().flat_map(|k| self.views[k].observations.clone());
        let weight: f64 = observations.map(|i| self.observations[i].weight).sum();
        let cost = self.linearisation.keypoints[g] + group.prior.cost(&self.state.shapes[g]);
        Misfit { squared: 2.0 * cost, numbers: 2.0 * weight }
    }

    /// Updates the weight of each car from its fit at the current state (`trust.rs`). Call after `linearise`.
    pub fn update_trust(&mut self) {
        let misfits: Vec<Misfit> =
            self.groups.iter().enumerate().map(|(g, group)| self.misfit(g, group)).collect();
        for (group, trust) in self.groups.iter_mut().zip(trust(&misfits)) {
            group.trust = trust;
        }
    }

    /// Replaces each car's shape prior by the prior of its likely body types (`body_types.rs`).
    ///
    /// The likely types follow from the car's keypoints at the current state. Call after `linearise`. Returns `None` if
    /// the pose of a view is not determined.
    pub fn infer_body_types(&mut self, types: &BodyTypes<M>) -> Option<()> {
        for (group, shape) in self.groups.iter_mut().zip(&self.state.shapes) {
            let terms = GroupBlock::of_keypoints(&self.linearisation.grams[group.views.clone()])?;
            types.update_prior(&mut group.prior, shape, &terms.information, &terms.gradient);
        }
        Some(())
    }
}
