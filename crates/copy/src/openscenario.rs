//! The vehicles and their trajectories as ASAM OpenSCENARIO XML 1.2.
//!
//! In OpenSCENARIO, the position of a vehicle is the point on the ground below the middle of its rear axle. If a
//! vehicle is present for only a part of the scene, actions add and delete it.

use roadplane_base::{GroundPose, VehicleClass};
use roadplane_export::{Element, fixed};

use crate::thin::ahead_of;
use crate::wheels::TYRE_M;
use crate::{Scene, Vehicle};

/// Smallest top speed in the file, m/s. The format requires a top speed for each vehicle.
const LEAST_TOP_SPEED_MPS: f64 = 70.0;
/// Largest difference between two times that count as equal, s.
const AT_ONCE_S: f64 = 1e-6;

/// Returns the OpenSCENARIO document of a scene.
pub fn document(scene: &Scene) -> Element {
    let header = Element::new("FileHeader")
        .with("revMajor", 1)
        .with("revMinor", 2)
        // The date is fixed. So the same run always gives the same bytes.
        .with("date", "1970-01-01T00:00:00")
        .with("description", format!("{}: vehicles as a camera saw them", scene.name))
        .with("author", "roadplane");
    let road = Element::new("LogicFile").with("filepath", "road.xodr");
    let from_start = scene.vehicles.iter().filter(|vehicle| !appears(vehicle));
    let init = from_start.filter_map(|vehicle| {
        let first = position(vehicle, &vehicle.trajectory.first()?.pose);
        let teleport = Element::new("TeleportAction").holding([first]);
        Some(entity("Private", vehicle).holding([Element::new("PrivateAction").holding([teleport])]))
    });
    let acting = scene.vehicles.iter().filter(|vehicle| !events(scene, vehicle).is_empty());
    let groups: Vec<Element> = acting.map(|vehicle| group(scene, vehicle)).collect();
    let actions = Element::new("Init").holding([Element::new("Actions").holding(init)]);
    let mut storyboard = Element::new("Storyboard").holding([actions]);
    if !groups.is_empty() {
        let act = Element::new("Act").with("name", "drive").holding(groups).holding([start("start", 0.0)]);
        storyboard = storyboard.holding([Element::new("Story").with("name", &scene.name).holding([act])]);
    }
    let end = Element::new("StopTrigger").holding([condition("end", scene.seconds())]);
    Element::new("OpenSCENARIO").holding([
        header,
        Element::new("CatalogLocations"),
        Element::new("RoadNetwork").holding([road]),
        Element::new("Entities").holding(scene.vehicles.iter().map(object)),
        storyboard.holding([end]),
    ])
}

fn appears(vehicle: &Vehicle) -> bool {
    vehicle.span_s[0] > AT_ONCE_S
}

fn entity(name: &'static str, vehicle: &Vehicle) -> Element {
    Element::new(name).with("entityRef", &vehicle.name)
}

fn metres(value: f64) -> String {
    fixed(value, 4)
}

/// Returns the position of a vehicle: the point on the ground below the middle of its rear axle.
fn position(vehicle: &Vehicle, pose: &GroundPose) -> Element {
    let rear = ahead_of(pose, -vehicle.wheels.half_wheelbase_m);
    let rear_axle = Element::new("WorldPosition")
        .with("x", metres(rear.x))
        .with("y", metres(rear.y))
        .with("z", 0)
        .with("h", fixed(pose.heading_rad, 5))
        .with("p", 0)
        .with("r", 0);
    Element::new("Position").holding([rear_axle])
}

fn object(vehicle: &Vehicle) -> Element {
    let [length, width, height] = vehicle.dims_m.map(metres);
    let wheelbase = 2.0 * vehicle.wheels.half_wheelbase_m;
    let category = match vehicle.class {
        VehicleClass::Car => "car",
        VehicleClass::Truck => "truck",
        VehicleClass::Bus => "bus",
        VehicleClass::Motorcycle => "motorbike",
    };
    let centre = Element::new("Center")
        .with("x", metres(vehicle.centre_m + vehicle.wheels.half_wheelbase_m))
        .with("y", 0)
        .with("z", metres(vehicle.dims_m[2] / 2.0));
    let size = Element::new("Dimensions").with("width", width).with("length", length).with("height", height);
    let axle = |name, steering: &str, x: f64| {
        Element::new(name)
            .with("maxSteering", steering)
            .with("wheelDiameter", metres(vehicle.wheels.diameter_m))
            .with("trackWidth", metres(vehicle.wheels.track_m - TYRE_M))
            .with("positionX", metres(x))
            .with("positionZ", metres(vehicle.wheels.diameter_m / 2.0))
    };
    let property =
        |name: &str, value: String| Element::new("Property").with("name", name).with("value", value);
    let invented = vehicle.invented_s.iter().map(|[from, to]| format!("{from:.2}-{to:.2}"));
    let mut properties = vec![property("track", vehicle.track.to_string())];
    if !vehicle.invented_s.is_empty() {
        properties.push(property("invented_s", invented.collect::<Vec<_>>().join(" ")));
    }
    let body = Element::new("Vehicle")
        .with("name", &vehicle.name)
        .with("vehicleCategory", category)
        .with("model3d", format!("meshes/{}.gltf", vehicle.name))
        .holding([
            Element::new("BoundingBox").holding([centre, size]),
            Element::new("Performance")
                .with("maxSpeed", fixed(vehicle.fastest_mps.max(LEAST_TOP_SPEED_MPS), 1))
                .with("maxAcceleration", 10)
                .with("maxDeceleration", 10),
            Element::new("Axles").holding([axle("FrontAxle", "0.6", wheelbase), axle("RearAxle", "0", 0.0)]),
            Element::new("Properties").holding(properties),
        ]);
    Element::new("ScenarioObject").with("name", &vehicle.name).holding([body])
}

