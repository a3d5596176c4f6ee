//! A vehicle's mesh as glTF 2.0 in one JSON file, its numbers inside as a data URI.
//!
//! glTF has y up and a thing's front towards +z: (x, y, z) there is (left, up, forward) of the car frame. The origin is the
//! car's: on the ground, midway between the axles.

use base64::{Engine as _, engine::general_purpose::STANDARD};
use serde_json::{Value, json};

use crate::{Part, Vehicle};

const PARTS: [Part; 3] = [Part::Paint, Part::Glass, Part::Rubber];
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;

/// The document.
pub fn document(vehicle: &Vehicle) -> Value {
    let mut bytes: Vec<u8> = Vec::new();
    let (mut views, mut accessors, mut primitives) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |numbers: &[[f32; 3]], bytes: &mut Vec<u8>| -> usize {
        let start = bytes.len();
        bytes.extend(numbers.iter().flatten().flat_map(|v| v.to_le_bytes()));
        views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": bytes.len() - start, "target": ARRAY_BUFFER}));
        let ends = |pick: fn(f32, f32) -> f32, from: f32| -> Vec<f32> {
            (0..3).map(|i| numbers.iter().map(|v| v[i]).fold(from, pick)).collect()
        };
        accessors.push(json!({
            "bufferView": views.len() - 1, "componentType": FLOAT, "count": numbers.len(), "type": "VEC3",
            "min": ends(f32::min, f32::INFINITY), "max": ends(f32::max, f32::NEG_INFINITY),
        }));
        accessors.len() - 1
    };
    for (material, part) in PARTS.iter().enumerate() {
        let (mut corners, mut normals) = (Vec::new(), Vec::new());
        for (_, triangle) in vehicle.mesh.triangles().iter().filter(|(of, _)| of == part) {
            let [a, b, c] = triangle;
            let normal = (b - a).cross(&(c - a)).try_normalize(1e-12).unwrap_or_else(nalgebra::Vector3::z);
            corners.extend(triangle.map(|p| [p.y as f32, p.z as f32, p.x as f32]));
            normals.extend([[normal.y as f32, normal.z as f32, normal.x as f32]; 3]);
        }
        let (position, normal) = (add(&corners, &mut bytes), add(&normals, &mut bytes));
        primitives.push(
            json!({"attributes": {"POSITION": position, "NORMAL": normal}, "material": material, "mode": 4}),
        );
    }
    let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&bytes));
    json!({
        "asset": {"version": "2.0", "generator": "roadplane"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": vehicle.name}],
        "meshes": [{"name": vehicle.name, "primitives": primitives}],
        "materials": [
            material("paint", vehicle.colour, 0.3, 0.5),
            material("glass", [24, 28, 34], 0.0, 0.1),
            material("rubber", [22, 22, 22], 0.0, 0.9),
        ],
        "buffers": [{"byteLength": bytes.len(), "uri": uri}],
        "bufferViews": views,
        "accessors": accessors,
    })
}

/// Colours of pictures are sRGB, those of glTF linear.
fn material(name: &str, colour: [u8; 3], metallic: f64, roughness: f64) -> Value {
    let linear = |v: u8| {
        let v = f64::from(v) / 255.0;
        let linear = if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
        (linear * 1e4).round() / 1e4
    };
    let [r, g, b] = colour.map(linear);
    json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness,
        },
    })
}
