//! The position of a camera, as given by the user.

use std::collections::BTreeMap;

use roadplane_base::{CameraEstimate, PictureMotion};

use crate::contradiction::placed;
use crate::{NotPlaced, Place, SurveyPoint, UtmZone};

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

    /// Returns the indices of the frames that surveyed points name.
    pub fn frames(&self) -> impl Iterator<Item = u64> + '_ {
        let points = if let Self::Points(points) = self { points.as_slice() } else { &[] };
        points.iter().filter_map(|point| point.frame)
    }

    /// Returns the site with the pixels of all points in the camera's first picture, and the number of points that
    /// were left out. `world_from_picture` maps pixels of a frame to that picture; points of other frames are left out.
    #[must_use]
    pub fn in_first_picture(&self, world_from_picture: &BTreeMap<u64, PictureMotion>) -> (Self, usize) {
        let Self::Points(points) = self else { return (self.clone(), 0) };
        let placed = |point: &SurveyPoint| {
            let Some(frame) = point.frame else { return Some(*point) };
            let pixel = world_from_picture.get(&frame)?.apply(&point.pixel.into()).into();
            Some(SurveyPoint { pixel, frame: None, ..*point })
        };
        let kept: Vec<_> = points.iter().filter_map(placed).collect();
        let left_out = points.len() - kept.len();
        (Self::Points(kept), left_out)
    }

    /// Returns the position and bearing of a camera on the map. Surveyed points also refine the camera's parameters.
    ///
    /// # Errors
    /// Returns the reason if the site is wrong, or if its points contradict the camera by more than 5 sd.
    pub fn place(&self, camera: &CameraEstimate) -> Result<Place, NotPlaced> {
        self.check()?;
        match self {
            Self::Points(points) => placed(camera, points),
            Self::Camera { at, bearing_deg } => Ok(Place::from_camera(camera, *at, *bearing_deg)?),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::Homography;

    #[test]
    fn pixels_of_a_frame_are_put_into_the_first_picture() {
        let point =
            SurveyPoint { pixel: [100.0, 50.0], latitude: 51.0, longitude: 13.0, height_m: 0.0, frame: None };
        let in_frame = |frame| SurveyPoint { frame: Some(frame), ..point };
        let site = Site::Points(vec![point, in_frame(7), in_frame(8)]);
        assert_eq!(site.frames().collect::<Vec<_>>(), [7, 8]);
        let shift = Homography::from_numbers([1.0, 0.0, 5.0, 0.0, 1.0, -3.0, 0.0, 0.0]).unwrap();
        let (placed, left_out) = site.in_first_picture(&[(7, shift.into())].into());
        let Site::Points(points) = placed else { panic!("points") };
        assert_eq!((points.len(), left_out), (2, 1));
        assert_eq!((points[0].pixel, points[1].pixel), ([100.0, 50.0], [105.0, 47.0]));
    }

    #[test]
    fn bad_sites_are_refused() {
        let point =
            SurveyPoint { pixel: [1.0, 2.0], latitude: 51.0, longitude: 13.0, height_m: 0.0, frame: None };
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
