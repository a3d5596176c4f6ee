//! Passages over a gate in one direction, with the headways between them.

use roadplane_base::VehicleClass;

use crate::Speed;
use crate::crossing::{Crossing, crossings};
use crate::site::{Period, Site, SiteClip};

/// A crossing, its clip, and its time in the camera's time.
#[derive(Clone)]
pub(crate) struct Passage<'a> {
    pub(crate) clip: &'a SiteClip,
    pub(crate) crossing: Crossing,
    pub(crate) at_s: f64,
    pub(crate) period: usize,
    pub(crate) exists_p: f64,
    pub(crate) probability: f64,
    pub(crate) headway: Option<Headway>,
}

#[derive(Clone, Copy)]
pub(crate) struct Headway {
    pub(crate) headway_s: f64,
    pub(crate) sd_s: f64,
    pub(crate) gap_s: f64,
}

impl Passage<'_> {
    /// Whether the vehicle counts: it is more probable than not that it crossed.
    pub(crate) fn counts(&self) -> bool {
        self.probability >= 0.5
    }

    /// Returns the time at which the first end (0) or the last end (1) of the vehicle is on the line, in the camera's
    /// time, s.
    fn end_s(&self, end: usize) -> f64 {
        self.crossing.ends_s[end] + self.clip.offset_s()
    }

    /// Returns the class of the vehicle.
    pub(crate) fn class(&self) -> VehicleClass {
        self.clip.clip.vehicles[self.crossing.vehicle].class
    }

    /// Returns the speed of the vehicle at the line.
    pub(crate) fn speed(&self) -> Speed {
        let state = &self.crossing.state;
        Speed {
            mps: f64::from(state.speed_mps).abs(),
            own_sd_mps: f64::from(state.own_speed_sd_mps),
            scale_sd: f64::from(state.scale_sd),
        }
    }
}

impl Site {
    /// Returns the crossings of a gate for each direction of [`Direction::ALL`](crate::Direction::ALL). They are in the order of time, with their
    /// headways.
    pub(crate) fn passages(&self, gate: usize, periods: &[Period]) -> [Vec<Passage<'_>>; 2] {
        let mut by_direction = [Vec::new(), Vec::new()];
        for clip in &self.clips {
            for (index, vehicle) in clip.clip.vehicles.iter().enumerate() {
                for crossing in crossings(&clip.gates[gate], index, vehicle) {
                    let at_s = crossing.time_s + clip.offset_s();
                    let period = periods.partition_point(|p| p.from_s <= at_s).saturating_sub(1);
                    let exists_p = vehicle.exists_p;
                    let probability = exists_p * crossing.probability(0.0, 0.0);
                    let passage =
                        Passage { clip, crossing, at_s, period, exists_p, probability, headway: None };
                    by_direction[passage.crossing.direction as usize].push(passage);
                }
            }
        }
        for passages in &mut by_direction {
            // In several lanes, the front that reaches the line first need not belong to the centre that does.
            passages.sort_by(|a, b| a.end_s(0).total_cmp(&b.end_s(0)));
            self.add_headways(passages);
        }
        by_direction
    }

    /// Sets the headways of passages, which are in the order in which the fronts reach the line.
    pub(crate) fn add_headways(&self, passages: &mut [Passage<'_>]) {
        let mut last: Option<usize> = None;
        for i in 0..passages.len() {
            passages[i].headway = None;
            if !passages[i].counts() {
                continue;
            }
            let leader = last.replace(i).map(|leader| &passages[leader]);
            let (Some(leader), follower) = (leader, &passages[i]) else { continue };
            let (from, to) = (leader.end_s(0), follower.end_s(0));
            // A vehicle may have passed in time that was not followed. A millisecond is the precision of times here.
            if self.followed_s(from, to) < to - from - 1e-3 {
                continue;
            }
            let headway = Headway {
                headway_s: to - from,
                sd_s: leader.crossing.ends_sd_s.hypot(follower.crossing.ends_sd_s),
                gap_s: to - leader.end_s(1),
            };
            passages[i].headway = Some(headway);
        }
    }
}
