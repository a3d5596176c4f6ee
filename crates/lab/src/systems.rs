//! The systems in the tables of the paper *Car Pose in Context*. Every system gets the same keypoints and returns the
//! cars' poses. Some systems also estimate the camera.

mod answer;
mod baselines;
mod free;
mod fused;
mod plane;

use roadplane_base::ShapeAtlas;
use roadplane_pipeline::Config;

pub use answer::{CameraAnswer, CarAnswer, FrameAnswer, FrameInput};
pub use fused::{FusedClip, solve_fused, solve_recorded};

/// A system that estimates the poses of the cars in a single frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum System {
    /// The method of Pavlakos et al. 2017, with the true focal length given.
    Pavlakos,
    /// The method of Krishna Murthy et al. 2017, with the true focal length given.
    KrishnaMurthy,
    /// Our solver without a common ground plane, with the true focal length given.
    FreePoses,
    /// Our solver with all cars on one ground plane, with the true focal length given.
    Plane,
    /// Our solver with all cars on one ground plane; the solver also estimates the focal length.
    PlaneFocal,
    /// Our solver with the true camera and the true ground plane given. This system shows the errors that remain with
    /// an exact camera.
    ConstrainedGround,
}

impl System {
    /// All systems, in the order of the tables' rows.
    pub const ALL: [Self; 6] = [
        Self::Pavlakos,
        Self::KrishnaMurthy,
        Self::FreePoses,
        Self::Plane,
        Self::PlaneFocal,
        Self::ConstrainedGround,
    ];

    /// Returns the name of the system in the tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pavlakos => "1 Pavlakos 2017",
            Self::KrishnaMurthy => "2 Krishna Murthy 2017",
            Self::FreePoses => "3 ours without the plane",
            Self::Plane => "4 ours with the plane",
            Self::PlaneFocal => "5 ours, focal estimated",
            Self::ConstrainedGround => "(true ground given)",
        }
    }

    /// Returns whether the system estimates the ground plane.
    #[must_use]
    pub fn finds_ground(self) -> bool {
        matches!(self, Self::Plane | Self::PlaneFocal)
    }

    /// Estimates the poses of the cars in one frame, and the camera if the system estimates a camera.
    #[must_use]
    pub fn solve(self, atlas: &ShapeAtlas, input: &FrameInput<'_>, config: &Config) -> FrameAnswer {
        match self {
            Self::Pavlakos => baselines::solve(roadplane_baselines::pavlakos, atlas, input),
            Self::KrishnaMurthy => baselines::solve(roadplane_baselines::krishna_murthy, atlas, input),
            Self::FreePoses => free::solve(atlas, input, config),
            Self::Plane => plane::solve(atlas, input, Some(input.focal_px), config),
            Self::PlaneFocal => plane::solve(atlas, input, None, config),
            Self::ConstrainedGround => plane::solve_on(atlas, input, config),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::KeypointSet;
    use roadplane_synth::{SynthOptions, scene};

    /// With noise of 1 % of the box, every system finds the poses of nine of ten cars to within 0.15 rad and 15 % of
    /// the distance. The limits are 0.5 rad and 50 % if the focal length is estimated.
    #[test]
    fn every_system_finds_the_cars_of_a_scene() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let config = Config::default();
        let options = SynthOptions { cars: 8, seen: 0.8, box_px: [80.0, 400.0], ..SynthOptions::default() };
        for system in System::ALL {
            let (mut close, mut count) = (0, 0);
            for seed in 0..6 {
                let truth = scene(&atlas, &options, seed);
                let cars: Vec<KeypointSet> = truth.cars.iter().map(|car| car.keypoints).collect();
                let (focal_px, plane) = (truth.params.focal_px(), truth.params.plane());
                let input = FrameInput { size: truth.size, focal_px, plane, cars: &cars };
                let answer = system.solve(&atlas, &input, &config);
                assert_eq!(answer.cars.len(), cars.len());
                assert_eq!(answer.camera.is_some(), system.finds_ground());
                let camera_from_world = truth.params.plane().camera_from_world();
                for (car, answer) in truth.cars.iter().zip(&answer.cars) {
                    let pose = camera_from_world * car.pose.world_from_car();
                    let off = answer.map_or(f64::INFINITY, |answer| {
                        let turn = answer.camera_from_car.rotation.angle_to(&pose.rotation);
                        let by = answer.camera_from_car.translation.vector - pose.translation.vector;
                        turn.max(by.norm() / pose.translation.vector.norm())
                    });
                    count += 1;
                    // An error of the focal length moves every car along its line of sight.
                    close += usize::from(off < if system == System::PlaneFocal { 0.5 } else { 0.15 });
                }
            }
            println!("{}: {close} of {count}", system.name());
            assert!(close * 10 >= count * 9, "{}: {close} of {count}", system.name());
        }
    }
}
