//! Compares each user constraint with all other evidence.

use std::collections::BTreeMap;

use nalgebra::Vector4;
use roadplane_base::{CameraEstimate, ImageSize};
use roadplane_calibrate::{Survey, derivatives_by_camera};
use roadplane_write::ConstraintSummary;

use super::{CameraConstraints, Fact};
use crate::cameras::joining::POPULATION_LOG_SD;

/// Distance from which a constraint contradicts the other evidence, sds.
const CONTRADICTS: f64 = 3.0;
/// Names and units of (log focal length, tilt, roll, log height) in reports.
const NUMBERS: [(&str, &str); 4] = [("focal length", "px"), ("tilt", "°"), ("roll", "°"), ("height", "m")];

impl CameraConstraints {
    /// Compares each constraint with the camera that all other evidence gives. `by` returns the estimates at the camera's
    /// positions from these constraints and the rest of the evidence.
    ///
    /// A constraint is compared at a position for which it holds. Also returns the number of constraints that hold at
    /// no position with an estimate.
    pub(crate) fn checked(
        &self,
        size: ImageSize,
        by: impl Fn(&CameraConstraints) -> BTreeMap<usize, CameraEstimate>,
    ) -> (Vec<ConstraintSummary>, usize) {
        let (mut checked, mut not_compared) = (Vec::new(), 0);
        for (i, fact) in self.facts.iter().enumerate() {
            let mut others = self.clone();
            others.facts.remove(i);
            let holds_at = |position: &usize| *position == 0 || fact.holds_everywhere();
            match by(&others).into_iter().find(|(position, _)| holds_at(position)) {
                Some((_, camera)) => {
                    checked.extend(fact.against(&camera, size, &others.seen_through(camera.lens)));
                }
                None => not_compared += 1,
            }
        }
        (checked, not_compared)
    }
}

/// Returns the contradiction in words; `None` where there is none.
pub(crate) fn contradiction(constraint: &ConstraintSummary) -> Option<String> {
    (constraint.apart_sds > CONTRADICTS)
        .then(|| format!("the {} is {}", constraint.what, in_words(constraint)))
}

/// Returns a warning about constraints that nothing is compared with; `None` if there are none.
pub(crate) fn not_compared_in_words(count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!("{count} of the user constraints cannot be compared with the cars: none are visible where they hold")
    })
}

/// Returns the constraint and the estimate from all other evidence in words.
pub(crate) fn in_words(constraint: &ConstraintSummary) -> String {
    let ConstraintSummary { unit, given, given_sd, by_all_else, by_all_else_sd, apart_sds, .. } = constraint;
    let digits = if unit == "px" { 0 } else { 2 };
    let space = if unit == "°" { "" } else { " " };
    let apart = if *apart_sds > CONTRADICTS { 0 } else { 1 };
    format!(
        "{by_all_else:.digits$} ± {by_all_else_sd:.digits$}{space}{unit} by everything else, \
         but {given:.digits$} ± {given_sd:.digits$}{space}{unit} was given: {apart_sds:.apart$} sd apart"
    )
}

impl Fact {
    /// Compares the constraint with a camera that was estimated from the other constraints, `others`.
    fn against(
        &self,
        camera: &CameraEstimate,
        size: ImageSize,
        others: &CameraConstraints,
    ) -> Vec<ConstraintSummary> {
        let (mean, covariance) = (camera.params.to_vector(), &camera.covariance);
        let number = |which: usize, value: f64, sd: f64, of: &str| {
            let (name, unit) = NUMBERS[which];
            let (else_value, else_sd) = (mean[which], covariance[(which, which)].max(0.0).sqrt());
            // The sds of logs are converted by the delta method.
            let shown = |value: f64, sd: f64| match unit {
                "°" => [value.to_degrees(), sd.to_degrees()],
                _ => [value.exp(), value.exp() * sd],
            };
            summary(
                format!("{name}{of}"),
                unit,
                shown(value, sd),
                shown(else_value, else_sd),
                (value - else_value) / sd.hypot(else_sd),
            )
        };
        match self {
            Self::Number { which, value, sd } => vec![number(*which, *value, *sd, "")],
            Self::Camera { file, survey: Survey { mean, information, by_cars }, .. } => {
                let variance = information.try_inverse().map(|covariance| covariance.diagonal());
                let summaries = (0..4).filter_map(|which| {
                    // The file may have no information on a number.
                    let sd = variance.map_or(1.0 / information[(which, which)], |v| v[which]).sqrt();
                    // A height by cars is as uncertain as their size.
                    let sd = if which == 3 && *by_cars { sd.hypot(POPULATION_LOG_SD) } else { sd };
                    sd.is_finite().then(|| number(which, mean[which], sd, &format!(" of {file}")))
                });
                summaries.collect()
            }
            Self::Length { file, length } => {
                let factor = others.length_factor(length, size);
                let log_metres = |camera: &Vector4<f64>| Some(factor.measured(camera)?.0.ln());
                let found = factor.measured(&mean).zip(derivatives_by_camera(log_metres, &mean));
                let Some(((metres, log_sd), by)) = found else { return Vec::new() };
                let by = Vector4::from(by);
                let else_sd = by.dot(&(covariance * by)).max(0.0).sqrt();
                let name = length.name.as_deref().unwrap_or_default();
                vec![summary(
                    format!("length of {name} of {file}"),
                    "m",
                    [length.length_m, length.length_m * log_sd],
                    [metres, metres * else_sd],
                    (metres / length.length_m).ln() / log_sd.hypot(else_sd),
                )]
            }
        }
    }
}

/// Builds the summary of a comparison, rounded. Each pair is a value and its sd; `apart` is the distance in sds.
fn summary(
    what: String,
    unit: &str,
    given: [f64; 2],
    by_all_else: [f64; 2],
    apart: f64,
) -> ConstraintSummary {
    let rounded = |value: f64| (value * 1e4).round() / 1e4;
    ConstraintSummary {
        what,
        unit: unit.to_owned(),
        given: rounded(given[0]),
        given_sd: rounded(given[1]),
        by_all_else: rounded(by_all_else[0]),
        by_all_else_sd: rounded(by_all_else[1]),
        apart_sds: (apart.abs() * 100.0).round() / 100.0,
    }
}
