//! Finds a fold of the ground: a road that begins to rise or fall at a line.
//!
//! In each window, all cars were solved on one plane. A view k gives evidence on (tilt, roll, log height) of the plane
//! below its car. A fold at the picture's line ℓ turns the plane beyond this line by the angle φ. Planes that meet in
//! ℓ differ by a multiple of it: with q = normal / height in the camera frame, q' = q + κ ℓ. So the change of the three
//! numbers beyond the line is φ d(ℓ), with one unknown angle φ.
//!
//! A car that is smaller than estimated seems farther away, like a car on a lower plane. So each car has an unknown
//! log size, too, which all its views in a window share. The keypoint net also has errors that depend on a car's size in
//! the picture. Planes, sizes and these errors are eliminated, and the evidence on φ remains. The angle has the prior of a
//! road's slope. The density of the evidence over all lines, relative to φ = 0, decides whether the ground has a fold. All
//! windows are then solved again, with one plane on either side of the line.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Cholesky, Matrix3, Matrix3x6, Matrix6, U3, Vector2, Vector3, Vector6};
use roadplane_base::{CameraParams, StudentT, upper_median};

use crate::{LinkId, VerticalVanishingPoint};

/// Sd of a car's log size, which its views share. It is the median sd of the log height that the keypoints of a single
/// car leave open, on eight rendered streets (0.052).
const SIZE_SD: f64 = 0.05;
/// Sds of the keypoint net's errors that depend on the size of a car in the picture, per unit of the log of the box's
/// side. The first is that of the tilt (rad), the second that of the log height. They are estimates: as large as the
/// error of the elevation that all cars share (`solve.shared_view_sd_deg`), and as the error of a car's size.
const BY_SIZE_SD: [f64; 2] = [0.016, SIZE_SD];
/// Index of the errors that depend on size, after the plane.
const BY_SIZE: usize = 3;
/// Index of the angle of the fold.
const FOLD: usize = 5;
/// Normal equations of the plane, the errors by size and the fold: the Hessian and the gradient.
type Equations = (Matrix6<f64>, Vector6<f64>);
/// Information that keeps unobserved numbers of a plane finite.
const LEAST_INFORMATION: f64 = 1e-6;
/// Number of directions of lines, and of lines per direction.
const LINES: usize = 12;
/// Largest number of views. Later windows of a long clip are not used.
const MOST_VIEWS: usize = 4000;
/// Number of rounds in which the views' weights are computed.
const ROUNDS: usize = 5;

/// Evidence of one view of a car on the plane below it.
#[derive(Clone, Copy, Debug)]
pub struct GroundView {
    /// Identifier of the car.
    pub link: LinkId,
    /// Whether the car was stationary.
    pub parked: bool,
    /// Middle of the box's lower edge, relative to the principal point, without lens distortion, px.
    pub foot_px: Vector2<f64>,
    /// Longer side of its box, px.
    pub side_px: f64,
    /// Hessian of the cost by (tilt, roll, log height).
    pub information: Matrix3<f64>,
    /// Gradient of the cost.
    pub gradient: Vector3<f64>,
}

/// Views of a window, and the plane on which they were solved.
struct Solved {
    params: CameraParams,
    views: Vec<GroundView>,
}

/// A line in the picture at which the ground folds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fold {
    /// Coefficients ℓ of the line: ℓ · (x, y, 1) = 0, where (x, y) is relative to the principal point, without lens
    /// distortion, px. Beyond the line, ℓ · (x, y, 1) > 0, and fewer cars are there than on the other side.
    pub line: Vector3<f64>,
    /// Means of the cars' feet on this side of the line and beyond it, in the same pixels.
    pub middles_px: [Vector2<f64>; 2],
    /// Turn of the ground beyond the line, rad. It is positive in a hollow and negative on a crest.
    pub angle_rad: f64,
    /// Log of the evidence for a fold, relative to a plane ground.
    pub log_evidence: f64,
}

