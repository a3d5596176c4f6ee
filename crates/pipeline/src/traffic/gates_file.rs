//! The file with gates and zones: GeoJSON, or OTAnalytics' `.otflow`.

use std::path::{Path, PathBuf};

use nalgebra::Vector2;
use roadplane_traffic::{Gate, Zone};
use roadplane_write::WriteError;
use serde_json::Value;

use super::world::World;
use crate::PipelineError;

/// Gates and zones as the user drew them.
#[derive(Debug)]
pub(super) struct GatesFile {
    path: PathBuf,
    coordinates: Coordinates,
    shapes: Vec<Shape>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Coordinates {
    /// Pixels of a frame, in a picture of this size; `None` if the size is that of the clip.
    Pixels { size: Option<[f64; 2]>, frame: u64 },
    /// World x and y, m.
    Metres,
    /// Longitude and latitude, degrees.
    Wgs84,
}

#[derive(Debug)]
struct Shape {
    name: String,
    points: Vec<Vector2<f64>>,
    is_zone: bool,
}

/// Number of parts into which a line in pixels is cut, because straight lines appear curved under distortion.
const PARTS: usize = 8;

impl GatesFile {
    /// Reads a file.
    pub(super) fn read(path: &Path) -> Result<Self, PipelineError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| PipelineError::Unreadable { source, path: path.to_path_buf() })?;
        let malformed =
            |what: String| PipelineError::from(WriteError::Malformed { what, path: path.to_path_buf() });
        let value: Value = serde_json::from_str(&text).map_err(|e| malformed(format!("no JSON: {e}")))?;
        let (coordinates, shapes) = if value.get("features").is_some() {
            geojson(&value).map_err(malformed)?
        } else if value.get("sections").is_some() {
            otflow(&value).map_err(malformed)?
        } else {
            return Err(malformed("neither GeoJSON (features) nor an .otflow file (sections)".to_owned()));
        };
        if shapes.is_empty() {
            return Err(malformed("the file has no gate and no zone".to_owned()));
        }
        for (i, shape) in shapes.iter().enumerate() {
            if shapes[..i].iter().any(|other| other.name == shape.name) {
                return Err(malformed(format!("two gates or zones have the name {:?}", shape.name)));
            }
        }
        Ok(Self { path: path.to_path_buf(), coordinates, shapes })
    }

    /// Returns the frame of the picture with the points; `None` if they are no pixels.
    pub(super) fn frame(&self) -> Option<u64> {
        match self.coordinates {
            Coordinates::Pixels { frame, .. } => Some(frame),
            Coordinates::Metres | Coordinates::Wgs84 => None,
        }
    }

    /// Returns the gates and zones in the world frame of a clip.
    pub(super) fn in_world(
        &self,
        world: Option<&World>,
        clip: &str,
    ) -> Result<(Vec<Gate>, Vec<Zone>), PipelineError> {
        let (mut gates, mut zones) = (Vec::new(), Vec::new());
        for shape in &self.shapes {
            let points = self.on_ground(shape, world).map_err(|what| {
                let path = self.path.display();
                PipelineError::usage(&format!("{:?} in {path} on the clip {clip}: {what}", shape.name))
            })?;
            if shape.is_zone {
                zones.push(Zone { name: shape.name.clone(), outline: points });
                continue;
            }
            let middle = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
            let shared_sd_m =
                world.filter(|_| self.frame().is_none()).map_or(0.0, |world| world.position_sd(&middle));
            gates.push(Gate { name: shape.name.clone(), line: points, shared_sd_m });
        }
        Ok((gates, zones))
    }

    fn on_ground(&self, shape: &Shape, world: Option<&World>) -> Result<Vec<Vector2<f64>>, String> {
        match self.coordinates {
            Coordinates::Metres => Ok(shape.points.clone()),
            Coordinates::Pixels { size, frame } => {
                let world = world.ok_or(
                    "pixels need a run of this program with its camera.json: give the gate in metres",
                )?;
                let ours = world.image_size();
                let ours = [f64::from(ours.width), f64::from(ours.height)];
                let [width, height] = size.unwrap_or(ours);
                let scale = ours[0] / width;
                if (ours[1] / height / scale - 1.0).abs() > 0.01 {
                    return Err(format!(
                        "it was drawn on a picture of {width} × {height} px, and the clip has {} × {} px",
                        ours[0], ours[1]
                    ));
                }
                let ground = |pixel: Vector2<f64>| {
                    // The centre of the first pixel is (0, 0), so half a pixel is added before scaling.
                    let pixel = (pixel.add_scalar(0.5) * scale).add_scalar(-0.5);
                    world.ground_at(&pixel, frame).ok_or("it reaches the horizon: draw it on the ground")
                };
                let mut points = Vec::new();
                let closed = shape.is_zone.then(|| [*shape.points.last()?, shape.points[0]].into());
                let pairs = shape.points.windows(2).map(|pair| [pair[0], pair[1]]).chain(closed.flatten());
                for [from, to] in pairs {
                    for part in 0..PARTS {
                        points.push(ground(from + (to - from) * part as f64 / PARTS as f64)?);
                    }
                }
                if !shape.is_zone {
                    points.push(ground(shape.points[shape.points.len() - 1])?);
                }
                Ok(points)
            }
            Coordinates::Wgs84 => {
                let world = world.filter(|world| world.is_on_map()).ok_or(
                    "longitude and latitude need a run with its place on the map (--geo or --camera-at)",
                )?;
                let ground = |p: &Vector2<f64>| world.ground_of(p.y, p.x).unwrap_or(Ok(*p));
                shape.points.iter().map(ground).collect()
            }
        }
    }
}

