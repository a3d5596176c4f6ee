//! The position and bearing of a camera on the map, and the map positions of vehicles.

use std::fmt;
use std::path::Path;

use nalgebra::{Matrix2, Point3, Rotation2, Vector2};
use roadplane_base::{CameraEstimate, GroundPose, OnMap, TrackRow};
use roadplane_write::{WriteError, decimals};
use serde::{Deserialize, Serialize};

use crate::solve::Solved;
use crate::survey::SurveyPoint;
use crate::utm::UtmZone;

/// Largest residual of a point, in sds. A point with a larger residual contradicts the other points or the camera.
const CONTRADICTION_SDS: f64 = 3.0;
/// Largest χ² by which the surveyed points may change the camera: the 99 % quantile with four degrees of freedom. A
/// larger value means that the camera or the points are wrong.
const CAMERA_CHI2: f64 = 13.3;
/// Distance from a vehicle to a point straight ahead, m. These two points give the bearing of the vehicle on the map.
const AHEAD_M: f64 = 0.5;

/// The position and bearing of a camera on the map.
#[derive(Clone, Debug)]
pub struct Place {
    /// UTM zone of the map coordinates.
    pub zone: UtmZone,
    /// Summary of the fit, as it is written to `place.json`.
    pub fit: Fit,
    solved: Solved,
}

/// Summary of a fit, as in `place.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// UTM zone.
    pub zone: String,
    /// Latitude and longitude of the point below the camera, degrees, WGS 84.
    pub camera_at: [f64; 2],
    /// Easting and northing of the point below the camera in the UTM zone, m.
    pub camera_utm_m: [f64; 2],
    /// Sds of easting and northing, m.
    pub camera_sd_m: [f64; 2],
    /// Bearing of the viewing direction, degrees clockwise from the grid north of the UTM zone.
    pub bearing_deg: f64,
    /// Sd of the bearing, degrees.
    pub bearing_sd_deg: f64,
    /// Focal length, refined by the survey, px.
    pub focal_px: f64,
    /// Sd of the focal length, px.
    pub focal_sd_px: f64,
    /// Height of the camera above the ground, refined by the survey, m.
    pub height_m: f64,
    /// Sd of the height, m.
    pub height_sd_m: f64,
    /// Metres on the map per metre in the world frame before the fit, at the point below the camera. A run with surveyed
    /// points has the world frame after the fit.
    pub scale: f64,
    /// Residual of each point (easting, northing), m: the fitted position minus the surveyed position.
    pub residuals_m: Vec<[f64; 2]>,
    /// Warnings about points that contradict the camera or the other points.
    pub warnings: Vec<String>,
}

impl Fit {
    /// Reads the file `place.json` of a result folder; `None` if the run has no position on the map.
    ///
    /// # Errors
    /// [`WriteError::Io`], or [`WriteError::Malformed`].
    pub fn read(folder: &Path) -> Result<Option<Self>, WriteError> {
        let path = folder.join("place.json");
        let text = match std::fs::read(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(WriteError::Io { doing: "read", source, path }),
        };
        serde_json::from_slice(&text).map(Some).map_err(|e| WriteError::malformed(&path, e))
    }
}

impl fmt::Display for Fit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([latitude, longitude], [east_sd, north_sd]) = (self.camera_at, self.camera_sd_m);
        write!(
            f,
            "camera at {latitude:.7}, {longitude:.7} (UTM zone {}, sd {east_sd:.2} and {north_sd:.2} m), bearing \
             {:.1}° ± {:.1}° from grid north; scale {:.3}, focal length {:.0} ± {:.0} px, height {:.2} ± {:.2} m",
            self.zone,
            self.bearing_deg,
            self.bearing_sd_deg,
            self.scale,
            self.focal_px,
            self.focal_sd_px,
            self.height_m,
            self.height_sd_m,
        )?;
        let distances: Vec<String> =
            self.residuals_m.iter().map(|[x, y]| format!("{:.2}", x.hypot(*y))).collect();
        if distances.is_empty() { Ok(()) } else { write!(f, "; residuals [{}] m", distances.join(", ")) }
    }
}