impl Fold {
    /// Least evidence of a certain fold: its probability is 99 % if 5 % of all sites have one.
    const CERTAIN: f64 = 7.5;

    /// Whether the ground has this fold with a probability of at least 99 %.
    #[must_use]
    pub fn is_certain(&self) -> bool {
        self.log_evidence >= Self::CERTAIN
    }
}

/// Whether a point of the picture lies beyond a line. It is relative to the principal point, without lens distortion, px.
pub(crate) fn is_beyond(line: &Vector3<f64>, point_px: &Vector2<f64>) -> bool {
    line.dot(&point_px.push(1.0)) > 0.0
}

/// Collects the evidence of windows on the shape of the ground.
#[derive(Default)]
pub struct GroundEvidence {
    windows: Vec<Solved>,
    parked: BTreeSet<LinkId>,
    views: usize,
}

impl GroundEvidence {
    /// Adds the views of a window that was solved with this camera. A parked car counts in one window only.
    pub fn add(&mut self, params: CameraParams, views: impl Iterator<Item = GroundView>) {
        if self.views >= MOST_VIEWS {
            return;
        }
        let views: Vec<GroundView> =
            views.filter(|view| !(view.parked && self.parked.contains(&view.link))).collect();
        self.parked.extend(views.iter().filter(|view| view.parked).map(|view| view.link));
        self.views += views.len();
        self.windows.push(Solved { params, views });
    }

    /// Returns the most likely fold of the ground, whatever its evidence; `None` without views.
    #[must_use]
    pub fn fold(&self) -> Option<Fold> {
        let weights = self.weights();
        let lines = self.lines();
        // Log evidence, angle and line of the fold at each line.
        let at_line = |line: &Vector3<f64>| {
            self.at_line(line, &weights).map(|(log_evidence, angle_rad)| (log_evidence, angle_rad, *line))
        };
        let folds: Vec<(f64, f64, Vector3<f64>)> = lines.iter().filter_map(at_line).collect();
        let (most, angle_rad, line) = folds.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let mean = folds.iter().map(|fold| (fold.0 - most).exp()).sum::<f64>() / lines.len() as f64;
        let (beyond, here): (Vec<_>, Vec<_>) = self.feet().partition(|foot| is_beyond(&line, foot));
        let middle = |feet: &[Vector2<f64>]| feet.iter().sum::<Vector2<f64>>() / feet.len() as f64;
        let (line, middles_px) = match beyond.len() > here.len() {
            true => (-line, [middle(&beyond), middle(&here)]),
            false => (line, [middle(&here), middle(&beyond)]),
        };
        Some(Fold { line, middles_px, angle_rad, log_evidence: most + mean.ln() })
    }

