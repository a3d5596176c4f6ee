//! Estimates together the path and the size of a vehicle that only boxes place.
//!
//! A single box says little. It may show a short lorry across the line of sight, or a long lorry along it. The path of
//! the vehicle shows its heading, and boxes from several positions show its length.
//!
//! Therefore both are one least-squares problem. Its unknowns are the states of the path (`vehicle.rs`), length, width
//! and height, and the offsets of the outline that all boxes share. The edges of each box are those of the projected
//! body, with scatter, or they are hidden (`measure/src/edge.rs`). Sizes have the prior of the vehicle's class. The shared unknowns border
//! the chain of states (Schur complement).

use nalgebra::{Matrix5, SMatrix, SVector, Vector3, Vector4, Vector5};
use roadplane_base::{FrameStamp, GroundPose, VehicleClass, upper_median};
use roadplane_measure::{Body, Edge, OUTLINE_SD, OUTWARD, REACH, STEP, edge_sd_px};

use crate::{
    Detection, Scene,
    chain::Blocks,
    descent::descend,
    measurement::Observation,
    noise::COMMON_SHARE,
    vehicle::{State, Vehicle, moved, origin},
};

/// Number of shared unknowns: length, width and height (m), and one offset per edge. The offset is the distance outside
/// the body's own edge, as a share of the box's shorter side.
const SHARED: usize = 7;
/// The shared unknowns of one vehicle.
type Shared = SVector<f64, SHARED>;
/// Second derivatives by one state (rows) and the shared unknowns (columns).
type Border = SMatrix<f64, 5, SHARED>;

/// Factors on the sd of the edges, one per stage. At first edges count as less certain, so that hidden parts show
/// before they mislead (graduated non-convexity: Blake and Zisserman 1987).
const EASED: [f64; 3] = [8.0, 3.0, 1.0];

/// The boxes of one node, combined to one box.
pub(crate) struct BoxEvidence {
    stamp: FrameStamp,
    /// Left, top, right and bottom edge of the box.
    edges: [Edge; 4],
    /// Shorter side of the box, px.
    side_px: f64,
    /// Number of detections that are combined.
    count: f64,
}

impl BoxEvidence {
    /// Combines the detections of a node: one, or all those of a stationary interval. Each edge is the median over the
    /// detections that show it. `together` is the number of detections from about this position. Returns `None` without
    /// a measured detection.
    pub(crate) fn of(observations: &[Observation], together: f64, stamps: &[FrameStamp]) -> Option<Self> {
        let first = observations.iter().find(|o| !o.detection.carried_over)?;
        let measured: Vec<&Detection> =
            observations.iter().map(|o| &o.detection).filter(|o| !o.carried_over).collect();
        let edge = |i: usize| {
            let of = |own: bool| {
                measured.iter().filter(move |o| !own || !o.goes_on()[i]).map(|o| o.bbox_px[i]).collect()
            };
            let mut edges_px: Vec<f64> = of(true);
            let is_own = !edges_px.is_empty();
            if !is_own {
                edges_px = of(false);
            }
            let median_px = upper_median(&mut edges_px, f64::total_cmp).unwrap_or(first.detection.bbox_px[i]);
            (median_px, edges_px.len() as f64, is_own)
        };
        let edges: [_; 4] = std::array::from_fn(edge);
        let width_px = edges[2].0 - edges[0].0;
        let height_px = edges[3].0 - edges[1].0;
        let side_px = width_px.min(height_px).max(1.0);
        let edges = std::array::from_fn(|i| {
            let (seen_px, count, is_own) = edges[i];
            let is_cut = !is_own && measured.iter().any(|o| o.cut[i]);
            Edge {
                seen_px,
                sd_px: edge_sd_px(side_px),
                hidden: Edge::hidden(is_cut, !is_own),
                reach_px: REACH * side_px,
                independent: count / (1.0 + (together.max(count) - 1.0) * COMMON_SHARE),
            }
        });
        Some(Self { stamp: stamps[first.frame], edges, side_px, count: measured.len() as f64 })
    }
}

