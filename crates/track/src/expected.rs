//! Predicts the position of a vehicle on the ground and in the picture, and computes the cost of a possible detection.

use roadplane_base::{bbox_around, bbox_iou, bbox_part_seen};

use crate::{
    box_motion::{BoxMotion, COAST_S},
    colour::Colour,
    filter::{Filter, GATE},
    measurement::Observation,
    noise::SIGNIFICANT,
};

/// Mean time for which a stationary or creeping vehicle stays undetected, s (exponential distribution).
pub(crate) const STATIONARY_S: f64 = 20.0;
/// Longest gap that linking bridges, and longest time for which a stationary vehicle is followed without a detection,
/// s. It is exceeded in 5 % of the cases.
pub(crate) const HIDDEN_S: f64 = SIGNIFICANT * STATIONARY_S;
/// Least overlap (IoU) of a stationary car's box with the box of a detection.
const MIN_OVERLAP: f64 = 0.25;
/// Overlap (IoU) of boxes that makes a pair, even where the pose is wrong.
pub(crate) const SURE_OVERLAP: f64 = 0.5;

/// A prediction of one vehicle from its detections, in the order of time.
#[derive(Clone, Debug)]
pub(crate) struct Expected {
    /// Position, velocity and axis on the ground.
    pub filter: Filter,
    /// Motion of the box in the picture.
    pub motion: BoxMotion,
    /// Box of the whole vehicle while it is stationary, px, even where a part is hidden.
    rest_px: [f64; 4],
    /// Colour of the vehicle; `None` while none was measured.
    colour: Option<Colour>,
}

impl Expected {
    /// Starts with the first detection of a vehicle.
    pub(crate) fn new(first: &Observation) -> Self {
        Self {
            filter: Filter::new(&first.pose, &first.covariance, first.time_s),
            motion: BoxMotion::new(first.detection.bbox_px, first.time_s),
            rest_px: first.detection.bbox_px,
            colour: Colour::of(first),
        }
    }

    /// Adds a detection.
    pub(crate) fn add(&mut self, observation: &Observation) {
        self.filter.update(&observation.pose, &observation.covariance, observation.time_s);
        let seen_px = observation.detection.bbox_px;
        // A part of a stationary vehicle may be hidden, so its box only grows.
        self.rest_px = if self.filter.is_still() { bbox_around(&self.rest_px, &seen_px) } else { seen_px };
        let gap_s = self.motion.unseen_s(observation.time_s);
        match (&mut self.colour, Colour::of(observation)) {
            (Some(colour), Some(new)) => colour.follow(new, gap_s),
            (colour, new) => *colour = colour.or(new),
        }
        self.motion.see(seen_px, observation.time_s);
    }

    /// Adds a detection that is carried over: the vehicle is in its old position, in this box (px).
    pub(crate) fn carry_over(&mut self, bbox_px: [f64; 4], time_s: f64) {
        self.filter.carry_over(time_s);
        self.motion.rest(bbox_px, time_s);
    }

    /// Whether the vehicle was undetected for so long that another may be there.
    pub(crate) fn is_lost(&self, time_s: f64) -> bool {
        let coast_s = if self.filter.is_still() { HIDDEN_S } else { COAST_S };
        self.motion.unseen_s(time_s) > coast_s
    }

    /// Returns the cost of a detection: 0 for a perfect match, 1 and more for none. Pose, overlap and colour cost up to
    /// 0.5 each.
    pub(crate) fn cost(&self, observation: &Observation) -> f64 {
        let colours = self.colour.zip(Colour::of(observation));
        self.cost_of_place(observation) + 0.5 * colours.map_or(0.0, |(own, other)| own.difference(other))
    }

