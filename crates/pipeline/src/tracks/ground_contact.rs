//! Estimates a vehicle's position from its box alone: the ground position at which a body of its class has the detected
//! box.
//!
//! The box alone does not determine heading and length, so bodies of all classes and headings are tried. Each is fitted
//! by least squares over position and size (x, y, length, width, height; sizes with the prior of their class). The
//! result has the moments of the mixture of these fits. The weights are Laplace's approximation of each fit's evidence
//! (MacKay 2003, chapter 27).

use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix3, Point3, SMatrix, SVector, Vector2, Vector3};
use roadplane_base::{GroundPose, VehicleClass, fold_axis};

use crate::tracks::body::{Body, body_of};
use crate::tracks::cars::FrameCamera;

/// Number of headings that are tried in half a turn.
const HEADINGS: usize = 8;
/// Largest number of Gauss–Newton rounds of a fit.
const ROUNDS: usize = 8;
/// Constant part of the sd of a box's edge, px.
const EDGE_SD_PX: f64 = 1.0;
/// Part of the sd of a box's edge that grows with the box, as a share of its shorter side.
const EDGE_SD_SHARE: f64 = 0.05;
/// Factor on the sd of the lower edge, which other vehicles may hide.
const BOTTOM_FACTOR: f64 = 2.0;
/// Factor on the sd of an edge that lies where another vehicle begins.
const HIDDEN_FACTOR: f64 = 10.0;
/// An edge nearer than this to the picture's border is cut off by the picture, px.
const CUT_PX: f64 = 2.5;
/// Height of the bumpers' lower edge above the ground, m.
const CLEARANCE_M: f64 = 0.3;
/// Least length, width and height of a body, m.
const LEAST_M: f64 = 1.0;

/// Outline of a body: levels of half length and half width, at a height.
///
/// Half length is in lengths, half width in widths. The height is a share of the height above the bumpers' lower edge;
/// `None` is the ground, where only the wheels are.
type Outline = [(f64, f64, Option<f64>)];
/// Outline of trucks and buses: a box with wheels.
const BOX: &Outline = &[(0.5, 0.5, Some(1.0)), (0.5, 0.5, Some(0.0)), (0.3, 0.5, None)];
/// Outline of cars: roof, bonnet and boot, bumpers, wheels.
///
/// It is the atlas's mean car with equal front and rear, because a box does not distinguish them.
const SALOON: &Outline =
    &[(0.2, 0.35, Some(1.0)), (0.45, 0.45, Some(0.47)), (0.5, 0.4, Some(0.0)), (0.3, 0.5, None)];

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

/// Least sd of a track's heading at one time, rad.
const LEAST_HEADING_SD_RAD: f64 = 0.05;

/// Prior information about the vehicle in a box.
#[derive(Clone, Copy, Debug)]
pub enum Knowledge {
    /// The detector's label.
    Label(VehicleClass),
    /// Size and heading of its track.
    Track {
        /// Size of the vehicle.
        body: Body,
        /// Heading, rad.
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
    /// Length, width and height, m.
    pub dims_m: Vector3<f64>,
    /// Sds of length, width and height, m.
    pub dims_sd_m: Vector3<f64>,
}

/// Returns whether a box reaches the border of the picture `[left, top, right, bottom]`, edge by edge.
#[must_use]
pub fn cut_edges([x0, y0, x1, y1]: &[f64; 4], [left, top, right, bottom]: &[f64; 4]) -> [bool; 4] {
    [*x0 < left + CUT_PX, *y0 < top + CUT_PX, *x1 > right - CUT_PX, *y1 > bottom - CUT_PX]
}

/// Estimates a vehicle's pose and size from its box.
///
/// `picture_px` is the picture as a box. `hidden` marks the edges at which another vehicle hides this one: left, top, right, bottom. They hardly show where
/// this vehicle ends.
///
/// `None` where the box's lower edge lies above the horizon. `None` also where that edge is cut off and only a label is
/// known.
#[must_use]
pub fn ground_contact(
    bbox_px: &[f64; 4],
    picture_px: &[f64; 4],
    hidden: [bool; 4],
    view: &FrameCamera,
    knowledge: &Knowledge,
) -> Option<GroundContact> {
    let cut = cut_edges(bbox_px, picture_px);
    let is_known = matches!(knowledge, Knowledge::Track { .. });
    if (cut[0] && cut[2]) || (cut[3] && (cut[1] || !is_known)) {
        return None;
    }
    let bodies: Vec<(Body, f64, f64)> = match knowledge {
        Knowledge::Label(label) => (prior(*label).iter())
            .flat_map(|&(class, share)| {
                let heading = |i: usize| PI * i as f64 / HEADINGS as f64;
                (0..HEADINGS).map(move |i| (body_of(class), heading(i), share))
            })
            .collect(),
        Knowledge::Track { body, heading_rad, heading_sd_rad } => {
            let share = |steps: f64| (-0.5 * steps * steps).exp();
            let sd_rad = heading_sd_rad.max(LEAST_HEADING_SD_RAD);
            [-1.5, 0.0, 1.5].map(|s| (*body, heading_rad + s * sd_rad, share(s))).to_vec()
        }
    };
    let fits: Vec<Fit> = bodies
        .into_iter()
        .filter_map(|(body, heading, share)| Seen { bbox_px, cut, hidden, view, body, heading }.fit(share))
        .collect();
    mixture(&fits)
}

/// Position and size of a vehicle: x, y, length, width, height, m.
type Place = SVector<f64, 5>;

/// The fit of one body to the box.
struct Fit {
    /// Position and size, m.
    place: Place,
    /// Covariance of position and size, m².
    covariance: SMatrix<f64, 5, 5>,
    /// Heading of the body, rad.
    heading: f64,
    /// Log of the fit's weight in the mixture.
    log_weight: f64,
}

/// A box, and the body that is fitted to it.
struct Seen<'a> {
    /// The box: left, top, right, bottom, px.
    bbox_px: &'a [f64; 4],
    /// Whether the picture cuts off the left, top, right and bottom edge.
    cut: [bool; 4],
    /// Whether another vehicle hides the left, top, right and bottom edge.
    hidden: [bool; 4],
    /// Camera and ground plane.
    view: &'a FrameCamera,
    /// Prior of the body's size.
    body: Body,
    /// Heading of the body, rad.
    heading: f64,
}

