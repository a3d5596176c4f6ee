//! Where the vertical of the scene points, by edges of a picture that may be vertical: a second witness for the focal length.
//!
//! Cars tell the horizon well (focal · tan tilt), and poorly where along it focal length and tilt lie. Vertical lines meet in
//! one point of the picture, or none; horizon × that point = −focal² (Caprile and Torre 1990). They run along
//! `(sin roll, −cos roll) + bend · p` at the pixel p, with `bend = tan(tilt) / focal`.
//!
//! Edges are a mixture: a share of them, which is not known, is vertical up to its lean and to how well it is found; the others
//! point anywhere. (bend, roll) and the lens' bend of straight lines are searched on a grid ([`field`](self::field)). Edges
//! beside each other say one thing together, as one thing's lean is theirs. What is found counts only where it explains the
//! edges so much better than chance, over all that the cars leave possible, that chance is out of the question; otherwise there
//! is no witness (a-contrario reasoning after Desolneux, Moisan and Morel 2000, as a Bayes factor). Lanes do not pass: lines on
//! the ground part downwards, verticals meet below a camera that looks down.

mod field;

use nalgebra::{Matrix2, Vector2};
use roadplane_base::{Camera, CameraEstimate, Factor, SceneLine};

use self::field::{Field, Node};
use crate::lens::{STRAIGHT_SD, bend_of_lenses, greatest_bend};

/// No more edges are looked at; ours are fewer, others' files may have any number.
const MOST_LINES: usize = 300;
/// Log of how many times better than chance the edges must be explained: a hundred times.
const LEAST_GAIN: f64 = 4.6;
/// A witness that knows log focal no better than this, with the horizon given, is none.
const WEAKEST: f64 = 0.25;

/// The vertical of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Verticals {
    /// What it says of the camera.
    pub factor: Factor,
    /// Log of how many times better than chance it explains the edges.
    pub gain: f64,
    /// Which of the edges are vertical; of the first ones, where there are very many.
    pub upright: Vec<bool>,
}

/// The vertical of the scene by its edges and the camera that the cars alone say; `None` where the edges do not show one, or
/// where it says next to nothing of the focal length.
#[must_use]
pub fn verticals(lines: &[SceneLine], cars: &CameraEstimate) -> Option<Verticals> {
    let prior = Prior::of(cars)?;
    let width = f64::from(cars.image_size_px.width);
    let field = Field::new(&lines[..lines.len().min(MOST_LINES)], &cars.principal_point_px, width);
    let (best, gain) = search(&field, &prior)?;
    if gain < LEAST_GAIN {
        return None;
    }
    let Moments { mean, mut covariance } = moments(&field, &prior, best)?;
    // Were the principal point elsewhere, so would be the middle of the bend and of the lens.
    let principal_point = Camera::PRINCIPAL_POINT_SD * width;
    let of_lens = 2.0 * mean.lens / (field.half_width() * field.half_width());
    covariance[(0, 0)] += (principal_point * (mean.bend * mean.bend).hypot(of_lens)).powi(2);
    covariance[(1, 1)] += (principal_point * mean.bend).powi(2);
    // log focal = (log horizon − log bend) / 2, and a slope of the road turns the bend but not the cars' horizon.
    let tilt = (mean.bend * prior.focal_px).atan();
    let slope = Factor::SLOPE_SD / (tilt.sin() * tilt.cos());
    let log_focal_sd = 0.5 * (covariance[(0, 0)].sqrt() / mean.bend).hypot(slope);
    if !(mean.bend > 0.0 && log_focal_sd < WEAKEST) {
        return None;
    }
    let upright = field.trust(&mean).into_iter().map(|trust| trust > 0.5).collect();
    Some(Verticals {
        factor: Factor::Upright { bend: mean.bend, roll: mean.roll, covariance },
        gain,
        upright,
    })
}

/// What the cars leave possible.
struct Prior {
    focal_px: f64,
    log_focal_sd: f64,
    /// Distance of the horizon from the principal point, px, and its sd.
    horizon: [f64; 2],
    roll: [f64; 2],
    /// Mean and sd of the lens' bend: share by which the half width is drawn in.
    lens: [f64; 2],
    /// Above this it is none, to [`STRAIGHT_SD`]: else lanes below the picture's middle pass for walls that such a lens bends.
    greatest_lens: f64,
}

