//! The way of a vehicle that only its boxes place, and how large it is, at once.
//!
//! A box alone says little: the same one shows a short lorry that stands across and a long one that stands along the line of sight. The
//! way that the vehicle drives says how it is turned, and boxes from several places how long it is. So the states of the way
//! (`vehicle.rs`), length, width and height, and what its outline is off in all boxes alike, are one least-squares problem: each
//! box's edges are those of the body's box before the camera, scattered or hidden (`edge.rs`), and sizes are about those of the class.
//! What all boxes share borders the chain of states (Schur complement).

use nalgebra::{Matrix5, SMatrix, SVector, Vector3, Vector4, Vector5};
use roadplane_base::{FrameStamp, GroundPose, VehicleClass, upper_median};

use crate::{
    Scene, TrackOptions,
    chain::Blocks,
    edge::Edge,
    measurement::{Sighting, Size},
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
/// What is hidden of a body is at most so much, in shorter sides of what is seen of it.
const REACH: f64 = 2.0;
/// Edges are first taken for so much less sure, so that what is hidden shows before it misleads (Blake and Zisserman 1987).
const EASED: [f64; 3] = [8.0, 3.0, 1.0];
/// Which way is out at a box's left, top, right, bottom edge.
const OUTWARD: [f64; 4] = [-1.0, -1.0, 1.0, 1.0];
/// Least size of a body, m.
const LEAST_M: f64 = 1.0;
/// Steps of derivatives, m and rad.
const STEP: f64 = 1e-3;
const MAX_ROUNDS: usize = 30;
/// A descent is through where a step gains less.
const LEAST_GAIN: f64 = 1e-4;

/// What a node's boxes say.
pub(crate) struct Look {
    stamp: FrameStamp,
    /// Left, top, right, bottom.
    edges: [Edge; 4],
    /// Shorter side, px.
    side_px: f64,
    /// How many it is.
    count: f64,
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
            let of = |own: bool| {
                looks.iter().filter(move |o| !own || !o.goes_on()[i]).map(|o| o.bbox_px[i]).collect()
            };
            let mut own: Vec<f64> = of(true);
            let is_own = !own.is_empty();
            if !is_own {
                own = of(false);
            }
            (upper_median(&mut own, f64::total_cmp).unwrap_or(first.bbox_px[i]), own.len() as f64, is_own)
        };
        let edges: [_; 4] = std::array::from_fn(edge);
        let width_px = edges[2].0 - edges[0].0;
        let height_px = edges[3].0 - edges[1].0;
        let side_px = width_px.min(height_px).max(1.0);
        let edges = std::array::from_fn(|i| {
            let (seen_px, count, is_own) = edges[i];
            let is_cut = !is_own && looks.iter().any(|o| o.cut[i]);
            Edge {
                seen_px,
                sd_px: EDGE_SD_PX + EDGE_SD_SHARE * side_px,
                hidden: Edge::hidden(is_cut, !is_own),
                reach_px: REACH * side_px,
                looks: count / (1.0 + (together.max(count) - 1.0) * CORRELATION),
            }
        });
        Some(Self { stamp: stamp(first), edges, side_px, count: looks.len() as f64 })
    }

    /// How far each edge lies inside the body's, in sds.
    fn inside(&self, body_px: &Vector4<f64>, ease: f64) -> Vector4<f64> {
        Vector4::from_fn(|i, _| {
            OUTWARD[i] * (body_px[i] - self.edges[i].seen_px) / (ease * self.edges[i].sd_px)
        })
    }
}

/// A vehicle's body as far as it is known beforehand.
pub(crate) struct Body {
    pub class: VehicleClass,
    pub known: Size,
    /// Where to start from, m.
    pub start_m: Vector3<f64>,
}

/// A vehicle's nodes, and what was seen at them.
pub(crate) struct ByBoxes<'a, S> {
    pub nodes: &'a [Node],
    pub looks: &'a [Option<Look>],
    pub body: &'a Body,
    pub scene: &'a S,
    pub options: &'a TrackOptions,
}

/// What came out.
pub(crate) struct Solved {
    pub states: Vec<State>,
    pub covariances: Vec<Matrix5<f64>>,
    pub size: Size,
}

struct Bordered {
    blocks: Blocks,
    border: Vec<Border>,
    shared: SMatrix<f64, SHARED, SHARED>,
    gradient: Shared,
}

