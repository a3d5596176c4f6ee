//! Estimates a vehicle's position from its box alone: the ground position at which a body of its class has the detected
//! box.
//!
//! At the border of the picture, and where another vehicle begins, an edge of the box only limits the body.
//!
//! The box alone does not determine heading and length, so bodies of all classes and headings are tried. Each is fitted
//! by least squares over position and size (x, y, length, width, height; sizes with the prior of their class). The
//! result has the moments of the mixture of these fits. The weights are Laplace's approximation of each fit's evidence
//! (MacKay 2003, chapter 27).

use std::f64::consts::PI;

use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3, Vector4};
use roadplane_base::{GroundPose, VehicleClass, bbox_foot, fold_axis};

use crate::edge::{EDGE_SD_PX, EDGE_SD_SHARE, OUTLINE_SD, OUTWARD};
use crate::{Body, FrameCamera, body_box, body_of, either};

/// Number of headings that are tried in half a turn.
const HEADINGS: usize = 8;
/// Largest number of Gauss–Newton rounds of a fit.
const ROUNDS: usize = 8;
/// Step of numerical derivatives, m and rad.
pub const STEP: f64 = 1e-3;

/// Returns the probability of each class in a box of a label. Detectors take cars for trucks more often than the
/// reverse.
fn prior(label: VehicleClass) -> &'static [(VehicleClass, f64)] {
    use VehicleClass::{Bus, Car, Motorcycle, Truck};
    match label {
        Car => &[(Car, 0.9), (Truck, 0.08), (Bus, 0.02)],
        Truck => &[(Car, 0.35), (Truck, 0.6), (Bus, 0.05)],
        Bus => &[(Car, 0.1), (Truck, 0.2), (Bus, 0.7)],
        Motorcycle => &[(Motorcycle, 1.0)],
    }
}

/// Sd of a direction of travel, and least sd of a track's heading at one time, rad.
pub const HEADING_SD_RAD: f64 = 0.1;

/// Prior information about the vehicle in a box.
#[derive(Clone, Copy, Debug)]
pub enum Knowledge {
    /// The detector's label.
    Label(VehicleClass),
    /// Size and heading, from its track or its path.
    Track {
        /// Size of the vehicle.
        body: Body,
        /// Heading, rad. It may be wrong by π.
        heading_rad: f64,
        /// Sd of the heading, rad.
        heading_sd_rad: f64,
    },
}

/// Position of a vehicle from its box.
#[derive(Clone, Debug)]
pub struct GroundContact {
    /// Pose on the ground; the heading may be off by π.
    pub pose: GroundPose,
    /// Covariance of (x, y, heading), m and rad.
    pub covariance: Matrix3<f64>,
    /// Length, width and height (m) and their sds (m).
    pub dims_m: [Vector3<f64>; 2],
}

/// Estimates a vehicle's pose and size from its box.
///
/// `cut` marks the edges (left, top, right, bottom) at which the picture ends, and `hidden` those at which another vehicle
/// hides this one. They only limit the vehicle: it does not end before them.
///
/// `None` where the box's lower edge lies above the horizon, or where two opposite edges are cut off. `None` also where
/// the lower edge is cut off and only a label is known.
#[must_use]
pub fn ground_contact(
    bbox_px: &[f64; 4],
    cut: [bool; 4],
    hidden: [bool; 4],
    view: &FrameCamera,
    knowledge: &Knowledge,
) -> Option<GroundContact> {
    let is_tracked = matches!(knowledge, Knowledge::Track { .. });
    if (cut[0] && cut[2]) || (cut[3] && (cut[1] || !is_tracked)) {
        return None;
    }
    // Bodies with their headings and prior weights, and the step between two headings, rad.
    let (bodies, step): (Vec<(Body, f64, f64)>, f64) = match knowledge {
        Knowledge::Label(label) => {
            let step = PI / HEADINGS as f64;
            let all = prior(*label).iter().flat_map(|&(class, share)| {
                (0..HEADINGS).map(move |i| (body_of(class), step * i as f64, share))
            });
            (all.collect(), step)
        }
        Knowledge::Track { body, heading_rad, heading_sd_rad } => {
            let share = |sds: f64| (-0.5 * sds * sds).exp();
            let sd_rad = heading_sd_rad.max(HEADING_SD_RAD);
            let all = [-1.5, 0.0, 1.5].map(|sds| (*body, heading_rad + sds * sd_rad, share(sds)));
            (all.to_vec(), 1.5 * sd_rad)
        }
    };
    // Beyond the border of the picture, and behind another vehicle, the body continues by an unknown length.
    let goes_on = either(cut, hidden);
    let fits: Vec<Fit> = bodies
        .into_iter()
        .filter_map(|(body, heading, share)| Seen { bbox_px, goes_on, view, body, heading }.fit(share))
        .collect();
    mixture(&fits, step)
}

