//! Drawing of vehicles and the ground into the picture: wireframes, boxes, labels, trails, and a grid on the ground.

use image::RgbImage;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use roadplane_base::{
    Camera, Ground, GroundPlane, KEYPOINTS, PictureMotion, Shape, ShapeAtlas, TrackRow, VehicleClass,
    skeleton_edges,
};

use crate::ViewError;
use crate::canvas::{Canvas, Rgb};
use crate::ground_cells::GroundCells;
use crate::labels::{free_rectangle, label};

/// Number of keypoints on the car's left side. In lists of keypoints, they come before those on the right side.
const LEFT: usize = KEYPOINTS / 2;

/// Colours of tracks. Tracks with consecutive numbers have different colours.
const PALETTE: [Rgb; 10] = [
    [64, 196, 255],
    [255, 160, 64],
    [124, 220, 96],
    [255, 96, 120],
    [190, 140, 255],
    [255, 220, 80],
    [80, 220, 190],
    [240, 130, 210],
    [160, 190, 255],
    [200, 210, 110],
];

/// Returns the colour of a track.
#[must_use]
pub fn track_colour(track: u64) -> Rgb {
    PALETTE[(track as usize).wrapping_sub(1) % PALETTE.len()]
}

/// One car to draw.
#[derive(Clone, Debug)]
pub struct DrawnCar<'a> {
    /// Row of the track files for this car and this frame.
    pub row: &'a TrackRow,
    /// Shape of the car.
    pub shape: &'a Shape,
    /// Earlier positions of the car, oldest first: world x and y, m.
    pub trail: &'a [[f64; 2]],
}

/// A drawing on a copy of one picture.
pub struct Overlay<'a> {
    canvas: Canvas,
    camera: &'a Camera,
    ground: Ground,
    atlas: &'a ShapeAtlas,
    thickness: i32,
    /// Mapping from the pixels of `camera` to those of the picture; `None` if the picture is not displaced.
    picture_from_world: Option<PictureMotion>,
}

