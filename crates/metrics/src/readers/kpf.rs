//! Reads boxes in Kitware's format KPF (KWIVER packet format), a list of YAML maps.
//!
//! - `geom` packets: `id1` is the track, `ts0` the frame, `g0` the box as `x0 y0 x1 y1`.
//! - `types` packets: `cset3` maps each type to the likelihood that the track has this type.

use std::collections::BTreeMap;
use std::path::Path;

use yaml_rust2::{Yaml, YamlLoader};

use crate::MetricsError;
use crate::text_file::read_text;

/// One box: an object in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct KpfBox {
    /// Id of the object's track (`id1`).
    pub track: u64,
    /// Index of the frame (`ts0`).
    pub frame: u64,
    /// Time in the clip (`ts1`), s; 0 if it is not given.
    pub time_s: f64,
    /// Left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Occlusion of the object: `partially` or `mostly`. `None` if the object is fully visible.
    pub occlusion: Option<String>,
}

/// Reads the boxes of a `*.geom.yml` file, in the order of the file.
///
/// # Errors
/// [`MetricsError::Unreadable`]; [`MetricsError::Malformed`], which names the packet and the field.
pub fn read_boxes(path: &Path) -> Result<Vec<KpfBox>, MetricsError> {
    let mut boxes = Vec::new();
    for (i, packet) in packets(path, "geom")? {
        let fail = |what: &str| MetricsError::malformed(path, format!("packet {i}: {what}"));
        let whole = |name: &str| {
            let value = packet[name].as_i64().and_then(|v| u64::try_from(v).ok());
            value.ok_or_else(|| fail(&format!("{name} is no number")))
        };
        let text = packet["g0"].as_str().ok_or_else(|| fail("g0 is missing"))?;
        let corners: Vec<f64> = text.split_whitespace().filter_map(|v| v.parse().ok()).collect();
        let Ok([x0, y0, x1, y1]) = <[f64; 4]>::try_from(corners) else {
            return Err(fail("g0 must have four numbers"));
        };
        if !([x0, y0, x1, y1].iter().all(|v| v.is_finite()) && x1 > x0 && y1 > y0) {
            return Err(fail("g0 has no area"));
        }
        boxes.push(KpfBox {
            track: whole("id1")?,
            frame: whole("ts0")?,
            time_s: real(&packet["ts1"]).unwrap_or(0.0),
            bbox_px: [x0, y0, x1, y1],
            occlusion: packet["occlusion"].as_str().map(str::to_owned),
        });
    }
    Ok(boxes)
}

/// Reads the most likely type of each track from a `types.yml` file.
///
/// # Errors
/// [`MetricsError::Unreadable`]; [`MetricsError::Malformed`], which names the packet and the field.
pub fn read_types(path: &Path) -> Result<BTreeMap<u64, String>, MetricsError> {
    let mut types = BTreeMap::new();
    for (i, packet) in packets(path, "types")? {
        let fail = |what: &str| MetricsError::malformed(path, format!("packet {i}: {what}"));
        let id = packet["id1"].as_i64().and_then(|v| u64::try_from(v).ok());
        let id = id.ok_or_else(|| fail("id1 is no number"))?;
        let set = packet["cset3"].as_hash().ok_or_else(|| fail("cset3 is no map"))?;
        let mut best: Option<(&str, f64)> = None;
        for (name, value) in set {
            let name = name.as_str().ok_or_else(|| fail("cset3 has a key that is no text"))?;
            let value = real(value).ok_or_else(|| fail("cset3 has a value that is no number"))?;
            if best.is_none_or(|(_, so_far)| value > so_far) {
                best = Some((name, value));
            }
        }
        let (name, _) = best.ok_or_else(|| fail("cset3 is empty"))?;
        types.insert(id, name.to_owned());
    }
    Ok(types)
}

/// Returns the value of a YAML number, with or without a decimal point. Returns `None` if the value is no number.
fn real(value: &Yaml) -> Option<f64> {
    value.as_f64().or_else(|| value.as_i64().map(|v| v as f64))
}

/// Returns the packets of one kind (`geom` or `types`). Each has its number in the file, counted from 1.
fn packets(path: &Path, kind: &str) -> Result<Vec<(usize, Yaml)>, MetricsError> {
    let text = read_text(path)?;
    let documents = YamlLoader::load_from_str(&text).map_err(|e| MetricsError::malformed(path, e))?;
    let Some(list) = documents.into_iter().next().and_then(Yaml::into_vec) else {
        return Err(MetricsError::malformed(path, "is no list of packets"));
    };
    let of_kind = |(i, packet): (usize, Yaml)| {
        let inner = packet[kind].clone();
        (!inner.is_badvalue()).then_some((i + 1, inner))
    };
    Ok(list.into_iter().enumerate().filter_map(of_kind).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.geom.yml");
        std::fs::write(&path, text).unwrap();
        (folder, path)
    }

    #[test]
    fn boxes_and_types() {
        let (_folder, path) = file(
            "- { meta: \"a clip\" }\n\
             - { geom: { id1: 4, id0: 25, ts0: 50, ts1: 0.83, g0: 1198 307 1248 343 , src: truth, occlusion: mostly, } }\n\
             - { geom: { id1: 0, ts0: 25, g0: 1 2 3.5 4 } }\n\
             - { types: { id1: 4 , cset3: { Person: 0.2, Vehicle: 0.8 } } }\n",
        );
        let boxes = read_boxes(&path).unwrap();
        assert_eq!(boxes.len(), 2);
        assert_eq!((boxes[0].track, boxes[0].frame), (4, 50));
        assert!((boxes[0].time_s - 0.83).abs() < 1e-12);
        assert_eq!(boxes[0].bbox_px, [1198.0, 307.0, 1248.0, 343.0]);
        assert_eq!((boxes[0].occlusion.as_deref(), boxes[1].occlusion.as_deref()), (Some("mostly"), None));
        assert_eq!(read_types(&path).unwrap(), BTreeMap::from([(4, "Vehicle".to_owned())]));
    }

    #[test]
    fn errors_name_the_fault() {
        for (text, word) in [
            ("- { geom: { id1: 4, ts0: 5, g0: 1 2 3 } }", "packet 1: g0 must have four"),
            ("- { geom: { id1: x, ts0: 5, g0: 1 2 3 4 } }", "packet 1: id1"),
            ("- { geom: { id1: 1, ts0: 5, g0: 3 2 1 4 } }", "no area"),
            ("- { geom: { id1: 4, ts0: 5, ", "boxes.geom.yml"),
            ("plain text", "no list"),
            ("", "no list"),
        ] {
            let (_folder, path) = file(text);
            let error = read_boxes(&path).unwrap_err().to_string();
            assert!(error.contains(word) && error.ends_with("boxes.geom.yml"), "{text}: {error}");
        }
    }

    #[test]
    #[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
    fn real_boxes_are_read() {
        let folder =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/virat/VIRAT_S_000206_04");
        let boxes = read_boxes(&folder.join("boxes.geom.yml")).unwrap();
        let types = read_types(&folder.join("types.yml")).unwrap();
        let vehicles = types.values().filter(|kind| *kind == "Vehicle").count();
        assert_eq!(vehicles, 28, "types.yml itself says 28");
        let first = boxes.iter().filter(|b| b.frame == 25 && types[&b.track] == "Vehicle").count();
        assert!((20..=28).contains(&first), "{first}");
        assert!(boxes.iter().all(|b| b.bbox_px[2] <= 1281.0 && b.bbox_px[3] <= 721.0));
    }
}
