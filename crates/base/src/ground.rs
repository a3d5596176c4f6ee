//! The ground of a site: one plane, or two planes that meet in a line.

use nalgebra::{
    Isometry2, Isometry3, Matrix2, Matrix3, Point2, Point3, Rotation2, UnitComplex, Vector2, Vector3,
};

use crate::{Camera, GroundPlane, GroundPose, wrap_angle};

/// The ground of a site: one plane, or two planes that meet in a line.
///
/// The world frame is that of the first plane. Tracks use coordinates on the surface: those of the first plane, which
/// continue on the second plane as if the ground were unfolded. Distances and speeds on the surface are true ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    first_plane: GroundPlane,
    second: Option<Second>,
}

/// The plane of the ground beyond the fold.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Second {
    plane: GroundPlane,
    /// From the world frame of this plane alone to coordinates on the surface.
    surface_from_plane: Isometry2<f64>,
    /// Whether the ground lies above the first plane beyond the fold.
    rises: bool,
}

/// A plane of the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPart {
    /// Number of the plane, from 0.
    pub index: usize,
    /// The plane in the camera frame.
    pub plane: GroundPlane,
    /// From the world frame of this plane alone to coordinates on the surface.
    pub surface_from_plane: Isometry2<f64>,
    /// From the world frame of this plane alone to that of the first plane.
    pub world_from_plane: Isometry3<f64>,
}

impl Ground {
    /// Returns a ground of one plane.
    #[must_use]
    pub fn plane(plane: GroundPlane) -> Self {
        Self { first_plane: plane, second: None }
    }

    /// Returns a ground of two planes. `rises`: whether the ground lies above the first plane beyond the fold.
    ///
    /// Returns `None` if the planes are parallel.
    #[must_use]
    pub fn folded(first: GroundPlane, second: GroundPlane, rises: bool) -> Option<Self> {
        let along = first.normal_in_camera.cross(&second.normal_in_camera).try_normalize(1e-6)?;
        // A point of both planes, and on the plane through the camera across the fold.
        let rows = Matrix3::from_rows(&[
            first.normal_in_camera.transpose(),
            second.normal_in_camera.transpose(),
            along.transpose(),
        ]);
        let point = rows.try_inverse()? * -Vector3::new(first.height_m, second.height_m, 0.0);
        let line_in = |plane: &GroundPlane| {
            let world_from_camera = plane.camera_from_world().inverse();
            ((world_from_camera * Point3::from(point)).coords.xy(), (world_from_camera * along).xy())
        };
        let ((at, direction), (at_second, direction_second)) = (line_in(&first), line_in(&second));
        let turn = UnitComplex::rotation_between(&direction_second, &direction);
        let surface_from_plane = Isometry2::from_parts((at - turn * at_second).into(), turn);
        Some(Self { first_plane: first, second: Some(Second { plane: second, surface_from_plane, rises }) })
    }

    /// Returns the planes, the first one first.
    pub fn parts(&self) -> impl Iterator<Item = GroundPart> + '_ {
        std::iter::once(self.first()).chain(self.second.iter().map(|second| self.second_part(second)))
    }

    /// Returns the plane that a ray from the camera meets.
    #[must_use]
    pub fn part_of_ray(&self, ray: &Vector3<f64>) -> GroundPart {
        let second = self.second.as_ref().filter(|_| self.beyond(ray) > 0.0);
        second.map_or_else(|| self.first(), |second| self.second_part(second))
    }

    /// Returns a number that is positive where a ray from the camera meets the second plane. It is linear in the ray.
    #[must_use]
    pub fn beyond(&self, ray: &Vector3<f64>) -> f64 {
        let Some(second) = &self.second else { return -1.0 };
        let nearer = second.plane.inverse_distance(ray) - self.first_plane.inverse_distance(ray);
        if second.rises { nearer } else { -nearer }
    }

    /// Returns the plane at a position on the surface, m.
    #[must_use]
    pub fn part_at(&self, x_m: f64, y_m: f64) -> GroundPart {
        let is_beyond = |second: &&Second| {
            let at = self.first_plane.camera_from_world() * Point3::new(x_m, y_m, 0.0);
            (second.plane.height_of(&at.coords) < 0.0) == second.rises
        };
        self.second.as_ref().filter(is_beyond).map_or_else(|| self.first(), |second| self.second_part(second))
    }

    /// Returns the point at which the viewing ray of a pixel meets the ground, in the world frame, m.
    ///
    /// Returns `None` if the pixel lies at or above the horizon.
    #[must_use]
    pub fn world_from_pixel(&self, camera: &Camera, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        let part = self.part_of_ray(&camera.ray_from_pixel(pixel));
        let at = part.plane.world_from_pixel(camera, pixel)?;
        Some((part.world_from_plane * Point3::new(at.x, at.y, 0.0)).coords)
    }

    /// Returns the z of the ground at a position in the world frame, m. World and surface have the same border between the
    /// planes.
    #[must_use]
    pub fn height_at(&self, x_m: f64, y_m: f64) -> f64 {
        let part = self.part_at(x_m, y_m);
        if part.index == 0 {
            return 0.0;
        }
        let at = self.first_plane.camera_from_world() * Point3::new(x_m, y_m, 0.0);
        -part.plane.height_of(&at.coords)
            / part.plane.normal_in_camera.dot(&self.first_plane.normal_in_camera)
    }

    /// Returns the first plane, which defines the world frame.
    #[must_use]
    pub fn first(&self) -> GroundPart {
        GroundPart {
            index: 0,
            plane: self.first_plane,
            surface_from_plane: Isometry2::identity(),
            world_from_plane: Isometry3::identity(),
        }
    }

    fn second_part(&self, second: &Second) -> GroundPart {
        GroundPart {
            index: 1,
            plane: second.plane,
            surface_from_plane: second.surface_from_plane,
            world_from_plane: self.first_plane.camera_from_world().inverse()
                * second.plane.camera_from_world(),
        }
    }
}

