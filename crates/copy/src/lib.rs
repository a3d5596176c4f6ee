//! Conversion of a finished run to a scene for simulators and 3D programs.
//!
//! [`Scene`] contains the camera and the vehicles. Each vehicle has a trajectory with few vertices, and a mesh.
//! [`write_scene`] writes these files:
//!
//! - `scenario.xosc` (ASAM OpenSCENARIO XML 1.2) and `road.xodr` (ASAM OpenDRIVE 1.7)
//! - `meshes/car_N.gltf` (glTF 2.0)
//! - `camera.json`
//! - `scene.json`: the same data in one JSON file
//!
//! The world frame is the world frame of the run. The z axis points up, and the origin is on the ground below the
//! camera.
//!
//! # Contents
//! - `scene.rs`: the scene. `thin.rs`: the trajectories. `mesh.rs` and `wheels.rs`: the surfaces of vehicles.
//! - `openscenario.rs`, `opendrive.rs`, `gltf.rs`: one file format each.

#![deny(missing_docs)]

mod gltf;
mod mesh;
mod opendrive;
mod openscenario;
mod scene;
mod thin;
mod wheels;

use std::path::Path;

use roadplane_base::CameraEstimate;
use roadplane_write::{WriteError, write_camera, write_json};

pub use mesh::{CarMesh, Part, Triangle};
pub use scene::{Colours, SCENE_SCHEMA, Scene, Vehicle};
pub use thin::{Body, Vertex, at, thinned};
pub use wheels::Wheels;

/// Writes all files of a scene into an existing folder.
///
/// # Errors
/// [`WriteError::Io`], [`WriteError::DiskFull`].
pub fn write_scene(scene: &Scene, folder: &Path) -> Result<(), WriteError> {
    let meshes = folder.join("meshes");
    let failed = |source| WriteError::Io { doing: "create the folder", source, path: meshes.clone() };
    std::fs::create_dir(&meshes).map_err(failed)?;
    for vehicle in &scene.vehicles {
        write_json(&meshes.join(format!("{}.gltf", vehicle.name)), &gltf::document(vehicle))?;
    }
    opendrive::document(scene).write(&folder.join("road.xodr"))?;
    openscenario::document(scene).write(&folder.join("scenario.xosc"))?;
    let camera = CameraEstimate { second_plane: None, ..scene.camera.estimate() };
    write_camera(&folder.join("camera.json"), &[camera], scene.motion.clone())?;
    write_json(&folder.join("scene.json"), scene)
}