impl<'a> Overlay<'a> {
    /// Starts a drawing on a copy of the picture.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn new(
        picture: &RgbImage,
        camera: &'a Camera,
        ground: Ground,
        atlas: &'a ShapeAtlas,
    ) -> Result<Self, ViewError> {
        let thickness = if picture.width() >= 1600 { 2 } else { 1 };
        Ok(Self { canvas: Canvas::new(picture)?, camera, ground, atlas, thickness, picture_from_world: None })
    }

    /// Draws into the picture of a camera that moved. `picture_from_world` maps the pixels of the camera to its pixels.
    #[must_use]
    pub fn displaced(self, picture_from_world: &PictureMotion) -> Self {
        Self { picture_from_world: Some(*picture_from_world), ..self }
    }

    /// Returns the finished picture.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn finish(self) -> Result<RgbImage, ViewError> {
        self.canvas.finish()
    }

    /// Draws a faint grid on the ground along the edges of the cells. The grid lines are 5 m apart.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn grid(&mut self, cells: &GroundCells) -> Result<(), ViewError> {
        for [from, to] in cells.edges() {
            self.ground_line(from, to, [150, 150, 150], 1)?;
        }
        Ok(())
    }

    /// Draws a car with its wireframe, its outline on the ground, its bounding box and its trail. A truck, bus or
    /// motorcycle is drawn as a cuboid instead of a wireframe.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn car(&mut self, car: &DrawnCar<'_>) -> Result<(), ViewError> {
        let row = car.row;
        let colour = track_colour(row.track);
        for pair in car.trail.windows(2) {
            self.ground_line(pair[0], pair[1], colour, self.thickness)?;
        }
        self.footprint(row, colour)?;
        match row.class {
            VehicleClass::Car => {
                let camera_from_car = self.camera_from_car(row);
                self.posed(&camera_from_car, car.shape, colour)?;
            }
            VehicleClass::Truck | VehicleClass::Bus | VehicleClass::Motorcycle => self.cuboid(row, colour)?,
        }
        let [x0, y0, x1, y1] = row.bbox_px;
        let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(Vector2::from);
        let faded = if row.observed { colour } else { colour.map(|c| c / 2) };
        for i in 0..4 {
            self.canvas.line(corners[i], corners[(i + 1) % 4], faded, 1)?;
        }
        Ok(())
    }

    /// Draws a label for each car if there is room for the label. No label covers another car.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn labels(&mut self, rows: &[&TrackRow]) -> Result<(), ViewError> {
        let size = 0.32 + 0.1 * f64::from(self.thickness);
        let boxes: Vec<[f64; 4]> = rows.iter().map(|row| row.bbox_px).collect();
        let mut placed = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            // The whole label is tried first, then the track number alone.
            for text in [label(row), row.track.to_string()] {
                let extent = self.canvas.label_size(&text, size)?;
                let Some(plate) = free_rectangle(i, &boxes, &placed, extent, self.canvas.size()) else {
                    continue;
                };
                self.canvas.label(&text, Vector2::new(plate[0], plate[3]), track_colour(row.track), size)?;
                placed.push(plate);
                break;
            }
        }
        Ok(())
    }

    /// Draws the car's outline on the ground and an arrow in front of it.
    fn footprint(&mut self, row: &TrackRow, colour: Rgb) -> Result<(), ViewError> {
        let (sin, cos) = row.heading_rad.sin_cos();
        let at = |forward: f64, left: f64| {
            [row.x_m + forward * cos - left * sin, row.y_m + forward * sin + left * cos]
        };
        let (l, w) = (row.length_m / 2.0, row.width_m / 2.0);
        let tip = l + 1.0;
        for (from, to) in [
            (at(l, w), at(l, -w)),
            (at(l, -w), at(-l, -w)),
            (at(-l, -w), at(-l, w)),
            (at(-l, w), at(l, w)),
            (at(l, 0.0), at(tip, 0.0)),
            (at(tip, 0.0), at(tip - 0.4, 0.3)),
            (at(tip, 0.0), at(tip - 0.4, -0.3)),
        ] {
            self.ground_line(from, to, colour, 1)?;
        }
        Ok(())
    }

    /// Draws a vehicle as a cuboid. Trucks and buses are drawn in this form, because they have no fitted shape.
    fn cuboid(&mut self, row: &TrackRow, colour: Rgb) -> Result<(), ViewError> {
        let camera_from_car = self.camera_from_car(row);
        let (l, w) = (row.length_m / 2.0, row.width_m / 2.0);
        let corner = |forward: f64, left: f64, up: f64| {
            self.pixel(&(camera_from_car * Point3::new(forward, left, up)))
        };
        let round = [(l, w), (l, -w), (-l, -w), (-l, w)];
        let lines: Vec<_> = (0..4)
            .flat_map(|i| {
                let ((a, b), (c, d)) = (round[i], round[(i + 1) % 4]);
                let top = row.height_m;
                [(corner(a, b, top), corner(c, d, top)), (corner(a, b, 0.0), corner(a, b, top))]
            })
            .collect();
        for line in lines {
            if let (Some(from), Some(to)) = line {
                self.canvas.line(from, to, colour, self.thickness)?;
            }
        }
        Ok(())
    }

    /// Draws the horizon of a camera, from edge to edge of the picture.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn horizon(&mut self, camera: &Camera, plane: &GroundPlane, colour: Rgb) -> Result<(), ViewError> {
        let [width, _] = self.canvas.size();
        let at = |x: f64| Some(Vector2::new(x, horizon_y_px(camera, plane, x)?));
        // The horizon is curved if the lens has distortion.
        const PIECES: u32 = 16;
        let x = |piece: u32| width * f64::from(piece) / f64::from(PIECES);
        for piece in 0..PIECES {
            if let (Some(from), Some(to)) = (at(x(piece)), at(x(piece + 1))) {
                self.canvas.line(from, to, colour, self.thickness + 1)?;
            }
        }
        Ok(())
    }

    /// Draws the wireframe of a car with a given pose and shape.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn posed(
        &mut self,
        camera_from_car: &Isometry3<f64>,
        shape: &Shape,
        colour: Rgb,
    ) -> Result<(), ViewError> {
        let near_left = eye_is_left(camera_from_car);
        let points = self.atlas.keypoints_in_car(shape);
        let pixels: Vec<_> =
            points.iter().map(|point| self.pixel(&(camera_from_car * Point3::from(*point)))).collect();
        for [a, b] in skeleton_edges() {
            let (Some(from), Some(to)) = (pixels[*a], pixels[*b]) else { continue };
            let far = if near_left { *a >= LEFT && *b >= LEFT } else { *a < LEFT && *b < LEFT };
            let colour = if far { colour.map(|c| c / 3 * 2) } else { colour };
            self.canvas.line(from, to, colour, if far { 1 } else { self.thickness })?;
        }
        Ok(())
    }

    /// Returns the pixel of a point in the camera frame; `None` if the point is not in front of the camera.
    fn pixel(&self, point_in_camera: &Point3<f64>) -> Option<Vector2<f64>> {
        let pixel = self.camera.pixel_from_camera(&point_in_camera.coords)?;
        Some(self.picture_from_world.map_or(pixel, |mapping| mapping.apply(&pixel)))
    }

    fn camera_from_world(&self) -> Isometry3<f64> {
        self.ground.first().plane.camera_from_world()
    }

    /// Returns the rigid motion from a vehicle's frame to the camera frame.
    fn camera_from_car(&self, row: &TrackRow) -> Isometry3<f64> {
        self.camera_from_world() * row.world_from_car()
    }

    fn ground_line(
        &mut self,
        a: [f64; 2],
        b: [f64; 2],
        colour: Rgb,
        thickness: i32,
    ) -> Result<(), ViewError> {
        let camera_from_world = self.camera_from_world();
        let pixel = |[x, y]: [f64; 2]| {
            let point = camera_from_world * Point3::new(x, y, self.ground.height_at(x, y));
            if point.z > 1.0 { self.pixel(&point) } else { None }
        };
        match (pixel(a), pixel(b)) {
            (Some(from), Some(to)) => self.canvas.line(from, to, colour, thickness),
            _ => Ok(()),
        }
    }
}

