//! The conflict of two vehicles.

use nalgebra::Vector2;

use super::{
    conflict::{Conflict, ConflictLimits, Projection, below_p},
    meeting::{Encroachment, Meeting, kind, meeting},
    path::Path,
    projection::{Brake, Contact, Motion, brake, contact, until_contact_s},
};
use crate::State;

/// Shortest time between two moments at which a projection starts, s. Tracks may have their states at different times.
const SHORTEST_STEP_S: f64 = 0.04;

/// The states of two vehicles at one time, each with its travelled distance, m.
#[derive(Clone, Copy)]
struct Moment {
    time_s: f64,
    states: [(State, f64); 2],
}

/// An expected contact.
#[derive(Clone, Copy)]
struct Expected {
    moment: Moment,
    after_s: f64,
}

/// Returns the conflict of two vehicles if it passes a limit. `a` has the smaller track number.
pub(super) fn conflict(
    a: &Path<'_>,
    b: &Path<'_>,
    scale_sd: Option<f64>,
    limits: &ConflictLimits,
) -> Option<Conflict> {
    let (meets, meeting) = meeting(a, b, limits.pet_s);
    if !meets && limits.projection == Projection::Path {
        return None;
    }
    let expected = expected_contacts(a, b, limits);
    let encroachment = meeting.and_then(|m| m.encroachment);
    if expected.is_empty() && encroachment.is_none() {
        return None;
    }
    let mut conflict = Conflict {
        exist_p: a.vehicle.exists_p * b.vehicle.exists_p,
        ..names(a, b, meeting.is_some_and(|m| m.swapped))
    };
    if let Some(soonest) = expected.iter().min_by(|x, y| x.after_s.total_cmp(&y.after_s)) {
        set_ttc(&mut conflict, a, b, soonest, meeting.is_none(), scale_sd, limits);
    }
    if let Some(Meeting { kind, angle_rad, .. }) = meeting {
        (conflict.kind, conflict.angle_deg) = (kind, angle_rad.to_degrees());
    }
    if let Some(encroachment) = encroachment {
        set_pet(&mut conflict, a, b, &encroachment, scale_sd, limits);
    }
    // The deceleration is costly: it waits until it matters. It never exceeds half the speed per time to the contact.
    let bound = |e: &Expected| fastest_mps(&e.moment) / (2.0 * e.after_s.max(1e-3));
    let highest = expected.iter().map(bound).fold(0.0, f64::max);
    if conflict.is_listed(limits) || highest >= limits.drac_mps2 / 2.0 {
        set_drac(&mut conflict, a, b, &expected, scale_sd, limits);
    }
    conflict.is_listed(limits).then_some(conflict)
}

fn names(a: &Path<'_>, b: &Path<'_>, swapped: bool) -> Conflict {
    let (first, second) = if swapped { (b, a) } else { (a, b) };
    Conflict { first: first.vehicle.track, second: second.vehicle.track, ..Conflict::default() }
}

fn fastest_mps(moment: &Moment) -> f64 {
    moment.states.iter().map(|(state, _)| f64::from(state.speed_mps.abs())).fold(0.0, f64::max)
}

/// Returns the motions of two vehicles from a moment on.
fn motions<'a>(
    a: &'a Path<'a>,
    b: &'a Path<'a>,
    moment: &Moment,
    limits: &ConflictLimits,
) -> [Motion<'a>; 2] {
    match limits.projection {
        Projection::Path => {
            [Motion::along_path(a, moment.states[0]), Motion::along_path(b, moment.states[1])]
        }
        Projection::Straight => {
            [Motion::straight(a, moment.states[0]), Motion::straight(b, moment.states[1])]
        }
    }
}

