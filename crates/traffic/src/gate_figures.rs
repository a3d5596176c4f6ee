//! Figures of a gate: counts, speeds, histograms and headways by class and period.

use std::collections::BTreeMap;

use crate::clock::Clock;
use crate::passages::{Headway, Passage};
use crate::records::{CountRow, CrossingRow, Figures, Group, HeadwayRow, HistogramRow, SpeedRow};
use crate::site::{Period, Site, classes};
use crate::{Crossing, Direction, Measured, Speed, count_interval, percentile, space_mean, time_mean};

/// Expected share of vehicles that have no track. Source: of 258 vehicles that were counted by eye at lines of eleven clips,
/// the program missed 5 (`scripts/traffic/check_counts.py`, and 86 vehicles of four other clips). The share is
/// (5 + 1/2) / (258 + 1), the mean with Jeffreys' prior.
const MISSED_SHARE: f64 = 0.021;
/// Width of the classes of the speed histogram, km/h.
const HISTOGRAM_KMH: f64 = 5.0;
const KMH_PER_MPS: f64 = 3.6;

/// Returns the tables of a gate in one direction. `passages` has the possible crossings in the order of time.
pub(crate) fn gate_figures(
    site: &Site,
    gate: usize,
    direction: Direction,
    passages: &[Passage<'_>],
    periods: &[Period],
    clock: &Clock,
) -> Figures {
    let mut figures = Figures::default();
    let place = &site.clips[0].gates[gate].name;
    let shared_sd_m = site.clips.iter().map(|clip| clip.gates[gate].shared_sd_m).fold(0.0, f64::max);
    let has_sds = site.has_sds();
    for (index, period) in periods.iter().enumerate() {
        for class in classes() {
            let here: Vec<&Passage<'_>> = passages
                .iter()
                .filter(|p| p.period == index && class.is_none_or(|class| p.class() == class))
                .collect();
            let counted: Vec<&Passage<'_>> = here.iter().copied().filter(|p| p.counts()).collect();
            if class.is_some() && counted.is_empty() {
                continue;
            }
            let group = site.group(place, direction.name(), class, period);
            let possible: Vec<(&Crossing, f64)> = here.iter().map(|p| (&p.crossing, p.exists_p)).collect();
            let interval = has_sds.then(|| count_interval(&possible, shared_sd_m, MISSED_SHARE));
            let followed = period.followed_s > 0.0;
            let vehicles = followed.then_some(counted.len() as u64);
            figures.counts.push(CountRow {
                group: group.clone(),
                vehicles,
                vehicles_low: interval.filter(|_| followed).map(|[low, _]| low.min(counted.len() as u64)),
                vehicles_high: interval.filter(|_| followed).map(|[_, high]| high.max(counted.len() as u64)),
                flow_per_h: vehicles.map(|n| n as f64 * 3600.0 / period.followed_s),
            });
            let speeds: Vec<Speed> = counted.iter().map(|p| p.speed()).collect();
            figures.speeds.extend(speed_row(&group, &speeds, has_sds));
            figures.speed_histogram.extend(histogram(&group, &speeds));
            let headways: Vec<Headway> = counted.iter().filter_map(|p| p.headway).collect();
            figures.headways.extend(headway_row(&group, &headways));
        }
    }
    for p in passages.iter().filter(|p| p.counts()) {
        figures.crossings.push(crossing_row(site, place, p, site.is_dated().then_some(clock)));
    }
    figures
}

fn crossing_row(site: &Site, place: &str, p: &Passage<'_>, clock: Option<&Clock>) -> CrossingRow {
    let vehicle = &p.clip.clip.vehicles[p.crossing.vehicle];
    let sd = |value: f64| p.clip.has_sds().then_some(value);
    let speed = p.speed();
    CrossingRow {
        camera: site.name.clone(),
        clip: p.clip.clip.name.clone(),
        track: vehicle.track,
        class: vehicle.class.name().to_owned(),
        gate: place.to_owned(),
        direction: p.crossing.direction.name().to_owned(),
        time_s: p.crossing.time_s,
        time_sd_s: sd(p.crossing.time_sd_s),
        moment: clock.map(|clock| clock.label(p.at_s)),
        along_m: p.crossing.along_m,
        speed_kmh: speed.mps * KMH_PER_MPS,
        speed_sd_kmh: sd(speed.own_sd_mps.hypot(speed.mps * speed.scale_sd) * KMH_PER_MPS),
        headway_s: p.headway.map(|h| h.headway_s),
        headway_sd_s: p.headway.and_then(|h| sd(h.sd_s)),
        gap_s: p.headway.map(|h| h.gap_s),
        probability: p.probability,
    }
}

pub(crate) fn speed_row(group: &Group, speeds: &[Speed], has_sds: bool) -> Option<SpeedRow> {
    let kmh = |m: Measured| (m.value * KMH_PER_MPS, has_sds.then_some(m.sd * KMH_PER_MPS));
    let (mean_kmh, mean_sd_kmh) = kmh(time_mean(speeds)?);
    let at = |share: f64| percentile(speeds, share).map(kmh);
    let ((v15_kmh, v15_sd_kmh), (v50_kmh, v50_sd_kmh), (v85_kmh, v85_sd_kmh)) =
        (at(0.15)?, at(0.5)?, at(0.85)?);
    let space = space_mean(speeds).map(kmh);
    Some(SpeedRow {
        group: group.clone(),
        vehicles: speeds.len() as u64,
        mean_kmh,
        mean_sd_kmh,
        space_mean_kmh: space.map(|s| s.0),
        space_mean_sd_kmh: space.and_then(|s| s.1),
        v15_kmh,
        v15_sd_kmh,
        v50_kmh,
        v50_sd_kmh,
        v85_kmh,
        v85_sd_kmh,
    })
}

fn histogram(group: &Group, speeds: &[Speed]) -> Vec<HistogramRow> {
    let mut bins: BTreeMap<u64, u64> = BTreeMap::new();
    for speed in speeds {
        *bins.entry((speed.mps * KMH_PER_MPS / HISTOGRAM_KMH) as u64).or_default() += 1;
    }
    let row = |(bin, vehicles): (u64, u64)| HistogramRow {
        group: group.clone(),
        least_kmh: bin as f64 * HISTOGRAM_KMH,
        below_kmh: (bin + 1) as f64 * HISTOGRAM_KMH,
        vehicles,
    };
    bins.into_iter().map(row).collect()
}

pub(crate) fn headway_row(group: &Group, headways: &[Headway]) -> Option<HeadwayRow> {
    let mut times: Vec<f64> = headways.iter().map(|h| h.headway_s).collect();
    times.sort_by(f64::total_cmp);
    let n = times.len();
    let median = (times.get(n.checked_sub(1)? / 2)? + times[n / 2]) / 2.0;
    let mean = |f: &dyn Fn(&Headway) -> f64| headways.iter().map(f).sum::<f64>() / n as f64;
    Some(HeadwayRow {
        group: group.clone(),
        headways: n as u64,
        headway_mean_s: mean(&|h| h.headway_s),
        headway_median_s: median,
        gap_mean_s: mean(&|h| h.gap_s),
        below_2s_share: mean(&|h| f64::from(u8::from(h.headway_s < 2.0))),
    })
}
