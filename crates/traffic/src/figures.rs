//! All figures of one camera.

use crate::clock::Clock;
use crate::conflicts::{ConflictLimits, conflicts, sound};
use crate::flows::Journeys;
use crate::gate_figures::gate_figures;
use crate::lanes::lane_rows;
use crate::records::{ConflictRow, Figures};
use crate::site::Site;
use crate::zone_figures::zone_figures;
use crate::{Conflict, Direction, SiteClip};

impl Figures {
    /// Computes all tables of a camera. Rows are sorted by place, direction, period and class, crossings by time.
    #[must_use]
    pub fn of(site: &Site, clock: &Clock) -> Self {
        let periods = site.periods(clock);
        let mut figures = Self::default();
        let mut journeys = Journeys::default();
        for gate in 0..site.clips.first().map_or(0, |clip| clip.gates.len()) {
            for (direction, passages) in Direction::ALL.into_iter().zip(site.passages(gate, &periods)) {
                journeys.add(gate, direction, &passages);
                figures.extend(gate_figures(site, gate, direction, &passages, &periods, clock));
                figures.lanes.extend(lane_rows(site, gate, direction, &passages, &periods));
            }
        }
        figures.crossings.sort_by(|a, b| {
            a.clip.cmp(&b.clip).then(a.time_s.total_cmp(&b.time_s)).then(a.track.cmp(&b.track))
        });
        figures.flows = journeys.flows(site, &periods);
        for zone in 0..site.clips.first().map_or(0, |clip| clip.zones.len()) {
            figures.extend(zone_figures(site, zone, &periods, clock));
        }
        for SiteClip { clip, .. } in &site.clips {
            let row = |conflict: Conflict| ConflictRow {
                camera: site.name.clone(),
                clip: clip.name.clone(),
                moment: clip.start_s.map(|start| clock.label(start + conflict.at_s)),
                conflict,
            };
            let limits = ConflictLimits::default();
            let all = conflicts(clip, &limits);
            let count = all.len();
            let sound = sound(all, &limits);
            figures.doubtful_conflicts += (count - sound.len()) as u64;
            figures.conflicts.extend(sound.into_iter().map(row));
        }
        figures
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Clip, Gate, State, Vehicle, Zone};
    use nalgebra::Vector2;
    use roadplane_base::VehicleClass;

    /// A vehicle that drives along x at 10 m/s from −50 m to 50 m, starting at the given time.
    fn vehicle(track: u64, class: VehicleClass, start_s: f64) -> Vehicle {
        let state = |i: i32| State {
            time_s: start_s + f64::from(i) / 10.0,
            x_m: f64::from(i) - 50.0,
            speed_mps: 10.0,
            scale_sd: 0.02,
            ..State::default()
        };
        Vehicle { track, class, ..Vehicle::car((0..=100).map(state).collect()) }
    }

    fn clip(name: &str, start_s: f64, vehicles: Vec<Vehicle>) -> SiteClip {
        let gate = |name: &str, x: f64| Gate {
            name: name.to_owned(),
            line: vec![Vector2::new(x, 5.0), Vector2::new(x, -5.0)],
            shared_sd_m: 0.0,
        };
        let zone = [[0.0, -5.0], [20.0, -5.0], [20.0, 5.0], [0.0, 5.0]].map(Vector2::from).to_vec();
        SiteClip {
            clip: Clip {
                name: name.to_owned(),
                start_s: Some(start_s),
                span_s: [0.0, 60.0],
                not_followed_s: vec![[40.0, 50.0]],
                scale_sd: Some(0.02),
                vehicles,
            },
            gates: vec![gate("a", -20.0), gate("b", 20.0)],
            zones: vec![Zone { name: "z".to_owned(), outline: zone }],
        }
    }

    /// Two clips of a minute with a gap of a minute between them.
    fn site() -> Site {
        let (car, bus) = (VehicleClass::Car, VehicleClass::Bus);
        let first = vec![vehicle(1, car, 0.0), vehicle(2, bus, 3.0), vehicle(3, car, 49.0)];
        Site {
            name: "cam".to_owned(),
            clips: vec![clip("one", 0.0, first), clip("two", 120.0, vec![vehicle(1, car, 10.0)])],
            lanes: Vec::new(),
        }
    }

