//! All figures of one camera.

use crate::Direction;
use crate::clock::Clock;
use crate::flows::Journeys;
use crate::gate_figures::gate_figures;
use crate::records::{CountRow, CrossingRow, FlowRow, HeadwayRow, HistogramRow, SpeedRow, ZoneRow};
use crate::site::Site;
use crate::zone_figures::zone_figures;

/// The tables of one camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// Numbers of vehicles by gate.
    pub counts: Vec<CountRow>,
    /// Speeds by gate.
    pub speeds: Vec<SpeedRow>,
    /// Histograms of speeds by gate.
    pub speed_histogram: Vec<HistogramRow>,
    /// Headways by gate.
    pub headways: Vec<HeadwayRow>,
    /// Vehicles by first and last gate.
    pub flows: Vec<FlowRow>,
    /// Figures by zone.
    pub zones: Vec<ZoneRow>,
    /// Every crossing of a gate.
    pub crossings: Vec<CrossingRow>,
}

impl Figures {
    /// Computes all tables of a camera. Rows are sorted by place, direction, period and class, crossings by time.
    #[must_use]
    pub fn of(site: &Site, clock: &Clock) -> Self {
        let periods = site.periods(clock);
        let mut figures = Self::default();
        let mut journeys = Journeys::default();
        for gate in 0..site.clips.first().map_or(0, |clip| clip.gates.len()) {
            for direction in Direction::ALL {
                let passages = site.passages(gate, direction, &periods);
                journeys.add(gate, direction, &passages);
                figures.add_gate(gate_figures(site, gate, direction, &passages, &periods, clock));
            }
        }
        figures.crossings.sort_by(|a, b| {
            a.clip.cmp(&b.clip).then(a.time_s.total_cmp(&b.time_s)).then(a.track.cmp(&b.track))
        });
        figures.flows = journeys.flows(site, &periods);
        for zone in 0..site.clips.first().map_or(0, |clip| clip.zones.len()) {
            figures.zones.extend(zone_figures(site, zone, &periods));
        }
        figures
    }

    /// Adds the tables of another camera.
    pub fn extend(&mut self, other: Self) {
        self.flows.extend(other.flows);
        self.zones.extend(other.zones);
        self.crossings.extend(other.crossings);
        self.counts.extend(other.counts);
        self.speeds.extend(other.speeds);
        self.speed_histogram.extend(other.speed_histogram);
        self.headways.extend(other.headways);
    }

    fn add_gate(&mut self, gate: crate::gate_figures::GateFigures) {
        self.counts.extend(gate.counts);
        self.speeds.extend(gate.speeds);
        self.speed_histogram.extend(gate.speed_histogram);
        self.headways.extend(gate.headways);
        self.crossings.extend(gate.crossings);
    }
}