impl GroundPart {
    /// Converts a pose on this plane alone to one on the surface.
    #[must_use]
    pub fn to_surface(&self, pose: &GroundPose) -> GroundPose {
        moved(&self.surface_from_plane, pose)
    }

    /// Converts a pose on the surface to one on this plane alone.
    #[must_use]
    pub fn from_surface(&self, pose: &GroundPose) -> GroundPose {
        moved(&self.surface_from_plane.inverse(), pose)
    }

    /// Converts a pose on the surface to the world frame. The result is the pose as seen from above, and the height, m.
    #[must_use]
    pub fn in_world(&self, pose: &GroundPose) -> (GroundPose, f64) {
        if self.index == 0 {
            return (*pose, 0.0);
        }
        let world_from_car = self.world_from_plane * self.from_surface(pose).world_from_car();
        (GroundPose::nearest(&world_from_car), world_from_car.translation.z)
    }

    /// Converts a covariance of (x, y, heading) on this plane alone to one on the surface.
    #[must_use]
    pub fn covariance_to_surface(&self, covariance: &Matrix3<f64>) -> Matrix3<f64> {
        let turn: Matrix2<f64> = *Rotation2::from(self.surface_from_plane.rotation).matrix();
        let mut by = Matrix3::identity();
        by.fixed_view_mut::<2, 2>(0, 0).copy_from(&turn);
        by * covariance * by.transpose()
    }
}

fn moved(by: &Isometry2<f64>, pose: &GroundPose) -> GroundPose {
    if *by == Isometry2::identity() {
        return *pose;
    }
    let at = by * Point2::new(pose.x_m, pose.y_m);
    GroundPose { x_m: at.x, y_m: at.y, heading_rad: wrap_angle(pose.heading_rad + by.rotation.angle()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns a ground that rises by `slope` (rad) beyond the line y = `fold_m`, which is turned by `turn` (rad).
    fn folded(slope: f64, fold_m: f64, turn: f64) -> Ground {
        let first = GroundPlane::from_tilt_roll_height(0.25, 0.02, 8.0);
        let across = Vector3::new(-turn.sin(), turn.cos(), 0.0);
        let up = Vector3::z() * slope.cos() - across * slope.sin();
        let rotation = first.camera_from_world().rotation;
        // The distance of the camera's centre (0, 0, 8) from the plane through the fold.
        let height_m = up.dot(&(Vector3::new(0.0, 0.0, 8.0) - across * fold_m));
        let second = GroundPlane { normal_in_camera: rotation * up, height_m };
        Ground::folded(first, second, slope > 0.0).unwrap()
    }

    proptest! {
        #[test]
        fn the_surface_is_continuous_and_keeps_distances(
            slope in prop_oneof![-0.1f64..-0.01, 0.01f64..0.1], turn in -0.5f64..0.5, x in -9.0f64..9.0, beyond in 0.1f64..30.0,
        ) {
            let ground = folded(slope, 40.0, turn);
            let (along, across) = (Vector2::new(turn.cos(), turn.sin()), Vector2::new(-turn.sin(), turn.cos()));
            let fold = across * 40.0 + along * x;
            let at = fold + across * beyond;
            let part = ground.part_at(at.x, at.y);
            prop_assert_eq!((part.index, ground.part_at(fold.x, fold.y - 1.0).index), (1, 0));
            let pose = GroundPose { x_m: at.x, y_m: at.y, heading_rad: 0.4 };
            let on_plane = part.from_surface(&pose);
            let back = part.to_surface(&on_plane);
            prop_assert!((back.x_m - pose.x_m).hypot(back.y_m - pose.y_m) + (back.heading_rad - 0.4).abs() < 1e-9);
            // A point of the fold is the same point of the world on either plane.
            let of_fold = part.from_surface(&GroundPose { x_m: fold.x, y_m: fold.y, heading_rad: 0.4 });
            let in_world = part.world_from_plane * Point3::new(of_fold.x_m, of_fold.y_m, 0.0);
            prop_assert!((in_world.coords - fold.push(0.0)).norm() < 1e-6, "{in_world}");
            // The road goes up from the fold, by its length times the slope.
            let world = part.world_from_plane * Point3::new(on_plane.x_m, on_plane.y_m, 0.0);
            let horizontal = fold + across * (beyond * slope.cos());
            prop_assert!((world.coords - horizontal.push(beyond * slope.sin())).norm() < 1e-6, "{world}");
            prop_assert!((ground.height_at(world.x, world.y) - world.z).abs() < 1e-6);
            // The pixel of that point shows the same plane, and the point.
            let camera = Camera::pinhole(1200.0, Vector2::new(639.5, 359.5));
            let in_camera = ground.first().plane.camera_from_world() * world;
            let pixel = camera.pixel_from_camera(&in_camera.coords).unwrap();
            let found = ground.world_from_pixel(&camera, &pixel).unwrap();
            prop_assert!((found - world.coords).norm() < 1e-5, "{found} {world}");
        }
    }

    #[test]
    fn parallel_planes_have_no_fold() {
        let plane = |height_m| GroundPlane::from_tilt_roll_height(0.3, 0.0, height_m);
        assert!(Ground::folded(plane(8.0), plane(5.0), true).is_none());
    }
}
