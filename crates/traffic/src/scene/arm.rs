//! An arm of the scene: a road on which vehicles come into view and leave it.

use nalgebra::Vector2;

use crate::Gate;

/// A road on which vehicles come into view, leave it, or both.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// Line across the road, a few metres inside of the places where vehicles come into view. As seen from its first
    /// point towards its last point, vehicles that come into the scene cross from left to right (`Forward`).
    pub gate: Gate,
    /// Unit vector along the road, out of the scene.
    pub outward: Vector2<f64>,
    /// Number of vehicles that cross the gate into the scene.
    pub entered: usize,
    /// Number of vehicles that cross the gate out of the scene.
    pub left: usize,
}

/// Vehicles that come into the scene by one arm and leave it by another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flow {
    /// Index of the arm by which they come.
    pub from: usize,
    /// Index of the arm by which they leave. It is `from` for a U-turn.
    pub to: usize,
    /// Number of vehicles.
    pub vehicles: usize,
}