    /// Returns the feet of all views, px.
    fn feet(&self) -> impl Iterator<Item = Vector2<f64>> + '_ {
        self.windows.iter().flat_map(|window| window.views.iter().map(|view| view.foot_px))
    }

    /// Returns the lines of a regular grid over the views.
    fn lines(&self) -> Vec<Vector3<f64>> {
        let mut lines = Vec::new();
        for direction in 0..LINES {
            let (sin, cos) = (std::f64::consts::PI * direction as f64 / LINES as f64).sin_cos();
            let mut along: Vec<f64> = self.feet().map(|foot| cos * foot.x + sin * foot.y).collect();
            along.sort_by(f64::total_cmp);
            for i in 1..=LINES {
                let Some(at) = along.get(i * along.len() / (LINES + 1)) else { continue };
                lines.push(Vector3::new(cos, sin, -at));
            }
        }
        lines
    }

    /// Returns the weight of each view. The views' errors are t-distributed, with the scale that the clip shows.
    fn weights(&self) -> Vec<Vec<f64>> {
        let mut weights: Vec<Vec<f64>> =
            self.windows.iter().map(|window| vec![1.0; window.views.len()]).collect();
        for _ in 0..ROUNDS {
            let squares: Vec<Vec<f64>> = self
                .windows
                .iter()
                .zip(&weights)
                .map(|(window, weights)| window.squares(weights).unwrap_or(vec![0.0; weights.len()]))
                .collect();
            let mut all: Vec<f64> = squares.iter().flatten().copied().collect();
            // The median of a chi-squared variable with three degrees of freedom is 2.366.
            let scale = (upper_median(&mut all, f64::total_cmp).unwrap_or(1.0) / 2.366).max(1.0);
            for (weights, squares) in weights.iter_mut().zip(&squares) {
                for (weight, square) in weights.iter_mut().zip(squares) {
                    *weight = StudentT { dimensions: 3.0 }.weight(square / scale) / scale;
                }
            }
        }
        weights
    }

    /// Returns log evidence and angle (rad) of the most likely fold at a line; `None` where the cars do not determine it.
    fn at_line(&self, line: &Vector3<f64>, weights: &[Vec<f64>]) -> Option<(f64, f64)> {
        // The errors by size are those of all windows. The plane is one per window.
        let by_size = Vector2::from(BY_SIZE_SD).map(|sd| 1.0 / (sd * sd)).push(0.0);
        let (mut hessian, mut gradient) = (Matrix3::from_diagonal(&by_size), Vector3::zeros());
        for (window, weights) in self.windows.iter().zip(weights) {
            let beyond = |view: &GroundView| is_beyond(line, &view.foot_px);
            let of_window = |change| without_plane(&window.equations(weights, beyond, &change));
            // A window whose plane the line does not cut, or whose cars do not determine it, gives no evidence.
            let Some((own, slope)) = window.change(line).and_then(of_window) else { continue };
            hessian += own;
            gradient += slope;
        }
        let cross = hessian.fixed_view::<2, 1>(0, 2).into_owned();
        let solved = hessian.fixed_view::<2, 2>(0, 0).into_owned().cholesky()?.solve(&cross);
        let information = (hessian[(2, 2)] - cross.dot(&solved)).max(0.0);
        let gradient = gradient[2] - gradient.xy().dot(&solved);
        // A road's slope is that of a level or of a steep street.
        let component = |sd: f64, share: f64| {
            let all = information + 1.0 / (sd * sd);
            let log_gain = 0.5 * gradient * gradient / all - 0.5 * (information * sd * sd).ln_1p();
            (share.ln() + log_gain, -gradient / all)
        };
        let steep = VerticalVanishingPoint::STEEP_SHARE;
        let level = component(VerticalVanishingPoint::SLOPE_SD, 1.0 - steep);
        let steep = component(VerticalVanishingPoint::STEEP_SD, steep);
        let (likely, other) = if level.0 > steep.0 { (level, steep) } else { (steep, level) };
        let log_evidence = likely.0 + (other.0 - likely.0).exp().ln_1p();
        log_evidence.is_finite().then_some((log_evidence, likely.1))
    }
}

impl Solved {
    /// Returns the change of (tilt, roll, log height) per radian of a fold at the line.
    fn change(&self, line: &Vector3<f64>) -> Option<Vector3<f64>> {
        let plane = self.params.plane();
        let normal = plane.normal_in_camera;
        let (sin_t, cos_t) = self.params.tilt.sin_cos();
        let (sin_r, cos_r) = self.params.roll.sin_cos();
        let by_tilt = Vector3::new(-sin_r * sin_t, cos_r * sin_t, -cos_t);
        let by_roll = Vector3::new(cos_r * cos_t, sin_r * cos_t, 0.0);
        let by = Matrix3::from_columns(&[by_tilt, by_roll, -normal]) / plane.height_m;
        // The line as coefficients of rays.
        let focal_px = self.params.focal_px();
        let line = line.component_mul(&Vector3::new(focal_px, focal_px, 1.0));
        let across = (line - normal * normal.dot(&line)).norm() * plane.height_m;
        // A ray meets the ground at the distance −1 / (q · ray), so q falls where the ground rises.
        (across > 1e-9).then(|| by.try_inverse().map(|inverse| -inverse * line / across))?
    }

