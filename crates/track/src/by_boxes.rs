//! The way of a vehicle that only its boxes place, and how large it is, at once.
//!
//! A box alone says little: the same one shows a short lorry that stands across and a long one that stands along the line of sight. The
//! way that the vehicle drives says how it is turned, and boxes from several places how long it is. So the states of the way
//! (`vehicle.rs`), length, width and height, and what its outline is off in all boxes alike, are one least-squares problem: each box's edges are those of the
//! body's box before the camera, scattered, and sizes are about those of the class. What all boxes share borders the chain of
//! states (Schur complement).

use nalgebra::{Matrix3, Matrix5, SMatrix, SVector, Vector3, Vector5};
use roadplane_base::{FrameStamp, GroundPose, StudentT, VehicleClass, upper_median};

use crate::{
    Scene, TrackOptions,
    measurement::Sighting,
    vehicle::{Node, State, Vehicle, origin},
};

/// Length, width, height, and how far each edge lies outside the body's own, as a share of the box's shorter side.
const SHARED: usize = 7;
type Shared = SVector<f64, SHARED>;
type Border = SMatrix<f64, 5, SHARED>;

/// sd of an edge from look to look: px, and as a share of the box's shorter side.
const EDGE_SD_PX: f64 = 1.0;
const EDGE_SD_SHARE: f64 = 0.03;
/// sd of what an edge is off in all looks: bodies are no boxes.
const OUTLINE_SD: f64 = 0.04;
/// Correlation of that between looks from about one place, which so count as fewer (design effect: Kish 1965, "Survey Sampling").
const CORRELATION: f64 = 0.5;
/// Vehicles stand in front of each other: what is seen of the lower edge is less sure.
const BOTTOM_FACTOR: f64 = 2.0;
/// The same of an edge that is where another vehicle begins.
const HIDDEN_FACTOR: f64 = 10.0;
/// How looks scatter.
const SCATTER: StudentT = StudentT { dimensions: 4.0 };
/// Least size of a body, m.
const LEAST_M: f64 = 1.0;
/// Steps of derivatives, m and rad.
const STEP: f64 = 1e-3;
const MAX_ROUNDS: usize = 30;

/// What a node's boxes say.
pub(crate) struct Look {
    stamp: FrameStamp,
    bbox_px: [f64; 4],
    sd_px: [f64; 4],
    /// The picture ends there, and the vehicle may go on.
    cut: [bool; 4],
    /// Shorter side, px.
    side_px: f64,
    /// A stand's is the middle of many.
    stands: bool,
}

impl Look {
    /// Of the sightings of a node: one, or all those of a stand, edge by edge by those that show it. So many looks `together` are from
    /// about its place.
    pub(crate) fn of(
        sightings: &[Sighting],
        together: f64,
        stamp: impl Fn(&Sighting) -> FrameStamp,
    ) -> Option<Self> {
        let looks: Vec<&Sighting> = sightings.iter().filter(|o| !o.held).collect();
        let first = *looks.first()?;
        let edge = |i: usize| {
            let mut own: Vec<f64> = looks.iter().filter(|o| !o.goes_on()[i]).map(|o| o.bbox_px[i]).collect();
            let is_own = !own.is_empty();
            if !is_own {
                own = looks.iter().map(|o| o.bbox_px[i]).collect();
            }
            (upper_median(&mut own, f64::total_cmp).unwrap_or(first.bbox_px[i]), own.len() as f64, is_own)
        };
        let edges: [_; 4] = std::array::from_fn(edge);
        let design_effect = 1.0 + (together - 1.0).max(0.0) * CORRELATION;
        let bbox_px = edges.map(|(place, _, _)| place);
        let side_px = (bbox_px[2] - bbox_px[0]).min(bbox_px[3] - bbox_px[1]);
        let cut = std::array::from_fn(|i| !edges[i].2 && looks.iter().any(|o| o.cut[i]));
        let sd_px = std::array::from_fn(|i| {
            let (_, count, is_own) = edges[i];
            let one = (EDGE_SD_PX + EDGE_SD_SHARE * side_px) * (design_effect / count).sqrt();
            one * match (is_own || cut[i], i == 3) {
                (false, _) => HIDDEN_FACTOR,
                (true, true) => BOTTOM_FACTOR,
                (true, false) => 1.0,
            }
        });
        Some(Self { stamp: stamp(first), bbox_px, sd_px, cut, side_px, stands: looks.len() > 1 })
    }
}