/// Returns the moments from which on a contact is expected within the horizon.
fn expected_contacts(a: &Path<'_>, b: &Path<'_>, limits: &ConflictLimits) -> Vec<Expected> {
    let [states_a, states_b] = [&a.vehicle.states, &b.vehicle.states];
    let from_s = states_a[0].time_s.max(states_b[0].time_s);
    let mut next = [states_a, states_b].map(|states| states.partition_point(|state| state.time_s < from_s));
    let mut taken = next;
    let mut last_s = f64::NEG_INFINITY;
    let mut found = Vec::new();
    while let (Some(x), Some(y)) = (states_a.get(taken[0]), states_b.get(taken[1])) {
        let time_s = x.time_s.min(y.time_s);
        taken[0] += usize::from(x.time_s == time_s);
        taken[1] += usize::from(y.time_s == time_s);
        if time_s - last_s < SHORTEST_STEP_S {
            continue;
        }
        last_s = time_s;
        let (Some(at_a), Some(at_b)) = (a.state_at(time_s, &mut next[0]), b.state_at(time_s, &mut next[1]))
        else {
            continue;
        };
        let moment = Moment { time_s, states: [at_a, at_b] };
        if fastest_mps(&moment) < limits.least_speed_mps {
            continue;
        }
        let [motion_a, motion_b] = motions(a, b, &moment, limits);
        if let Some(after_s) = until_contact_s(&motion_a, &motion_b, limits.horizon_s) {
            found.push(Expected { moment, after_s });
        }
    }
    found
}

/// Sets the shortest time to collision. It names the vehicles and the kind if their paths do not meet.
fn set_ttc(
    conflict: &mut Conflict,
    a: &Path<'_>,
    b: &Path<'_>,
    soonest: &Expected,
    names_them: bool,
    scale_sd: Option<f64>,
    limits: &ConflictLimits,
) {
    let [motion_a, motion_b] = motions(a, b, &soonest.moment, limits);
    let contact = contact(&motion_a, &motion_b, soonest.after_s);
    if names_them {
        *conflict = Conflict { exist_p: conflict.exist_p, ..names(a, b, !contact.second_runs_in) };
        conflict.kind = kind(contact.angle_rad, contact.angle_rad);
        conflict.angle_deg = contact.angle_rad.to_degrees();
    }
    let sd_at = |after_s: f64| scale_sd.map(|_| ttc_sd_s(&soonest.moment, &contact, after_s));
    conflict.min_ttc_s = Some(contact.after_s);
    conflict.min_ttc_sd_s = sd_at(contact.after_s);
    conflict.min_ttc_below_p = Some(below_p(contact.after_s, sd_at(limits.ttc_s), limits.ttc_s));
    conflict.min_ttc_at_s = Some(soonest.moment.time_s);
    conflict.relative_speed_mps = Some(contact.relative_speed_mps);
    (conflict.at_s, conflict.x_m, conflict.y_m) =
        (soonest.moment.time_s, contact.place_m.x, contact.place_m.y);
}

/// Returns the sd of a time to collision (s) that is near `after_s`.
fn ttc_sd_s(moment: &Moment, contact: &Contact, after_s: f64) -> f64 {
    let [along_a, along_b] = contact.along_mps;
    let closing_mps = (along_a - along_b).max(0.05);
    let mut variance_m2 = 0.0;
    for (i, (state, _)) in moment.states.iter().enumerate() {
        variance_m2 += state.own_variance_along(&contact.position_axes[i]);
        variance_m2 += (contact.speed_shares[i] * after_s * f64::from(state.own_speed_sd_mps)).powi(2);
    }
    variance_m2.sqrt() / closing_mps
}

fn set_pet(
    conflict: &mut Conflict,
    a: &Path<'_>,
    b: &Path<'_>,
    encroachment: &Encroachment,
    scale_sd: Option<f64>,
    limits: &ConflictLimits,
) {
    let (first, second) = if conflict.first == a.vehicle.track { (a, b) } else { (b, a) };
    let variance_s2 = |path: &Path<'_>, time_s: f64| {
        path.vehicle.at(time_s).map_or(0.0, |state| state.own_variance_along(&encroachment.slope))
    };
    let sd_s = scale_sd.map(|_| {
        (variance_s2(first, encroachment.leaves_s) + variance_s2(second, encroachment.enters_s)).sqrt()
    });
    conflict.pet_s = Some(encroachment.pet_s);
    conflict.pet_sd_s = sd_s;
    conflict.pet_serious_p = Some(below_p(encroachment.pet_s, sd_s, limits.serious_pet_s));
    conflict.pet_below_p = Some(below_p(encroachment.pet_s, sd_s, limits.pet_s));
    (conflict.at_s, conflict.x_m, conflict.y_m) =
        (encroachment.enters_s, encroachment.place_m.x, encroachment.place_m.y);
}