/// Reads a FeatureCollection (RFC 7946) with LineStrings and Polygons. Without the member `coordinates`, the positions are
/// longitude and latitude.
fn geojson(value: &Value) -> Result<(Coordinates, Vec<Shape>), String> {
    let numbers = |key: &str| -> Option<[f64; 2]> { serde_json::from_value(value.get(key)?.clone()).ok() };
    let coordinates = match value.get("coordinates").and_then(Value::as_str) {
        None | Some("wgs84") => Coordinates::Wgs84,
        Some("metres") => Coordinates::Metres,
        Some("pixels") => Coordinates::Pixels {
            size: numbers("image_size_px"),
            frame: value.get("frame").and_then(Value::as_u64).unwrap_or(0),
        },
        Some(other) => return Err(format!("coordinates {other:?}: choose pixels, metres or wgs84")),
    };
    let mut shapes = Vec::new();
    for (i, feature) in value["features"].as_array().into_iter().flatten().enumerate() {
        let name = feature["properties"]["name"].as_str().map_or_else(|| (i + 1).to_string(), str::to_owned);
        let geometry = &feature["geometry"];
        let line = |value: &Value| {
            points(value).ok_or_else(|| format!("{name:?} has positions that are no numbers"))
        };
        let (mut points, is_zone) = match geometry["type"].as_str() {
            Some("LineString") => (line(&geometry["coordinates"])?, false),
            Some("Polygon") => (line(&geometry["coordinates"][0])?, true),
            other => {
                return Err(format!("{name:?} is a {}: use LineString or Polygon", other.unwrap_or("shape")));
            }
        };
        if is_zone && points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        shapes.push(checked(name, points, is_zone)?);
    }
    Ok((coordinates, shapes))
}

