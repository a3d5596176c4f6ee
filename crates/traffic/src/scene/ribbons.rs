//! Lanes from paths: groups of paths along one reference line, and the lanes of each group.

use super::{
    arm::Flow,
    border::HALF_LANE_M,
    cluster::FEWEST,
    lane::{Lane, Stay},
    mixture::{Lanes, Sample},
    path::Path,
    reference::{NODE_M, Place, Reference, smoothed},
    trips::Trip,
};

/// Number of nodes in a window, in which the offset of a vehicle is averaged.
const WINDOW: usize = 3;
/// Share of a path that must be on the ribbon of a group.
const COVERED: f64 = 0.8;
/// Farthest offset of a path from the reference line of a group without known arms, m: one lane to each side.
const BESIDE_M: f64 = 5.0;
/// Probability from which a vehicle is in a lane.
const IN_LANE_P: f64 = 0.5;

/// Returns the lanes of all groups of paths: first those of the flows, then those of further common paths.
/// `track_of` gives the track number of a path.
pub(super) fn lanes(
    paths: &[Path],
    trips: &[Trip],
    flows: &[Flow],
    track_of: &dyn Fn(&Path) -> u64,
) -> Vec<Lane> {
    let mut flows = flows.to_vec();
    flows.sort_by_key(|flow| (usize::MAX - flow.vehicles, flow.from, flow.to));
    let mut used = vec![false; paths.len()];
    let mut lanes = Vec::new();
    for flow in flows {
        let trip = Trip { from: Some(flow.from), to: Some(flow.to) };
        let whole: Vec<usize> = (0..paths.len()).filter(|&i| trips[i] == trip).collect();
        let Some(reference) = reference(paths, &whole) else { continue };
        let Some(fitted) = Ribbon::fit(paths, &whole, reference.clone()) else { continue };
        let fits = |i: usize| {
            trips[i].from.is_none_or(|from| from == flow.from) && trips[i].to.is_none_or(|to| to == flow.to)
        };
        let parts =
            (0..paths.len()).filter(|&i| !used[i] && trips[i] != trip && fits(i) && fitted.covers(&paths[i]));
        let members: Vec<usize> = whole.iter().copied().chain(parts).collect();
        members.iter().for_each(|&i| used[i] = true);
        let ribbon = Ribbon::fit(paths, &members, reference).unwrap_or(fitted);
        lanes.extend(ribbon.lanes(paths, track_of, trip));
    }
    let mut seeds: Vec<usize> = (0..paths.len()).filter(|&i| !used[i]).collect();
    seeds.sort_by(|&a, &b| paths[b].length_m().total_cmp(&paths[a].length_m()).then(a.cmp(&b)));
    for &seed in &seeds {
        if used[seed] {
            continue;
        }
        used[seed] = true;
        let points: Vec<_> = paths[seed].points.iter().map(|point| point.at).collect();
        let Some(reference) = Reference::new(&points) else { continue };
        let along = |i: &usize| {
            share(&reference.places(&paths[*i]), |place| place.left_m.abs() <= BESIDE_M) >= COVERED
        };
        let members: Vec<usize> =
            seeds.iter().copied().filter(|&i| i == seed || !used[i]).filter(along).collect();
        if members.len() < FEWEST {
            continue;
        }
        members.iter().for_each(|&i| used[i] = true);
        if let Some(ribbon) = Ribbon::fit(paths, &members, reference) {
            lanes.extend(ribbon.lanes(paths, track_of, Trip::default()));
        }
    }
    lanes
}

/// Returns the share of a path's points with a place that fulfils a condition.
fn share(places: &[Option<Place>], fulfils: impl Fn(&Place) -> bool) -> f64 {
    places.iter().flatten().filter(|place| fulfils(place)).count() as f64 / places.len().max(1) as f64
}

