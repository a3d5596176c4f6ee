//! Where a camera stands on the map, from surveyed points in its picture.
//!
//! Camera and place are solved together: a survey is evidence on focal length, tilt and height as well. Unknown are
//! `p = (log focal, tilt, roll, log height, turn, east, north)`; the camera's part has the run's estimate as its prior. A
//! point's ground lies at `R(turn) · g(pixel; camera) + (east, north)`, where g is where its viewing ray meets the plane.
//! Errors are those of the pixel, carried to the ground, and of the survey. Solved by Gauss–Newton.

use nalgebra::{Matrix2, Rotation2, SMatrix, SVector, Vector2, Vector4};
use roadplane_base::{Camera, CameraParams, GroundPlane, Similarity, TrackRow};
use roadplane_write::CameraSegment;
use serde::Serialize;

use crate::survey::SurveyPoint;
use crate::{UtmZone, digits};

/// How well people click on a point, px.
const PIXEL_SD: f64 = 1.5;
/// How well points are surveyed, m.
const SURVEY_SD_M: f64 = 0.15;
/// A residual beyond this many sds contradicts the others.
const CONTRADICTION_SDS: f64 = 3.0;
/// 99 % of χ² with four degrees of freedom: a camera that had to give way further was wrong, or the points are.
const CAMERA_CHI2: f64 = 13.3;
/// Widest prior of each of the camera's numbers, where the run knows nothing.
const WIDE_SD: f64 = 1.0;
/// Narrowest.
const GIVEN_SD: f64 = 1e-5;
const STEPS: usize = 50;
const HALVINGS: usize = 20;
const NO_FIT: &str =
    "no place fits the points and the camera: check the pixels, and the order of latitude and longitude";

type Params = SVector<f64, 7>;

/// A place on the map.
#[derive(Clone, Debug)]
pub struct Place {
    /// The zone of its metres.
    pub zone: UtmZone,
    /// What was found, for people.
    pub fit: Fit,
    params: Params,
    covariance: SMatrix<f64, 7, 7>,
    principal_point_px: Vector2<f64>,
}

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Fit {
    /// UTM zone.
    pub zone: String,
    /// The camera's foot: latitude and longitude, degrees.
    pub camera_at: [f64; 2],
    /// The same, east and north in the zone, m.
    pub camera_utm_m: [f64; 2],
    /// sds of that.
    pub camera_sd_m: [f64; 2],
    /// Where it looks, degrees clockwise from the zone's north.
    pub bearing_deg: f64,
    /// sd of that.
    pub bearing_sd_deg: f64,
    /// Focal length with the survey's evidence, px.
    pub focal_px: f64,
    /// sd of that.
    pub focal_sd_px: f64,
    /// Height with the survey's evidence, m.
    pub height_m: f64,
    /// sd of that.
    pub height_sd_m: f64,
    /// Metres on the map for a metre of the run, at the camera's foot.
    pub scale: f64,
    /// East and north of each point by the fit less its survey, m.
    pub residuals_m: Vec<[f64; 2]>,
    /// What contradicts what.
    pub warnings: Vec<String>,
}

/// A row's place on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnMap {
    /// East and north, m.
    pub utm_m: [f64; 2],
    /// Their sds with those of the place, m.
    pub sd_m: [f64; 2],
    /// Latitude and longitude, degrees.
    pub degrees: [f64; 2],
    /// Where the vehicle points, degrees clockwise from north.
    pub bearing_deg: f64,
}