impl Place {
    /// Estimates the position of a camera from three or more surveyed points.
    ///
    /// # Errors
    /// Returns a message if UTM does not cover the points, or if no position fits the points and the camera.
    pub fn from_points(camera: &CameraEstimate, points: &[SurveyPoint]) -> Result<Self, String> {
        let first = points.first().ok_or("no points")?;
        let zone = UtmZone::around(first.latitude, first.longitude)?;
        let targets: Vec<Vector2<f64>> = points
            .iter()
            .map(|p| zone.from_degrees(p.latitude, p.longitude).map(Vector2::from))
            .collect::<Result<_, _>>()?;
        let solved = Solved::from_points(camera, points, &targets)?;
        let mut place = Self { fit: describe(camera, &zone, &solved)?, zone, solved };
        place.add_residuals(points, &targets, camera);
        Ok(place)
    }

    /// Creates a place from the camera's position on the map and its bearing.
    ///
    /// `at` is the latitude and longitude, degrees. `bearing_deg` is clockwise from grid north, degrees. The height of
    /// the camera stays as the run estimated it.
    ///
    /// # Errors
    /// Returns a message if UTM does not cover the position, or if the covariance of the camera is singular.
    pub fn from_camera(camera: &CameraEstimate, at: [f64; 2], bearing_deg: f64) -> Result<Self, String> {
        let zone = UtmZone::around(at[0], at[1])?;
        let solved =
            Solved::from_camera(camera, -bearing_deg.to_radians(), zone.from_degrees(at[0], at[1])?)?;
        Ok(Self { fit: describe(camera, &zone, &solved)?, zone, solved })
    }

    /// Returns the camera with the parameters and covariance that the survey refined.
    #[must_use]
    pub fn refined(&self, camera: &CameraEstimate) -> CameraEstimate {
        let covariance = self.solved.covariance.fixed_view::<4, 4>(0, 0).into_owned();
        CameraEstimate { params: self.solved.camera(), covariance, ..camera.clone() }
    }

