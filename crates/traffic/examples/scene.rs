//! Finds the layout of a scene: reads tracks (CSV) and writes JSON.
//!
//!   cargo run --release -p roadplane-traffic --example scene -- TRACKS.csv ...
//!
//! Each file is one clip of the same camera, with the columns of `tracks.csv`. Files after `--next` are another scene.
//! The output has one line per scene.

use std::{collections::BTreeMap, fs};

use roadplane_base::VehicleClass;
use roadplane_traffic::{Clip, Scene, State, Vehicle, find_scene};
use serde_json::{Value, json};

fn main() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    for files in arguments.split(|argument| argument == "--next").filter(|files| !files.is_empty()) {
        let clips = files.iter().map(|file| read(file)).collect::<Result<Vec<_>, _>>()?;
        let start = std::time::Instant::now();
        let scene = find_scene(&clips.iter().collect::<Vec<_>>(), None);
        println!("{}", record(&scene, start.elapsed().as_secs_f64()));
    }
    Ok(())
}

fn read(file: &str) -> Result<Clip, String> {
    let text = fs::read_to_string(file).map_err(|error| format!("{file}: {error}"))?;
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let column =
        |name: &str| names.iter().position(|n| *n == name).ok_or_else(|| format!("{file}: no column {name}"));
    let numbers = [
        "time_s",
        "x_m",
        "y_m",
        "heading_rad",
        "speed_mps",
        "x_own_sd_m",
        "y_own_sd_m",
        "length_m",
        "width_m",
        "track",
    ]
    .into_iter()
    .map(column)
    .collect::<Result<Vec<_>, _>>()?;
    let class = column("class")?;
    let mut vehicles: BTreeMap<u64, Vehicle> = BTreeMap::new();
    for (number, line) in lines.enumerate() {
        let fields: Vec<&str> = line.split(',').collect();
        let value = |i: usize| {
            let text = fields.get(numbers[i]).copied().unwrap_or_default();
            text.parse::<f64>().map_err(|error| format!("{file}: line {}: {text}: {error}", number + 2))
        };
        let vehicle = vehicles.entry(value(9)? as u64).or_insert(Vehicle {
            track: value(9)? as u64,
            class: match fields.get(class).copied().unwrap_or_default() {
                "truck" => VehicleClass::Truck,
                "bus" => VehicleClass::Bus,
                "motorcycle" => VehicleClass::Motorcycle,
                _ => VehicleClass::Car,
            },
            length_m: value(7)?,
            width_m: value(8)?,
            length_sd_m: 0.0,
            exists_p: 1.0,
            states: Vec::new(),
        });
        vehicle.states.push(State {
            scale_sd: 0.0,
            time_s: value(0)?,
            x_m: value(1)?,
            y_m: value(2)?,
            heading_rad: value(3)? as f32,
            speed_mps: value(4)? as f32,
            own_sd_m: [value(5)? as f32, value(6)? as f32],
            own_speed_sd_mps: 0.0,
        });
    }
    let vehicles: Vec<Vehicle> = vehicles.into_values().collect();
    let spans = vehicles.iter().map(Vehicle::span_s);
    let span_s = spans.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], [c, d]| [a.min(c), b.max(d)]);
    Ok(Clip {
        name: file.to_owned(),
        start_s: None,
        span_s,
        not_followed_s: Vec::new(),
        scale_sd: None,
        vehicles,
    })
}

fn record(scene: &Scene, seconds: f64) -> Value {
    let point = |v: &nalgebra::Vector2<f64>| json!([v.x, v.y]);
    let arms = scene.arms.iter().map(|arm| {
        json!({"name": arm.gate.name, "line": arm.gate.line.iter().map(point).collect::<Vec<_>>(),
               "outward": point(&arm.outward), "entered": arm.entered, "left": arm.left})
    });
    let lanes = scene.lanes.iter().map(|lane| {
        json!({"middle": lane.middle.iter().map(point).collect::<Vec<_>>(), "middle_sd_m": lane.middle_sd_m,
               "width_m": lane.width_m, "from": lane.from, "to": lane.to,
               "stays": lane.stays.iter().map(|s| json!([s.clip, s.track, s.span_s[0], s.span_s[1]])).collect::<Vec<_>>()})
    });
    let stop_lines = scene.stop_lines.iter().map(|line| {
        json!({"lane": line.lane, "place": point(&line.place), "forward": point(&line.forward), "sd_m": line.sd_m,
               "spread_m": line.spread_m, "queues": line.queues})
    });
    let flows = scene.flows.iter().map(|flow| json!([flow.from, flow.to, flow.vehicles]));
    json!({"arms": arms.collect::<Vec<_>>(), "lanes": lanes.collect::<Vec<_>>(),
           "stop_lines": stop_lines.collect::<Vec<_>>(), "flows": flows.collect::<Vec<_>>(), "seconds": seconds})
}