/// Position and size of a vehicle: x, y, length, width, height, m.
type Placement = SVector<f64, 5>;

/// The fit of one body to the box.
struct Fit {
    placement: Placement,
    covariance: SMatrix<f64, 5, 5>,
    heading: f64,
    /// Log of the fit's weight in the mixture.
    log_weight: f64,
}

/// The negative log posterior of one body, linearised at a position and size.
struct Linear {
    cost: f64,
    /// Its second derivatives.
    information: SMatrix<f64, 5, 5>,
    gradient: Placement,
}

/// A box, and the body that is fitted to it.
struct Seen<'a> {
    /// The box: left, top, right, bottom, px.
    bbox_px: &'a [f64; 4],
    /// Whether the body continues beyond the left, top, right and bottom edge.
    goes_on: [bool; 4],
    view: &'a FrameCamera,
    body: Body,
    heading: f64,
}

impl Seen<'_> {
    /// Fits position and size; `share` is the prior probability of the body. `None` where the body has no projection.
    fn fit(&self, share: f64) -> Option<Fit> {
        let foot = self.view.surface_from_pixel(&bbox_foot(self.bbox_px))?;
        let behind = foot
            + foot.try_normalize(f64::MIN_POSITIVE).unwrap_or_default()
                * (self.body.dims_m.x + self.body.dims_m.y)
                / 4.0;
        let precision = self.body.covariance.try_inverse()?;
        let dims = self.body.dims_m;
        let mut placement = Placement::new(behind.x, behind.y, dims.x, dims.y, dims.z);
        let mut here = self.linear(&placement, &precision)?;
        let least_m = self.body.least_m();
        for _ in 0..ROUNDS {
            let mut trial = placement - here.information.cholesky()?.solve(&here.gradient);
            (0..3).for_each(|i| trial[2 + i] = trial[2 + i].max(least_m[i]));
            let Some(there) = self.linear(&trial, &precision) else { break };
            let gained = here.cost - there.cost;
            if gained.is_nan() || gained < 1e-3 {
                break;
            }
            (placement, here) = (trial, there);
        }
        let Linear { cost, information, .. } = here;
        let factor = information.cholesky()?;
        let log_det = 2.0 * factor.l().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        let log_prior = 0.5 * precision.determinant().ln();
        let log_weight = share.ln() - cost + log_prior - 0.5 * log_det;
        Some(Fit { placement, covariance: factor.inverse(), heading: self.heading, log_weight })
    }

    /// Linearises the negative log posterior at a position and size.
    fn linear(&self, placement: &Placement, precision: &Matrix3<f64>) -> Option<Linear> {
        let [x0, y0, x1, y1] = *self.bbox_px;
        let sd_px = EDGE_SD_PX + EDGE_SD_SHARE.hypot(OUTLINE_SD) * (x1 - x0).min(y1 - y0);
        let inside = |placement: &Placement| {
            let pose = GroundPose { x_m: placement[0], y_m: placement[1], heading_rad: self.heading };
            let dims_m = placement.fixed_rows::<3>(2).into_owned();
            let at = body_box(self.view, &pose, self.body.class, &dims_m)?;
            Some(Vector4::from_fn(|i, _| OUTWARD[i] * (at[i] - self.bbox_px[i]) / sd_px))
        };
        let here = inside(placement)?;
        let mut derivatives = SMatrix::<f64, 4, 5>::zeros();
        for p in 0..5 {
            let mut moved = *placement;
            moved[p] += STEP;
            derivatives.set_column(p, &((inside(&moved)? - here) / STEP));
        }
        let mut information = SMatrix::<f64, 5, 5>::zeros();
        let mut gradient = Placement::zeros();
        let mut cost = 0.0;
        for edge in (0..4).filter(|edge| !(self.goes_on[*edge] && here[*edge] > 0.0)) {
            let row = derivatives.row(edge);
            information += row.transpose() * row;
            gradient += row.transpose() * here[edge];
            cost += 0.5 * here[edge] * here[edge];
        }
        let off = placement.fixed_rows::<3>(2) - self.body.dims_m;
        let mut sizes = information.fixed_view_mut::<3, 3>(2, 2);
        sizes += precision;
        let mut pull = gradient.fixed_rows_mut::<3>(2);
        pull += precision * off;
        cost += 0.5 * off.dot(&(precision * off));
        // A weak prior of the position keeps the information invertible.
        information[(0, 0)] += 1e-6;
        information[(1, 1)] += 1e-6;
        Some(Linear { cost, information, gradient })
    }
}

