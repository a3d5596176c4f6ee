//! The mesh of a vehicle as glTF 2.0: one JSON file, with the binary data as a data URI.
//!
//! In glTF, the y axis points up and the front of an object points towards +z. So the axes x, y and z are the
//! directions left, up and forward of the car frame. The origin is on the ground, midway between the axles of the car.
//! The body and each wheel are separate nodes. A wheel rolls forwards when its node turns about +x.

use base64::{Engine as _, engine::general_purpose::STANDARD};
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use crate::mesh::Triangle;
use crate::{Part, Vehicle};

const PARTS: [Part; 4] = [Part::Paint, Part::Glass, Part::Rubber, Part::Rim];
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;

/// Returns the glTF document of a vehicle.
pub fn document(vehicle: &Vehicle) -> Value {
    let mut numbers = Numbers::default();
    let wheels = &vehicle.wheels;
    let meshes = [
        numbers.mesh("body", vehicle.mesh.triangles()),
        numbers.mesh("wheel_left", &wheels.triangles(1.0)),
        numbers.mesh("wheel_right", &wheels.triangles(-1.0)),
    ];
    let hubs = wheels.hubs();
    let wheel = hubs.map(|(name, hub)| {
        let mesh = if hub.y > 0.0 { 1 } else { 2 };
        json!({"mesh": mesh, "name": name, "translation": axes(&hub.coords)})
    });
    let mut nodes = vec![
        json!({"name": vehicle.name, "children": (1..=1 + hubs.len()).collect::<Vec<_>>()}),
        json!({"mesh": 0, "name": "body"}),
    ];
    nodes.extend(wheel);
    let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&numbers.bytes));
    json!({
        "asset": {"version": "2.0", "generator": "roadplane"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [
            material("paint", vehicle.colour, 0.3, 0.5),
            material("glass", [24, 28, 34], 0.0, 0.1),
            material("rubber", [22, 22, 22], 0.0, 0.9),
            material("rim", [168, 168, 172], 0.8, 0.4),
        ],
        "buffers": [{"byteLength": numbers.bytes.len(), "uri": uri}],
        "bufferViews": numbers.views,
        "accessors": numbers.accessors,
    })
}

/// The binary buffer of a glTF document, with its views and accessors.
#[derive(Default)]
struct Numbers {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Numbers {
    /// Adds the corners and normals of a mesh to the buffer. Returns the mesh as JSON, with one primitive per material.
    fn mesh(&mut self, name: &str, triangles: &[Triangle]) -> Value {
        let mut primitives = Vec::new();
        for (material, part) in PARTS.iter().enumerate() {
            let (mut corners, mut normals) = (Vec::new(), Vec::new());
            for (_, [a, b, c]) in triangles.iter().filter(|(of, _)| of == part) {
                let normal = (b - a).cross(&(c - a)).try_normalize(1e-12).unwrap_or_else(Vector3::z);
                corners.extend([a, b, c].map(|p: &Point3<f64>| axes(&p.coords)));
                normals.extend([axes(&normal); 3]);
            }
            if corners.is_empty() {
                continue;
            }
            let (position, normal) = (self.vectors(&corners), self.vectors(&normals));
            primitives.push(
                json!({"attributes": {"POSITION": position, "NORMAL": normal}, "material": material, "mode": 4}),
            );
        }
        json!({"name": name, "primitives": primitives})
    }

    /// Adds vectors to the buffer, and returns the index of the accessor for these vectors.
    fn vectors(&mut self, vectors: &[[f32; 3]]) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(vectors.iter().flatten().flat_map(|v| v.to_le_bytes()));
        let length = self.bytes.len() - start;
        self.views
            .push(json!({"buffer": 0, "byteOffset": start, "byteLength": length, "target": ARRAY_BUFFER}));
        let ends = |pick: fn(f32, f32) -> f32, from: f32| -> Vec<f32> {
            (0..3).map(|i| vectors.iter().map(|v| v[i]).fold(from, pick)).collect()
        };
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": FLOAT, "count": vectors.len(), "type": "VEC3",
            "min": ends(f32::min, f32::INFINITY), "max": ends(f32::max, f32::NEG_INFINITY),
        }));
        self.accessors.len() - 1
    }
}

/// Converts a vector from the car frame to glTF's axes.
fn axes(v: &Vector3<f64>) -> [f32; 3] {
    [v.y as f32, v.z as f32, v.x as f32]
}

/// Returns a glTF material. The colour is converted from sRGB to the linear colours of glTF.
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
