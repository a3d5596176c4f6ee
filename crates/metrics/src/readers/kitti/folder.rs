//! Reads a folder of the KITTI object benchmark.

use std::path::{Path, PathBuf};

use super::{KittiCamera, KittiObject, read_calib, read_objects};
use crate::MetricsError;

/// One labelled image of the KITTI object benchmark.
#[derive(Clone, Debug, PartialEq)]
pub struct KittiItem {
    /// Name of the image without its extension, `NNNNNN`.
    pub name: String,
    /// Path of the image.
    pub image: PathBuf,
    /// Camera of the image.
    pub camera: KittiCamera,
    /// Labelled objects of the image.
    pub objects: Vec<KittiObject>,
}

/// Returns the labelled images with at least `min_vehicles` vehicles, sorted by name.
///
/// The folder contains `image_2/`, `label_2/` and `calib/`, or has a folder `training/` that contains them. For Table 3
/// of Li et al., *Car Pose in Context*, `min_vehicles` is 4: the paper uses images with more than three vehicles.
///
/// # Errors
/// [`MetricsError::Unreadable`] or [`MetricsError::Malformed`] for a file; [`MetricsError::Unsuitable`] if no image has
/// enough vehicles.
pub fn object_items(folder: &Path, min_vehicles: usize) -> Result<Vec<KittiItem>, MetricsError> {
    let training = folder.join("training");
    let root = if training.is_dir() { training } else { folder.to_path_buf() };
    let labels = root.join("label_2");
    let unreadable = |source| MetricsError::Unreadable { source, path: labels.clone() };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&labels).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.extension().is_some_and(|extension| extension == "txt") {
            names.extend(path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned));
        }
    }
    names.sort();
    let mut items = Vec::new();
    for name in names {
        let objects = read_objects(&labels.join(format!("{name}.txt")))?;
        if objects.iter().filter(|object| object.is_vehicle()).count() < min_vehicles {
            continue;
        }
        let images = ["png", "jpg"].map(|extension| root.join("image_2").join(format!("{name}.{extension}")));
        let [png, jpg] = images;
        let image = if jpg.is_file() { jpg } else { png };
        let camera = read_calib(&root.join("calib").join(format!("{name}.txt")))?;
        items.push(KittiItem { name, image, camera, objects });
    }
    if items.is_empty() {
        let what =
            format!("no image with at least {min_vehicles} vehicles is labelled in {}", labels.display());
        return Err(MetricsError::Unsuitable { what });
    }
    Ok(items)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_with_few_cars_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("training");
        for part in ["label_2", "calib", "image_2"] {
            std::fs::create_dir_all(root.join(part)).unwrap();
        }
        let car = "Car 0 0 0 10 10 90 60 1.5 1.6 4.0 1 1.6 20 0.1\n";
        let truck = car.replace("Car", "Truck");
        let person = car.replace("Car", "Pedestrian");
        for (name, label) in [
            ("000002", format!("{}{truck}", car.repeat(3))),
            ("000001", format!("{}{person}{person}", car.repeat(3))),
            ("000000", car.repeat(5)),
        ] {
            std::fs::write(root.join(format!("label_2/{name}.txt")), label).unwrap();
            let calib = "P2: 700 0 600 40 0 700 170 0.2 0 0 1 0.003\n";
            std::fs::write(root.join(format!("calib/{name}.txt")), calib).unwrap();
        }
        let items = object_items(folder.path(), 4).unwrap();
        let names: Vec<&str> = items.iter().map(|item| item.name.as_str()).collect();
        assert_eq!(names, ["000000", "000002"]);
        assert!(items[0].image.ends_with("training/image_2/000000.png"));
        assert!(matches!(object_items(folder.path(), 9), Err(MetricsError::Unsuitable { .. })));
        assert!(matches!(object_items(&folder.path().join("none"), 4), Err(MetricsError::Unreadable { .. })));
    }
}