/// Sets the highest deceleration to avoid a crash.
fn set_drac(
    conflict: &mut Conflict,
    a: &Path<'_>,
    b: &Path<'_>,
    expected: &[Expected],
    scale_sd: Option<f64>,
    limits: &ConflictLimits,
) {
    let bound = |e: &Expected| fastest_mps(&e.moment) / (2.0 * e.after_s.max(1e-3));
    let mut order: Vec<(f64, &Expected)> = expected.iter().map(|e| (bound(e), e)).collect();
    order.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.moment.time_s.total_cmp(&y.1.moment.time_s)));
    // A vehicle in a lane brakes until twice the time to the contact.
    let horizon_s = 2.0 * limits.horizon_s;
    let mut highest: Option<(f64, Moment)> = None;
    for (bound, expected) in order {
        if highest.is_some_and(|(value, _)| bound <= value) {
            break;
        }
        let [motion_a, motion_b] = motions(a, b, &expected.moment, limits);
        if let Brake::Needed(value) = brake(&motion_a, &motion_b, horizon_s)
            && highest.is_none_or(|(best, _)| value > best)
        {
            highest = Some((value, expected.moment));
        }
    }
    let Some((value, moment)) = highest else { return };
    let sd = scale_sd.map(|scale_sd| {
        // The scale at the vehicles' places, if it is given.
        let local = moment.states.iter().map(|(state, _)| f64::from(state.scale_sd)).fold(0.0, f64::max);
        let scale_sd = if local > 0.0 { local } else { scale_sd };
        let own = drac_variance(&motions(a, b, &moment, limits), &moment, value, horizon_s);
        (own + (value * scale_sd).powi(2)).sqrt()
    });
    conflict.max_drac_mps2 = Some(value);
    conflict.max_drac_sd_mps2 = sd;
    conflict.max_drac_above_p = Some(1.0 - below_p(value, sd, limits.drac_mps2));
    conflict.max_drac_at_s = Some(moment.time_s);
}

/// Returns the variance of a deceleration (m/s²) from the vehicles' own errors: the sum of squares of central
/// differences over one sd of each error.
fn drac_variance(motions: &[Motion<'_>; 2], moment: &Moment, value: f64, horizon_s: f64) -> f64 {
    let changed = |i: usize, shift_m: Vector2<f64>, faster_mps: f64| {
        let mut changed = *motions;
        let forward = moment.states[i].0.forward();
        changed[i].shift_m = Vector2::new(shift_m.dot(&forward), forward.perp(&shift_m));
        changed[i].speed_mps += faster_mps;
        match brake(&changed[0], &changed[1], horizon_s) {
            Brake::Needed(value) => Some(value),
            Brake::Futile => None,
        }
    };
    let mut variance = 0.0;
    for (i, (state, _)) in moment.states.iter().enumerate() {
        let [x, y] = state.own_sd_m.map(f64::from);
        let steps = [(Vector2::new(x, 0.0), 0.0), (Vector2::new(0.0, y), 0.0)];
        for (shift_m, faster_mps) in
            steps.into_iter().chain([(Vector2::zeros(), state.own_speed_sd_mps.into())])
        {
            let more = changed(i, shift_m, faster_mps).unwrap_or(value);
            let less = changed(i, -shift_m, -faster_mps).unwrap_or(value);
            variance += ((more - less) / 2.0_f64).powi(2);
        }
    }
    variance
}