/// Reads the sections of an `.otflow` file. Their coordinates are pixels, and so are those of our pictures; a section of the
/// type `area` is a zone.
fn otflow(value: &Value) -> Result<(Coordinates, Vec<Shape>), String> {
    let mut shapes = Vec::new();
    for (i, section) in value["sections"].as_array().into_iter().flatten().enumerate() {
        let name = section["name"].as_str().or(section["id"].as_str());
        let name = name.map_or_else(|| (i + 1).to_string(), str::to_owned);
        let pair = |point: &Value| Some(Vector2::new(point["x"].as_f64()?, point["y"].as_f64()?));
        let points = section["coordinates"].as_array().into_iter().flatten().map(pair);
        let mut points = points
            .collect::<Option<Vec<_>>>()
            .ok_or_else(|| format!("{name:?} has coordinates that are no numbers"))?;
        let is_zone = section["type"].as_str() == Some("area");
        if is_zone && points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        shapes.push(checked(name, points, is_zone)?);
    }
    Ok((Coordinates::Pixels { size: None, frame: 0 }, shapes))
}

fn points(value: &Value) -> Option<Vec<Vector2<f64>>> {
    let point = |v: &Value| Some(Vector2::new(v.get(0)?.as_f64()?, v.get(1)?.as_f64()?));
    value.as_array()?.iter().map(point).collect()
}

fn checked(name: String, mut points: Vec<Vector2<f64>>, is_zone: bool) -> Result<Shape, String> {
    points.dedup();
    let least = if is_zone { 3 } else { 2 };
    if points.len() < least {
        let kind = if is_zone { "zone" } else { "gate" };
        return Err(format!("{name:?} has {} different points; a {kind} needs {least}", points.len()));
    }
    Ok(Shape { name, points, is_zone })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<GatesFile, PipelineError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        GatesFile::read(file.path())
    }

    #[test]
    fn gates_and_zones_in_metres() {
        let file = read(
            r#"{"type": "FeatureCollection", "coordinates": "metres", "features": [
            {"type": "Feature", "properties": {"name": "in"},
             "geometry": {"type": "LineString", "coordinates": [[0, 1], [4, 1]]}},
            {"type": "Feature", "properties": {},
             "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 4], [0, 0]]]}}]}"#,
        );
        let (gates, zones) = file.unwrap().in_world(None, "clip").unwrap();
        assert_eq!((gates[0].name.as_str(), gates[0].line.len(), gates[0].shared_sd_m), ("in", 2, 0.0));
        assert_eq!((zones[0].name.as_str(), zones[0].outline.len(), zones[0].area_m2()), ("2", 3, 8.0));
    }

    #[test]
    fn sections_of_an_otflow_file_are_in_pixels() {
        let file = read(
            r#"{"sections": [{"id": "1", "name": "north", "type": "line",
            "coordinates": [{"x": 1, "y": 2}, {"x": 3, "y": 4}]}], "flows": []}"#,
        )
        .unwrap();
        assert_eq!(file.coordinates, Coordinates::Pixels { size: None, frame: 0 });
        let error = file.in_world(None, "clip").unwrap_err().to_string();
        assert!(error.contains("\"north\"") && error.contains("camera.json"), "{error}");
    }

    #[test]
    fn faults_are_named() {
        let line = |name: &str, points: &str| {
            format!(
                r#"{{"type": "Feature", "properties": {{"name": "{name}"}},
                "geometry": {{"type": "LineString", "coordinates": {points}}}}}"#
            )
        };
        let collection = |features: &[String], more: &str| {
            format!(r#"{{"type": "FeatureCollection", {more} "features": [{}]}}"#, features.join(","))
        };
        let good = line("a", "[[0, 1], [4, 1]]");
        for (text, fault) in [
            ("{".to_owned(), "no JSON"),
            ("{}".to_owned(), "neither GeoJSON"),
            (collection(&[], ""), "no gate and no zone"),
            (collection(&[good.clone(), good.clone()], ""), "two gates or zones"),
            (collection(&[line("b", "[[0, 1], [0, 1]]")], ""), "1 different points"),
            (collection(&[line("b", "[[0, \"x\"], [0, 1]]")], ""), "no numbers"),
            (collection(std::slice::from_ref(&good), r#""coordinates": "feet","#), "feet"),
        ] {
            let error = read(&text).unwrap_err().to_string();
            assert!(error.contains(fault), "{fault}: {error}");
        }
    }
}
