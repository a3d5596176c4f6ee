//! Finds conflicts: reads tracks (CSV, standard input) and writes conflicts (CSV, standard output).
//!
//!   cargo run --release -p roadplane-traffic --example conflicts -- [NAME=VALUE ...] < tracks.csv > conflicts.csv
//!   cargo run --release -p roadplane-traffic --example conflicts -- --day VEHICLES
//!
//! The input has the columns `time_s`, `track`, `x_m`, `y_m`, `heading_rad`, `speed_mps`, `length_m`, `width_m`, sorted
//! by time. The names and values are those of `ConflictLimits`. `--day` measures the time for a simulated day at a
//! crossroads instead.

use std::{collections::BTreeMap, f64::consts::FRAC_PI_2, io::Read as _, time::Instant};

use roadplane_base::VehicleClass;
use roadplane_traffic::{Clip, ConflictLimits, State, Vehicle, conflicts};
use serde_json::Value;

fn main() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, count] = arguments.as_slice()
        && flag == "--day"
    {
        return day(count.parse().map_err(|error| format!("{count}: {error}"))?);
    }
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text).map_err(|error| error.to_string())?;
    let rows = conflicts(&read(&text)?, &limits(&arguments)?);
    for (number, row) in rows.iter().enumerate() {
        let Value::Object(fields) = serde_json::to_value(row).map_err(|error| error.to_string())? else {
            continue;
        };
        if number == 0 {
            println!("{}", fields.keys().cloned().collect::<Vec<_>>().join(","));
        }
        let cell = |value: &Value| match value {
            Value::Null => String::new(),
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        println!("{}", fields.values().map(cell).collect::<Vec<_>>().join(","));
    }
    Ok(())
}

fn limits(arguments: &[String]) -> Result<ConflictLimits, String> {
    let mut fields = serde_json::Map::new();
    for argument in arguments {
        let (name, value) =
            argument.split_once('=').ok_or_else(|| format!("{argument} is not NAME=VALUE"))?;
        let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.into()));
        fields.insert(name.into(), value);
    }
    serde_json::from_value(fields.into()).map_err(|error| error.to_string())
}

fn read(text: &str) -> Result<Clip, String> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let wanted = ["time_s", "track", "x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m"];
    let mut columns = [0; 8];
    for (column, name) in columns.iter_mut().zip(wanted) {
        *column =
            names.iter().position(|n| *n == name).ok_or_else(|| format!("there is no column {name}"))?;
    }
    let mut vehicles: BTreeMap<u64, Vehicle> = BTreeMap::new();
    for (number, line) in lines.enumerate() {
        let fields: Vec<&str> = line.split(',').collect();
        let mut values = [0.0; 8];
        for (value, column) in values.iter_mut().zip(columns) {
            let field = fields.get(column).copied().unwrap_or_default();
            *value = field.parse().map_err(|error| format!("line {}: {field}: {error}", number + 2))?;
        }
        let [time_s, track, x_m, y_m, heading_rad, speed_mps, length_m, width_m] = values;
        let vehicle = vehicles.entry(track as u64).or_insert_with(|| empty(track as u64, length_m, width_m));
        let (heading_rad, speed_mps) = (heading_rad as f32, speed_mps as f32);
        vehicle.states.push(State { time_s, x_m, y_m, heading_rad, speed_mps, ..State::default() });
    }
    Ok(clip(vehicles.into_values().collect(), None))
}

fn empty(track: u64, length_m: f64, width_m: f64) -> Vehicle {
    Vehicle {
        track,
        class: VehicleClass::Car,
        length_m,
        length_sd_m: 0.0,
        width_m,
        exists_p: 1.0,
        states: Vec::new(),
    }
}

fn clip(vehicles: Vec<Vehicle>, scale_sd: Option<f64>) -> Clip {
    Clip {
        name: String::new(),
        start_s: None,
        span_s: [0.0, 86400.0],
        not_followed_s: Vec::new(),
        scale_sd,
        vehicles,
    }
}

/// Measures the time for a day: vehicles on four approaches go straight across, in two lanes per direction, at 10 Hz.
/// Most come by day: their times have three quarters of the vehicles in a third of the day.
fn day(count: u64) -> Result<(), String> {
    let vehicle = |track: u64| {
        let share = (track as f64 + 0.5) / count as f64;
        let start_s = 86400.0 * if share < 0.75 { 0.3 + share / 0.75 / 3.0 } else { (share - 0.75) * 1.2 };
        // A multiplicative hash spreads approaches, lanes and speeds.
        let hash = track.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        let (sin, cos) = (FRAC_PI_2 * (hash % 4) as f64).sin_cos();
        let (lane_m, speed_mps) = (1.75 + 3.5 * (hash / 4 % 2) as f64, 8.0 + (hash / 8 % 64) as f64 / 8.0);
        let mut vehicle = empty(track, 4.5, 1.8);
        vehicle.states = (0..(1600.0 / speed_mps) as u32)
            .map(|i| {
                let along_m = f64::from(i) / 10.0 * speed_mps - 80.0;
                State {
                    time_s: start_s + f64::from(i) / 10.0,
                    x_m: along_m * cos + lane_m * sin,
                    y_m: along_m * sin - lane_m * cos,
                    heading_rad: f64::atan2(sin, cos) as f32,
                    speed_mps: speed_mps as f32,
                    own_sd_m: [0.2; 2],
                    own_speed_sd_mps: 0.2,
                    scale_sd: 0.0,
                }
            })
            .collect();
        vehicle
    };
    let day = clip((0..count).map(vehicle).collect(), Some(0.05));
    let states: usize = day.vehicles.iter().map(|vehicle| vehicle.states.len()).sum();
    let start = Instant::now();
    let found = conflicts(&day, &ConflictLimits::default());
    println!(
        "{count} vehicles, {states} states, {} conflicts, {:.1} s",
        found.len(),
        start.elapsed().as_secs_f64()
    );
    Ok(())
}
