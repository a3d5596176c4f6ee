//! Measures one car's keypoints: errors, exchanged names, and how well the scores separate visible from hidden
//! keypoints.

use nalgebra::Vector2;
use roadplane_base::{KEYPOINTS, KeypointSet, mirror_index};
use roadplane_tables::median;

use super::labels::LabelledCar;

/// For each of the 18 keypoints of one side: the index of the matching keypoint at the other end of the car.
///
/// Mirror and B-pillar have no match and map to themselves.
const OTHER_END: [usize; KEYPOINTS / 2] = [1, 0, 3, 2, 6, 7, 4, 5, 9, 8, 13, 12, 11, 10, 14, 16, 15, 17];
/// Least number of clearly visible keypoints at which exchanged names are detected.
const MIN_CLEAR: usize = 4;

/// A kind of mistake in which the net exchanges the names of keypoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Confusion {
    /// The net exchanges left and right.
    LeftRight,
    /// The net exchanges front and back.
    FrontBack,
    /// The net exchanges both, as if the car were turned by 180°.
    TurnedRound,
}

impl Confusion {
    /// All kinds of exchanged names.
    pub const ALL: [Self; 3] = [Self::LeftRight, Self::FrontBack, Self::TurnedRound];

    fn exchanged(self, index: usize) -> usize {
        let half = KEYPOINTS / 2;
        let other_end = |i: usize| OTHER_END[i % half] + i / half * half;
        match self {
            Self::LeftRight => mirror_index(index),
            Self::FrontBack => other_end(index),
            Self::TurnedRound => mirror_index(other_end(index)),
        }
    }
}

/// The error of a keypoint whose label is clearly visible.
#[derive(Clone, Copy, Debug)]
pub struct PointError {
    /// Index of the keypoint.
    pub index: usize,
    /// Distance between predicted and labelled position, in units of the longer side of the car's box.
    pub of_box: f64,
    /// (Predicted position − labelled position) / predicted sd, for x and y.
    pub normalised: [f64; 2],
    /// Predicted score of the keypoint, 0–1.
    pub score: f64,
}

/// The errors of a car's keypoints.
#[derive(Clone, Debug, Default)]
pub struct CarErrors {
    /// Longer side of the car's labelled box, px.
    pub box_px: f64,
    /// Body type of the car; may be empty.
    pub body: String,
    /// Errors of the keypoints whose labels are clearly visible. An error is infinite if the net did not find the
    /// keypoint.
    pub points: Vec<PointError>,
    /// Predicted scores of the keypoints that are labelled as hidden or blurred.
    pub hidden_scores: Vec<f64>,
    /// The exchange of names that fits the labels better than the predicted names; `None` if there is none.
    pub confusion: Option<Confusion>,
}

impl CarErrors {
    /// Returns the median error in units of the longer side of the car's box; NaN if no label is clearly visible.
    #[must_use]
    pub fn median(&self) -> f64 {
        median(&self.points.iter().map(|p| p.of_box).collect::<Vec<_>>())
    }
}

/// Compares a car's predicted keypoints with the labels. A clear label whose keypoint was not found gets an infinite
/// error.
#[must_use]
pub fn measure(car: &LabelledCar, found: &KeypointSet) -> CarErrors {
    let [x0, y0, x1, y1] = car.bbox_px;
    let mut errors = CarErrors {
        box_px: (x1 - x0).max(y1 - y0),
        body: car.body.clone(),
        confusion: confusion(car, found),
        ..CarErrors::default()
    };
    for (index, (label, found)) in car.labels.iter().zip(found).enumerate() {
        let Some(label) = label else { continue };
        match (label.clear, found) {
            (true, Some(found)) => {
                let off = found.pixel - label.pixel;
                let sd = |i: usize| found.covariance_px2[(i, i)].sqrt();
                errors.points.push(PointError {
                    index,
                    of_box: off.norm() / errors.box_px,
                    normalised: [off.x / sd(0), off.y / sd(1)],
                    score: found.score,
                });
            }
            (true, None) => errors.points.push(PointError {
                index,
                of_box: f64::INFINITY,
                normalised: [f64::INFINITY; 2],
                score: 0.0,
            }),
            (false, found) => errors.hidden_scores.push(found.map_or(0.0, |f| f.score)),
        }
    }
    errors
}

