//! Converts the evidence of a clip to the picture that the camera database keeps of the scene, and back.
//!
//! A clip's camera is that of its world picture, the first reference of a place. The camera database compares pictures
//! of the empty scene. Such a picture shows the last part of the clip, at the mean position of a camera that sways. So
//! the evidence is that of the camera which takes this picture.

use nalgebra::Vector2;
use roadplane_base::{
    CameraEvidence, CameraParams, ImageSize, JointInformation, ParkedCar, PictureMotion, Registration,
    SceneLine,
};
use roadplane_calibrate::{Places, WindowEstimate, turned_information};

/// Mapping from the world picture of the camera's last position to the picture of the empty scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EmptySceneView {
    scene_from_world: PictureMotion,
    centre_px: Vector2<f64>,
}

impl EmptySceneView {
    /// Returns the view of a picture of the empty scene with this registration. `None` if the picture does not show the
    /// position with this index.
    pub(crate) fn of(
        registration: Option<&Registration>,
        places: &Places,
        position: usize,
        size: ImageSize,
    ) -> Option<Self> {
        let scene_from_world = match registration.filter(|_| places.is_measured()) {
            None => PictureMotion::IDENTITY,
            Some(registration) => {
                let (place, scene_from_world) = places.position(registration, size)?;
                (place == position).then_some(scene_from_world)?
            }
        };
        Some(Self { scene_from_world, centre_px: size.centre_px() })
    }

    /// Converts evidence on the camera of the world picture to the camera of the empty scene. `None` if the motion
    /// between the two is no turn.
    pub(crate) fn evidence(&self, said: CameraEvidence) -> Option<CameraEvidence> {
        if self.scene_from_world.is_identity() {
            return Some(said);
        }
        let (params, joint) = self.turned(&said.camera_params(), &said.joint(), &self.scene_from_world)?;
        let numbers = params.to_vector();
        let parked = said.parked.iter().map(|car| ParkedCar {
            bbox_px: self.scene_from_world.apply_to_box(&car.bbox_px),
            keypoints_px: car
                .keypoints_px
                .iter()
                .map(|pixel| pixel.map(|pixel| self.in_scene(pixel)))
                .collect(),
        });
        Some(CameraEvidence {
            params: numbers.into(),
            information: std::array::from_fn(|r| std::array::from_fn(|c| joint.information[(r, c)])),
            shared: std::array::from_fn(|r| std::array::from_fn(|c| joint.cross[(r, c)])),
            parked: parked.collect(),
            ..said
        })
    }

    /// Converts a window of the camera of the empty scene to the camera of the world picture. `None` if the motion
    /// between the two is no turn.
    pub(crate) fn window_in_world(&self, window: &WindowEstimate) -> Option<WindowEstimate> {
        if self.scene_from_world.is_identity() {
            return Some(window.clone());
        }
        let back = self.scene_from_world.inverse();
        let (params, joint) = self.turned(&window.params, &window.joint, &back)?;
        Some(WindowEstimate { params, joint, ..window.clone() })
    }

    /// Converts a line of the world picture to the picture of the empty scene.
    pub(crate) fn line(&self, line: &SceneLine) -> SceneLine {
        SceneLine { ends_px: line.ends_px.map(|end| self.scene_from_world.apply(&end)), ..*line }
    }

    fn turned(
        &self,
        params: &CameraParams,
        joint: &JointInformation,
        motion: &PictureMotion,
    ) -> Option<(CameraParams, JointInformation)> {
        turned_information(params, joint, &motion.homography, &self.centre_px)
    }

    fn in_scene(&self, pixel: [f64; 2]) -> [f64; 2] {
        self.scene_from_world.apply(&Vector2::from(pixel)).into()
    }
}