impl Prior {
    fn of(cars: &CameraEstimate) -> Option<Self> {
        let (tilt, focal_px) = (cars.params.tilt, cars.params.focal_px());
        let covariance = &cars.covariance;
        let by = nalgebra::Vector4::new(focal_px * tilt.tan(), focal_px / tilt.cos().powi(2), 0.0, 0.0);
        let horizon = [by.x, by.dot(&(covariance * by)).max(0.0).sqrt()];
        // Without a horizon below which the ground lies there is nothing to multiply with.
        if !(horizon[0] > 2.0 * horizon[1] && horizon[1].is_finite()) {
            return None;
        }
        Some(Self {
            focal_px,
            log_focal_sd: covariance[(0, 0)].sqrt(),
            horizon,
            roll: [cars.params.roll, 1.5 * covariance[(2, 2)].sqrt()],
            lens: cars.bend_sd.map_or_else(
                || bend_of_lenses(focal_px, cars.image_size_px),
                |sd| [cars.lens.bend(cars.image_size_px), sd.max(STRAIGHT_SD)],
            ),
            greatest_lens: match cars.bend_sd {
                None => greatest_bend(focal_px, cars.image_size_px),
                Some(_) => f64::INFINITY,
            },
        })
    }

    /// Density of a bend, up to a constant: over what focal length may be, along the horizon, and slopes.
    fn of_bend(&self, bend: f64) -> f64 {
        let steps = (-10..=10).map(|i| 0.25 * f64::from(i));
        let density = |z: f64| {
            let focal_px = self.focal_px * (z * self.log_focal_sd).exp();
            let tilt = (self.horizon[0] / focal_px).atan();
            let horizon_sd = 2.0 * self.horizon[1] / focal_px * tilt.cos().powi(2);
            let seen = bend * focal_px;
            let per_bend = focal_px / (1.0 + seen * seen);
            (-0.5 * z * z).exp() * sloped(seen.atan() - tilt, horizon_sd) * per_bend
        };
        steps.map(density).sum()
    }

    /// Density of a roll, up to a constant.
    fn of_roll(&self, roll: f64) -> f64 {
        sloped(roll - self.roll[0], self.roll[1])
    }

    fn of_lens(&self, lens: f64) -> f64 {
        let beyond = (lens - self.greatest_lens).max(0.0) / STRAIGHT_SD;
        (-0.5 * (((lens - self.lens[0]) / self.lens[1]).powi(2) + beyond * beyond)).exp()
    }
}

/// Density of an angle between the cars' up and that of the scene, known to `sd`, up to a constant.
fn sloped(angle: f64, sd: f64) -> f64 {
    let normal = |slope_sd: f64| {
        let sd = sd.hypot(slope_sd);
        (-0.5 * (angle / sd).powi(2)).exp() / sd
    };
    (1.0 - Factor::STEEP_SHARE) * normal(Factor::SLOPE_SD) + Factor::STEEP_SHARE * normal(Factor::STEEP_SD)
}

/// Step of the search, rad: of the roll, and of what a bend does at the picture's side.
const SEARCH_STEP: f64 = 0.007;
/// The roll is searched so far from the cars', rad.
const SEARCH_ROLL: f64 = 0.105;
/// Steps of the lens to either side, and sds that they reach.
const LENS_STEPS: i32 = 4;
const LENS_REACH: f64 = 2.2;
/// What the cars hold for less likely than this share of the likeliest is not looked at.
const UNLIKELY: f64 = 1e-5;

