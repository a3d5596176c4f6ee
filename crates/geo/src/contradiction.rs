//! Decides whether surveyed points contradict a camera as a whole, and finds the likely mistake in them.

use std::fmt;

use roadplane_base::CameraEstimate;

use crate::{Place, SurveyPoint};

/// Largest difference between surveyed points and a camera, in sds. Points that differ more are not used at all.
const USABLE_SDS: f64 = 5.0;
/// Largest difference, in sds, at which points without a certain mistake count as correct.
const FITTING_SDS: f64 = 3.0;

/// Reason why a camera is not put on the map.
#[derive(Clone, Debug, PartialEq)]
pub enum NotPlaced {
    /// The site cannot be used with the camera. The text has the reason.
    Unusable(String),
    /// The surveyed points contradict the camera. The text names the difference and the likely mistake.
    Contradiction(String),
}

impl fmt::Display for NotPlaced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Unusable(why) | Self::Contradiction(why)) = self;
        f.write_str(why)
    }
}

impl From<String> for NotPlaced {
    fn from(why: String) -> Self {
        Self::Unusable(why)
    }
}

/// A mistake in a survey: its name, and the points without it.
type Mistake = (&'static str, fn(&SurveyPoint) -> SurveyPoint);

/// Mistakes that are tried, in this order.
const MISTAKES: [Mistake; 3] = [
    ("latitude and longitude are swapped", with_degrees_swapped),
    ("x_px and y_px are swapped", with_pixel_swapped),
    ("latitude and longitude are swapped, and x_px and y_px are swapped", |point| {
        with_pixel_swapped(&with_degrees_swapped(point))
    }),
];

fn with_degrees_swapped(point: &SurveyPoint) -> SurveyPoint {
    SurveyPoint { latitude: point.longitude, longitude: point.latitude, ..*point }
}

fn with_pixel_swapped(point: &SurveyPoint) -> SurveyPoint {
    SurveyPoint { pixel: [point.pixel[1], point.pixel[0]], ..*point }
}

/// Returns the position of a camera from surveyed points that agree with it.
///
/// # Errors
/// Returns [`NotPlaced::Contradiction`] if a point or a parameter of the camera would be more than 5 sd off, or if no
/// position fits the points.
pub(crate) fn placed(camera: &CameraEstimate, points: &[SurveyPoint]) -> Result<Place, NotPlaced> {
    let found = Place::from_points(camera, points);
    let off = match &found {
        Ok(place) if place.most_sds(points, camera) <= USABLE_SDS => return found.map_err(NotPlaced::from),
        Ok(place) => {
            let sds = place.sds_of_points(points);
            let camera_sds = place.camera_sds(camera);
            let of_point = |i: usize| format!("point {} by {:.0} sd", i + 1, sds[i]);
            let mut parts: Vec<String> =
                (0..sds.len()).filter(|i| sds[*i] > FITTING_SDS).map(of_point).collect();
            if camera_sds > FITTING_SDS {
                parts.push(format!("the fitted camera by {camera_sds:.0} sd"));
            }
            parts.join(", ")
        }
        Err(why) => why.clone(),
    };
    let without = |(_, correct): &&Mistake| {
        let points: Vec<SurveyPoint> = points.iter().map(correct).collect();
        Place::from_points(camera, &points).is_ok_and(|place| place.most_sds(&points, camera) <= FITTING_SDS)
    };
    let likely = MISTAKES
        .iter()
        .find(without)
        .map_or("check the pixels, the positions and their order".to_owned(), |(mistake, _)| {
            format!("probably {mistake}: the points fit when this is corrected")
        });
    Err(NotPlaced::Contradiction(format!(
        "the surveyed points contradict the camera and are not used ({off}); {likely}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Site;
    use crate::place::tests::{PIXELS, camera, params, survey};

    #[test]
    fn points_with_a_mistake_are_not_used_and_the_mistake_is_named() {
        let camera = camera(params(), 0.03);
        let place = |points: Vec<SurveyPoint>| Site::Points(points).place(&camera);
        assert!(place(survey(&PIXELS)).is_ok());
        for count in [3, 4, 6] {
            let points = survey(&PIXELS[..count]);
            for (mistake, make) in MISTAKES.iter().take(2) {
                let Err(NotPlaced::Contradiction(why)) = place(points.iter().map(make).collect()) else {
                    panic!("{count} points of which {mistake}")
                };
                assert!(why.contains(&format!("probably {mistake}:")), "{count} points: {why}");
            }
        }
    }

    #[test]
    fn other_contradictions_have_no_name_but_their_points() {
        let camera = camera(params(), 0.005);
        let mut points = survey(&PIXELS);
        points[4].latitude += 3e-4;
        let Err(NotPlaced::Contradiction(why)) = Site::Points(points.clone()).place(&camera) else {
            panic!("33 m are a contradiction")
        };
        assert!(why.contains("point 5 by ") && why.contains("check the pixels"), "{why}");
        // A smaller error is a warning of the fit.
        points[4].latitude -= 2.92e-4;
        let place = Site::Points(points).place(&camera).unwrap();
        assert!(!place.fit.warnings.is_empty() && place.fit.warnings[0].contains("point 5"));
    }

    #[test]
    fn a_wrong_site_is_no_contradiction() {
        let camera = camera(params(), 0.01);
        let two = Site::Points(survey(&PIXELS[..2])).place(&camera);
        assert!(matches!(two, Err(NotPlaced::Unusable(_))));
    }
}