impl Place {
    /// From surveyed points.
    ///
    /// # Errors
    /// What is wrong with the points.
    pub fn from_points(camera: &CameraSegment, points: &[SurveyPoint]) -> Result<Self, String> {
        if points.len() < 3 {
            return Err(format!("{} points; three or more are needed", points.len()));
        }
        let zone = UtmZone::around(points[0].latitude, points[0].longitude)?;
        let targets: Vec<Vector2<f64>> = points
            .iter()
            .map(|p| zone.from_degrees(p.latitude, p.longitude).map(Vector2::from))
            .collect::<Result<_, _>>()?;
        let prior = camera.estimate().params.to_vector();
        let principal = Vector2::from(camera.principal_point_px);
        let mut params = start(&prior, &principal, points, &targets)?;
        let information = prior_information(camera);
        let mut normal = SMatrix::<f64, 7, 7>::identity();
        for _ in 0..STEPS {
            let mut gradient = Params::zeros();
            normal = SMatrix::zeros();
            normal.fixed_view_mut::<4, 4>(0, 0).copy_from(&information);
            let away: Vector4<f64> = params.fixed_rows::<4>(0) - prior;
            gradient.fixed_rows_mut::<4>(0).copy_from(&(information * away));
            for (point, target) in points.iter().zip(&targets) {
                let error = seen(&params, &principal, point).ok_or(NO_FIT)? - target;
                let (j, weight) = derivatives(&params, &principal, point).ok_or(NO_FIT)?;
                gradient += j.transpose() * weight * error;
                normal += j.transpose() * weight * j;
            }
            let step = normal.cholesky().ok_or(NO_FIT)?.solve(&gradient);
            params = stepped(&params, &step, &principal, points).ok_or(NO_FIT)?;
            if step.fixed_rows::<5>(0).amax() < 1e-10 && step.fixed_rows::<2>(5).amax() < 1e-6 {
                break;
            }
        }
        let covariance = normal.try_inverse().ok_or(NO_FIT)?;
        let fit = describe(camera, &zone, &params, &covariance)?;
        let mut place = Self { zone, fit, params, covariance, principal_point_px: principal };
        place.judge(points, &targets, &information, &prior);
        Ok(place)
    }