impl Seen<'_> {
    /// Fits position and size; `share` is the prior probability of the body. `None` where the body has no projection.
    fn fit(&self, share: f64) -> Option<Fit> {
        let [x0, _, x1, y1] = *self.bbox_px;
        let foot = self.view.plane.world_from_pixel(&self.view.camera, &Vector2::new((x0 + x1) / 2.0, y1))?;
        let behind = foot
            + foot.try_normalize(f64::MIN_POSITIVE).unwrap_or_default()
                * (self.body.dims_m.x + self.body.dims_m.y)
                / 4.0;
        let precision = self.body.covariance.try_inverse()?;
        let dims = self.body.dims_m;
        let mut place = Place::new(behind.x, behind.y, dims.x, dims.y, dims.z);
        let (mut cost, mut information) = self.linear(&place, &precision)?.0;
        for _ in 0..ROUNDS {
            let (_, gradient) = self.linear(&place, &precision)?;
            let step = information.cholesky()?.solve(&gradient);
            let mut trial = place - step;
            for i in 2..5 {
                trial[i] = trial[i].max(LEAST_M);
            }
            let Some(((reached, next), _)) = self.linear(&trial, &precision) else { break };
            let gained = cost - reached;
            if gained.is_nan() || gained < 1e-3 {
                break;
            }
            (place, cost, information) = (trial, reached, next);
        }
        let factor = information.cholesky()?;
        let log_det = 2.0 * factor.l().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        let log_prior = 0.5 * precision.determinant().ln();
        let log_weight = share.ln() - 0.5 * cost + log_prior - 0.5 * log_det;
        Some(Fit { place, covariance: factor.inverse(), heading: self.heading, log_weight })
    }

    /// Returns ((cost, information), gradient) at a position and size.
    fn linear(&self, place: &Place, precision: &Matrix3<f64>) -> Option<((f64, SMatrix<f64, 5, 5>), Place)> {
        let at = self.projected(place)?;
        let [x0, y0, x1, y1] = *self.bbox_px;
        let edge_sd = EDGE_SD_PX + EDGE_SD_SHARE * (x1 - x0).min(y1 - y0);
        let mut information = SMatrix::<f64, 5, 5>::zeros();
        let mut gradient = Place::zeros();
        let mut cost = 0.0;
        let mut derivatives = [[0.0; 5]; 4];
        for p in 0..5 {
            let mut moved = *place;
            moved[p] += 1e-3;
            let there = self.projected(&moved)?;
            for edge in 0..4 {
                derivatives[edge][p] = (there[edge] - at[edge]) / 1e-3;
            }
        }
        // Beyond the border of the picture the body continues by an unknown length.
        let is_beyond = |edge: usize| (at[edge] < self.bbox_px[edge]) == (edge < 2);
        for edge in (0..4).filter(|edge| !(self.cut[*edge] && is_beyond(*edge))) {
            let sd = edge_sd
                * match (self.hidden[edge], edge == 3) {
                    (true, _) => HIDDEN_FACTOR,
                    (false, true) => BOTTOM_FACTOR,
                    (false, false) => 1.0,
                };
            let row = Place::from(derivatives[edge]) / sd;
            let residual = (at[edge] - self.bbox_px[edge]) / sd;
            information += row * row.transpose();
            gradient += row * residual;
            cost += residual * residual;
        }
        let off = place.fixed_rows::<3>(2) - self.body.dims_m;
        let mut sizes = information.fixed_view_mut::<3, 3>(2, 2);
        sizes += precision;
        let mut pull = gradient.fixed_rows_mut::<3>(2);
        pull += precision * off;
        cost += off.dot(&(precision * off));
        // A weak prior of the position keeps the information invertible.
        information[(0, 0)] += 1e-6;
        information[(1, 1)] += 1e-6;
        Some(((cost, information), gradient))
    }

    /// Returns the box of the body in the picture, px.
    fn projected(&self, place: &Place) -> Option<[f64; 4]> {
        let pose = GroundPose { x_m: place[0], y_m: place[1], heading_rad: self.heading };
        body_box(self.view, &pose, self.body.class, &Vector3::new(place[2], place[3], place[4]))
    }
}