/// Returns the mean line of paths between the same arms, along the longest of them.
fn reference(paths: &[Path], members: &[usize]) -> Option<Reference> {
    let longest = members.iter().max_by(|&&a, &&b| paths[a].length_m().total_cmp(&paths[b].length_m()))?;
    let points: Vec<_> = paths[*longest].points.iter().map(|point| point.at).collect();
    let mut line = Reference::new(&points)?;
    for _ in 0..2 {
        // Only changes along the line matter: otherwise the line jumps where a vehicle of another lane appears.
        let mut sums = vec![[0.0; 2]; line.nodes.len()];
        for &i in members {
            let places: Vec<Place> = line.places(&paths[i]).into_iter().flatten().collect();
            let mean = places.iter().map(|place| place.left_m).sum::<f64>() / places.len().max(1) as f64;
            for place in places {
                let node = ((place.along_m / NODE_M).round().max(0.0) as usize).min(sums.len() - 1);
                sums[node] = [sums[node][0] + place.left_m - mean, sums[node][1] + 1.0];
            }
        }
        line = line.shifted(&filled(&sums))?;
    }
    Some(line)
}

/// Returns the means of sums with counts. Where few values are, it is the nearest mean of many values.
fn filled(sums: &[[f64; 2]]) -> Vec<f64> {
    let most = sums.iter().map(|sum| sum[1]).fold(1.0, f64::max);
    let many: Vec<usize> = (0..sums.len()).filter(|&node| 2.0 * sums[node][1] >= most).collect();
    let nearest = |node: usize| many.iter().copied().min_by_key(|other| other.abs_diff(node));
    (0..sums.len()).map(|node| nearest(node).map_or(0.0, |node| sums[node][0] / sums[node][1])).collect()
}

/// A group of paths along a reference line, with its lanes.
struct Ribbon {
    reference: Reference,
    lanes: Lanes,
    members: Vec<usize>,
    samples: Vec<Vec<Sample>>,
}

impl Ribbon {
    fn fit(paths: &[Path], members: &[usize], reference: Reference) -> Option<Self> {
        let windows = reference.nodes.len().div_ceil(WINDOW);
        let samples: Vec<_> = members.iter().map(|&i| samples(&paths[i], &reference, windows)).collect();
        let lanes = Lanes::fit(&samples, windows)?;
        Some(Self { reference, lanes, members: members.to_vec(), samples })
    }

    /// Whether a path is in the lanes over most of its length.
    fn covers(&self, path: &Path) -> bool {
        let middles: Vec<Vec<(f64, f64, f64)>> =
            (0..self.lanes.count()).map(|lane| self.lanes.offsets(lane, &self.samples)).collect();
        let within = |place: &Place| {
            let window = (place.along_m / NODE_M).max(0.0) as usize / WINDOW;
            middles
                .iter()
                .any(|lane| lane.get(window).is_some_and(|lane| (place.left_m - lane.0).abs() <= HALF_LANE_M))
        };
        share(&self.reference.places(path), within) >= COVERED
    }

    /// Returns the lanes with enough vehicles.
    fn lanes(&self, paths: &[Path], track_of: &dyn Fn(&Path) -> u64, trip: Trip) -> Vec<Lane> {
        (0..self.lanes.count()).filter_map(|lane| self.lane(lane, paths, track_of, trip)).collect()
    }