    /// Of a camera that is known to stand somewhere and to look somewhere (degrees clockwise from north). Its height stays
    /// the run's.
    ///
    /// # Errors
    /// What is wrong with the place.
    pub fn from_camera(camera: &CameraSegment, at: [f64; 2], bearing_deg: f64) -> Result<Self, String> {
        let zone = UtmZone::around(at[0], at[1])?;
        let [east, north] = zone.from_degrees(at[0], at[1])?;
        let mut params = Params::zeros();
        params.fixed_rows_mut::<4>(0).copy_from(&camera.estimate().params.to_vector());
        params.fixed_rows_mut::<3>(4).copy_from_slice(&[-bearing_deg.to_radians(), east, north]);
        let mut covariance = SMatrix::<f64, 7, 7>::zeros();
        let prior = prior_information(camera).try_inverse().ok_or("the camera is not known")?;
        covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&prior);
        let fit = describe(camera, &zone, &params, &covariance)?;
        let principal_point_px = Vector2::from(camera.principal_point_px);
        Ok(Self { zone, fit, params, covariance, principal_point_px })
    }

    /// Where a pixel's ground lies: east and north, m, with their covariance from camera, place and click.
    #[must_use]
    pub fn utm_from_pixel(&self, pixel: [f64; 2]) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let point = SurveyPoint { pixel, latitude: 0.0, longitude: 0.0, height_m: 0.0 };
        let at = seen(&self.params, &self.principal_point_px, &point)?;
        let (j, weight) = derivatives(&self.params, &self.principal_point_px, &point)?;
        Some((at, j * self.covariance * j.transpose() + weight.try_inverse()?))
    }

    /// Where a row's car stands. Its pixel is what was measured, so that it goes through the picture: what the survey says of
    /// the camera moves it, too.
    ///
    /// # Errors
    /// If it has no place on the map.
    pub fn of_row(&self, row: &TrackRow, camera: &CameraSegment) -> Result<OnMap, String> {
        let here = Vector2::new(row.x_m, row.y_m);
        let ahead = here + Vector2::new(row.heading_rad.cos(), row.heading_rad.sin()) * 0.5;
        let (at, covariance) = self.of_ground(&here, camera);
        let way = self.of_ground(&ahead, camera).0 - at;
        let own = Matrix2::from_diagonal(&Vector2::new(row.x_sd_m.powi(2), row.y_sd_m.powi(2)));
        let turn = Rotation2::new(self.params[4]);
        let covariance = covariance + turn * own * turn.inverse();
        let utm_m = [at.x, at.y];
        Ok(OnMap {
            utm_m,
            sd_m: [covariance[(0, 0)].sqrt(), covariance[(1, 1)].sqrt()],
            degrees: self.zone.to_degrees(utm_m)?,
            bearing_deg: way.x.atan2(way.y).to_degrees().rem_euclid(360.0),
        })
    }

    /// A ground point of the run on the map. Ground that the camera cannot see goes there by turn, scale and shift.
    fn of_ground(&self, ground: &Vector2<f64>, camera: &CameraSegment) -> (Vector2<f64>, Matrix2<f64>) {
        let in_camera = camera.plane().camera_from_world() * nalgebra::Point3::new(ground.x, ground.y, 0.0);
        let through = camera.camera().pixel_from_camera(&in_camera.coords).and_then(|pixel| {
            let point = SurveyPoint { pixel: pixel.into(), latitude: 0.0, longitude: 0.0, height_m: 0.0 };
            let at = seen(&self.params, &self.principal_point_px, &point)?;
            let (j, _) = derivatives(&self.params, &self.principal_point_px, &point)?;
            Some((at, j * self.covariance * j.transpose()))
        });
        through.unwrap_or_else(|| {
            let shift = Vector2::new(self.params[5], self.params[6]);
            let at = Rotation2::new(self.params[4]) * ground * self.fit.scale + shift;
            (at, self.covariance.fixed_view::<2, 2>(5, 5).into_owned())
        })
    }

    /// Residuals, and what contradicts what.
    fn judge(
        &mut self,
        points: &[SurveyPoint],
        targets: &[Vector2<f64>],
        information: &SMatrix<f64, 4, 4>,
        prior: &Vector4<f64>,
    ) {
        for (i, (point, target)) in points.iter().zip(targets).enumerate() {
            let Some(at) = seen(&self.params, &self.principal_point_px, point) else { continue };
            let residual = at - target;
            self.fit.residuals_m.push([digits(residual.x, 4), digits(residual.y, 4)]);
            let weight = derivatives(&self.params, &self.principal_point_px, point).map(|(_, weight)| weight);
            let sds = weight.map_or(0.0, |weight| residual.dot(&(weight * residual)).sqrt());
            if sds > CONTRADICTION_SDS {
                let metres = residual.norm();
                self.fit.warnings.push(format!(
                    "point {} lies {metres:.2} m ({sds:.1} sd) from where the others and the camera put it",
                    i + 1
                ));
            }
        }
        let away: Vector4<f64> = self.params.fixed_rows::<4>(0) - prior;
        if away.dot(&(information * away)) > CAMERA_CHI2 {
            self.fit
                .warnings
                .push("the points contradict the camera: check them, or their pixels".to_owned());
        }
    }
}

/// Where a point lies on the map by the parameters, east and north; `None` at or above the horizon.
fn seen(p: &Params, principal_px: &Vector2<f64>, point: &SurveyPoint) -> Option<Vector2<f64>> {
    let params = CameraParams::from_vector(&p.fixed_rows::<4>(0).into_owned());
    let camera = Camera { focal_px: params.focal_px(), principal_point_px: *principal_px };
    let ground = params.plane();
    // A point above the ground lies on a plane that the camera is less high above.
    let plane = GroundPlane { height_m: ground.height_m - point.height_m, ..ground };
    let at = plane.world_from_pixel(&camera, &Vector2::from(point.pixel)).filter(|_| plane.height_m > 0.0)?;
    Some(Rotation2::new(p[4]) * at + Vector2::new(p[5], p[6]))
}