/// Returns the exchange of names with the smallest median error.
///
/// Returns `None` if the predicted names have no larger error, or if too few labels are clear.
#[must_use]
pub fn confusion(car: &LabelledCar, found: &KeypointSet) -> Option<Confusion> {
    let clear: Vec<(usize, Vector2<f64>)> = car
        .labels
        .iter()
        .enumerate()
        .filter_map(|(i, label)| label.filter(|l| l.clear).map(|l| (i, l.pixel)))
        .collect();
    if clear.len() < MIN_CLEAR {
        return None;
    }
    let misfit = |name: &dyn Fn(usize) -> usize| {
        let off = |(i, true_px): &(usize, Vector2<f64>)| {
            found[name(*i)].map_or(f64::INFINITY, |f| (f.pixel - true_px).norm())
        };
        median(&clear.iter().map(off).collect::<Vec<_>>())
    };
    let kinds = Confusion::ALL.map(|kind| (misfit(&|i| kind.exchanged(i)), kind));
    let (least, kind) = kinds.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    (least < misfit(&|i| i)).then_some(kind)
}

/// Returns the area under the ROC curve (Fawcett 2006); NaN if `above` or `below` is empty.
///
/// This area is the probability that a random value of `above` is larger than a random value of `below`. Ties count
/// half.
#[must_use]
pub fn auc(above: &[f64], below: &[f64]) -> f64 {
    let mut sorted = below.to_vec();
    sorted.sort_by(f64::total_cmp);
    let beaten = |score: &f64| {
        let less = sorted.partition_point(|b| b < score);
        let no_more = sorted.partition_point(|b| b <= score);
        (less + no_more) as f64 / 2.0
    };
    above.iter().map(beaten).sum::<f64>() / (above.len() as f64 * below.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::super::labels::Label;
    use super::*;
    use roadplane_base::{Keypoint, keypoint_names};

    /// A car whose keypoints lie on a 6 × 6 grid of 10 px.
    fn car() -> LabelledCar {
        let labels = std::array::from_fn(|i| {
            let pixel = Vector2::new((i % 6) as f64 * 10.0, (i / 6) as f64 * 10.0);
            Some(Label { pixel, clear: i % 3 != 0 })
        });
        LabelledCar { bbox_px: [0.0, 0.0, 100.0, 60.0], body: "sedan".to_owned(), labels }
    }

    fn prediction(name: impl Fn(usize) -> usize) -> KeypointSet {
        let car = car();
        std::array::from_fn(|i| {
            let label = car.labels[name(i)].unwrap();
            Some(Keypoint::isotropic(label.pixel + Vector2::new(3.0, -4.0), 0.5, 2.0))
        })
    }

    #[test]
    fn errors_are_in_units_of_the_box_and_of_the_sd() {
        let errors = measure(&car(), &prediction(|i| i));
        assert_eq!((errors.points.len(), errors.hidden_scores.len()), (24, 12));
        assert!((errors.median() - 0.05).abs() < 1e-12);
        assert_eq!(errors.points[0].normalised, [1.5, -2.0]);
        assert_eq!(errors.confusion, None);
    }

    #[test]
    fn exchanged_names_are_recognised() {
        for kind in Confusion::ALL {
            let errors = measure(&car(), &prediction(|i| kind.exchanged(i)));
            assert_eq!(errors.confusion, Some(kind));
        }
        let names = keypoint_names();
        for (i, name) in names.iter().enumerate() {
            let other = &names[Confusion::FrontBack.exchanged(i)];
            let swapped = name
                .replace("front", "•")
                .replace("rear", "front")
                .replace('•', "rear")
                .replace("headlight", "•")
                .replace("taillight", "headlight")
                .replace('•', "taillight")
                .replace("windscreen", "•")
                .replace("front_window", "windscreen")
                .replace('•', "rear_window");
            assert_eq!(*other, swapped, "the other end of {name}");
        }
    }

    #[test]
    fn a_missing_keypoint_counts_as_wrong() {
        let mut found = prediction(|i| i);
        found[1] = None;
        assert!(measure(&car(), &found).points[0].of_box.is_infinite());
    }

    #[test]
    fn auc_counts_pairs() {
        assert_eq!(auc(&[0.9, 0.8], &[0.1, 0.2]), 1.0);
        assert_eq!(auc(&[0.5, 0.9], &[0.5, 0.7]), (0.5 + 0.0 + 1.0 + 1.0) / 4.0);
        assert!(auc(&[], &[0.5]).is_nan());
    }
}
