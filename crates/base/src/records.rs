//! The records that the stages of a run exchange and that files store (see `ARCHITECTURE.md`).

mod camera;
mod car;
mod error;
mod frame;
mod pose;
mod track_row;
mod vehicle_class;
mod watch;

pub use camera::{CameraEstimate, CameraStatus, SecondPlane};
pub use car::{CarRecord, CarRef, WeakBox};
pub use error::RecordError;
pub use frame::FrameRecord;
pub use pose::{PoseRecord, rows_from_isometry};
pub use track_row::{OnMap, TrackRow};
pub use vehicle_class::VehicleClass;
pub use watch::{
    CameraMove, MoveKind, NotFollowedReason, PictureVerdict, RegisteredLens, Registration, WatchRecord,
};