    /// Returns the map position of the ground at a pixel (easting and northing, m), and its covariance (m²).
    ///
    /// The covariance includes the errors of the camera, of its map position and of the pixel. Returns `None` if the
    /// pixel lies at or above the horizon.
    #[must_use]
    pub fn utm_from_pixel(&self, pixel: [f64; 2]) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let point = SurveyPoint::on_ground(pixel);
        let seen = self.solved.seen_point(&point)?;
        let covariance = seen.by_params * self.solved.covariance * seen.by_params.transpose();
        Some((self.solved.place_of(&point)?, covariance + seen.click))
    }

    /// Returns the map position of a vehicle. `pose` is its pose in the world frame of `camera`.
    ///
    /// The actual measurement is a pixel. Therefore `camera` projects the position into the picture, and the refined
    /// camera projects the pixel to the ground. `own_sd_m` contains the sds of the vehicle's x and y without the
    /// camera's error, m.
    ///
    /// # Errors
    /// Returns a message if the position has no latitude and longitude.
    pub fn on_map(
        &self,
        pose: &GroundPose,
        own_sd_m: [f64; 2],
        camera: &CameraEstimate,
    ) -> Result<OnMap, String> {
        let here = Vector2::new(pose.x_m, pose.y_m);
        let ahead = here + Vector2::new(pose.heading_rad.cos(), pose.heading_rad.sin()) * AHEAD_M;
        let (at, shared) = self.of_ground(&here, camera);
        let forward = self.of_ground(&ahead, camera).0 - at;
        let own = Matrix2::from_diagonal(&Vector2::from(own_sd_m).map(|sd| sd * sd));
        let turn = Rotation2::new(self.solved.params[4]);
        let covariance = shared + turn * own * turn.inverse();
        let [latitude, longitude] = self.zone.to_degrees([at.x, at.y])?;
        Ok(OnMap {
            latitude,
            longitude,
            utm_zone: self.zone.name(),
            east_m: at.x,
            north_m: at.y,
            east_sd_m: covariance[(0, 0)].sqrt(),
            north_sd_m: covariance[(1, 1)].sqrt(),
            bearing_deg: forward.x.atan2(forward.y).to_degrees().rem_euclid(360.0),
        })
    }

    /// Returns the map position of the vehicle in a row of a finished run. The sds in the row include the camera's
    /// error.
    ///
    /// # Errors
    /// Returns a message if the position has no latitude and longitude.
    pub fn of_row(&self, row: &TrackRow, camera: &CameraEstimate) -> Result<OnMap, String> {
        let shared = camera_share(camera, &Vector2::new(row.x_m, row.y_m));
        let own = [row.x_sd_m.powi(2) - shared.m11, row.y_sd_m.powi(2) - shared.m22];
        self.on_map(&row.pose(), own.map(|variance| variance.max(0.0).sqrt()), camera)
    }

    /// Returns the map position of a ground point (m), and its covariance due to the errors of camera and site (m²).
    ///
    /// `ground` is in the run's world frame, m. A point that the camera cannot see is only rotated, scaled and shifted.
    fn of_ground(&self, ground: &Vector2<f64>, camera: &CameraEstimate) -> (Vector2<f64>, Matrix2<f64>) {
        let through = pixel_of(camera, ground).and_then(|point| {
            let j = self.solved.seen_point(&point)?.by_params;
            Some((self.solved.place_of(&point)?, j * self.solved.covariance * j.transpose()))
        });
        through.unwrap_or_else(|| {
            let scale = (self.solved.camera().log_height - camera.params.log_height).exp();
            let at = Rotation2::new(self.solved.params[4]) * ground * scale + self.solved.foot();
            (at, self.solved.covariance.fixed_view::<2, 2>(5, 5).into_owned())
        })
    }

    /// Returns the residual of each point, in sds.
    pub(crate) fn sds_of_points(&self, points: &[SurveyPoint]) -> Vec<f64> {
        let sds = |(point, residual): (&SurveyPoint, &[f64; 2])| {
            let residual = Vector2::from(*residual);
            let weight = self.solved.seen_point(point).and_then(|seen| seen.weight());
            weight.map_or(f64::INFINITY, |weight| residual.dot(&(weight * residual)).sqrt())
        };
        points.iter().zip(&self.fit.residuals_m).map(sds).collect()
    }

    /// Returns the difference between the refined camera and the run's camera, in sds.
    pub(crate) fn camera_sds(&self, camera: &CameraEstimate) -> f64 {
        self.solved.camera_chi2(camera).sqrt()
    }

    /// Returns the largest difference in sds: of a point or of the camera.
    pub(crate) fn most_sds(&self, points: &[SurveyPoint], camera: &CameraEstimate) -> f64 {
        self.sds_of_points(points).into_iter().fold(self.camera_sds(camera), f64::max)
    }

    /// Adds residuals and warnings to the fit.
    fn add_residuals(&mut self, points: &[SurveyPoint], targets: &[Vector2<f64>], camera: &CameraEstimate) {
        for (point, target) in points.iter().zip(targets) {
            let residual = self.solved.place_of(point).map_or(Vector2::repeat(f64::NAN), |at| at - target);
            self.fit.residuals_m.push([decimals(residual.x, 4), decimals(residual.y, 4)]);
        }
        for (i, sds) in self.sds_of_points(points).into_iter().enumerate() {
            if sds > CONTRADICTION_SDS {
                let [x, y] = self.fit.residuals_m[i];
                self.fit.warnings.push(format!(
                    "point {} lies {:.2} m ({sds:.1} sd) away from its fitted position",
                    i + 1,
                    x.hypot(y)
                ));
            }
        }
        if self.solved.camera_chi2(camera) > CAMERA_CHI2 {
            self.fit
                .warnings
                .push("the points contradict the camera: check them, or their pixels".to_owned());
        }
    }
}