fn group(scene: &Scene, vehicle: &Vehicle) -> Element {
    let actors = Element::new("Actors")
        .with("selectTriggeringEntities", false)
        .holding([entity("EntityRef", vehicle)]);
    let manoeuvre = Element::new("Maneuver")
        .with("name", format!("{}_way", vehicle.name))
        .holding(events(scene, vehicle));
    Element::new("ManeuverGroup")
        .with("name", format!("{}_group", vehicle.name))
        .with("maximumExecutionCount", 1)
        .holding([actors, manoeuvre])
}

/// Returns the events of a vehicle, up to three: the vehicle appears, drives and vanishes.
fn events(scene: &Scene, vehicle: &Vehicle) -> Vec<Element> {
    let [from, to] = vehicle.span_s;
    let mut events = Vec::new();
    let on_entity = |action: Element| {
        Element::new("GlobalAction").holding([entity("EntityAction", vehicle).holding([action])])
    };
    if let Some(first) = vehicle.trajectory.first().filter(|_| appears(vehicle)) {
        let add = Element::new("AddEntityAction").holding([position(vehicle, &first.pose)]);
        events.push(event(vehicle, "appears", from, on_entity(add)));
    }
    if !vehicle.is_stationary() {
        events.push(event(vehicle, "drives", from, follow(vehicle)));
    }
    if to < scene.seconds() - AT_ONCE_S {
        events.push(event(vehicle, "vanishes", to, on_entity(Element::new("DeleteEntityAction"))));
    }
    events
}

fn event(vehicle: &Vehicle, what: &str, at_s: f64, action: Element) -> Element {
    let name = format!("{}_{what}", vehicle.name);
    Element::new("Event")
        .with("name", &name)
        .with("priority", "parallel")
        .with("maximumExecutionCount", 1)
        .holding([
            Element::new("Action").with("name", format!("{name}_action")).holding([action]),
            start(&name, at_s),
        ])
}

fn follow(vehicle: &Vehicle) -> Element {
    let vertices = vehicle.trajectory.iter().map(|vertex| {
        Element::new("Vertex")
            .with("time", fixed(vertex.time_s, 5))
            .holding([position(vehicle, &vertex.pose)])
    });
    let trajectory = Element::new("Trajectory")
        .with("name", format!("{}_trajectory", vehicle.name))
        .with("closed", false)
        .holding([Element::new("Shape").holding([Element::new("Polyline").holding(vertices)])]);
    let timing =
        Element::new("Timing").with("domainAbsoluteRelative", "absolute").with("scale", 1).with("offset", 0);
    let action = Element::new("FollowTrajectoryAction").holding([
        Element::new("TimeReference").holding([timing]),
        Element::new("TrajectoryFollowingMode").with("followingMode", "position"),
        Element::new("TrajectoryRef").holding([trajectory]),
    ]);
    Element::new("PrivateAction").holding([Element::new("RoutingAction").holding([action])])
}

fn start(name: &str, at_s: f64) -> Element {
    Element::new("StartTrigger").holding([condition(&format!("{name}_when"), at_s)])
}

/// Returns a condition that is true from the simulation time `at_s` (s) onwards.
fn condition(name: &str, at_s: f64) -> Element {
    let time =
        Element::new("SimulationTimeCondition").with("value", fixed(at_s, 5)).with("rule", "greaterOrEqual");
    let condition = Element::new("Condition")
        .with("name", name)
        .with("delay", 0)
        .with("conditionEdge", "none")
        .holding([Element::new("ByValueCondition").holding([time])]);
    Element::new("ConditionGroup").holding([condition])
}