/// A vehicle's nodes, and what was seen at them.
pub(crate) struct ByBoxes<'a, S> {
    pub nodes: &'a [Node],
    pub looks: &'a [Option<Look>],
    pub class: VehicleClass,
    pub scene: &'a S,
    pub options: &'a TrackOptions,
}

/// What came out.
pub(crate) struct Solved {
    pub states: Vec<State>,
    pub covariances: Vec<Matrix5<f64>>,
    /// Length, width, height, m.
    pub dims_m: Vector3<f64>,
    /// Their covariance.
    pub dims_covariance: Matrix3<f64>,
}

struct Bordered {
    blocks: crate::chain::Blocks,
    border: Vec<Border>,
    shared: SMatrix<f64, SHARED, SHARED>,
    gradient: Shared,
}

impl<S: Scene> ByBoxes<'_, S> {
    /// Levenberg–Marquardt from a way and the class' sizes; `None` where boxes and way do not go together.
    pub(crate) fn solve(&self, start: Vec<State>, dims_m: Vector3<f64>) -> Option<Solved> {
        let mut states = start;
        let mut shared = Shared::zeros();
        shared.fixed_rows_mut::<3>(0).copy_from(&dims_m);
        let mut cost = self.cost(&states, &shared)?;
        let mut damping = 1e-4;
        for _ in 0..MAX_ROUNDS {
            let system = self.system(&states, &shared)?;
            let mut gained = None;
            while damping < 1e9 {
                if let Some((step, shared_step)) = system.step(damping) {
                    let trial: Vec<State> = states.iter().zip(&step).map(|(s, d)| s + d).collect();
                    let mut trial_shared = shared + shared_step;
                    (0..3).for_each(|i| trial_shared[i] = trial_shared[i].max(LEAST_M));
                    if let Some(reached) = self.cost(&trial, &trial_shared).filter(|reached| *reached <= cost)
                    {
                        gained = Some(cost - reached);
                        (states, shared, cost) = (trial, trial_shared, reached);
                        damping = (damping * 0.1).max(1e-9);
                        break;
                    }
                }
                damping *= 10.0;
            }
            match gained {
                Some(gain) if gain > 1e-4 => {}
                _ => break,
            }
        }
        let (covariances, shared_covariance) = self.system(&states, &shared)?.covariances()?;
        Some(Solved {
            states,
            covariances,
            dims_m: shared.fixed_rows::<3>(0).into_owned(),
            dims_covariance: shared_covariance.fixed_view::<3, 3>(0, 0).into_owned(),
        })
    }

    fn vehicle(&self) -> Vehicle<'_> {
        Vehicle { nodes: self.nodes, options: self.options }
    }

    /// Precision of what is known of the shared unknowns beforehand, and about what.
    fn prior(&self) -> Option<(Shared, SMatrix<f64, SHARED, SHARED>)> {
        let (mean, covariance) = self.scene.size(self.class);
        let mut about = Shared::zeros();
        about.fixed_rows_mut::<3>(0).copy_from(&mean);
        let mut precision = SMatrix::<f64, SHARED, SHARED>::from_diagonal_element(OUTLINE_SD.powi(-2));
        precision.fixed_view_mut::<3, 3>(0, 0).copy_from(&covariance.try_inverse()?);
        Some((about, precision))
    }

    fn cost(&self, states: &[State], shared: &Shared) -> Option<f64> {
        let (about, precision) = self.prior()?;
        let off = shared - about;
        let mut total = self.vehicle().cost(states) + 0.5 * off.dot(&(precision * off));
        for (state, look) in states.iter().zip(self.looks) {
            let Some(look) = look else { continue };
            let pose = origin(state, self.options.half_wheelbase_m).0;
            let square = self.residual(look, &self.edges(look, &pose, shared)?).norm_squared();
            total += if look.stands { 0.5 * square } else { SCATTER.cost(square) };
        }
        total.is_finite().then_some(total)
    }

    /// The edges of the box where the body is expected to be seen.
    fn edges(&self, look: &Look, pose: &Vector3<f64>, shared: &Shared) -> Option<SVector<f64, 4>> {
        let pose = GroundPose { x_m: pose.x, y_m: pose.y, heading_rad: pose.z };
        let dims_m = shared.fixed_rows::<3>(0).into_owned();
        let body = self.scene.body_px(&look.stamp, &pose, self.class, &dims_m)?;
        Some(SVector::from_fn(|i, _| {
            let outward = if i < 2 { -1.0 } else { 1.0 };
            body[i] + outward * shared[3 + i] * look.side_px
        }))
    }

    /// In units of their sds; none of an edge beyond which the vehicle may go on.
    fn residual(&self, look: &Look, edges: &SVector<f64, 4>) -> SVector<f64, 4> {
        SVector::from_fn(|i, _| {
            let is_beyond = (edges[i] < look.bbox_px[i]) == (i < 2);
            if look.cut[i] && is_beyond { 0.0 } else { (edges[i] - look.bbox_px[i]) / look.sd_px[i] }
        })
    }

    fn system(&self, states: &[State], shared: &Shared) -> Option<Bordered> {
        let (about, precision) = self.prior()?;
        let mut system = Bordered {
            blocks: self.vehicle().blocks(states),
            border: vec![Border::zeros(); states.len()],
            shared: precision,
            gradient: precision * (shared - about),
        };
        for (i, (state, look)) in states.iter().zip(self.looks).enumerate() {
            let Some(look) = look else { continue };
            let (pose, by_state) = origin(state, self.options.half_wheelbase_m);
            let edges = self.edges(look, &pose, shared)?;
            let residual = self.residual(look, &edges);
            let weight = if look.stands { 1.0 } else { SCATTER.weight(residual.norm_squared()) };
            let derivative = |there: SVector<f64, 4>| {
                SVector::<f64, 4>::from_fn(|edge, _| match residual[edge] == 0.0 {
                    true => 0.0,
                    false => (there[edge] - edges[edge]) / (STEP * look.sd_px[edge]),
                })
            };
            let (mut by_pose, mut by_shared) =
                (SMatrix::<f64, 4, 3>::zeros(), SMatrix::<f64, 4, SHARED>::zeros());
            for p in 0..3 {
                let mut moved = pose;
                moved[p] += STEP;
                by_pose.set_column(p, &derivative(self.edges(look, &moved, shared)?));
            }
            for p in 0..SHARED {
                let mut moved = *shared;
                moved[p] += STEP;
                by_shared.set_column(p, &derivative(self.edges(look, &pose, &moved)?));
            }
            let by_state: SMatrix<f64, 4, 5> = by_pose * by_state;
            system.blocks.diagonal[i] += by_state.transpose() * by_state * weight;
            system.blocks.gradient[i] += by_state.transpose() * residual * weight;
            system.border[i] += by_state.transpose() * by_shared * weight;
            system.shared += by_shared.transpose() * by_shared * weight;
            system.gradient += by_shared.transpose() * residual * weight;
        }
        Some(system)
    }
}