    /// Returns the normal equations. The sizes of the cars are eliminated.
    fn equations(
        &self,
        weights: &[f64],
        beyond: impl Fn(&GroundView) -> bool,
        change: &Vector3<f64>,
    ) -> Equations {
        let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        let mut sizes: BTreeMap<LinkId, (Vector6<f64>, f64, f64)> = BTreeMap::new();
        for (view, weight) in self.views.iter().zip(weights) {
            let mut design = Matrix3x6::zeros();
            design.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            let log_side = view.side_px.max(1.0).ln();
            (design[(0, BY_SIZE)], design[(2, BY_SIZE + 1)]) = (log_side, log_side);
            if beyond(view) {
                design.set_column(FOLD, change);
            }
            let (information, slope) = (view.information * *weight, view.gradient * *weight);
            hessian += design.transpose() * information * design;
            gradient += design.transpose() * slope;
            // A larger car at the same pixels means a larger height.
            let size = sizes.entry(view.link).or_insert((Vector6::zeros(), SIZE_SD.powi(-2), 0.0));
            size.0 -= design.transpose() * information.column(2);
            size.1 += information[(2, 2)];
            size.2 -= slope[2];
        }
        for (cross, information, slope) in sizes.values() {
            hessian -= cross * cross.transpose() / *information;
            gradient -= cross * (slope / information);
        }
        (hessian, gradient)
    }

    /// Returns the squared distance of each view from the common plane, in its sds.
    fn squares(&self, weights: &[f64]) -> Option<Vec<f64>> {
        let (hessian, gradient) = self.equations(weights, |_| false, &Vector3::zeros());
        let plane = -cholesky(&hessian.fixed_view::<3, 3>(0, 0).into_owned())?
            .solve(&gradient.fixed_rows::<3>(0).into_owned());
        let mut sizes: BTreeMap<LinkId, (f64, f64)> = BTreeMap::new();
        for (view, weight) in self.views.iter().zip(weights) {
            let size = sizes.entry(view.link).or_insert((SIZE_SD.powi(-2), 0.0));
            size.0 += weight * view.information[(2, 2)];
            size.1 += weight * (view.gradient + view.information * plane)[2];
        }
        let square = |view: &GroundView| {
            let size = sizes.get(&view.link).map_or(0.0, |(information, slope)| slope / information);
            let slope = view.gradient + view.information * (plane - Vector3::z() * size);
            cholesky(&view.information).map_or(0.0, |own| slope.dot(&own.solve(&slope)))
        };
        Some(self.views.iter().map(square).collect())
    }
}

/// Returns the Cholesky factor of an information matrix of a plane's numbers, of which some may be unobserved.
fn cholesky(plane: &Matrix3<f64>) -> Option<Cholesky<f64, U3>> {
    (plane + Matrix3::identity() * LEAST_INFORMATION).cholesky()
}

