//! Reads boxes in COCO's format, from two files: annotations (`images`, `annotations`, `categories`) and results (a
//! list of boxes with scores).

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::MetricsError;
use crate::average_precision::{FoundBox, PictureBoxes, TrueBox};
use crate::text_file::read_text;

#[derive(Deserialize)]
struct Annotations {
    images: Vec<Id>,
    annotations: Vec<Annotation>,
    categories: Vec<Category>,
}

#[derive(Deserialize)]
struct Id {
    id: u64,
}

#[derive(Deserialize)]
struct Category {
    id: u64,
    name: String,
}

#[derive(Deserialize)]
struct Annotation {
    image_id: u64,
    category_id: u64,
    bbox: [f64; 4],
    area: f64,
    #[serde(default)]
    iscrowd: u8,
}

#[derive(Deserialize)]
struct Found {
    image_id: u64,
    category_id: u64,
    bbox: [f64; 4],
    score: f64,
}

/// Reads a file of true boxes and a file of detections. Returns each category's name and its boxes in each picture.
/// Categories and pictures are sorted by id.
///
/// As in pycocotools, crowd regions are the only true boxes that are ignored.
///
/// # Errors
/// [`MetricsError::Unreadable`]; [`MetricsError::Malformed`] for a file of another format, or for a box of an unknown
/// picture or category.
pub fn read_coco(truth: &Path, found: &Path) -> Result<Vec<(String, Vec<PictureBoxes>)>, MetricsError> {
    let annotations: Annotations = parse(truth)?;
    let results: Vec<Found> = parse(found)?;
    let pictures = || annotations.images.iter().map(|image| (image.id, PictureBoxes::default()));
    let mut of: BTreeMap<u64, BTreeMap<u64, PictureBoxes>> =
        annotations.categories.iter().map(|category| (category.id, pictures().collect())).collect();
    let mut add_box =
        |path: &Path, name: &str, i: usize, category: u64, image: u64, add: &dyn Fn(&mut PictureBoxes)| {
            let boxes = of.get_mut(&category).and_then(|pictures| pictures.get_mut(&image));
            let unknown = || format!("{name}[{i}]: image {image} or category {category} is not listed");
            boxes.map(add).ok_or_else(|| MetricsError::malformed(path, unknown()))
        };
    for (i, a) in annotations.annotations.iter().enumerate() {
        let bbox_px = corners(&a.bbox, truth, "annotations", i)?;
        let area_px2 = a.area;
        let boxed = TrueBox { bbox_px, area_px2, ignore: false, crowd: a.iscrowd != 0 };
        add_box(truth, "annotations", i, a.category_id, a.image_id, &|boxes| boxes.truth.push(boxed))?;
    }
    for (i, r) in results.iter().enumerate() {
        let boxed = FoundBox { bbox_px: corners(&r.bbox, found, "results", i)?, score: r.score };
        add_box(found, "results", i, r.category_id, r.image_id, &|boxes| boxes.found.push(boxed))?;
    }
    let mut names: Vec<Category> = annotations.categories;
    names.sort_by_key(|category| category.id);
    let boxes_of = |category: Category| {
        let pictures = of.remove(&category.id).unwrap_or_default();
        (category.name, pictures.into_values().collect())
    };
    Ok(names.into_iter().map(boxes_of).collect())
}

fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, MetricsError> {
    serde_json::from_str(&read_text(path)?).map_err(|e| MetricsError::malformed(path, e))
}

fn corners(
    [x, y, width, height]: &[f64; 4],
    path: &Path,
    name: &str,
    i: usize,
) -> Result<[f64; 4], MetricsError> {
    if *width >= 0.0 && *height >= 0.0 {
        Ok([*x, *y, x + width, y + height])
    } else {
        Err(MetricsError::malformed(path, format!("{name}[{i}].bbox has a negative side")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_sorted_by_category_and_picture() {
        let folder = tempfile::tempdir().unwrap();
        let (truth, found) = (folder.path().join("gt.json"), folder.path().join("dt.json"));
        let annotations = r#"{"images": [{"id": 9}, {"id": 2}], "categories": [{"id": 3, "name": "car"}],
            "annotations": [{"id": 1, "image_id": 9, "category_id": 3, "bbox": [1, 2, 10, 20], "area": 150, "iscrowd": 1}]}"#;
        let result = r#"[{"image_id": 2, "category_id": 3, "bbox": [0, 0, 5, 5], "score": 0.5}]"#;
        std::fs::write(&truth, annotations).unwrap();
        std::fs::write(&found, result).unwrap();
        let boxes = read_coco(&truth, &found).unwrap();
        assert_eq!(boxes.len(), 1);
        let (name, pictures) = &boxes[0];
        assert_eq!((name.as_str(), pictures.len()), ("car", 2));
        assert_eq!((pictures[0].found.len(), pictures[0].truth.len()), (1, 0));
        let expected =
            TrueBox { bbox_px: [1.0, 2.0, 11.0, 22.0], area_px2: 150.0, ignore: false, crowd: true };
        assert_eq!(pictures[1].truth, [expected]);
        for (broken, word) in [
            (result.replace("\"image_id\": 2", "\"image_id\": 4"), "results[0]: image 4"),
            (result.replace("5, 5]", "-5, 5]"), "results[0].bbox"),
            (result.replace("score", "points"), "score"),
        ] {
            std::fs::write(&found, broken).unwrap();
            let error = read_coco(&truth, &found).unwrap_err().to_string();
            assert!(error.contains(word) && error.ends_with("dt.json"), "{error}");
        }
    }
}
