//! The ground as ASAM OpenDRIVE 1.7: one flat, straight road with two lanes. The road is so large that all vehicles are
//! on it.
//!
//! The real lanes of the scene are unknown. The surface of the road is the ground plane.

use roadplane_export::{Element, fixed};

use crate::Scene;

/// Margin of the ground around the vehicles, m.
const MARGIN_M: f64 = 25.0;

/// Returns the OpenDRIVE document of a scene.
pub fn document(scene: &Scene) -> Element {
    let poses = || scene.vehicles.iter().flat_map(|vehicle| &vehicle.trajectory).map(|vertex| vertex.pose);
    let range = |values: Vec<f64>| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        [low - MARGIN_M, high + MARGIN_M]
    };
    let (x, y) = (range(poses().map(|p| p.x_m).collect()), range(poses().map(|p| p.y_m).collect()));
    let (wide, long) = (x[1] - x[0], y[1] - y[0]);
    // The road runs along the longer side of the area.
    let (start, heading, length, lane) = if wide > long {
        ([x[0], f64::midpoint(y[0], y[1])], 0.0, wide, long / 2.0)
    } else {
        ([f64::midpoint(x[0], x[1]), y[0]], std::f64::consts::FRAC_PI_2, long, wide / 2.0)
    };
    let metres = |value: f64| fixed(value, 4);
    let header = Element::new("header")
        .with("revMajor", 1)
        .with("revMinor", 7)
        .with("name", &scene.name)
        .with("version", "1.00")
        .with("north", metres(y[1]))
        .with("south", metres(y[0]))
        .with("east", metres(x[1]))
        .with("west", metres(x[0]))
        .with("vendor", "roadplane");
    let line = Element::new("geometry")
        .with("s", 0)
        .with("x", metres(start[0]))
        .with("y", metres(start[1]))
        .with("hdg", fixed(heading, 15))
        .with("length", metres(length))
        .holding([Element::new("line")]);
    let flat = polynomial("elevation", "s", 0.0);
    let section = Element::new("laneSection").with("s", 0).holding([
        Element::new("left").holding([driving(1, lane)]),
        Element::new("center")
            .holding([Element::new("lane").with("id", 0).with("type", "none").with("level", false)]),
        Element::new("right").holding([driving(-1, lane)]),
    ]);
    let road = Element::new("road")
        .with("name", "ground")
        .with("length", metres(length))
        .with("id", 1)
        .with("junction", -1)
        .with("rule", "RHT")
        .holding([
            Element::new("planView").holding([line]),
            Element::new("elevationProfile").holding([flat]),
            Element::new("lanes").holding([section]),
        ]);
    Element::new("OpenDRIVE").holding([header, road])
}

fn driving(id: i32, width: f64) -> Element {
    let lane = Element::new("lane").with("id", id).with("type", "driving").with("level", false);
    lane.holding([polynomial("width", "sOffset", width)])
}

/// Returns a constant value as a cubic polynomial, because the format requires polynomials. `from` is the name of the
/// attribute for the start of the polynomial.
fn polynomial(name: &'static str, from: &'static str, value: f64) -> Element {
    Element::new(name).with(from, 0).with("a", fixed(value, 4)).with("b", 0).with("c", 0).with("d", 0)
}
