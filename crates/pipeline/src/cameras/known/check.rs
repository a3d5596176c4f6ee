//! Compares each user constraint with all other evidence.

use nalgebra::Vector4;
use roadplane_base::{CameraEstimate, ImageSize};
use roadplane_calibrate::{Number, Survey};
use roadplane_write::ConstraintSummary;

use super::{CameraConstraints, Fact};

/// Distance from which a constraint contradicts the other evidence, sds.
const CONTRADICTS: f64 = 3.0;
/// Step of the numerical derivatives, log or rad.
const STEP: f64 = 1e-5;
/// Names and units of (log focal length, tilt, roll, log height) in reports.
const NUMBERS: [(&str, &str); 4] = [("focal length", "px"), ("tilt", "°"), ("roll", "°"), ("height", "m")];

impl CameraConstraints {
    /// Compares each fact with the camera that `without(i)` finds when fact `i` is left out.
    pub(crate) fn checked(
        &self,
        size: ImageSize,
        without: impl Fn(&CameraConstraints) -> Option<CameraEstimate>,
    ) -> Vec<ConstraintSummary> {
        let mut checked = Vec::new();
        for (i, fact) in self.facts.iter().enumerate() {
            let mut others = self.clone();
            others.facts.remove(i);
            if let Some(camera) = without(&others) {
                checked.extend(fact.against(&camera, size, &others.seen_through(camera.lens)));
            }
        }
        checked
    }
}

/// Returns the contradiction in words; `None` where there is none.
pub(crate) fn contradiction(known: &ConstraintSummary) -> Option<String> {
    (known.apart_sds > CONTRADICTS).then(|| format!("the {} is {}", known.what, in_words(known)))
}

/// Returns the constraint and the estimate from all other evidence in words.
pub(crate) fn in_words(known: &ConstraintSummary) -> String {
    let ConstraintSummary { unit, given, given_sd, by_all_else, by_all_else_sd, apart_sds, .. } = known;
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
            Self::Number(Number { which, value, sd }) => vec![number(*which, *value, *sd, "")],
            Self::Camera { file, survey: Survey { mean, information, .. }, .. } => {
                let variance = information.try_inverse().map(|covariance| covariance.diagonal());
                let told = (0..4).filter_map(|which| {
                    // The file may have no information on a number.
                    let variance = variance.map_or(1.0 / information[(which, which)], |v| v[which]);
                    variance
                        .is_finite()
                        .then(|| number(which, mean[which], variance.sqrt(), &format!(" of {file}")))
                });
                told.collect()
            }
            Self::Length { file, length } => {
                let known = others.on_ground(length, size);
                let Some((metres, log_sd)) = known.measured(&mean) else { return Vec::new() };
                let by = Vector4::from_fn(|i, _| {
                    let moved = |step: f64| {
                        known.measured(&(mean + Vector4::ith(i, step))).map(|(metres, _)| metres.ln())
                    };
                    moved(STEP).zip(moved(-STEP)).map_or(0.0, |(plus, minus)| (plus - minus) / (2.0 * STEP))
                });
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
