//! Focal length from the turns and zooms of a camera, without any vehicle.
//!
//! A camera that turns by R and zooms by g maps pixels by `K_g R K⁻¹`. How much the corners of the picture move compared
//! with its middle depends on the focal length (Hartley 1997, Agapito, Hayman and Reid 2001). For each focal length of a
//! grid, the rotation and the zoom that fit a registration best are removed. The rest is its misfit.

use nalgebra::{Matrix3, Matrix4, Vector2, Vector3, Vector4};
use roadplane_base::{Camera, Homography, ImageSize, Registration, Turn, bbox_grid};

use crate::factors::WEAKEST;
use crate::turned_lens::INDEPENDENT;

/// Number of focal lengths of the grid.
const GRID: usize = 64;
/// Least focal length of the grid, in widths of the picture. It belongs to a field of view of 118°.
const LEAST_WIDTHS: f64 = 0.3;
/// Step of the grid, in log focal length. The last focal length is 12 widths.
const STEP: f64 = 0.0586;
/// Least displacement of a picture that counts, as a share of its width. Smaller turns hardly show the focal length.
const LEAST_TURN: f64 = 0.02;
/// Least misfit of a camera that is carried along, as a multiple of the misfit that the sds predict (root mean square).
/// Measured on references: at most 1.6 for 30 rendered pans and 20 films. Rendered cameras that are carried at 8 m/s have
/// 1.2 to 8, as their references soon leave the view. The plane of a road that is passed at 1 m/s has 32 to 154.
const TRAVELLING: f64 = 3.0;
/// Largest half χ² that one picture adds in that decision: twice the mean that counts as travelling. So the decision
/// needs half of the pictures. A few registrations on vehicles that fill the picture do not make it.
const MOST_MISFIT: f64 = 5.0 * TRAVELLING * TRAVELLING;
/// Least sd of a registration, px. Errors of neighbouring blocks are alike, which its own sd leaves out. `places.rs`
/// adds it to the sds of a link, so that no link is exact.
pub(crate) const LEAST_SD_PX: f64 = 0.1;

/// The misfit of the pictures of one reference or of a place, as a function of the focal length.
#[derive(Clone, Debug)]
pub(crate) struct Misfit {
    /// Half of the χ² for each focal length of the grid.
    cost: [f64; GRID],
    /// The same for the parts in view alone, with the distortion that each picture shows.
    in_view: [f64; GRID],
    count: f64,
}

impl Default for Misfit {
    fn default() -> Self {
        Self { cost: [0.0; GRID], in_view: [0.0; GRID], count: 0.0 }
    }
}

/// The focal length from the turns of the camera at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turns {
    /// Focal length of the world picture, px.
    pub focal_px: f64,
    /// Sd of the logarithm of the focal length.
    pub log_sd: f64,
}

impl Misfit {
    /// Adds a picture that was registered on this reference, seen through a lens with the distortion `distortion`
    /// ([`roadplane_base::Lens::distortion`]).
    pub(crate) fn add(&mut self, registration: &Registration, distortion: f64, size: ImageSize) {
        let mapping = registration.homography_for(distortion);
        let unit = f64::from(size.width) / 2.0;
        if mapping.displacement(&size.picture_px()) < 2.0 * LEAST_TURN * unit {
            return;
        }
        let mapping = centred(&mapping, size);
        let aspect = f64::from(size.height) / f64::from(size.width);
        let sd = registration.sd_px.max(LEAST_SD_PX) / unit;
        let of_lens =
            registration.lens.map_or(0.0, |lens| 0.5 * ((lens.bend - distortion) / lens.sd).powi(2));
        let all: Option<Vec<[f64; 2]>> =
            (0..GRID).map(|i| remaining(&mapping, focal_at(i), aspect)).collect();
        // A mapping that is near no turn at all gives no evidence: it would make each focal length impossible.
        let Some(all) = all else { return };
        for (i, squares) in all.into_iter().enumerate() {
            // χ² of eight numbers whose errors have the root mean square `sd` over the picture.
            let [whole, in_view] = squares.map(|square| 4.0 * square / (sd * sd));
            self.cost[i] += whole;
            self.in_view[i] += (in_view + of_lens).min(MOST_MISFIT);
        }
        self.count += 1.0;
    }

    /// Adds the misfit of the pictures of a reference. `reference_from_world` is the position of the reference, px.
    pub(crate) fn join(&mut self, other: &Self, reference_from_world: &Homography, size: ImageSize) {
        if other.count <= 0.0 {
            return;
        }
        let share = (INDEPENDENT / other.count).min(1.0);
        let mapping = centred(reference_from_world, size);
        for (i, cost) in self.cost.iter_mut().enumerate() {
            // The focal length of the reference is that of the world picture times the zoom between them.
            let growth = mapping.turn(focal_at(i), &Vector2::zeros()).map_or(1.0, |turn| turn.growth);
            let at = (i as f64 + growth.ln() / STEP).clamp(0.0, (GRID - 1) as f64);
            let (low, part) = (at as usize, at.fract());
            let high = (low + 1).min(GRID - 1);
            *cost += share * (other.cost[low] * (1.0 - part) + other.cost[high] * part);
        }
        self.count += share * other.count;
    }

