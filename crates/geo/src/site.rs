//! The position of a camera, as given by the user.

use roadplane_base::CameraEstimate;

use crate::{Place, SurveyPoint, UtmZone};

/// The position of a camera on the map, as given by the user.
#[derive(Clone, Debug, PartialEq)]
pub enum Site {
    /// Three or more surveyed points in the camera's picture.
    Points(Vec<SurveyPoint>),
    /// The position and bearing of the camera.
    Camera {
        /// Latitude and longitude, degrees, WGS 84.
        at: [f64; 2],
        /// Bearing of the camera's viewing direction, degrees clockwise from the grid north of the UTM zone.
        bearing_deg: f64,
    },
}

impl Site {
    /// Checks the numbers of the site. The check needs no estimated camera.
    ///
    /// # Errors
    /// Returns a message that names the wrong number.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Points(points) if points.len() < 3 => {
                Err(format!("{} points; three or more are needed", points.len()))
            }
            Self::Points(points) => points.iter().enumerate().try_for_each(|(i, point)| {
                UtmZone::around(point.latitude, point.longitude)
                    .map(drop)
                    .map_err(|what| format!("point {}: {what}", i + 1))
            }),
            Self::Camera { at: [latitude, longitude], bearing_deg } => {
                UtmZone::around(*latitude, *longitude)?;
                if bearing_deg.is_finite() {
                    Ok(())
                } else {
                    Err(format!("the bearing {bearing_deg} is not a finite number of degrees"))
                }
            }
        }
    }

    /// Returns the position and bearing of a camera on the map. Surveyed points also refine the camera's parameters.
    ///
    /// # Errors
    /// Returns a message if the site is wrong or contradicts the camera.
    pub fn place(&self, camera: &CameraEstimate) -> Result<Place, String> {
        self.check()?;
        match self {
            Self::Points(points) => Place::from_points(camera, points),
            Self::Camera { at, bearing_deg } => Place::from_camera(camera, *at, *bearing_deg),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_sites_are_refused() {
        let point = SurveyPoint { pixel: [1.0, 2.0], latitude: 51.0, longitude: 13.0, height_m: 0.0 };
        assert!(Site::Points(vec![point; 2]).check().unwrap_err().contains("three or more"));
        let swapped = SurveyPoint { latitude: 151.0, ..point };
        let wrong = Site::Points(vec![point, point, swapped]).check().unwrap_err();
        assert!(wrong.starts_with("point 3: latitude 151"), "{wrong}");
        assert!(Site::Points(vec![point; 3]).check().is_ok());
        let camera = |at, bearing_deg| Site::Camera { at, bearing_deg }.check();
        assert!(camera([51.0, 13.0], -20.0).is_ok());
        assert!(camera([13.0, 551.0], 0.0).is_err() && camera([51.0, 13.0], f64::NAN).is_err());
    }
}
