//! The flow matrix: vehicles by the first and the last gate that they cross.

use std::collections::BTreeMap;

use roadplane_base::VehicleClass;

use crate::Direction;
use crate::passages::Passage;
use crate::records::FlowRow;
use crate::site::{Period, Site};

/// A passage of a vehicle, as the flow matrix needs it.
#[derive(Clone, Copy)]
struct Step {
    at_s: f64,
    gate: usize,
    direction: Direction,
    period: usize,
}

/// The passages of each vehicle over all gates.
#[derive(Default)]
pub(crate) struct Journeys<'a> {
    /// By the name of the clip and the number of the track.
    steps: BTreeMap<(&'a str, u64), (VehicleClass, Vec<Step>)>,
}

impl<'a> Journeys<'a> {
    /// Adds the passages over a gate.
    pub(crate) fn add(&mut self, gate: usize, direction: Direction, passages: &[Passage<'a>]) {
        for p in passages.iter().filter(|p| p.counts()) {
            let track = p.clip.clip.vehicles[p.crossing.vehicle].track;
            let steps =
                self.steps.entry((&p.clip.clip.name, track)).or_insert_with(|| (p.class(), Vec::new()));
            steps.1.push(Step { at_s: p.at_s, gate, direction, period: p.period });
        }
    }

    /// Returns the number of vehicles for each pair of a first and a last gate.
    pub(crate) fn flows(&self, site: &Site, periods: &[Period]) -> Vec<FlowRow> {
        let mut numbers: BTreeMap<_, u64> = BTreeMap::new();
        for (class, steps) in self.steps.values() {
            let first = steps.iter().min_by(|a, b| a.at_s.total_cmp(&b.at_s));
            let last = steps.iter().max_by(|a, b| a.at_s.total_cmp(&b.at_s));
            let Some((first, last)) = first.zip(last) else { continue };
            for class in [None, Some(*class)] {
                let pair = (first.gate, first.direction, last.gate, last.direction);
                *numbers.entry((pair, class, first.period)).or_default() += 1;
            }
        }
        let name = |gate: usize| site.clips[0].gates[gate].name.as_str();
        let mut rows = Vec::new();
        for (((from, direction, to, to_direction), class, period), vehicles) in numbers {
            rows.push(FlowRow {
                group: site.group(name(from), direction.name(), class, &periods[period]),
                to_place: name(to).to_owned(),
                to_direction: to_direction.name().to_owned(),
                vehicles,
            });
        }
        rows
    }
}
