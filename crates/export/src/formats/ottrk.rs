//! OTVision: tracks in the picture as `.ottrk`, which OTAnalytics opens. The file is JSON, compressed with bzip2.
//!
//! The layout is version 1.1 of `.ottrk`, with version 1.4 of `.otdet` for boxes and video. A box has its upper left
//! corner, its width and its height, in pixels. Frames are numbered from 1. Times are seconds since the start of 1970
//! (UTC). If the start of the recording is unknown, it is the start of 1970. A row that is not observed is an
//! interpolated detection with confidence 0.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;

use bzip2::Compression;
use bzip2::write::BzEncoder;
use roadplane_base::{TrackRow, VehicleClass};
use roadplane_write::{OutFile, WriteError, decimals};
use serde_json::{Value, json};

use crate::{Run, Track};

const OTDET_VERSION: &str = "1.4";
const OTTRK_VERSION: &str = "1.1";
/// Name and version of the program that wrote the file, in the place of the version of OTVision.
const PROGRAM: &str = concat!("roadplane ", env!("CARGO_PKG_VERSION"));
/// The classes with their numbers in the data set COCO. OTVision uses the names of COCO, and ours are the same.
const COCO: [(u32, VehicleClass); 4] =
    [(2, VehicleClass::Car), (3, VehicleClass::Motorcycle), (5, VehicleClass::Bus), (7, VehicleClass::Truck)];

/// Writes all rows. The boxes of all segments are in one file, because they are in pixels.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let path = folder.join(format!("{}.ottrk", run.name));
    let mut packed = BzEncoder::new(OutFile::create(&path)?, Compression::best());
    let detections: Vec<Value> =
        run.rows().into_iter().map(|(track, row)| detection(run, track, row)).collect();
    let content = json!({"metadata": metadata(run), "data": {"detections": detections}});
    packed.write_all(content.to_string().as_bytes()).map_err(WriteError::io("write", &path))?;
    packed.finish().map_err(WriteError::io("write", &path))?.finish()
}

fn start_s(run: &Run) -> i64 {
    run.start_s.unwrap_or(0)
}

fn detection(run: &Run, track: &Track, row: &TrackRow) -> Value {
    let [x0, y0, x1, y1] = row.bbox_px;
    let px = |value| decimals(value, 2);
    let is_at = |end: Option<&TrackRow>| end.is_some_and(|end| end.frame == row.frame);
    json!({
        "class": track.class.name(),
        "confidence": row.score,
        "x": px(x0), "y": px(y0), "w": px(x1 - x0), "h": px(y1 - y0),
        "interpolated-detection": !row.observed,
        "first": is_at(track.rows.first()),
        "finished": is_at(track.rows.last()),
        "track-id": track.id,
        "frame": row.frame + 1,
        "occurrence": decimals(start_s(run) as f64 + row.time_s, 6),
        "input_file_path": run.media,
    })
}

fn metadata(run: &Run) -> Value {
    let media = Path::new(&run.media);
    let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let [width, height] = run.segments.first().map_or([0, 0], |s| s.camera.image_size_px.into());
    let fps = decimals(run.frames_per_s, 3);
    let seconds = (run.frames as f64 / run.frames_per_s).ceil() as i64;
    let suffix = text(media.extension());
    let classes: BTreeMap<String, &str> =
        COCO.iter().map(|(number, class)| (number.to_string(), class.name())).collect();
    json!({
        "otdet_version": OTDET_VERSION,
        "video": {
            "filename": text(media.file_stem()),
            "filetype": if suffix.is_empty() { suffix } else { format!(".{suffix}") },
            "width": width,
            "height": height,
            "recorded_fps": fps,
            "actual_fps": fps,
            "number_of_frames": run.frames,
            "recorded_start_date": start_s(run) as f64,
            "length": format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60),
            "expected_duration": seconds,
        },
        "detection": {
            "otvision_version": PROGRAM,
            "model": {
                "name": "roadplane",
                "weights": Value::Null,
                "iou_threshold": Value::Null,
                "image_size": Value::Null,
                "max_confidence": Value::Null,
                "half_precision": Value::Null,
                "classes": classes,
            },
            "chunksize": Value::Null,
            "normalized_bbox": false,
            "detect_start": Value::Null,
            "detect_end": Value::Null,
        },
        "ottrk_version": OTTRK_VERSION,
        "tracking": {
            "otvision_version": PROGRAM,
            "first_tracked_video_start": start_s(run) as f64,
            "last_tracked_video_end": (start_s(run) + seconds) as f64,
            "tracker": {
                "name": "roadplane",
                "sigma_l": Value::Null,
                "sigma_h": Value::Null,
                "sigma_iou": Value::Null,
                "t_min": Value::Null,
                "t_miss_max": Value::Null,
            },
            // OTAnalytics opens many files together. This id keeps their tracks apart.
            "tracking_run_id": format!("{}-{}", run.name, run.media_sha256.get(..12).unwrap_or_default()),
            "frame_group": 1,
        },
    })
}