    /// Whether no turn and zoom explain how the pictures lie on the reference. The camera is then carried along.
    pub(crate) fn is_travelling(&self) -> bool {
        let least = self.in_view.iter().copied().fold(f64::INFINITY, f64::min);
        // A homography and a distortion are nine numbers. The rotation and the zoom fit four of them.
        self.count > 0.0 && 2.0 * least > 5.0 * self.count * TRAVELLING * TRAVELLING
    }

    /// Returns the focal length; `None` if the turns do not determine it.
    pub(crate) fn solve(&self, size: ImageSize) -> Option<Turns> {
        if self.count <= 0.0 {
            return None;
        }
        let best = (0..GRID).min_by(|a, b| self.cost[*a].total_cmp(&self.cost[*b]))?;
        if best == 0 || best == GRID - 1 {
            return None;
        }
        let [before, here, after] = [-1_isize, 0, 1].map(|by| self.cost[best.wrapping_add_signed(by)]);
        let curvature = before + after - 2.0 * here;
        let shift = 0.5 * (before - after) / curvature;
        let least = here - 0.25 * (before - after) * shift;
        // Four of the eight numbers are fitted.
        let misfit = (2.0 * least.max(0.0) / (4.0 * self.count)).sqrt();
        // A principal point beside the middle of the picture changes the focal length by about the same share
        // (`docs/book/science.md`). The registrations do not show this error.
        let log_sd = (STEP / curvature.sqrt() * misfit.max(1.0)).hypot(Camera::PRINCIPAL_POINT_SD);
        let focal_px = f64::from(size.width) * LEAST_WIDTHS * (STEP * (best as f64 + shift)).exp();
        (curvature > 0.0 && log_sd < WEAKEST).then_some(Turns { focal_px, log_sd })
    }
}

/// Returns a focal length of the grid, in half widths of the picture.
fn focal_at(i: usize) -> f64 {
    2.0 * LEAST_WIDTHS * (STEP * i as f64).exp()
}

/// Converts a mapping to half widths of the picture, from its middle.
fn centred(mapping: &Homography, size: ImageSize) -> Homography {
    let unit = f64::from(size.width) / 2.0;
    mapping.in_coordinates(1.0, -size.centre_px()).in_coordinates(1.0 / unit, Vector2::zeros())
}

/// Returns the mean squared distance per coordinate between a mapping and the nearest `K_g R K⁻¹` of a focal length. The
/// first number is that over the whole picture, the second that over the part that both pictures show. Lengths are in
/// half widths of the picture, from its middle.
///
/// Only the common part was measured, so a wrong distance elsewhere is no proof that the camera is carried along.
fn remaining(mapping: &Homography, focal: f64, aspect: f64) -> Option<[f64; 2]> {
    let inverse = Matrix3::from_diagonal(&Vector3::new(1.0 / focal, 1.0 / focal, 1.0));
    let Turn { growth, rotation } = mapping.turn(focal, &Vector2::zeros())?;
    let zoomed = Matrix3::from_diagonal(&Vector3::new(focal * growth, focal * growth, 1.0));
    let model = Homography::new(zoomed * rotation.matrix() * inverse)?;
    // Small changes of rotation and zoom take out the rest that they can explain.
    let (mut whole, mut in_view) = (Rest::default(), Rest::default());
    for p in bbox_grid(&[-1.0, -aspect, 1.0, aspect]) {
        let q = model.apply(&p);
        let away = mapping.apply(&p) - q;
        let (x, y) = (q.x / focal, q.y / focal);
        let rows = [
            (Vector4::new(focal * (1.0 + x * x), focal * x * y, -q.y, q.x), away.x),
            (Vector4::new(focal * x * y, focal * (1.0 + y * y), q.x, q.y), away.y),
        ];
        let is_in_view = q.x.abs() <= 1.0 && q.y.abs() <= aspect;
        for (row, value) in rows {
            whole.add(row, value);
            if is_in_view {
                in_view.add(row, value);
            }
        }
    }
    Some([whole.mean(), in_view.mean()])
}

/// The residual of a least squares fit of the rotation and the zoom.
#[derive(Default)]
struct Rest {
    normal: Matrix4<f64>,
    right: Vector4<f64>,
    squares: f64,
    count: f64,
}

impl Rest {
    fn add(&mut self, row: Vector4<f64>, value: f64) {
        self.normal += row * row.transpose();
        self.right += row * value;
        self.squares += value * value;
        self.count += 1.0;
    }