impl<S: Scene> ByBoxes<'_, S> {
    /// Levenberg–Marquardt from a way; `None` where boxes and way do not go together.
    pub(crate) fn solve(&self, start: Vec<State>) -> Option<Solved> {
        let mut states = start;
        let mut shared = Shared::zeros();
        shared.fixed_rows_mut::<3>(0).copy_from(&self.body.start_m);
        for ease in EASED {
            (states, shared) = self.descend(states, shared, ease)?;
        }
        if !self.is_seen(&states, &shared)? {
            return None;
        }
        let (covariances, shared_covariance) = self.system(&states, &shared, 1.0)?.covariances()?;
        Some(Solved {
            states,
            covariances,
            size: Size {
                dims_m: shared.fixed_rows::<3>(0).into_owned(),
                covariance: shared_covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            },
        })
    }

    fn descend(&self, mut states: Vec<State>, mut shared: Shared, ease: f64) -> Option<(Vec<State>, Shared)> {
        let mut cost = self.cost(&states, &shared, ease)?;
        let mut damping = 1e-4;
        for _ in 0..MAX_ROUNDS {
            let system = self.system(&states, &shared, ease)?;
            let mut gained = None;
            while damping < 1e9 {
                if let Some((step, shared_step)) = system.step(damping) {
                    let trial: Vec<State> = states.iter().zip(&step).map(|(s, d)| s + d).collect();
                    let mut trial_shared = shared + shared_step;
                    (0..3).for_each(|i| trial_shared[i] = trial_shared[i].max(LEAST_M));
                    let reached = self.cost(&trial, &trial_shared, ease);
                    if let Some(reached) = reached.filter(|reached| *reached <= cost) {
                        gained = Some(cost - reached);
                        (states, shared, cost) = (trial, trial_shared, reached);
                        damping = (damping * 0.1).max(1e-9);
                        break;
                    }
                }
                damping *= 10.0;
            }
            if gained.is_none_or(|gain| gain < LEAST_GAIN) {
                break;
            }
        }
        Some((states, shared))
    }

    /// Whether most looks show all of the body but what something known is before: what is smaller than a vehicle of its kind in most
    /// looks is none, but a motorcycle, or a part of something.
    fn is_seen(&self, states: &[State], shared: &Shared) -> Option<bool> {
        let (mut seen, mut all) = (0.0, 0.0);
        for (state, look) in states.iter().zip(self.looks) {
            let Some(look) = look else { continue };
            let pose = origin(state, self.options.half_wheelbase_m).0;
            let inside = look.inside(&self.body_px(look, &pose, shared)?, 1.0);
            let is_own = |(edge, by): (&Edge, &f64)| edge.is_own(*by) || edge.is_hidden();
            all += look.count;
            seen += if look.edges.iter().zip(&inside).all(is_own) { look.count } else { 0.0 };
        }
        Some(2.0 * seen >= all)
    }

    fn vehicle(&self) -> Vehicle<'_> {
        Vehicle { nodes: self.nodes, options: self.options }
    }

    /// Precision of what is known of the shared unknowns beforehand, and about what.
    fn prior(&self) -> Option<(Shared, SMatrix<f64, SHARED, SHARED>)> {
        let Size { dims_m, covariance } = &self.body.known;
        let mut about = Shared::zeros();
        about.fixed_rows_mut::<3>(0).copy_from(dims_m);
        let mut precision = SMatrix::<f64, SHARED, SHARED>::from_diagonal_element(OUTLINE_SD.powi(-2));
        precision.fixed_view_mut::<3, 3>(0, 0).copy_from(&covariance.try_inverse()?);
        Some((about, precision))
    }

    fn cost(&self, states: &[State], shared: &Shared, ease: f64) -> Option<f64> {
        let (about, precision) = self.prior()?;
        let off = shared - about;
        let mut total = self.vehicle().cost(states) + 0.5 * off.dot(&(precision * off));
        for (state, look) in states.iter().zip(self.looks) {
            let Some(look) = look else { continue };
            let pose = origin(state, self.options.half_wheelbase_m).0;
            let inside = look.inside(&self.body_px(look, &pose, shared)?, ease);
            total +=
                look.edges.iter().zip(&inside).map(|(edge, by)| edge.cost_and_weight(*by).0).sum::<f64>();
        }
        total.is_finite().then_some(total)
    }

    /// The box in which all of the body would be seen.
    fn body_px(&self, look: &Look, pose: &Vector3<f64>, shared: &Shared) -> Option<Vector4<f64>> {
        let pose = GroundPose { x_m: pose.x, y_m: pose.y, heading_rad: pose.z };
        let dims_m = shared.fixed_rows::<3>(0).into_owned();
        let body = self.scene.body_px(&look.stamp, &pose, self.body.class, &dims_m)?;
        Some(Vector4::from_fn(|i, _| body[i] + OUTWARD[i] * shared[3 + i] * look.side_px))
    }

    fn system(&self, states: &[State], shared: &Shared, ease: f64) -> Option<Bordered> {
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
            let inside = |pose: &_, shared: &_| Some(look.inside(&self.body_px(look, pose, shared)?, ease));
            let here = inside(&pose, shared)?;
            let weights = Vector4::from_fn(|i, _| look.edges[i].cost_and_weight(here[i]).1);
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
            for (p, edge) in look.edges.iter().enumerate() {
                by_shared[(p, 3 + p)] = look.side_px / (ease * edge.sd_px);
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