/// Returns the pixel at which a camera sees a ground point, or `None` for a point behind the camera.
fn pixel_of(camera: &CameraEstimate, ground: &Vector2<f64>) -> Option<SurveyPoint> {
    let in_camera = camera.params.plane().camera_from_world() * Point3::new(ground.x, ground.y, 0.0);
    let view = camera.camera();
    Some(SurveyPoint::on_ground(view.pixel_from_camera(&in_camera.coords)?.into()))
}

/// Returns the covariance of a ground position due to the camera's error alone, m².
///
/// The position is in the run's world frame. The result is zero if the camera has no finite covariance.
fn camera_share(camera: &CameraEstimate, ground: &Vector2<f64>) -> Matrix2<f64> {
    let seen = pixel_of(camera, ground).and_then(|point| Solved::of_camera(camera).seen_point(&point));
    match seen {
        Some(seen) if camera.covariance.iter().all(|v| v.is_finite()) => {
            let by_camera = seen.by_params.fixed_columns::<4>(0).into_owned();
            by_camera * camera.covariance * by_camera.transpose()
        }
        _ => Matrix2::zeros(),
    }
}

fn describe(camera: &CameraEstimate, zone: &UtmZone, solved: &Solved) -> Result<Fit, String> {
    let sd = |i: usize| solved.covariance[(i, i)].sqrt();
    let utm: [f64; 2] = solved.foot().into();
    let (focal_px, height_m) = (solved.camera().focal_px(), solved.camera().log_height.exp());
    let [latitude, longitude] = zone.to_degrees(utm)?;
    Ok(Fit {
        zone: zone.name(),
        camera_at: [decimals(latitude, 9), decimals(longitude, 9)],
        camera_utm_m: utm.map(|v| decimals(v, 4)),
        camera_sd_m: [sd(5), sd(6)].map(|v| decimals(v, 4)),
        bearing_deg: decimals((-solved.params[4]).to_degrees().rem_euclid(360.0), 5),
        bearing_sd_deg: decimals(sd(4).to_degrees(), 5),
        focal_px: decimals(focal_px, 3),
        focal_sd_px: decimals(focal_px * sd(0), 3),
        height_m: decimals(height_m, 4),
        height_sd_m: decimals(height_m * sd(3), 4),
        scale: decimals(height_m / camera.params.log_height.exp(), 6),
        residuals_m: Vec::new(),
        warnings: Vec::new(),
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use nalgebra::Matrix4;
    use roadplane_base::{CameraParams, CameraStatus, ImageSize, Lens};

    use crate::Site;

    const AT: [f64; 2] = [51.05, 13.74];
    const BEARING: f64 = 130.0;

    pub(crate) fn camera(params: CameraParams, sd: f64) -> CameraEstimate {
        let size = ImageSize { width: 1280, height: 720 };
        CameraEstimate {
            span_s: [0.0, 10.0],
            image_size_px: size,
            principal_point_px: size.centre_px(),
            lens: Lens::STRAIGHT,
            distortion_sd: None,
            params,
            covariance: Matrix4::identity() * sd * sd,
            status: CameraStatus::Estimated,
            cars_used: 9,
            frames_used: 90,
            second_plane: None,
        }
    }

    pub(crate) fn params() -> CameraParams {
        CameraParams { log_focal: 1200f64.ln(), tilt: 0.3, roll: 0.02, log_height: 7f64.ln() }
    }

    /// Returns points on the ground at these pixels, with exact map positions.
    pub(crate) fn survey(pixels: &[[f64; 2]]) -> Vec<SurveyPoint> {
        let truth = Place::from_camera(&camera(params(), 0.01), AT, BEARING).unwrap();
        let point = |pixel: &[f64; 2]| {
            let (at, _) = truth.utm_from_pixel(*pixel).unwrap();
            let [latitude, longitude] = truth.zone.to_degrees([at.x, at.y]).unwrap();
            SurveyPoint { pixel: *pixel, latitude, longitude, height_m: 0.0, frame: None }
        };
        pixels.iter().map(point).collect()
    }

    pub(crate) const PIXELS: [[f64; 2]; 6] =
        [[100.0, 300.0], [1200.0, 260.0], [640.0, 700.0], [200.0, 600.0], [1000.0, 420.0], [640.0, 200.0]];

    #[test]
    fn exact_points_give_the_position_and_the_bearing() {
        let place = Place::from_points(&camera(params(), 0.02), &survey(&PIXELS[..3])).unwrap();
        assert!((place.fit.bearing_deg - BEARING).abs() < 1e-3, "{}", place.fit.bearing_deg);
        let [east, north] = place.zone.from_degrees(AT[0], AT[1]).unwrap();
        let [e, n] = place.fit.camera_utm_m;
        assert!((e - east).hypot(n - north) < 0.01 && (place.fit.scale - 1.0).abs() < 1e-3);
        assert!(place.fit.warnings.is_empty(), "{:?}", place.fit.warnings);
    }

    #[test]
    fn points_correct_a_camera_that_is_wrong_within_its_sds() {
        let wrong = CameraParams { log_focal: 1290f64.ln(), tilt: 0.31, log_height: 7.4f64.ln(), ..params() };
        let place = Place::from_points(&camera(wrong, 0.08), &survey(&PIXELS)).unwrap();
        assert!((place.fit.focal_px - 1200.0).abs() < 12.0, "{}", place.fit.focal_px);
        assert!((place.fit.height_m - 7.0).abs() < 0.1, "{}", place.fit.height_m);
        assert!(place.fit.focal_sd_px < 0.08 * 1290.0 / 2.0);
        assert!(place.fit.warnings.is_empty(), "{:?}", place.fit.warnings);
    }

    #[test]
    fn a_swapped_point_is_named() {
        let mut points = survey(&PIXELS);
        points[4].latitude += 3e-5;
        let place = Place::from_points(&camera(params(), 0.005), &points).unwrap();
        assert!(place.fit.warnings.iter().any(|w| w.starts_with("point 5 lies")), "{:?}", place.fit.warnings);
    }

    #[test]
    fn bad_surveys_are_refused() {
        let camera = camera(params(), 0.01);
        let two = Site::Points(survey(&PIXELS[..2]));
        assert!(two.place(&camera).unwrap_err().to_string().contains("three or more"));
        let mut far = survey(&PIXELS);
        for (i, point) in far.iter_mut().enumerate() {
            (point.latitude, point.longitude) = (AT[1] + 1e-4 * i as f64, AT[0] - 1e-4 * (i * i) as f64);
        }
        let odd = Place::from_points(&camera, &far);
        assert!(odd.map_or_else(
            |error| error.starts_with("no position fits"),
            |place| !place.fit.warnings.is_empty()
        ));
        let mut sky = survey(&PIXELS[..3]);
        sky[1].pixel = [600.0, -400.0];
        assert!(
            Place::from_points(&camera, &sky).unwrap_err().contains("point 2 lies at or above the horizon")
        );
        // A single point does not determine the bearing.
        assert!(Place::from_points(&camera, &survey(&[PIXELS[0]; 3])).is_err());
    }

    #[test]
    fn rows_keep_distances_and_turn_with_the_camera() {
        let camera = camera(params(), 0.01);
        let place = Place::from_camera(&camera, AT, BEARING).unwrap();
        let row = |x: f64, y: f64| -> TrackRow {
            serde_json::from_value(serde_json::json!({
                "frame": 0, "time_s": 0.0, "track": 1, "x_m": x, "y_m": y, "heading_rad": std::f64::consts::FRAC_PI_2,
                "speed_mps": 0.0, "x_sd_m": 0.1, "y_sd_m": 0.3, "heading_sd_rad": 0.01, "length_m": 4.5, "width_m": 1.8,
                "height_m": 1.5, "bbox_px": [0.0, 0.0, 9.0, 9.0], "score": 0.9, "observed": true,
            }))
            .unwrap()
        };
        // The first pair of vehicles is in view, and the second pair is behind the camera.
        for (a, b) in [(row(3.0, 20.0), row(-4.0, 30.0)), (row(1.0, -5.0), row(2.0, -9.0))] {
            let [at_a, at_b] = [&a, &b].map(|row| place.of_row(row, &camera).unwrap());
            let apart = (at_a.east_m - at_b.east_m).hypot(at_a.north_m - at_b.north_m);
            assert!((apart - (a.x_m - b.x_m).hypot(a.y_m - b.y_m)).abs() < 1e-3);
            assert!((at_a.bearing_deg - BEARING).abs() < 1e-2, "the camera's bearing points ahead");
            assert!(at_a.east_sd_m > 0.05 && at_a.north_sd_m > 0.05);
        }
    }

    #[test]
    fn cars_of_a_refined_camera_have_the_same_map_positions() {
        let wrong =
            camera(CameraParams { log_focal: 1260f64.ln(), log_height: 7.3f64.ln(), ..params() }, 0.05);
        let place = Place::from_points(&wrong, &survey(&PIXELS)).unwrap();
        let refined = place.refined(&wrong);
        assert!(refined.covariance[(3, 3)] < wrong.covariance[(3, 3)] / 4.0);
        // The same pixel gives one position in the world frame of each camera.
        let pixel = Vector2::new(700.0, 500.0);
        let on_map = |camera: &CameraEstimate| {
            let view = camera.camera();
            let at = camera.params.plane().world_from_pixel(&view, &pixel).unwrap();
            place.on_map(&GroundPose { x_m: at.x, y_m: at.y, heading_rad: 1.0 }, [0.0; 2], camera).unwrap()
        };
        let (a, b) = (on_map(&wrong), on_map(&refined));
        assert!((a.east_m - b.east_m).hypot(a.north_m - b.north_m) < 1e-6);
        // The world frame of the refined camera is the map, rotated and shifted.
        let foot = Vector2::from(place.fit.camera_utm_m);
        let far =
            place.on_map(&GroundPose { x_m: 3.0, y_m: 20.0, heading_rad: 0.0 }, [0.0; 2], &refined).unwrap();
        let distance = (Vector2::new(far.east_m, far.north_m) - foot).norm();
        assert!((distance - 3f64.hypot(20.0)).abs() < 1e-3, "{distance}");
        let behind = GroundPose { x_m: 3.0, y_m: -20.0, heading_rad: 0.0 };
        let behind = place.on_map(&behind, [0.0; 2], &refined).unwrap();
        let distance = (Vector2::new(behind.east_m, behind.north_m) - foot).norm();
        assert!((distance - 3f64.hypot(20.0)).abs() < 1e-3, "{distance}");
    }

    #[test]
    fn the_cameras_share_of_a_rows_sd_counts_once() {
        let camera = camera(params(), 0.02);
        let place = Place::from_camera(&camera, AT, 0.0).unwrap();
        let shared = camera_share(&camera, &Vector2::new(3.0, 20.0));
        let own = [0.05, 0.2];
        let row: TrackRow = serde_json::from_value(serde_json::json!({
            "frame": 0, "time_s": 0.0, "track": 1, "x_m": 3.0, "y_m": 20.0, "heading_rad": 0.0, "speed_mps": 0.0,
            "x_sd_m": (shared.m11 + own[0] * own[0]).sqrt(), "y_sd_m": (shared.m22 + own[1] * own[1]).sqrt(),
            "heading_sd_rad": 0.01, "length_m": 4.5, "width_m": 1.8, "height_m": 1.5,
            "bbox_px": [0.0, 0.0, 9.0, 9.0], "score": 0.9, "observed": true,
        }))
        .unwrap();
        // The camera views north, so x is east and y is north.
        let at = place.of_row(&row, &camera).unwrap();
        assert!((at.east_sd_m - row.x_sd_m).abs() < 1e-4, "{} {}", at.east_sd_m, row.x_sd_m);
        assert!((at.north_sd_m - row.y_sd_m).abs() < 1e-4, "{} {}", at.north_sd_m, row.y_sd_m);
    }
}
