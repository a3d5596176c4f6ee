//! Files explain themselves: the schemas in `docs/schemas` are those of the code, and every field says what it is.

#![allow(missing_docs, clippy::unwrap_used)]

use std::path::Path;

use roadplane_pipeline::schemas;
use serde_json::Value;

fn committed(name: &str) -> Value {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/schemas");
    let text = std::fs::read(folder.join(format!("{name}.schema.json"))).unwrap();
    serde_json::from_slice(&text).unwrap()
}

#[test]
fn the_schemas_kept_are_those_of_the_code() {
    for (name, schema) in schemas() {
        assert!(committed(name) == schema, "{name} changed: run `roadplane schemas --out docs/schemas`");
    }
}

/// Names of the fields without a description, anywhere below.
fn undescribed(schema: &Value, found: &mut Vec<String>) {
    match schema {
        Value::Object(object) => {
            if let Some(Value::Object(fields)) = object.get("properties") {
                let silent = fields.iter().filter(|(_, field)| field.get("description").is_none());
                found.extend(silent.map(|(name, _)| name.clone()));
            }
            object.values().for_each(|below| undescribed(below, found));
        }
        Value::Array(items) => items.iter().for_each(|below| undescribed(below, found)),
        _ => {}
    }
}

#[test]
fn every_field_says_what_it_is() {
    for (name, schema) in schemas() {
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