impl Bordered {
    /// What is left of the shared unknowns' information once the chain follows them, and how it does (its states' steps per unit of each).
    fn reduced(&self, damping: f64) -> Option<(SMatrix<f64, SHARED, SHARED>, Vec<Border>)> {
        let follows = self.blocks.solve(damping, self.border.clone())?;
        let mut left = self.shared + SMatrix::from_diagonal(&self.shared.diagonal()) * damping;
        for (border, follow) in self.border.iter().zip(&follows) {
            left -= border.transpose() * follow;
        }
        Some(((left + left.transpose()) / 2.0, follows))
    }

    fn step(&self, damping: f64) -> Option<(Vec<Vector5<f64>>, Shared)> {
        let (left, follows) = self.reduced(damping)?;
        let alone = self.blocks.step(damping)?;
        let mut right = -self.gradient;
        for (border, step) in self.border.iter().zip(&alone) {
            right -= border.transpose() * step;
        }
        let shared = left.cholesky()?.solve(&right);
        let steps = alone.iter().zip(&follows).map(|(step, follow)| step - follow * shared).collect();
        Some((steps, shared))
    }

    /// Of each state and of what is shared, all others unknown.
    fn covariances(&self) -> Option<(Vec<Matrix5<f64>>, SMatrix<f64, SHARED, SHARED>)> {
        let (left, follows) = self.reduced(0.0)?;
        let shared = left.cholesky()?.inverse();
        let alone = self.blocks.covariances()?;
        let all = alone.iter().zip(&follows).map(|(own, follow)| own + follow * shared * follow.transpose());
        Some((all.collect(), shared))
    }
}
