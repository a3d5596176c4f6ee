//! Reads sets of pictures with true boxes.

use std::path::{Path, PathBuf};

use roadplane_base::VehicleClass;
use roadplane_metrics::MetricsError;
use roadplane_metrics::detection_curve::IgnoredRegion;
use roadplane_metrics::text_file::read_text;
use roadplane_metrics::truth::{Kind, Truth, read_dataset, read_truth};
use serde::Deserialize;

use crate::LabError;

/// Vehicles of a data set with a smaller visible share are ignored. The training of the detector ignores them, too.
const LEAST_VISIBLE: f64 = 0.25;
/// Overlap with an unlabelled neighbour from which a detection does not count.
const NEIGHBOUR_IOU: f64 = 0.25;
/// Limits of the groups of tilt, roll and hidden share.
const TILTS_DEG: [f64; 4] = [10.0, 20.0, 30.0, 45.0];
const ROLLS_DEG: [f64; 3] = [5.0, 15.0, 25.0];
const HIDDEN: [f64; 3] = [0.05, 0.25, 0.5];

/// Pictures that are scored together.
#[derive(Clone, Debug)]
pub struct PictureSet {
    /// Name of the file or folder.
    pub name: String,
    /// The pictures.
    pub pictures: Vec<LabelledPicture>,
}

