//! Measures vehicles in one frame with a known camera: by their keypoints, or by their boxes.
//!
//! The crate is below the camera and the tracks, and both use it. It is pure mathematics without I/O.
//!
//! # Contents
//! ```text
//! frame_camera.rs    camera of a frame, and the ground below it
//! body.rs            sizes of vehicles by class
//! outline.rs         the projected outline of a body: its box in the picture
//! filled_boxes.rs    the boxes of a vehicle in frames in which it is not detected
//! edge.rs            an edge of a box: the body's own, or something hides the body there
//! hidden.rs          edges at which another vehicle hides the body
//! ground_contact.rs  pose and size of a vehicle from its box
//! cars.rs            pose and shape of a car from its keypoints
//! fit_check.rs       whether a fit of a car is valid
//! ```

mod body;
mod cars;
mod edge;
mod filled_boxes;
mod fit_check;
mod frame_camera;
mod ground_contact;
mod hidden;
mod outline;

pub use body::{Body, body_of, car_body};
pub use cars::{POSE_SD_RATIO, any_car, fit_frame};
pub use edge::{Edge, OUTLINE_SD, OUTWARD, REACH, edge_sd_px};
pub use filled_boxes::{FrameBoxes, filled_boxes};
pub use fit_check::{FitLimits, projected_box, usable};
pub use frame_camera::FrameCamera;
pub use ground_contact::{GroundContact, HEADING_SD_RAD, Knowledge, STEP, ground_contact};
pub use hidden::{either, hidden_edges};
pub use outline::body_box;