/// The least-squares problem of one vehicle.
pub(crate) struct ByBoxes<'a, S> {
    /// Motion model of the path, with the poses that were measured there.
    pub vehicle: Vehicle<'a>,
    /// Evidence at each node, where boxes place it.
    pub evidence: &'a [Option<BoxEvidence>],
    /// Prior of the body.
    pub body: &'a Body,
    /// Length, width and height from which the solution starts, m.
    pub start_m: Vector3<f64>,
    /// Scene that projects the body into the picture.
    pub scene: &'a S,
}

/// Normal equations of the chain of states and the shared unknowns.
struct Bordered {
    blocks: Blocks,
    /// Coupling of each state with the shared unknowns.
    border: Vec<Border>,
    shared: SMatrix<f64, SHARED, SHARED>,
    /// Gradient of the cost by the shared unknowns.
    gradient: Shared,
}

impl<S: Scene> ByBoxes<'_, S> {
    /// Solves the problem, starting from the states of a path. Returns the states, their
    /// covariances (all other unknowns are uncertain), and the body. `None` where boxes and path contradict each other.
    pub(crate) fn solve(&self, mut states: Vec<State>) -> Option<(Vec<State>, Vec<Matrix5<f64>>, Body)> {
        let mut shared = Shared::zeros();
        shared.fixed_rows_mut::<3>(0).copy_from(&self.start_m);
        let least_m = self.body.least_m();
        for ease in EASED {
            (states, shared) = descend(
                (states, shared),
                |(states, shared)| self.cost(states, shared, ease),
                |(states, shared)| self.system(states, shared, ease),
                |(states, shared), system, damping| {
                    let (step, shared_step) = system.step(damping)?;
                    let mut shared = shared + shared_step;
                    (0..3).for_each(|i| shared[i] = shared[i].max(least_m[i]));
                    Some((moved(states, &step), shared))
                },
            )?;
        }
        // The prior of a motorcycle's size is narrow, but riders lean and carry things.
        if self.body.class == VehicleClass::Motorcycle && !self.is_seen(&states, &shared)? {
            return None;
        }
        let (covariances, shared_covariance) = self.system(&states, &shared, 1.0)?.covariances()?;
        let body = Body {
            class: self.body.class,
            dims_m: shared.fixed_rows::<3>(0).into_owned(),
            covariance: shared_covariance.fixed_view::<3, 3>(0, 0).into_owned(),
        };
        Some((states, covariances, body))
    }

    /// Whether most detections show the whole body, apart from parts behind another vehicle.
    fn is_seen(&self, states: &[State], shared: &Shared) -> Option<bool> {
        let (mut seen, mut all) = (0.0, 0.0);
        for (state, evidence) in states.iter().zip(self.evidence) {
            let Some(evidence) = evidence else { continue };
            let pose = origin(state, self.vehicle.half_wheelbase_m).0;
            let inside = self.inside(evidence, &pose, shared, 1.0)?;
            let is_own = |(edge, by): (&Edge, &f64)| edge.is_own(*by) || edge.is_hidden();
            all += evidence.count;
            seen += if evidence.edges.iter().zip(&inside).all(is_own) { evidence.count } else { 0.0 };
        }
        Some(2.0 * seen >= all)
    }

    /// Returns mean and precision of the prior of the shared unknowns.
    fn prior(&self) -> Option<(Shared, SMatrix<f64, SHARED, SHARED>)> {
        let Body { dims_m, covariance, .. } = self.body;
        let mut about = Shared::zeros();
        about.fixed_rows_mut::<3>(0).copy_from(dims_m);
        let mut precision = SMatrix::<f64, SHARED, SHARED>::from_diagonal_element(OUTLINE_SD.powi(-2));
        precision.fixed_view_mut::<3, 3>(0, 0).copy_from(&covariance.try_inverse()?);
        Some((about, precision))
    }

    /// Returns the negative log posterior, up to a constant.
    fn cost(&self, states: &[State], shared: &Shared, ease: f64) -> Option<f64> {
        let (about, precision) = self.prior()?;
        let off = shared - about;
        let mut total = self.vehicle.cost(states) + 0.5 * off.dot(&(precision * off));
        for (state, evidence) in states.iter().zip(self.evidence) {
            let Some(evidence) = evidence else { continue };
            let pose = origin(state, self.vehicle.half_wheelbase_m).0;
            let inside = self.inside(evidence, &pose, shared, ease)?;
            total +=
                evidence.edges.iter().zip(&inside).map(|(edge, by)| edge.cost_and_weight(*by).0).sum::<f64>();
        }
        total.is_finite().then_some(total)
    }

    /// Returns how far each edge of the box (left, top, right, bottom) lies inside the body's projected outline. The unit
    /// is the edge's sd times `ease`.
    fn inside(
        &self,
        evidence: &BoxEvidence,
        pose: &Vector3<f64>,
        shared: &Shared,
        ease: f64,
    ) -> Option<Vector4<f64>> {
        let pose = GroundPose { x_m: pose.x, y_m: pose.y, heading_rad: pose.z };
        let dims_m = shared.fixed_rows::<3>(0).into_owned();
        let body = self.scene.body_px(&evidence.stamp, &pose, self.body.class, &dims_m)?;
        Some(Vector4::from_fn(|i, _| {
            let edge_px = body[i] + OUTWARD[i] * shared[3 + i] * evidence.side_px;
            OUTWARD[i] * (edge_px - evidence.edges[i].seen_px) / (ease * evidence.edges[i].sd_px)
        }))
    }

    /// Returns the normal equations about the given states.
    fn system(&self, states: &[State], shared: &Shared, ease: f64) -> Option<Bordered> {
        let (about, precision) = self.prior()?;
        let mut system = Bordered {
            blocks: self.vehicle.blocks(states),
            border: vec![Border::zeros(); states.len()],
            shared: precision,
            gradient: precision * (shared - about),
        };
        for (i, (state, evidence)) in states.iter().zip(self.evidence).enumerate() {
            let Some(evidence) = evidence else { continue };
            let (pose, by_state) = origin(state, self.vehicle.half_wheelbase_m);
            let inside = |pose: &_, shared: &_| self.inside(evidence, pose, shared, ease);
            let here = inside(&pose, shared)?;
            let weights = Vector4::from_fn(|i, _| evidence.edges[i].cost_and_weight(here[i]).1);
            let (mut by_pose, mut by_shared) =
                (SMatrix::<f64, 4, 3>::zeros(), SMatrix::<f64, 4, SHARED>::zeros());
            for p in 0..3 {
                let mut moved = pose;
                moved[p] += STEP;
                by_pose.set_column(p, &((inside(&moved, shared)? - here) / STEP));
            }
            for p in 0..3 {
                let mut moved = *shared;
                moved[p] += STEP;
                by_shared.set_column(p, &((inside(&pose, &moved)? - here) / STEP));
            }
            for (p, edge) in evidence.edges.iter().enumerate() {
                by_shared[(p, 3 + p)] = evidence.side_px / (ease * edge.sd_px);
            }
            let by_state: SMatrix<f64, 4, 5> = by_pose * by_state;
            let weighted = by_state.transpose() * SMatrix::from_diagonal(&weights);
            let weighted_shared = by_shared.transpose() * SMatrix::from_diagonal(&weights);
            system.blocks.diagonal[i] += weighted * by_state;
            system.blocks.gradient[i] += weighted * here;
            system.border[i] += weighted * by_shared;
            system.shared += weighted_shared * by_shared;
            system.gradient += weighted_shared * here;
        }
        Some(system)
    }
}

impl Bordered {
    /// Eliminates the states. Returns the reduced information of the shared unknowns. It also returns the step of each
    /// state per unit of a shared unknown.
    fn reduced(&self, damping: f64) -> Option<(SMatrix<f64, SHARED, SHARED>, Vec<Border>)> {
        let follows = self.blocks.solve(damping, self.border.clone())?;
        let mut left = self.shared + SMatrix::from_diagonal(&self.shared.diagonal()) * damping;
        for (border, follow) in self.border.iter().zip(&follows) {
            left -= border.transpose() * follow;
        }
        Some(((left + left.transpose()) / 2.0, follows))
    }

    /// Returns the damped step of the states and of the shared unknowns.
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

    /// Returns the covariance of each state and of the shared unknowns, all other unknowns being uncertain.
    fn covariances(&self) -> Option<(Vec<Matrix5<f64>>, SMatrix<f64, SHARED, SHARED>)> {
        let (left, follows) = self.reduced(0.0)?;
        let shared = left.cholesky()?.inverse();
        let alone = self.blocks.covariances()?;
        let all = alone.iter().zip(&follows).map(|(own, follow)| own + follow * shared * follow.transpose());
        Some((all.collect(), shared))
    }
}
