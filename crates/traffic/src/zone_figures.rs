//! Figures of a zone: its stays, and figures of a period.

use nalgebra::Vector2;

use crate::clock::Clock;
use crate::records::{Figures, Group, StayRow, ZoneRow};
use crate::site::{Period, Site, SiteClip, classes};
use crate::zone::{Visit, queue, visits};

/// Time between the samples of queues and of numbers in the zone, s.
const SAMPLE_S: f64 = 1.0;

/// Returns the figures of a zone by period and class, and its stays. `zone` is the index of the zone.
pub(crate) fn zone_figures(site: &Site, zone: usize, periods: &[Period], clock: &Clock) -> Figures {
    let mut figures = Figures::default();
    let Some(place) = site.clips.first().map(|clip| clip.zones[zone].name.clone()) else { return figures };
    let mut stays: Vec<(usize, Visit)> = Vec::new();
    for (i, clip) in site.clips.iter().enumerate() {
        for (index, vehicle) in clip.clip.vehicles.iter().enumerate() {
            stays.extend(visits(&clip.zones[zone], index, vehicle).into_iter().map(|visit| (i, visit)));
        }
    }
    for period in periods {
        for class in classes() {
            let of_class = |(clip, visit): &&(usize, Visit)| {
                class.is_none_or(|class| site.clips[*clip].clip.vehicles[visit.vehicle].class == class)
            };
            let here: Vec<&(usize, Visit)> = stays.iter().filter(of_class).collect();
            if class.is_none() || !here.is_empty() {
                figures.zones.push(zone_row(site, site.group(&place, "", class, period), &here, period));
            }
        }
    }
    let clock = site.is_dated().then_some(clock);
    figures.stays = stays.iter().map(|(clip, visit)| stay_row(site, &place, *clip, visit, clock)).collect();
    figures
}

fn stay_row(site: &Site, place: &str, clip: usize, visit: &Visit, clock: Option<&Clock>) -> StayRow {
    let SiteClip { clip, .. } = &site.clips[clip];
    let vehicle = &clip.vehicles[visit.vehicle];
    let [enters_s, leaves_s] = [0, 1].map(|end| visit.seen[end].then_some(visit.span_s[end]));
    StayRow {
        camera: site.name.clone(),
        clip: clip.name.clone(),
        track: vehicle.track,
        class: vehicle.class.name().to_owned(),
        zone: place.to_owned(),
        enters_s,
        leaves_s,
        stay_s: visit.time_s(),
        stay_sd_s: site.has_sds().then_some(visit.sd_s),
        stationary_s: visit.stationary_s,
        path_m: visit.path_m,
        moment: clock.zip(clip.start_s).map(|(clock, start)| clock.label(start + visit.span_s[0])),
    }
}

/// Returns the figures of a zone in a period. `stays` are pairs of the index of a clip and a stay in it.
fn zone_row(site: &Site, group: Group, stays: &[&(usize, Visit)], period: &Period) -> ZoneRow {
    let offset = |clip: usize| site.clips[clip].offset_s();
    let within = |t: f64| period.from_s <= t && t < period.to_s;
    let ended: Vec<&(usize, Visit)> = stays
        .iter()
        .copied()
        .filter(|(clip, v)| v.seen == [true, true] && within(v.span_s[1] + offset(*clip)))
        .collect();
    let n = ended.len() as f64;
    let mean =
        |f: &dyn Fn(&Visit) -> f64| (n > 0.0).then(|| ended.iter().map(|(_, v)| f(v)).sum::<f64>() / n);
    let sums = Sums::of(site, &group.place, stays, period);
    let followed = (period.followed_s > 0.0).then_some(period.followed_s);
    let length_m = sums.length_m;
    let per_length =
        |value: f64| followed.filter(|_| length_m > 0.0).map(|time_s| value / (length_m * time_s));
    ZoneRow {
        entered: stays.iter().filter(|(clip, v)| v.seen[0] && within(v.span_s[0] + offset(*clip))).count()
            as u64,
        stays: ended.len() as u64,
        time_mean_s: mean(&Visit::time_s),
        time_mean_sd_s: mean(&|v| v.sd_s.powi(2))
            .filter(|_| site.has_sds())
            .map(|variance| (variance / n).sqrt()),
        stationary_mean_s: mean(&|v| v.stationary_s),
        delay_mean_s: free_speed(stays).and_then(|free| mean(&|v| (v.time_s() - v.path_m / free).max(0.0))),
        occupancy: (sums.samples > 0).then(|| sums.occupied as f64 / sums.samples as f64),
        vehicles_mean: followed.map(|time_s| sums.stay_s / time_s),
        vehicles_max: sums.vehicles_max as u64,
        density_per_km: per_length(sums.stay_s).map(|density| density * 1000.0),
        flow_per_h: per_length(sums.path_m).map(|flow| flow * 3600.0),
        speed_kmh: (sums.stay_s > 0.0).then(|| sums.path_m / sums.stay_s * 3.6),
        queue_max_vehicles: sums.queue_max as u64,
        queue_max_m: sums.queue_max_m,
        group,
    }
}