/// Returns the moments of the mixture of fits, whose headings are a `step` apart, rad; `None` without a finite weight.
fn mixture(fits: &[Fit], step: f64) -> Option<GroundContact> {
    let most = fits.iter().map(|fit| fit.log_weight).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = fits.iter().map(|fit| (fit.log_weight - most).exp()).collect();
    let total: f64 = weights.iter().sum();
    if !(total.is_finite() && total > 0.0) {
        return None;
    }
    let mut mean = Placement::zeros();
    let mut axis = Vector2::zeros();
    for (fit, weight) in fits.iter().zip(&weights) {
        mean += fit.placement * (weight / total);
        axis += Vector2::new((2.0 * fit.heading).cos(), (2.0 * fit.heading).sin()) * (weight / total);
    }
    let heading_rad = axis.y.atan2(axis.x) / 2.0;
    let mut spread = SMatrix::<f64, 5, 5>::zeros();
    let (mut by_heading, mut turned_square) = (Vector2::zeros(), 0.0);
    for (fit, weight) in fits.iter().zip(&weights) {
        let off = fit.placement - mean;
        spread += (fit.covariance + off * off.transpose()) * (weight / total);
        let turned = fold_axis(fit.heading - heading_rad);
        by_heading += off.fixed_rows::<2>(0) * (turned * weight / total);
        turned_square += turned * turned * weight / total;
    }
    // Variance of the axis from the mean of doubled angles (Mardia & Jupp 2000, wrapped normal), plus that of one step
    // of headings.
    let axis_variance = -2.0 * axis.norm().clamp(1e-3, 1.0).ln() / 4.0 + step * step / 12.0;
    let mut covariance = Matrix3::zeros();
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&spread.fixed_view::<2, 2>(0, 0));
    covariance[(2, 2)] = axis_variance.max(turned_square);
    covariance.fixed_view_mut::<2, 1>(0, 2).copy_from(&by_heading);
    covariance.fixed_view_mut::<1, 2>(2, 0).copy_from(&by_heading.transpose());
    Some(GroundContact {
        pose: GroundPose { x_m: mean[0], y_m: mean[1], heading_rad },
        covariance,
        dims_m: [mean.fixed_rows::<3>(2).into_owned(), spread.diagonal().fixed_rows::<3>(2).map(f64::sqrt)],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{Camera, Ground, GroundPlane, ImageSize, bbox_cut};

    /// Size of the test pictures, px.
    const SIZE: ImageSize = ImageSize { width: 1280, height: 720 };

    /// Returns the camera and the plane of the tests.
    fn view() -> FrameCamera {
        FrameCamera {
            camera: Camera::centred(1100.0, SIZE),
            ground: Ground::plane(GroundPlane::from_tilt_roll_height(0.3, 0.0, 9.0)),
        }
    }

    /// Places the vehicle in a box, with these hidden edges.
    fn placed(bbox_px: &[f64; 4], hidden: [bool; 4], knowledge: &Knowledge) -> Option<GroundContact> {
        ground_contact(bbox_px, bbox_cut(bbox_px, &SIZE.picture_px()), hidden, &view(), knowledge)
    }

    #[test]
    fn a_body_is_at_its_position_within_its_covariance() {
        for (class, label) in [
            (VehicleClass::Truck, VehicleClass::Truck),
            (VehicleClass::Bus, VehicleClass::Bus),
            (VehicleClass::Motorcycle, VehicleClass::Motorcycle),
            (VehicleClass::Car, VehicleClass::Truck),
        ] {
            for (x_m, y_m, heading_rad) in [(-5.0, 30.0, 0.2), (3.0, 45.0, 1.5), (0.0, 25.0, 2.3)] {
                let pose = GroundPose { x_m, y_m, heading_rad };
                let bbox = body_box(&view(), &pose, class, &body_of(class).dims_m).unwrap();
                let found = placed(&bbox, [false; 4], &Knowledge::Label(label)).unwrap();
                let off = Vector2::new(found.pose.x_m - x_m, found.pose.y_m - y_m);
                let spread = found.covariance.fixed_view::<2, 2>(0, 0).into_owned();
                let square = off.dot(&(spread.try_inverse().unwrap() * off));
                assert!(square < 9.0 && off.norm() < 4.0, "{class:?} as {label:?}: {off:?}, {spread:?}");
                if class == label {
                    let body = body_of(class);
                    let larger =
                        (found.dims_m[0] - body.dims_m).component_div(&(body.at_sds_m(1.0) - body.dims_m));
                    assert!(larger.amax() < 1.0, "{class:?}: {:?}", found.dims_m[0]);
                }
            }
        }
    }

    #[test]
    fn a_tracked_body_has_a_precise_position() {
        let pose = GroundPose { x_m: -4.0, y_m: 35.0, heading_rad: 1.2 };
        let body = Body { covariance: Matrix3::identity() * 0.04, ..body_of(VehicleClass::Bus) };
        let bbox = body_box(&view(), &pose, body.class, &body.dims_m).unwrap();
        let known = Knowledge::Track { body, heading_rad: 1.2, heading_sd_rad: 0.05 };
        let found = placed(&bbox, [false; 4], &known).unwrap();
        assert!((found.pose.x_m - pose.x_m).hypot(found.pose.y_m - pose.y_m) < 0.2, "{found:?}");
        assert!(found.covariance[(0, 0)].sqrt() < 1.0);
        // The box may show the heading better, and the grid of headings adds little.
        assert!(found.covariance[(2, 2)].sqrt() < 1.1 * HEADING_SD_RAD, "{found:?}");
    }

    #[test]
    fn a_hidden_lower_edge_is_not_on_the_ground() {
        let pose = GroundPose { x_m: 2.0, y_m: 40.0, heading_rad: 1.4 };
        let body = body_of(VehicleClass::Car);
        let [x0, y0, x1, y1] = body_box(&view(), &pose, body.class, &body.dims_m).unwrap();
        let bbox = [x0, y0, x1, y0 + 0.6 * (y1 - y0)];
        let label = Knowledge::Track { body, heading_rad: 1.4, heading_sd_rad: 0.05 };
        let off = |hidden| {
            let found = placed(&bbox, hidden, &label).unwrap();
            let off = Vector2::new(found.pose.x_m - pose.x_m, found.pose.y_m - pose.y_m);
            let spread = found.covariance.fixed_view::<2, 2>(0, 0).into_owned();
            (off.norm(), off.dot(&(spread.try_inverse().unwrap() * off)))
        };
        let (taken, told) = (off([false; 4]), off([false, false, false, true]));
        assert!(told.0 < 0.3 * taken.0 && told.1 < 4.0, "{taken:?} {told:?}");
    }

    #[test]
    fn a_tracked_body_continues_below_the_picture() {
        let pose = GroundPose { x_m: -3.0, y_m: 14.0, heading_rad: 1.4 };
        let body = body_of(VehicleClass::Truck);
        let whole = body_box(&view(), &pose, body.class, &body.dims_m).unwrap();
        assert!(whole[3] > f64::from(SIZE.height) + 20.0, "{whole:?}");
        let bbox = [whole[0], whole[1], whole[2], f64::from(SIZE.height) - 1.0];
        let known = Knowledge::Track {
            body: Body { covariance: Matrix3::identity() * 0.04, ..body },
            heading_rad: 1.4,
            heading_sd_rad: 0.05,
        };
        let found = placed(&bbox, [false; 4], &known).unwrap();
        assert!((found.pose.x_m - pose.x_m).hypot(found.pose.y_m - pose.y_m) < 1.0, "{found:?}");
    }

    #[test]
    fn what_is_cut_off_below_or_lies_above_the_horizon_says_nothing() {
        let label = Knowledge::Label(VehicleClass::Truck);
        assert!(placed(&[100.0, 600.0, 300.0, 719.0], [false; 4], &label).is_none());
        assert!(placed(&[100.0, 0.0, 300.0, 4.0], [false; 4], &label).is_none());
    }
}
