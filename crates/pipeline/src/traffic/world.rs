//! The world frame of a clip: how pixels and map positions lie on its ground.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::Vector2;
use roadplane_base::{CameraEstimate, GroundPose, Homography, ImageSize, PictureMotion};
use roadplane_geo::Fit;

use crate::tracks::shared_error::shared_covariance;

/// The camera of a clip, and its place on the map.
pub(super) struct World {
    camera: CameraEstimate,
    /// World picture from the picture of a frame, for frames whose picture is displaced.
    world_from_picture: BTreeMap<u64, PictureMotion>,
    place: Option<Fit>,
    /// Frames in which the camera has this position.
    frames: Vec<Range<u64>>,
    /// Pairs of a world position and its easting and northing, m.
    on_map: Vec<[Vector2<f64>; 2]>,
}

/// Largest number of pairs from which the map's transform is fitted. Eight numbers are fitted to exact pairs.
const MOST_PAIRS: usize = 64;

impl World {
    pub(super) fn new(
        camera: CameraEstimate,
        world_from_picture: BTreeMap<u64, PictureMotion>,
        place: Option<Fit>,
        frames: Vec<Range<u64>>,
    ) -> Self {
        Self { camera, world_from_picture, place, frames, on_map: Vec::new() }
    }

    /// Whether the camera has this position in a frame.
    pub(super) fn has_frame(&self, frame: u64) -> bool {
        self.frames.iter().any(|frames| frames.contains(&frame))
    }

    /// Adds a position with its easting and northing, m.
    pub(super) fn add_pair(&mut self, world_m: [f64; 2], map_m: [f64; 2]) {
        let pair = [Vector2::from(world_m), Vector2::from(map_m)];
        let apart = |other: &[Vector2<f64>; 2]| (other[0] - pair[0]).norm() > 2.0;
        if self.on_map.len() < MOST_PAIRS && self.on_map.iter().all(apart) {
            self.on_map.push(pair);
        }
    }

    /// Returns the size of the clip's pictures.
    pub(super) fn image_size(&self) -> ImageSize {
        self.camera.image_size_px
    }

    /// Returns the height of the camera above the ground, m.
    pub(super) fn height_m(&self) -> f64 {
        self.camera.params.log_height.exp()
    }

    /// Whether the clip has a place on the map.
    pub(super) fn is_on_map(&self) -> bool {
        self.place.is_some()
    }

    /// Returns the bearing of the world's y axis on the map, rad clockwise from north; `None` without a map.
    pub(super) fn bearing_rad(&self) -> Option<f64> {
        self.place.as_ref().map(|place| place.bearing_deg.to_radians())
    }

    /// Returns the ground at a pixel of a frame, m; `None` at or above the horizon.
    pub(super) fn ground_at(&self, pixel: &Vector2<f64>, frame: u64) -> Option<Vector2<f64>> {
        let pixel = self.world_from_picture.get(&frame).map_or(*pixel, |view| view.apply(pixel));
        self.camera.ground().world_from_pixel(&self.camera.camera(), &pixel).map(|at| at.xy())
    }

    /// Returns the world position of a place on the map, m; `None` if the clip is not on the map.
    pub(super) fn ground_of(&self, latitude: f64, longitude: f64) -> Option<Result<Vector2<f64>, String>> {
        let place = self.place.as_ref()?;
        let hemisphere = place.zone.ends_with('S');
        let number = place.zone.trim_end_matches(['N', 'S']).parse().unwrap_or(0);
        let zone = roadplane_geo::UtmZone::numbered(number, hemisphere);
        let utm = zone.and_then(|zone| zone.from_degrees(latitude, longitude));
        Some(utm.map(|utm| self.world_from_utm(place, &Vector2::from(utm))))
    }

    /// The survey refines the camera, so the map is a projective image of the world frame. It is fitted to the positions
    /// of the vehicles, which the run has in both. Without enough positions, it is a rotation and a shift.
    fn world_from_utm(&self, place: &Fit, utm: &Vector2<f64>) -> Vector2<f64> {
        let foot = Vector2::from(place.camera_utm_m);
        let (sin, cos) = place.bearing_deg.to_radians().sin_cos();
        let similar = |utm: &Vector2<f64>| {
            let away = utm - foot;
            Vector2::new(away.x * cos - away.y * sin, away.x * sin + away.y * cos)
        };
        let near = similar(utm);
        // The similarity is divided out, so that the numbers of the fit are all near 1.
        let size = self.camera.params.log_height.exp().max(1.0) * 10.0;
        let pairs = self.on_map.iter().map(|[world, utm]| (similar(utm) / size, world / size, 1.0));
        let spread = self.on_map.len() >= 12;
        let fitted = spread.then(|| Homography::fit(pairs, None)).flatten();
        fitted.map_or(near, |(homography, _)| homography.apply(&(near / size)) * size)
    }

    /// Returns the relative sd of lengths along the heading of a pose.
    pub(super) fn scale_sd(&self, pose: &GroundPose) -> f64 {
        shared_covariance(&self.camera, pose)[(3, 3)].sqrt()
    }

    /// Returns the sd of a ground position from the camera's error, m: the root of the mean variance of x and y.
    pub(super) fn position_sd(&self, at: &Vector2<f64>) -> f64 {
        let pose = GroundPose { x_m: at.x, y_m: at.y, heading_rad: 0.0 };
        let covariance = shared_covariance(&self.camera, &pose);
        ((covariance[(0, 0)] + covariance[(1, 1)]) / 2.0).sqrt()
    }
}