/// Returns the median speed of vehicles that are never stationary in the zone, m/s.
fn free_speed(stays: &[&(usize, Visit)]) -> Option<f64> {
    let free =
        stays.iter().filter(|(_, v)| v.seen == [true, true] && v.stationary_s == 0.0 && v.path_m > 0.0);
    let mut speeds: Vec<f64> = free.map(|(_, v)| v.path_m / v.time_s()).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() / 2).copied()
}

/// Sums over a period.
#[derive(Default)]
struct Sums {
    /// Time that vehicles spend in the zone, s.
    stay_s: f64,
    /// Lengths of their paths in the zone, m. A path counts in proportion to the time within the period.
    path_m: f64,
    /// Length of the zone along the traffic, m.
    length_m: f64,
    samples: usize,
    occupied: usize,
    vehicles_max: usize,
    queue_max: usize,
    queue_max_m: f64,
}

impl Sums {
    fn of(site: &Site, place: &str, stays: &[&(usize, Visit)], period: &Period) -> Self {
        let mut sums = Self::default();
        for (index, clip) in site.clips.iter().enumerate() {
            let offset = clip.offset_s();
            let (from, to) = (period.from_s - offset, period.to_s - offset);
            let mut here: Vec<&Visit> = stays
                .iter()
                .filter(|(i, v)| *i == index && v.within_s(from, to) > 0.0)
                .map(|(_, v)| v)
                .collect();
            here.sort_by(|a, b| a.span_s[0].total_cmp(&b.span_s[0]));
            for visit in &here {
                let [begin_s, end_s] = visit.span_s;
                let time_s = clip.clip.followed_s(begin_s.max(from), end_s.min(to));
                sums.stay_s += time_s;
                sums.path_m += visit.path_m * time_s / visit.time_s();
            }
            let [first, last] = clip.clip.span_s;
            let (mut at, end) = (from.max(first), to.min(last));
            let (mut next, mut inside): (usize, Vec<&Visit>) = (0, Vec::new());
            while at < end {
                while here.get(next).is_some_and(|v| v.span_s[0] <= at) {
                    inside.push(here[next]);
                    next += 1;
                }
                inside.retain(|v| at <= v.span_s[1]);
                if clip.clip.followed_s(at, at + 1e-6) > 0.0 {
                    sums.sample(clip, &inside, at);
                }
                at += SAMPLE_S;
            }
            // Without vehicles, the direction of the traffic is unknown.
            if !here.is_empty() || sums.length_m == 0.0 {
                let zone = clip.zones.iter().find(|zone| zone.name == place);
                sums.length_m = zone.map_or(0.0, |zone| length_along(&zone.outline, &direction(clip, &here)));
            }
        }
        sums
    }

    fn sample(&mut self, clip: &SiteClip, inside: &[&Visit], at: f64) {
        self.samples += 1;
        self.occupied += usize::from(!inside.is_empty());
        self.vehicles_max = self.vehicles_max.max(inside.len());
        let states: Vec<_> = inside
            .iter()
            .filter_map(|v| {
                let vehicle = &clip.clip.vehicles[v.vehicle];
                Some((vehicle, vehicle.at(at)?))
            })
            .collect();
        let queue = queue(&states);
        self.queue_max = self.queue_max.max(queue.vehicles);
        self.queue_max_m = self.queue_max_m.max(queue.length_m);
    }
}

/// Returns the main axis of the vehicles' motion in the zone. Opposite directions count as one axis, so angles are
/// doubled.
fn direction(clip: &SiteClip, stays: &[&Visit]) -> Vector2<f64> {
    let doubled: Vector2<f64> = stays
        .iter()
        .filter_map(|v| clip.clip.vehicles[v.vehicle].at((v.span_s[0] + v.span_s[1]) / 2.0))
        .map(|state| {
            let (sin, cos) = (2.0 * f64::from(state.heading_rad)).sin_cos();
            Vector2::new(cos, sin)
        })
        .sum();
    let (sin, cos) = (doubled.y.atan2(doubled.x) / 2.0).sin_cos();
    Vector2::new(cos, sin)
}

/// Returns the extent of an area along an axis, m.
fn length_along(outline: &[Vector2<f64>], axis: &Vector2<f64>) -> f64 {
    let places = outline.iter().map(|corner| corner.dot(axis));
    let (low, high) =
        places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    (high - low).max(0.0)
}