/// Returns the normal equations of the errors by size and the fold, with the plane eliminated.
fn without_plane((hessian, gradient): &Equations) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    let cross = hessian.fixed_view::<3, 3>(0, 3).into_owned();
    let solved = cholesky(&hessian.fixed_view::<3, 3>(0, 0).into_owned())?.solve(&cross);
    Some((
        hessian.fixed_view::<3, 3>(3, 3) - cross.transpose() * solved,
        gradient.fixed_rows::<3>(3) - solved.transpose() * gradient.fixed_rows::<3>(0),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::GroundPlane;
    use roadplane_synth::Rng;

    /// Line of the fold in the tests: 45 px below the middle of the picture, with a slope of a tenth.
    const LINE: [f64; 3] = [0.1, -1.0, 45.0];

    /// Returns the evidence of cars on a grid over the picture. The ground beyond the line is turned by an angle (rad).
    /// The errors have one sd.
    fn evidence(angle_rad: f64, seed: u64) -> GroundEvidence {
        let params = CameraParams::new(1200.0, &GroundPlane::from_tilt_roll_height(0.25, 0.02, 8.0));
        let alone = Solved { params, views: Vec::new() };
        let change = alone.change(&Vector3::from(LINE)).unwrap() * angle_rad;
        let information = Matrix3::new(4e3, 30.0, 60.0, 30.0, 3e3, 20.0, 60.0, 20.0, 1.2e3);
        let mut evidence = GroundEvidence::default();
        let mut random = Rng::new(seed);
        let view = |i: usize| {
            let foot_px = Vector2::new(70.0 * (i % 13) as f64 - 420.0, 40.0 * (i / 13) as f64 - 140.0);
            let beyond = if is_beyond(&Vector3::from(LINE), &foot_px) { change } else { Vector3::zeros() };
            let error = Vector3::from_fn(|k, _| random.normal() / f64::sqrt(information[(k, k)]));
            GroundView {
                link: i as LinkId,
                parked: false,
                foot_px,
                side_px: 60.0,
                information,
                gradient: -(information * (beyond + error)),
            }
        };
        evidence.add(params, (0..130).map(view));
        evidence
    }

    #[test]
    fn a_fold_is_found_where_it_is() {
        for (angle_rad, seed) in [(0.06, 1), (-0.06, 2), (0.1, 3), (-0.1, 4)] {
            let fold = evidence(angle_rad, seed).fold().unwrap();
            assert!(fold.is_certain() && (fold.angle_rad / angle_rad - 1.0).abs() < 0.4, "{fold:?}");
            // Cars that are 70 px away from the line are on the right side.
            let line = Vector3::from(LINE);
            let upside = if fold.line.dot(&line) > 0.0 { 1.0 } else { -1.0 };
            for x in [-300.0, 0.0, 300.0] {
                let on_line = Vector2::new(x, 45.0 + 0.1 * x);
                assert!(is_beyond(&fold.line, &(on_line - Vector2::new(0.0, 70.0 * upside))), "{fold:?}");
                assert!(!is_beyond(&fold.line, &(on_line + Vector2::new(0.0, 70.0 * upside))), "{fold:?}");
            }
        }
    }

    #[test]
    fn a_plane_ground_has_no_certain_fold() {
        assert!((0..20).all(|seed| !evidence(0.0, seed).fold().unwrap().is_certain()));
        assert!(GroundEvidence::default().fold().is_none());
    }

    #[test]
    fn a_fold_moves_only_the_ground_beyond_its_line() {
        let params = CameraParams::new(1200.0, &GroundPlane::from_tilt_roll_height(0.25, 0.02, 8.0));
        let line = Vector3::from(LINE);
        let change = Solved { params, views: Vec::new() }.change(&line).unwrap();
        let angle_rad = 1e-4;
        let numbers = params.to_vector() + (change * angle_rad).insert_row(0, 0.0);
        let (near, far) = (params.plane(), CameraParams::from_vector(&numbers).plane());
        assert!((near.normal_in_camera.angle(&far.normal_in_camera) / angle_rad - 1.0).abs() < 1e-3);
        // On the line, both planes are equally far away. Beyond it, the second one is nearer.
        let nearness = |plane: &GroundPlane, x: f64, off: f64| {
            let ray = Vector3::new(x, 45.0 + 0.1 * x - off, 1200.0);
            -plane.normal_in_camera.dot(&ray) / plane.height_m
        };
        for x in [-300.0, 0.0, 300.0] {
            let nearer = |off: f64| nearness(&far, x, off) - nearness(&near, x, off);
            assert!(nearer(0.0).abs() < 1e-2 * nearer(40.0), "{} {}", nearer(0.0), nearer(40.0));
        }
    }
}
