//! Figures of a gate by lane.

use nalgebra::Vector2;

use crate::gate_figures::{headway_row, speed_row};
use crate::passages::{Headway, Passage};
use crate::records::LaneRow;
use crate::scene::HALF_LANE_M;
use crate::site::{Period, Site};
use crate::{Direction, Gate, Lane, Speed};

/// Length by which lanes are prolonged, m. A lane ends where vehicles come into view, near the gate of its road.
const PROLONGED_M: f64 = 15.0;

/// Returns the figures of a gate in one direction by lane and period. `passages` has the possible crossings.
pub(crate) fn lane_rows(
    site: &Site,
    gate: usize,
    direction: Direction,
    passages: &[Passage<'_>],
    periods: &[Period],
) -> Vec<LaneRow> {
    let Some(clip) = site.clips.first() else { return Vec::new() };
    let places = places(&clip.gates[gate], &site.lanes, direction);
    let mut rows = Vec::new();
    for number in 1..=places.len() {
        let in_lane = |p: &&Passage<'_>| p.counts() && lane_at(&places, p.crossing.along_m) == Some(number);
        let mut mine: Vec<Passage<'_>> = passages.iter().filter(in_lane).cloned().collect();
        site.add_headways(&mut mine);
        for (index, period) in periods.iter().enumerate() {
            let here: Vec<_> = mine.iter().filter(|p| p.period == index).collect();
            let group = site.group(&clip.gates[gate].name, direction.name(), None, period);
            let speeds: Vec<Speed> = here.iter().map(|p| p.speed()).collect();
            let headways: Vec<Headway> = here.iter().filter_map(|p| p.headway).collect();
            let speed = speed_row(&group, &speeds, site.has_sds());
            let headway = headway_row(&group, &headways);
            rows.push(LaneRow {
                group,
                lane: number as u64,
                vehicles: (period.followed_s > 0.0).then_some(here.len() as u64),
                mean_kmh: speed.as_ref().map(|row| row.mean_kmh),
                mean_sd_kmh: speed.as_ref().and_then(|row| row.mean_sd_kmh),
                v85_kmh: speed.as_ref().map(|row| row.v85_kmh),
                v85_sd_kmh: speed.as_ref().and_then(|row| row.v85_sd_kmh),
                headway_mean_s: headway.as_ref().map(|row| row.headway_mean_s),
                gap_mean_s: headway.as_ref().map(|row| row.gap_mean_s),
            });
        }
    }
    rows
}

/// Returns the number of the lane at a place along a gate, from 1 on. `places` are the middles of the lanes.
fn lane_at(places: &[f64], along_m: f64) -> Option<usize> {
    let away = |i: usize| (places[i] - along_m).abs();
    let nearest = (0..places.len()).min_by(|a, b| away(*a).total_cmp(&away(*b)))?;
    (away(nearest) <= HALF_LANE_M).then_some(nearest + 1)
}

/// Returns where the lanes of a direction cross a gate, m from its first point, in this order.
fn places(gate: &Gate, lanes: &[Lane], direction: Direction) -> Vec<f64> {
    let mut places: Vec<f64> = lanes.iter().filter_map(|lane| place(gate, lane, direction)).collect();
    places.sort_by(f64::total_cmp);
    // Ribbons of one lane to several roads lie upon each other at the gate.
    places.dedup_by(|later, first| *later - *first < HALF_LANE_M);
    places
}

fn place(gate: &Gate, lane: &Lane, direction: Direction) -> Option<f64> {
    let (first, last) = (*gate.line.first()?, *gate.line.last()?);
    let along = (last - first).try_normalize(0.0)?;
    let right = Vector2::new(along.y, -along.x) * if direction == Direction::Forward { 1.0 } else { -1.0 };
    let mut middle = lane.middle.clone();
    let [begin, next, ..] = *middle.as_slice() else { return None };
    let [.., before, end] = *middle.as_slice() else { return None };
    middle.insert(0, begin + (begin - next).try_normalize(0.0)? * PROLONGED_M);
    middle.push(end + (end - before).try_normalize(0.0)? * PROLONGED_M);
    middle.windows(2).find_map(|pair| {
        let (a, b) = ((pair[0] - first).dot(&right), (pair[1] - first).dot(&right));
        let place = (pair[0] + (pair[1] - pair[0]) * (a / (a - b)) - first).dot(&along);
        (a < 0.0 && b >= 0.0 && (0.0..=(last - first).norm()).contains(&place)).then_some(place)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_are_numbered_along_the_gate() {
        let lane = |y: f64, from: f64, to: f64| Lane {
            middle: vec![Vector2::new(from, y), Vector2::new((from + to) / 2.0, y), Vector2::new(to, y)],
            middle_sd_m: vec![0.1; 3],
            width_m: 2.5,
            from: None,
            to: None,
            stays: Vec::new(),
        };
        let line = vec![Vector2::new(0.0, 6.0), Vector2::new(0.0, -6.0)];
        let gate = Gate { name: "g".to_owned(), line, shared_sd_m: 0.0 };
        // Three lanes with the traffic along −x, one along +x, and a lane that ends far from the gate.
        let lanes = [
            lane(-3.0, 50.0, -50.0),
            lane(3.0, 50.0, 5.0),
            lane(0.0, -5.0, -50.0),
            lane(5.0, -40.0, 40.0),
            lane(1.0, 90.0, 40.0),
        ];
        assert_eq!(places(&gate, &lanes, Direction::Forward), [3.0, 6.0, 9.0]);
        assert_eq!(places(&gate, &lanes, Direction::Backward), [1.0]);
        let places = [3.0, 6.0, 9.0];
        assert_eq!([2.0, 5.5, 12.0].map(|at| lane_at(&places, at)), [Some(1), Some(2), None]);
    }
}