    /// Returns the part of the cost that comes from the pose and from the box.
    fn cost_of_place(&self, observation: &Observation) -> f64 {
        let distance = self.filter.distance(&observation.pose, &observation.covariance, observation.time_s);
        let near = (distance / GATE).min(1.0);
        let is_still = self.filter.is_still();
        // A driving vehicle that was undetected for long has no expected box, so nothing overlaps it.
        if !is_still && self.is_lost(observation.time_s) {
            return if distance < GATE { 0.5 * near + 0.5 } else { f64::INFINITY };
        }
        let expected = if is_still { self.rest_px } else { self.motion.at(observation.time_s) };
        let seen_px = &observation.detection.bbox_px;
        let plain = bbox_iou(&expected, seen_px);
        let overlap = if is_still {
            // Less of a vehicle is visible while something hides it.
            bbox_iou(&bbox_part_seen(&expected, seen_px, observation.detection.goes_on()), seen_px)
        } else {
            // A driving vehicle must not take the half-hidden box of another that it passes.
            plain
        };
        let away = (observation.pose.xy() - self.filter.state.xy()).norm();
        let spread = observation.covariance.fixed_view::<2, 2>(0, 0).trace().sqrt();
        // A sliver within a stationary vehicle's box may be of any vehicle that passes.
        let is_another = plain < MIN_OVERLAP && away > spread;
        if is_still && (overlap < MIN_OVERLAP || is_another) {
            return f64::INFINITY;
        }
        // A vague position is near to everything, so the boxes must touch, too.
        let is_near = distance < GATE && overlap > 0.0;
        if is_near || overlap > SURE_OVERLAP { 0.5 * near + 0.5 * (1.0 - overlap) } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Detection;
    use nalgebra::{Matrix3, Vector3};
    use roadplane_base::VehicleClass;

    /// Returns a detection at x = 30 m with this sd of its position. Another vehicle hides the top and right edges of
    /// its box.
    fn observation(y_m: f64, sd_m: f64, bbox_px: [f64; 4], time_s: f64) -> Observation {
        Observation {
            frame: 0,
            time_s,
            pose: Vector3::new(30.0, y_m, 0.0),
            covariance: Matrix3::from_diagonal_element(sd_m * sd_m),
            detection: Detection {
                hidden: [false, true, true, false],
                ..Detection::uncut(bbox_px, 0.8, VehicleClass::Car)
            },
            from_box: false,
            fit_rms_share: None,
        }
    }

    #[test]
    fn a_sliver_in_a_stationary_cars_box_is_the_cars_only_at_its_place() {
        const WHOLE: [f64; 4] = [100.0, 200.0, 150.0, 230.0];
        const SLIVER: [f64; 4] = [100.0, 215.0, 118.0, 232.0];
        let mut car = Expected::new(&observation(90.0, 0.3, WHOLE, 0.0));
        (1..30).for_each(|i| car.add(&observation(90.0, 0.3, WHOLE, 0.1 * f64::from(i))));
        let cost = |y_m: f64, sd_m: f64, bbox_px: [f64; 4]| car.cost(&observation(y_m, sd_m, bbox_px, 3.0));
        // These cost little: half of the car, wherever its keypoints seem to be, and slivers near its position, within
        // their uncertainty. A sliver of another vehicle that passes in front costs much.
        assert!(cost(84.0, 2.0, [100.0, 200.0, 125.0, 230.0]) < 1.0);
        assert!(cost(90.5, 0.5, SLIVER) < 1.0 && cost(88.0, 3.0, SLIVER) < 1.0);
        assert!(cost(84.0, 2.0, SLIVER) >= 1.0);
    }

    #[test]
    fn a_box_of_another_colour_costs_up_to_a_half_more() {
        let coloured = |colour_rgb: Option<[u8; 3]>, time_s: f64| {
            let mut seen = observation(20.0, 0.3, [100.0, 200.0, 150.0, 230.0], time_s);
            seen.detection.colour_rgb = colour_rgb;
            seen
        };
        let expected = Expected::new(&coloured(Some([150, 20, 20]), 0.0));
        let [unknown, same, other] =
            [None, Some([150, 20, 20]), Some([90; 3])].map(|colour| expected.cost(&coloured(colour, 0.1)));
        assert!((same - unknown).abs() < 1e-9, "{same} {unknown}");
        assert!(same + 0.3 < other && other < same + 0.5, "{same} {other}");
    }
}