    /// Returns the mean square of the residuals. It is 0 if the data do not determine the numbers, as the numbers then
    /// explain everything.
    fn mean(&self) -> f64 {
        match self.normal.cholesky() {
            Some(normal) if self.count > 4.0 => {
                (self.squares - self.right.dot(&normal.solve(&self.right))).max(0.0) / self.count
            }
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    const SIZE: ImageSize = ImageSize { width: 1280, height: 720 };

    fn registration(mapping: &Homography, sd_px: f64) -> Registration {
        Registration { reference: 0, homography: Some(mapping.numbers()), sd_px, lens: None }
    }

    /// Returns the focal length from a turning camera. `at` gives pan, tilt, roll and growth at a time 0–1.
    fn turned(focal_px: f64, noise_px: f64, at: impl Fn(f64) -> [f64; 4]) -> Option<Turns> {
        let mut misfit = Misfit::default();
        for i in 0..100_u32 {
            let [pan, tilt, roll, growth] = at(f64::from(i) / 99.0);
            let k = |f: f64| Matrix3::from_diagonal(&Vector3::new(f, f, 1.0));
            let rotation = Rotation3::from_euler_angles(tilt, pan, roll);
            let m = k(focal_px * growth) * rotation.matrix() * k(focal_px).try_inverse().unwrap();
            let noise = |k: f64| noise_px * (f64::from(i) * 12.9898 + k * 78.233).sin();
            let wrong = Matrix3::new(
                noise(1.0) / 640.0,
                noise(2.0) / 640.0,
                noise(3.0), //
                noise(4.0) / 640.0,
                noise(5.0) / 640.0,
                noise(6.0), //
                noise(7.0) / 640.0 / 640.0,
                noise(8.0) / 640.0 / 640.0,
                0.0,
            );
            let mapping = Homography::new(m + wrong).unwrap().in_coordinates(1.0, SIZE.centre_px());
            misfit.add(&registration(&mapping, noise_px.max(0.01)), 0.0, SIZE);
        }
        let mut place = Misfit::default();
        place.join(&misfit, &Homography::IDENTITY, SIZE);
        place.solve(SIZE)
    }

    #[test]
    fn a_pan_and_a_zoom_show_the_focal_length() {
        for focal_px in [700.0, 1500.0, 4000.0] {
            let pan = turned(focal_px, 0.1, |t| [0.25 * 1280.0 / focal_px * t, 0.01, 0.02 * t, 1.0]).unwrap();
            assert!((pan.focal_px / focal_px).ln().abs() < 3.0 * pan.log_sd, "{focal_px}: {pan:?}");
            assert!((pan.focal_px / focal_px).ln().abs() < 0.06, "{focal_px}: {pan:?}");
        }
    }

    #[test]
    fn a_zoom_and_a_roll_alone_show_no_focal_length() {
        for noise_px in [0.0, 0.1] {
            let zoom = turned(1500.0, noise_px, |t| [0.0, 0.0, 0.0, 1.0 + 0.25 * t]);
            let roll = turned(1500.0, noise_px, |t| [0.0, 0.0, 0.2 * t, 1.0]);
            assert_eq!((zoom, roll), (None, None), "{noise_px} px");
        }
    }

    #[test]
    fn a_camera_that_is_carried_along_is_noticed() {
        // The plane of a road, seen from a camera 10 m above it that moves sideways: H = K (I + t nᵀ / d) K⁻¹.
        let mut travels = Misfit::default();
        let mut turns = Misfit::default();
        let k = Matrix3::from_diagonal(&Vector3::new(1500.0, 1500.0, 1.0));
        let normal = Vector3::new(0.0, 0.9, 0.4).transpose();
        for i in 1..40_u32 {
            let mapping = |m: Matrix3<f64>| {
                let mapping = Homography::new(k * m * k.try_inverse().unwrap()).unwrap();
                mapping.in_coordinates(1.0, SIZE.centre_px())
            };
            let moved = Vector3::new(0.1 * f64::from(i), 0.0, 0.0) * normal / 10.0;
            travels.add(&registration(&mapping(Matrix3::identity() + moved), 0.1), 0.0, SIZE);
            let pan = Rotation3::from_euler_angles(0.0, 0.004 * f64::from(i), 0.0);
            turns.add(&registration(&mapping(*pan.matrix()), 0.1), 0.0, SIZE);
        }
        assert!(travels.is_travelling() && !turns.is_travelling());
        // A few wrong registrations are no travel.
        for _ in 40..52_u32 {
            let moved = Vector3::new(4.0, 0.0, 0.0) * normal / 10.0;
            let mapping =
                Homography::new(k * (Matrix3::identity() + moved) * k.try_inverse().unwrap()).unwrap();
            let wrong = registration(&mapping.in_coordinates(1.0, SIZE.centre_px()), 0.1);
            turns.add(&wrong, 0.0, SIZE);
        }
        assert!(!turns.is_travelling());
    }

    #[test]
    fn a_small_turn_and_a_pure_roll_say_nothing() {
        assert_eq!(turned(1500.0, 0.1, |t| [0.01 * t, 0.0, 0.0, 1.0]), None);
        let roll = turned(1500.0, 0.1, |t| [0.0, 0.0, 0.3 * t, 1.0]);
        assert!(roll.is_none_or(|turns| turns.log_sd > 0.2), "{roll:?}");
    }
}