/// A picture with its true vehicles.
#[derive(Clone, Debug)]
pub struct LabelledPicture {
    /// File of the picture.
    pub path: PathBuf,
    /// The vehicles to be found.
    pub vehicles: Vec<Labelled>,
    /// Regions in which detections do not count.
    pub ignored: Vec<IgnoredRegion>,
    /// Groups of the whole picture: name and value, for example `weather` and `fog`.
    pub groups: Vec<(&'static str, String)>,
}

/// A true vehicle.
#[derive(Clone, Debug)]
pub struct Labelled {
    /// Box of the visible part: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Class, if the truth gives it.
    pub class: Option<VehicleClass>,
    /// Groups of this vehicle: name and value.
    pub groups: Vec<(&'static str, String)>,
}

/// A JSON list of pictures with boxes.
#[derive(Deserialize)]
struct List {
    images: Vec<ListedPicture>,
}

#[derive(Deserialize)]
struct ListedPicture {
    file: PathBuf,
    boxes_px: Vec<[f64; 4]>,
    #[serde(default)]
    ignore_px: Vec<[f64; 4]>,
    #[serde(default)]
    neighbours_px: Vec<[f64; 4]>,
    angle_deg: Option<f64>,
}

/// Reads a JSON list, a data set, or a folder of pictures without vehicles.
pub fn read_set(input: &Path) -> Result<PictureSet, LabError> {
    let mut name = input.display().to_string();
    let pictures = if input.is_file() {
        read_list(input)?
    } else if input.join("dataset.json").is_file() {
        let items = read_dataset(input)?.items;
        let truths = items.iter().map(|item| read_truth(item)).collect::<Result<Vec<_>, _>>()?;
        truths.into_iter().filter(|truth| truth.kind == Kind::Still).filter_map(of_truth).collect()
    } else {
        name += ", no vehicles";
        read_empty(input)?
    };
    if pictures.is_empty() {
        return Err(LabError::unsuitable(format!("{} holds no pictures", input.display())));
    }
    Ok(PictureSet { name, pictures })
}

fn read_list(path: &Path) -> Result<Vec<LabelledPicture>, LabError> {
    let list: List =
        serde_json::from_str(&read_text(path)?).map_err(|error| LabError::malformed(path, error))?;
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let picture = |listed: ListedPicture| {
        let regions = listed.ignore_px.iter().map(|bbox_px| IgnoredRegion::at_half(*bbox_px));
        let neighbour = |bbox_px: &[f64; 4]| IgnoredRegion {
            bbox_px: *bbox_px,
            least_iou: NEIGHBOUR_IOU,
            least_inside: f64::INFINITY,
        };
        let neighbours = listed.neighbours_px.iter().map(neighbour);
        LabelledPicture {
            path: folder.join(listed.file),
            vehicles: listed
                .boxes_px
                .iter()
                .map(|bbox_px| Labelled { bbox_px: *bbox_px, class: None, groups: Vec::new() })
                .collect(),
            ignored: regions.chain(neighbours).collect(),
            groups: listed.angle_deg.map(|angle| ("roll, °", format!("{angle}"))).into_iter().collect(),
        }
    };
    Ok(list.images.into_iter().map(picture).collect())
}

/// Returns a still of a data set; `None` if it has no picture.
fn of_truth(truth: Truth) -> Option<LabelledPicture> {
    let frame = truth.frames.first()?;
    let (clear, slivers): (Vec<_>, Vec<_>) =
        frame.cars.iter().partition(|car| car.visible_share >= LEAST_VISIBLE);
    let vehicle = |car: &&roadplane_metrics::truth::TrueCar| Labelled {
        bbox_px: car.bbox_px,
        class: truth.model(car.id).map(|model| model.class),
        groups: vec![("hidden share", range(&HIDDEN, 1.0 - car.visible_share))],
    };
    let mut groups = vec![
        ("tilt, °", range(&TILTS_DEG, truth.camera.tilt_rad.to_degrees())),
        ("roll, °", range(&ROLLS_DEG, truth.camera.roll_rad.to_degrees().abs())),
    ];
    groups.extend(truth.conditions.get("weather").map(|weather| ("weather", weather.clone())));
    Some(LabelledPicture {
        path: truth.media.clone()?,
        vehicles: clear.iter().map(vehicle).collect(),
        ignored: slivers.iter().map(|car| IgnoredRegion::at_half(car.bbox_px)).collect(),
        groups,
    })
}

/// Returns the name of the range between limits that contains a value.
pub fn range(limits: &[f64], value: f64) -> String {
    match limits.iter().position(|limit| value < *limit) {
        Some(0) => format!("below {}", limits[0]),
        Some(i) => format!("{}–{}", limits[i - 1], limits[i]),
        None => limits.last().map_or_else(String::new, |last| format!("{last} and more")),
    }
}

fn read_empty(folder: &Path) -> Result<Vec<LabelledPicture>, LabError> {
    let unreadable = |source| MetricsError::Unreadable { path: folder.to_path_buf(), source };
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(unreadable)?;
    let is_picture = |path: &PathBuf| {
        let suffix = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        ["jpg", "jpeg", "png"].contains(&suffix.as_str())
    };
    let mut paths: Vec<PathBuf> = entries.iter().map(std::fs::DirEntry::path).filter(is_picture).collect();
    paths.sort();
    let empty = |path| LabelledPicture { path, vehicles: vec![], ignored: vec![], groups: vec![] };
    Ok(paths.into_iter().map(empty).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_lie_in_one_range() {
        let names = [-1.0, 10.0, 44.0, 45.0].map(|value| range(&TILTS_DEG, value));
        assert_eq!(names, ["below 10", "10–20", "30–45", "45 and more"]);
    }

    #[test]
    fn a_list_gives_vehicles_and_regions() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("list.json");
        let text = r#"{"images": [{"file": "a.jpg", "size_px": [9, 9], "angle_deg": -20, "boxes_px": [[0, 0, 4, 4]],
            "ignore_px": [[5, 5, 9, 9]], "neighbours_px": [[0, 0, 5, 5]]}]}"#;
        std::fs::write(&path, text).unwrap();
        let set = read_set(&path).unwrap();
        let [picture] = &set.pictures[..] else { panic!("{set:?}") };
        assert_eq!(picture.path, folder.path().join("a.jpg"));
        assert_eq!((picture.vehicles.len(), picture.ignored.len()), (1, 2));
        assert_eq!(picture.groups, [("roll, °", "-20".to_owned())]);
        std::fs::write(&path, "{}").unwrap();
        assert!(read_set(&path).is_err());
        assert!(read_set(folder.path()).is_err(), "no pictures");
    }
}
