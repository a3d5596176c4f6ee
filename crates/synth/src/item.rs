//! Items of a synthetic data set: the ground truth and the measurements of each car in each frame.

use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use roadplane_base::{Camera, CameraParams, ImageSize, KEYPOINTS, KeypointSet, ShapeAtlas};

use crate::scene::scene;
use crate::trajectory::CarState;
use crate::truth::SynthOptions;

/// A synthetic still or clip.
#[derive(Clone, Debug)]
pub struct Item {
    /// Width and height of the image, px.
    pub size: ImageSize,
    /// Focal length and ground plane.
    pub params: CameraParams,
    /// Frame rate of a clip, 1/s; `None` for a still.
    pub fps: Option<f64>,
    /// Cars of the item. The index of a car is its id.
    pub cars: Vec<ItemCar>,
    /// Visible cars of each frame, sorted by id.
    pub frames: Vec<Vec<CarInFrame>>,
}

/// A car of an item: its keypoints and dimensions.
#[derive(Clone, Debug)]
pub struct ItemCar {
    /// Keypoints of the car, car frame, m.
    pub keypoints_in_car: [Vector3<f64>; KEYPOINTS],
    /// Length, width, height, m.
    pub dims_m: Vector3<f64>,
}

/// A car in one frame: its ground truth and measured keypoints.
#[derive(Clone, Debug)]
pub struct CarInFrame {
    /// Id of the car.
    pub id: usize,
    /// True pose, speed and activity.
    pub state: CarState,
    /// True positions of all keypoints in the picture, px.
    pub pixels: [Vector2<f64>; KEYPOINTS],
    /// Box around all keypoints: left, top, right, bottom, px.
    pub whole_box: [f64; 4],
    /// Measured keypoints of the car.
    pub keypoints: KeypointSet,
}

impl CarInFrame {
    /// Returns the part of the car's box inside the image (px), and its share of the area of the whole box.
    #[must_use]
    pub fn visible_box(&self, size: ImageSize) -> ([f64; 4], f64) {
        let [x0, y0, x1, y1] = self.whole_box;
        let (right, bottom) = (f64::from(size.width) - 0.5, f64::from(size.height) - 0.5);
        let inside =
            [x0.clamp(-0.5, right), y0.clamp(-0.5, bottom), x1.clamp(-0.5, right), y1.clamp(-0.5, bottom)];
        let area = |b: [f64; 4]| (b[2] - b[0]) * (b[3] - b[1]);
        (inside, area(inside) / area(self.whole_box))
    }
}

/// Returns the pixels of a car's keypoints, and the box around them (px). Returns `None` if a keypoint is not in front
/// of the camera.
pub(crate) fn projected(
    camera: &Camera,
    camera_from_car: &Isometry3<f64>,
    keypoints_in_car: &[Vector3<f64>; KEYPOINTS],
) -> Option<([Vector2<f64>; KEYPOINTS], [f64; 4])> {
    let mut pixels = [Vector2::zeros(); KEYPOINTS];
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    for (pixel, point) in pixels.iter_mut().zip(keypoints_in_car) {
        *pixel = camera.pixel_from_camera(&(camera_from_car * Point3::from(*point)).coords)?;
        low = low.inf(pixel);
        high = high.sup(pixel);
    }
    Some((pixels, [low.x, low.y, high.x, high.y]))
}

/// Creates a still from one random scene.
#[must_use]
pub fn still_item(atlas: &ShapeAtlas, options: &SynthOptions, seed: u64) -> Item {
    let truth = scene(atlas, options, seed);
    let camera = Camera::centred(truth.params.focal_px(), truth.size);
    let camera_from_world = truth.params.plane().camera_from_world();
    let (mut cars, mut in_frame) = (Vec::new(), Vec::new());
    for car in &truth.cars {
        let camera_from_car = camera_from_world * car.pose.world_from_car();
        let Some((pixels, whole_box)) = projected(&camera, &camera_from_car, &car.keypoints_in_car) else {
            continue;
        };
        in_frame.push(CarInFrame {
            id: cars.len(),
            state: CarState::parked(car.pose),
            pixels,
            whole_box,
            keypoints: car.keypoints,
        });
        cars.push(ItemCar { keypoints_in_car: car.keypoints_in_car, dims_m: atlas.dims_m(&car.shape) });
    }
    Item { size: truth.size, params: truth.params, fps: None, cars, frames: vec![in_frame] }
}