/// Returns the box of a body on the ground in the picture, px.
///
/// `None` if a corner of its outline is not in front of the camera.
#[must_use]
pub fn body_box(
    view: &FrameCamera,
    pose: &GroundPose,
    class: VehicleClass,
    dims_m: &Vector3<f64>,
) -> Option<[f64; 4]> {
    let camera_from_car = view.plane.camera_from_world() * pose.world_from_car();
    let outline = if class == VehicleClass::Car { SALOON } else { BOX };
    let mut bbox = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for &(half_length, half_width, height) in outline {
        let z = height.map_or(0.0, |share| CLEARANCE_M + share * (dims_m.z - CLEARANCE_M));
        for (ahead, left) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let point = Point3::new(ahead * half_length * dims_m.x, left * half_width * dims_m.y, z);
            let pixel = view.camera.pixel_from_camera(&(camera_from_car * point).coords)?;
            bbox = [bbox[0].min(pixel.x), bbox[1].min(pixel.y), bbox[2].max(pixel.x), bbox[3].max(pixel.y)];
        }
    }
    Some(bbox)
}

/// Returns the moments of the mixture of fits; `None` without a finite weight.
fn mixture(fits: &[Fit]) -> Option<GroundContact> {
    let most = fits.iter().map(|fit| fit.log_weight).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = fits.iter().map(|fit| (fit.log_weight - most).exp()).collect();
    let total: f64 = weights.iter().sum();
    if !(total.is_finite() && total > 0.0) {
        return None;
    }
    let mut mean = Place::zeros();
    let mut axis = Vector2::zeros();
    for (fit, weight) in fits.iter().zip(&weights) {
        mean += fit.place * (weight / total);
        axis += Vector2::new((2.0 * fit.heading).cos(), (2.0 * fit.heading).sin()) * (weight / total);
    }
    let heading_rad = axis.y.atan2(axis.x) / 2.0;
    let mut spread = SMatrix::<f64, 5, 5>::zeros();
    let (mut by_heading, mut turned_square) = (Vector2::zeros(), 0.0);
    for (fit, weight) in fits.iter().zip(&weights) {
        let off = fit.place - mean;
        spread += (fit.covariance + off * off.transpose()) * (weight / total);
        let turned = fold_axis(fit.heading - heading_rad);
        by_heading += off.fixed_rows::<2>(0) * (turned * weight / total);
        turned_square += turned * turned * weight / total;
    }
    // Variance of the axis from the mean of doubled angles (Mardia & Jupp 2000, wrapped normal), plus that of one step
    // of headings.
    let step = PI / HEADINGS as f64;
    let axis_variance = -2.0 * axis.norm().clamp(1e-3, 1.0).ln() / 4.0 + step * step / 12.0;
    let mut covariance = Matrix3::zeros();
    let position: Matrix2<f64> = spread.fixed_view::<2, 2>(0, 0).into_owned();
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&position);
    covariance[(2, 2)] = axis_variance.max(turned_square);
    covariance.fixed_view_mut::<2, 1>(0, 2).copy_from(&by_heading);
    covariance.fixed_view_mut::<1, 2>(2, 0).copy_from(&by_heading.transpose());
    Some(GroundContact {
        pose: GroundPose { x_m: mean[0], y_m: mean[1], heading_rad },
        covariance,
        dims_m: Vector3::new(mean[2], mean[3], mean[4]),
        dims_sd_m: Vector3::new(spread[(2, 2)], spread[(3, 3)], spread[(4, 4)]).map(f64::sqrt),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::ImageSize;
    use roadplane_base::{Camera, GroundPlane};

    /// Size of the test pictures, px.
    const SIZE: ImageSize = ImageSize { width: 1280, height: 720 };

    /// Returns the camera and the plane of the tests.
    fn view() -> FrameCamera {
        FrameCamera {
            camera: Camera::centred(1100.0, SIZE),
            plane: GroundPlane::from_tilt_roll_height(0.3, 0.0, 9.0),
        }
    }

    #[test]
    fn a_body_is_found_where_it_stands_within_what_is_claimed() {
        for (class, label) in [
            (VehicleClass::Truck, VehicleClass::Truck),
            (VehicleClass::Bus, VehicleClass::Bus),
            (VehicleClass::Motorcycle, VehicleClass::Motorcycle),
            (VehicleClass::Car, VehicleClass::Truck),
        ] {
            for (x_m, y_m, heading_rad) in [(-5.0, 30.0, 0.2), (3.0, 45.0, 1.5), (0.0, 25.0, 2.3)] {
                let pose = GroundPose { x_m, y_m, heading_rad };
                let bbox = body_box(&view(), &pose, class, &body_of(class).dims_m).unwrap();
                let found =
                    ground_contact(&bbox, &SIZE.picture_px(), [false; 4], &view(), &Knowledge::Label(label))
                        .unwrap();
                let off = Vector2::new(found.pose.x_m - x_m, found.pose.y_m - y_m);
                let spread = found.covariance.fixed_view::<2, 2>(0, 0).into_owned();
                let square = off.dot(&(spread.try_inverse().unwrap() * off));
                assert!(square < 9.0 && off.norm() < 4.0, "{class:?} as {label:?}: {off:?}, {spread:?}");
            }
        }
    }

    #[test]
    fn a_known_body_is_found_sharply() {
        let pose = GroundPose { x_m: -4.0, y_m: 35.0, heading_rad: 1.2 };
        let body = Body { covariance: Matrix3::identity() * 0.04, ..body_of(VehicleClass::Bus) };
        let bbox = body_box(&view(), &pose, body.class, &body.dims_m).unwrap();
        let known = Knowledge::Track { body, heading_rad: 1.2, heading_sd_rad: 0.05 };
        let found = ground_contact(&bbox, &SIZE.picture_px(), [false; 4], &view(), &known).unwrap();
        assert!((found.pose.x_m - pose.x_m).hypot(found.pose.y_m - pose.y_m) < 0.2, "{found:?}");
        assert!(found.covariance[(0, 0)].sqrt() < 1.0);
    }

    #[test]
    fn a_hidden_lower_edge_is_not_where_the_vehicle_stands() {
        let pose = GroundPose { x_m: 2.0, y_m: 40.0, heading_rad: 1.4 };
        let body = body_of(VehicleClass::Car);
        let [x0, y0, x1, y1] = body_box(&view(), &pose, body.class, &body.dims_m).unwrap();
        let bbox = [x0, y0, x1, y0 + 0.6 * (y1 - y0)];
        let label = Knowledge::Track { body, heading_rad: 1.4, heading_sd_rad: 0.05 };
        let off = |hidden| {
            let found = ground_contact(&bbox, &SIZE.picture_px(), hidden, &view(), &label).unwrap();
            let off = Vector2::new(found.pose.x_m - pose.x_m, found.pose.y_m - pose.y_m);
            let spread = found.covariance.fixed_view::<2, 2>(0, 0).into_owned();
            (off.norm(), off.dot(&(spread.try_inverse().unwrap() * off)))
        };
        let (taken, told) = (off([false; 4]), off([false, false, false, true]));
        assert!(told.0 < 0.3 * taken.0 && told.1 < 4.0, "{taken:?} {told:?}");
    }

    #[test]
    fn a_known_body_goes_on_below_the_picture() {
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
        let found = ground_contact(&bbox, &SIZE.picture_px(), [false; 4], &view(), &known).unwrap();
        assert!((found.pose.x_m - pose.x_m).hypot(found.pose.y_m - pose.y_m) < 1.0, "{found:?}");
    }

    #[test]
    fn what_is_cut_off_below_or_lies_above_the_horizon_says_nothing() {
        let label = Knowledge::Label(VehicleClass::Truck);
        assert!(
            ground_contact(&[100.0, 600.0, 300.0, 719.0], &SIZE.picture_px(), [false; 4], &view(), &label)
                .is_none()
        );
        assert!(
            ground_contact(&[100.0, 0.0, 300.0, 4.0], &SIZE.picture_px(), [false; 4], &view(), &label)
                .is_none()
        );
    }
}