/// Returns the y coordinate of the horizon at the x coordinate `x_px`, px; `None` if the horizon is vertical.
#[must_use]
pub fn horizon_y_px(camera: &Camera, plane: &GroundPlane, x_px: f64) -> Option<f64> {
    // A ray to the horizon is at a right angle to the vertical. A few iterations are enough for any distortion.
    const ROUNDS: usize = 12;
    let up = plane.normal_in_camera;
    let mut y_px = camera.principal_point_px.y;
    for _ in 0..ROUNDS {
        let ray = camera.ray_from_pixel(&Vector2::new(x_px, y_px));
        let below = camera.ray_from_pixel(&Vector2::new(x_px, y_px + 1.0)) - ray;
        y_px -= up.dot(&ray) / up.dot(&below);
    }
    (up.y.abs() > 1e-6 && y_px.is_finite()).then_some(y_px)
}

/// Whether the camera is on the car's left side.
fn eye_is_left(camera_from_car: &Isometry3<f64>) -> bool {
    (camera_from_car.inverse() * Point3::from(Vector3::zeros())).y > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{GroundPose, ImageSize};

    #[test]
    fn a_car_is_drawn_at_its_position() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let camera = Camera::centred(900.0, ImageSize { width: 640, height: 480 });
        let plane = GroundPlane::from_tilt_roll_height(0.4, 0.0, 8.0);
        let black = RgbImage::new(640, 480);
        let mut overlay = Overlay::new(&black, &camera, Ground::plane(plane), &atlas).unwrap();
        let pose = GroundPose { x_m: 0.0, y_m: 18.0, heading_rad: 0.7 };
        let row = TrackRow {
            x_m: pose.x_m,
            y_m: pose.y_m,
            heading_rad: pose.heading_rad,
            speed_mps: 4.0,
            bbox_px: [200.0, 150.0, 420.0, 330.0],
            ..roadplane_synth::stationary_row(1, 0, 0.0)
        };
        let mut cells = GroundCells::default();
        cells.add(0.0, 18.0);
        overlay.grid(&cells).unwrap();
        overlay
            .car(&DrawnCar { row: &row, shape: &Shape::zeros(), trail: &[[0.0, 15.0], [0.0, 18.0]] })
            .unwrap();
        let drawn = overlay.finish().unwrap();
        let tyre = plane.camera_from_world() * pose.world_from_car() * Point3::from(atlas.mean[2]);
        let at = camera.pixel_from_camera(&tyre.coords).unwrap();
        let lit = (-2..=2).flat_map(|dx| (-2..=2).map(move |dy| (dx, dy))).any(|(dx, dy)| {
            drawn.get_pixel((at.x as i32 + dx) as u32, (at.y as i32 + dy) as u32).0 != [0, 0, 0]
        });
        assert!(lit, "nothing at {at}");
        let pixel = |x: f64, y: f64| {
            let at = camera.pixel_from_camera(&(plane.camera_from_world() * Point3::new(x, y, 0.0)).coords);
            let at = at.unwrap();
            drawn.get_pixel(at.x.round() as u32, at.y.round() as u32).0
        };
        assert_eq!(pixel(-2.5, 12.5), [0, 0, 0], "nothing is drawn between the lines");
        assert_ne!(pixel(-2.5, 25.0), [0, 0, 0], "the edge of the next cell");
        assert_eq!(pixel(-2.5, 30.0), [0, 0, 0], "no cell here");
    }

    #[test]
    fn the_horizon_is_at_the_pixels_of_distant_points() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let camera = Camera::centred(900.0, ImageSize { width: 640, height: 480 });
        let plane = GroundPlane::from_tilt_roll_height(0.2, 0.05, 8.0);
        let mut overlay =
            Overlay::new(&RgbImage::new(640, 480), &camera, Ground::plane(plane), &atlas).unwrap();
        overlay.horizon(&camera, &plane, [255, 0, 0]).unwrap();
        let drawn = overlay.finish().unwrap();
        for x_m in [-2e6, 0.0, 3e6] {
            let far = plane.camera_from_world() * Point3::new(x_m, 1e7, 0.0);
            let at = camera.pixel_from_camera(&far.coords).unwrap();
            assert!(drawn.get_pixel(at.x.round() as u32, at.y.round() as u32).0[0] > 150, "{at}");
        }
    }
}