/// Derivatives of [`seen`] by the parameters (2 × 7), and the weight of a point: the inverse covariance of click and survey.
fn derivatives(
    p: &Params,
    principal_px: &Vector2<f64>,
    point: &SurveyPoint,
) -> Option<(SMatrix<f64, 2, 7>, Matrix2<f64>)> {
    let at = seen(p, principal_px, point)?;
    let mut j = SMatrix::<f64, 2, 7>::zeros();
    for i in 0..5 {
        let mut moved = *p;
        moved[i] += 1e-6;
        j.set_column(i, &((seen(&moved, principal_px, point)? - at) / 1e-6));
    }
    j[(0, 5)] = 1.0;
    j[(1, 6)] = 1.0;
    let mut by_pixel = Matrix2::zeros();
    for i in 0..2 {
        let mut moved = *point;
        moved.pixel[i] += 1e-3;
        by_pixel.set_column(i, &((seen(p, principal_px, &moved)? - at) / 1e-3));
    }
    let covariance =
        by_pixel * by_pixel.transpose() * PIXEL_SD.powi(2) + Matrix2::identity() * SURVEY_SD_M.powi(2);
    Some((j, covariance.try_inverse()?))
}

/// The camera as it is, and the turn and shift that fit it best.
fn start(
    prior: &Vector4<f64>,
    principal_px: &Vector2<f64>,
    points: &[SurveyPoint],
    targets: &[Vector2<f64>],
) -> Result<Params, String> {
    let mut params = Params::zeros();
    params.fixed_rows_mut::<4>(0).copy_from(prior);
    let mut pairs = Vec::new();
    for (i, (point, target)) in points.iter().zip(targets).enumerate() {
        let ground = seen(&params, principal_px, point)
            .ok_or_else(|| format!("point {} lies at or above the horizon of the run's camera", i + 1))?;
        pairs.push((ground, target - targets[0]));
    }
    let similarity = Similarity::fit(&pairs).ok_or("no points")?;
    let origin = similarity.apply(&Vector2::zeros());
    let along = similarity.apply(&Vector2::x()) - origin;
    let shift = origin + targets[0];
    params.fixed_rows_mut::<3>(4).copy_from_slice(&[along.y.atan2(along.x), shift.x, shift.y]);
    Ok(params)
}

/// A step of Gauss–Newton subtracted, shortened until all points lie on the ground.
fn stepped(
    params: &Params,
    step: &Params,
    principal_px: &Vector2<f64>,
    points: &[SurveyPoint],
) -> Option<Params> {
    let candidates = (0..HALVINGS).map(|i| params - step / f64::from(1u32 << i));
    candidates.into_iter().find(|p| points.iter().all(|point| derivatives(p, principal_px, point).is_some()))
}

fn prior_information(camera: &CameraSegment) -> SMatrix<f64, 4, 4> {
    let covariance = camera.estimate().covariance;
    let known = covariance.iter().all(|v| v.is_finite());
    let identity = SMatrix::<f64, 4, 4>::identity();
    let covariance = if known { covariance } else { identity * WIDE_SD.powi(2) };
    // What was given has no variance.
    (covariance + identity * GIVEN_SD.powi(2)).try_inverse().unwrap_or(identity / WIDE_SD.powi(2))
}

