//! Tests that the schemas in `docs/schemas` equal those of the code, and that they describe every field.

#![allow(missing_docs, clippy::unwrap_used)]

use std::path::Path;

use roadplane_pipeline::schemas;
use serde_json::Value;

/// Reads a schema from `docs/schemas`.
fn committed(name: &str) -> Value {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/schemas");
    let text = std::fs::read(folder.join(format!("{name}.schema.json"))).unwrap();
    serde_json::from_slice(&text).unwrap()
}

#[test]
fn the_committed_schemas_are_those_of_the_code() {
    for (name, schema) in schemas() {
        assert!(committed(name) == schema, "{name} changed: run `roadplane schemas --out docs/schemas`");
    }
}

/// Whether the description of a field is a full sentence without Rust documentation links, which a reader of JSON
/// cannot follow.
fn is_sentence(field: &Value) -> bool {
    let text = field["description"].as_str().unwrap_or_default();
    text.ends_with('.') && text.contains(' ') && !text.contains("[`")
}

/// Collects in `found` the names of all fields of a schema that lack a proper description.
fn undescribed(schema: &Value, found: &mut Vec<String>) {
    match schema {
        Value::Object(object) => {
            if let Some(Value::Object(fields)) = object.get("properties") {
                let bad = fields.iter().filter(|(_, field)| !is_sentence(field));
                found.extend(bad.map(|(name, _)| name.clone()));
            }
            object.values().for_each(|inner| undescribed(inner, found));
        }
        Value::Array(items) => items.iter().for_each(|inner| undescribed(inner, found)),
        _ => {}
    }
}

#[test]
fn every_field_has_a_description() {
    for (name, schema) in schemas() {
        assert!(schema["title"].as_str().unwrap().starts_with(&format!("{name}: ")), "{name}");
        let mut found = Vec::new();
        undescribed(&schema, &mut found);
        assert!(found.is_empty(), "{name}: {found:?}");
    }
}

#[test]
fn the_columns_of_tracks_are_in_the_schema() {
    let (_, schema) = schemas().into_iter().find(|(name, _)| *name == "tracks").unwrap();
    let header = include_str!("../../write/tests/golden/tracks.csv").lines().next().unwrap();
    for column in header.split(',').filter(|column| !column.starts_with("bbox_")) {
        assert!(schema["properties"][column]["description"].is_string(), "{column}");
    }
}