    fn lane(&self, lane: usize, paths: &[Path], track_of: &dyn Fn(&Path) -> u64, trip: Trip) -> Option<Lane> {
        let offsets = self.lanes.offsets(lane, &self.samples);
        let filled = |offset: &(f64, f64, f64)| offset.2 >= FEWEST as f64 - 0.5;
        let (first, last) = (offsets.iter().position(filled)?, offsets.iter().rposition(filled)?);
        let mut stays = Vec::new();
        for (&i, samples) in self.members.iter().zip(&self.samples) {
            let path = &paths[i];
            let (posterior, _) = self.lanes.posterior(samples);
            let inside = |k: usize| posterior[k][lane] >= IN_LANE_P;
            let mut k = 0;
            while k < samples.len() {
                let from = k;
                while k < samples.len() && inside(k) {
                    k += 1;
                }
                if k - from >= 2 {
                    let windows = [samples[from].window, samples[k - 1].window];
                    stays.push(Stay {
                        clip: path.clip,
                        track: track_of(path),
                        span_s: self.times(path, windows),
                    });
                }
                k += usize::from(k == from);
            }
        }
        stays.sort_by(|a, b| {
            (a.clip, a.track).cmp(&(b.clip, b.track)).then(a.span_s[0].total_cmp(&b.span_s[0]))
        });
        let mut vehicles: Vec<_> = stays.iter().map(|stay| (stay.clip, stay.track)).collect();
        vehicles.dedup();
        if vehicles.len() < FEWEST || first == last {
            return None;
        }
        let at = |node: usize| {
            // Windows are averaged with their neighbours, and nodes lie between the middles of two windows.
            let smooth = |window: usize| {
                let near = [window.max(first + 1) - 1, window, window, (window + 1).min(last)];
                let mean = |of: &dyn Fn(usize) -> f64| near.iter().map(|&w| of(w)).sum::<f64>() / 4.0;
                [mean(&|w| offsets[w].0), mean(&|w| offsets[w].1)]
            };
            let place = (node as f64 - (WINDOW - 1) as f64 / 2.0) / WINDOW as f64;
            let low = (place.floor().max(first as f64) as usize).min(last - 1);
            let share = (place - low as f64).clamp(0.0, 1.0);
            let [a, b] = [smooth(low), smooth(low + 1)];
            [0, 1].map(|i| a[i] + (b[i] - a[i]) * share)
        };
        let nodes = first * WINDOW..((last + 1) * WINDOW).min(self.reference.nodes.len());
        let place = |node: usize| self.reference.nodes[node] + self.reference.left(node) * at(node)[0];
        let middle: Vec<_> = nodes.clone().map(place).collect();
        let width = self.members.iter().map(|&i| paths[i].width_m).sum::<f64>() / self.members.len() as f64;
        Some(Lane {
            middle: smoothed(&middle),
            middle_sd_m: nodes.map(|node| at(node)[1]).collect(),
            width_m: width + 2.0 * 1.96 * self.lanes.wander_m,
            from: trip.from,
            to: trip.to,
            stays,
        })
    }

    /// Returns the times at which a path is in two windows, s.
    fn times(&self, path: &Path, windows: [usize; 2]) -> [f64; 2] {
        let within = |place: &Option<Place>| {
            place.is_some_and(|place| {
                let window = (place.along_m / NODE_M).max(0.0) as usize / WINDOW;
                (windows[0]..=windows[1]).contains(&window)
            })
        };
        let places = self.reference.places(path);
        let time = |i: Option<usize>| path.points[i.unwrap_or(0)].state.time_s;
        [time(places.iter().position(within)), time(places.iter().rposition(within))]
    }
}

/// Returns the mean offsets of a path in each window.
fn samples(path: &Path, reference: &Reference, windows: usize) -> Vec<Sample> {
    let mut sums = vec![[0.0; 3]; windows];
    for (point, place) in path.points.iter().zip(reference.places(path)) {
        let Some(place) = place else { continue };
        let node = ((place.along_m / NODE_M).max(0.0) as usize).min(reference.nodes.len() - 1);
        let variance = point.state.own_variance_along(&reference.left(node));
        let sum = &mut sums[(node / WINDOW).min(windows - 1)];
        *sum = [sum[0] + place.left_m, sum[1] + variance, sum[2] + 1.0];
    }
    let sample = |(window, sum): (usize, &[f64; 3])| {
        (sum[2] > 0.0).then(|| Sample { window, left_m: sum[0] / sum[2], variance: sum[1] / sum[2] })
    };
    sums.iter().enumerate().filter_map(sample).collect()
}