/// The likeliest node by cars and edges, and the log Bayes factor of all against chance.
fn search(field: &Field, prior: &Prior) -> Option<(Node, f64)> {
    let half = field.half_width();
    let count = |reach: f64| (reach / SEARCH_STEP) as i32;
    let bends: Vec<(f64, f64)> = (1..count(1.0))
        .map(|i| {
            let angle = (f64::from(i) - 0.5) * SEARCH_STEP;
            (angle.tan() / half, SEARCH_STEP / angle.cos().powi(2) / half)
        })
        .map(|(bend, step)| (bend, step * prior.of_bend(bend)))
        .collect();
    let rolls: Vec<(f64, f64)> = (-count(SEARCH_ROLL)..=count(SEARCH_ROLL))
        .map(|i| prior.roll[0] + f64::from(i) * SEARCH_STEP)
        .map(|roll| (roll, prior.of_roll(roll)))
        .collect();
    let lenses: Vec<(f64, f64)> = (-LENS_STEPS..=LENS_STEPS)
        .map(|i| prior.lens[0] + LENS_REACH * prior.lens[1] * f64::from(i) / f64::from(LENS_STEPS))
        .map(|lens| (lens, prior.of_lens(lens)))
        .collect();
    let total = |of: &[(f64, f64)]| of.iter().map(|(_, weight)| weight).sum::<f64>();
    let most = |of: &[(f64, f64)]| of.iter().map(|(_, weight)| *weight).fold(0.0, f64::max);
    let all = total(&bends) * total(&rolls) * total(&lenses);
    let least = UNLIKELY * most(&bends) * most(&rolls);
    let mut found: Vec<(Node, f64)> = Vec::new();
    for (lens, of_lens) in &lenses {
        let seen = field.straightened(*lens);
        for (bend, of_bend) in &bends {
            for (roll, of_roll) in rolls.iter().filter(|(_, of_roll)| of_bend * of_roll > least) {
                let node = Node { bend: *bend, roll: *roll, lens: *lens };
                let weight = (of_bend * of_roll * of_lens / all).ln();
                found.push((node, weight + field.log_ratio(&seen, &node)));
            }
        }
    }
    let best = found.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let sum: f64 = found.iter().map(|(_, log)| (log - best.1).exp()).sum();
    Some((best.0, best.1 + sum.ln()))
}

/// Where the edges' likelihood lies around a node.
struct Moments {
    mean: Node,
    covariance: Matrix2<f64>,
}

/// Rounds of laying a grid over the likelihood, each by the moments of the one before.
const ROUNDS: usize = 5;
/// Steps of that grid to either side, and how many sds they reach.
const STEPS: i32 = 5;
const REACH: f64 = 3.0;

/// Mean and covariance of (bend, roll) by the edges and what is known of lenses, without the cars.
fn moments(field: &Field, prior: &Prior, best: Node) -> Option<Moments> {
    let step = SEARCH_STEP / (best.bend * field.half_width()).atan().cos().powi(2);
    let mut mean = best;
    let mut covariance =
        Matrix2::from_diagonal(&Vector2::new(step / field.half_width(), SEARCH_STEP).map(|s| s * s));
    let mut lens_sd = 2.0 * LENS_REACH / f64::from(LENS_STEPS) * prior.lens[1];
    for _ in 0..ROUNDS {
        let reach = |i: i32, sd: f64| REACH * sd * f64::from(i) / f64::from(STEPS);
        let sd = covariance.diagonal().map(f64::sqrt);
        let mut told: Vec<(Node, f64)> = Vec::new();
        for lens in (-STEPS..=STEPS).map(|i| mean.lens + reach(i, lens_sd)) {
            let seen = field.straightened(lens);
            let of_lens = prior.of_lens(lens).max(1e-300).ln();
            for i in -STEPS..=STEPS {
                for k in -STEPS..=STEPS {
                    let node =
                        Node { bend: mean.bend + reach(i, sd.x), roll: mean.roll + reach(k, sd.y), lens };
                    told.push((node, of_lens + field.log_ratio(&seen, &node)));
                }
            }
        }
        let most = told.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
        for (_, log) in &mut told {
            *log = (*log - most).exp();
        }
        let total: f64 = told.iter().map(|(_, weight)| weight).sum();
        let average = |of: &dyn Fn(&Node) -> f64| told.iter().map(|(n, w)| w * of(n)).sum::<f64>() / total;
        let next =
            Node { bend: average(&|n| n.bend), roll: average(&|n| n.roll), lens: average(&|n| n.lens) };
        let (bend, roll) = (|n: &Node| n.bend - next.bend, |n: &Node| n.roll - next.roll);
        let cross = average(&|n| bend(n) * roll(n));
        covariance = Matrix2::new(average(&|n| bend(n).powi(2)), cross, cross, average(&|n| roll(n).powi(2)));
        lens_sd = average(&|n| (n.lens - next.lens).powi(2)).sqrt();
        mean = next;
    }
    let is_sound = covariance.iter().all(|v| v.is_finite()) && covariance.cholesky().is_some();
    is_sound.then_some(Moments { mean, covariance })
}