fn describe(
    camera: &CameraSegment,
    zone: &UtmZone,
    params: &Params,
    covariance: &SMatrix<f64, 7, 7>,
) -> Result<Fit, String> {
    let sd = |i: usize| covariance[(i, i)].sqrt();
    let utm = [params[5], params[6]];
    let (focal_px, height_m) = (params[0].exp(), params[3].exp());
    let [latitude, longitude] = zone.to_degrees(utm)?;
    Ok(Fit {
        zone: zone.name(),
        camera_at: [digits(latitude, 9), digits(longitude, 9)],
        camera_utm_m: utm.map(|v| digits(v, 4)),
        camera_sd_m: [sd(5), sd(6)].map(|v| digits(v, 4)),
        bearing_deg: digits((-params[4]).to_degrees().rem_euclid(360.0), 5),
        bearing_sd_deg: digits(sd(4).to_degrees(), 5),
        focal_px: digits(focal_px, 3),
        focal_sd_px: digits(focal_px * sd(0), 3),
        height_m: digits(height_m, 4),
        height_sd_m: digits(height_m * sd(3), 4),
        scale: digits(height_m / camera.height_m, 6),
        residuals_m: Vec::new(),
        warnings: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix4;
    use roadplane_base::{CameraEstimate, CameraStatus, ImageSize};

    const AT: [f64; 2] = [51.05, 13.74];
    const BEARING: f64 = 130.0;

    fn camera(params: CameraParams, sd: f64) -> CameraSegment {
        let size = ImageSize { width: 1280, height: 720 };
        CameraSegment::new(&CameraEstimate {
            span_s: [0.0, 10.0],
            image_size_px: size,
            principal_point_px: size.centre_px(),
            params,
            covariance: Matrix4::identity() * sd * sd,
            status: CameraStatus::Estimated,
            cars_used: 9,
            frames_used: 90,
        })
    }

    fn params() -> CameraParams {
        CameraParams { log_focal: 1200f64.ln(), tilt: 0.3, roll: 0.02, log_height: 7f64.ln() }
    }

    /// Points of the ground where a true place has them.
    fn survey(pixels: &[[f64; 2]]) -> Vec<SurveyPoint> {
        let truth = Place::from_camera(&camera(params(), 0.01), AT, BEARING).unwrap();
        let point = |pixel: &[f64; 2]| {
            let (at, _) = truth.utm_from_pixel(*pixel).unwrap();
            let [latitude, longitude] = truth.zone.to_degrees([at.x, at.y]).unwrap();
            SurveyPoint { pixel: *pixel, latitude, longitude, height_m: 0.0 }
        };
        pixels.iter().map(point).collect()
    }

    const PIXELS: [[f64; 2]; 6] =
        [[100.0, 300.0], [1200.0, 260.0], [640.0, 700.0], [200.0, 600.0], [1000.0, 420.0], [640.0, 200.0]];

    #[test]
    fn exact_points_give_the_place_and_the_bearing() {
        let place = Place::from_points(&camera(params(), 0.02), &survey(&PIXELS[..3])).unwrap();
        assert!((place.fit.bearing_deg - BEARING).abs() < 1e-3, "{}", place.fit.bearing_deg);
        let [east, north] = place.zone.from_degrees(AT[0], AT[1]).unwrap();
        let [e, n] = place.fit.camera_utm_m;
        assert!((e - east).hypot(n - north) < 0.01 && (place.fit.scale - 1.0).abs() < 1e-3);
        assert!(place.fit.warnings.is_empty(), "{:?}", place.fit.warnings);
    }

    #[test]
    fn points_mend_a_camera_that_is_wrong_within_its_sds() {
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
    fn what_is_no_survey_is_refused() {
        let camera = camera(params(), 0.01);
        assert!(Place::from_points(&camera, &survey(&PIXELS[..2])).unwrap_err().contains("three or more"));
        let mut far = survey(&PIXELS);
        for (i, point) in far.iter_mut().enumerate() {
            (point.latitude, point.longitude) = (AT[1] + 1e-4 * i as f64, AT[0] - 1e-4 * (i * i) as f64);
        }
        let odd = Place::from_points(&camera, &far);
        assert!(
            odd.is_err_and(|e| e == NO_FIT)
                || !Place::from_points(&camera, &far).unwrap().fit.warnings.is_empty()
        );
        let mut sky = survey(&PIXELS[..3]);
        sky[1].pixel = [600.0, -400.0];
        assert!(
            Place::from_points(&camera, &sky).unwrap_err().contains("point 2 lies at or above the horizon")
        );
        let one = survey(&[PIXELS[0]; 3]);
        assert!(
            Place::from_points(&camera, &one).is_ok(),
            "the camera's own prior carries what the points do not"
        );
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
        // One in view, one behind the camera.
        for (a, b) in [(row(3.0, 20.0), row(-4.0, 30.0)), (row(1.0, -5.0), row(2.0, -9.0))] {
            let [at_a, at_b] = [&a, &b].map(|row| place.of_row(row, &camera).unwrap());
            let apart = (at_a.utm_m[0] - at_b.utm_m[0]).hypot(at_a.utm_m[1] - at_b.utm_m[1]);
            assert!((apart - (a.x_m - b.x_m).hypot(a.y_m - b.y_m)).abs() < 1e-3);
            assert!((at_a.bearing_deg - BEARING).abs() < 1e-2, "ahead of the camera is where it looks");
            assert!(at_a.sd_m.iter().all(|sd| *sd > 0.05));
        }
    }
}