    #[test]
    fn vehicles_that_overlap_are_counted_but_are_no_conflict() {
        // The second vehicle follows so closely that both are at the same place.
        let pair = |gap_s| vec![vehicle(1, VehicleClass::Car, 0.0), vehicle(2, VehicleClass::Car, gap_s)];
        let of = |vehicles| {
            let site = Site { clips: vec![clip("one", 0.0, vehicles)], ..site() };
            let figures = Figures::of(&site, &Clock::new("UTC", "60s").unwrap());
            (figures.conflicts.len(), figures.doubtful_conflicts)
        };
        assert_eq!(of(pair(0.2)), (0, 1));
        assert_eq!(of(pair(2.0)), (0, 0));
    }

    #[test]
    fn counts_by_period_class_and_direction() {
        let figures = Figures::of(&site(), &Clock::new("UTC", "60s").unwrap());
        let count = |place: &str, direction: &str, class: &str| -> Vec<_> {
            let rows = figures.counts.iter().filter(|row| {
                let g = &row.group;
                (g.place.as_str(), g.direction.as_str(), g.class.as_str()) == (place, direction, class)
            });
            rows.map(|row| (row.group.from.clone(), row.group.followed_s, row.vehicles)).collect()
        };
        let period = |minute: u32| format!("1970-01-01T00:0{minute}:00+00:00");
        // The gap between the clips has no row. The time that was not followed does not count.
        assert_eq!(count("a", "forward", "all"), [(period(0), 50.0, Some(0)), (period(2), 50.0, Some(0))]);
        assert_eq!(count("a", "backward", "all"), [(period(0), 50.0, Some(3)), (period(2), 50.0, Some(1))]);
        assert_eq!(count("a", "backward", "bus"), [(period(0), 50.0, Some(1))]);
    }

    #[test]
    fn headways_need_time_in_which_vehicles_were_followed() {
        let figures = Figures::of(&site(), &Clock::new("UTC", "60s").unwrap());
        let rows: Vec<_> = figures.crossings.iter().filter(|row| row.gate == "b").collect();
        let of = |clip: &str, track: u64| rows.iter().find(|r| r.clip == clip && r.track == track).unwrap();
        assert!((of("one", 1).time_s - 7.0).abs() < 1e-6 && of("one", 1).headway_s.is_none());
        assert!((of("one", 2).headway_s.unwrap() - 3.0).abs() < 1e-6);
        assert!((of("one", 2).gap_s.unwrap() - 2.6).abs() < 1e-6);
        // Between vehicles 2 and 3, and between the clips, others may have passed.
        assert_eq!((of("one", 3).headway_s, of("two", 1).headway_s), (None, None));
        assert!((of("one", 1).speed_kmh - 36.0).abs() < 1e-9);
        assert!((of("one", 1).speed_sd_kmh.unwrap() - 0.72).abs() < 1e-6);
    }

    #[test]
    fn flows_and_zones() {
        let figures = Figures::of(&site(), &Clock::new("UTC", "1h").unwrap());
        let all: Vec<_> = figures.flows.iter().filter(|row| row.group.class == "all").collect();
        let [flow] = all.as_slice() else { panic!("{all:?}") };
        assert_eq!((flow.group.place.as_str(), flow.to_place.as_str(), flow.vehicles), ("a", "b", 4));
        let zone = figures.zones.iter().find(|row| row.group.class == "all").unwrap();
        assert_eq!((zone.entered, zone.stays, zone.queue_max_vehicles), (4, 4, 0));
        assert!((zone.time_mean_s.unwrap() - 2.0).abs() < 1e-4);
        // Edie: 80 m of paths in 20 m and 100 s are 144 vehicles per hour; 8 s in them are 4 per km.
        assert!((zone.flow_per_h.unwrap() - 144.0).abs() < 0.1, "{zone:?}");
        assert!((zone.density_per_km.unwrap() - 4.0).abs() < 0.01);
        assert!((zone.speed_kmh.unwrap() - 36.0).abs() < 0.01);
    }

    #[test]
    fn an_empty_site_has_no_figures() {
        let empty = Site { name: "cam".to_owned(), clips: Vec::new(), lanes: Vec::new() };
        assert_eq!(Figures::of(&empty, &Clock::new("UTC", "1h").unwrap()), Figures::default());
    }
}
