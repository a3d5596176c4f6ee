//! Car models that are described by their keypoints. Their shapes are not in the shape atlas.

use nalgebra::{Matrix6, Vector3, Vector6};
use roadplane_base::{FullShape, KEYPOINTS, MODES, Shape, ShapeAtlas};
use serde::Deserialize;

use crate::Rng;

/// A car model that is described by its own keypoints.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(try_from = "Entry")]
pub struct CarModel {
    /// Name of the model.
    pub model: String,
    /// Relative frequency with which the model is drawn.
    pub weight: f64,
    /// Keypoints of the model, car frame, m.
    pub keypoints_in_car: [Vector3<f64>; KEYPOINTS],
}

/// A car model in a file.
#[derive(Deserialize)]
struct Entry {
    model: String,
    weight: f64,
    keypoints_in_car: Vec<Vector3<f64>>,
}

impl TryFrom<Entry> for CarModel {
    type Error = String;

    fn try_from(entry: Entry) -> Result<Self, String> {
        let Entry { model, weight, keypoints_in_car } = entry;
        let wrong = |found: Vec<_>| format!("{model}: {} keypoints, not {KEYPOINTS}", found.len());
        let keypoints_in_car = keypoints_in_car.try_into().map_err(wrong)?;
        Ok(Self { model, weight, keypoints_in_car })
    }
}

#[derive(Deserialize)]
struct File {
    cars: Vec<CarModel>,
}

impl CarModel {
    /// Reads car models from the text of a file with the schema `roadplane.cars/1`.
    ///
    /// # Errors
    /// Returns an error if the text is not JSON of that schema, or if a car does not have 36 keypoints.
    pub fn list_from_json(text: &str) -> Result<Vec<Self>, serde_json::Error> {
        Ok(serde_json::from_str::<File>(text)?.cars)
    }

    /// Returns the shape coefficients of the atlas that describe the model best.
    ///
    /// The fit is by least squares. The keypoints' residuals are divided by the residual sds of the atlas, and the
    /// coefficients have the prior N(0, I).
    #[must_use]
    pub fn nearest_shape(&self, atlas: &ShapeAtlas) -> Shape {
        let (mut hessian, mut side) = (Matrix6::identity(), Vector6::zeros());
        for (i, point) in self.keypoints_in_car.iter().enumerate() {
            for axis in 0..3 {
                let sd = atlas.residual_sd_m[i][axis].max(1e-3);
                let row = Vector6::from_fn(|j, _| if j < MODES { atlas.modes[j][i][axis] / sd } else { 0.0 });
                hessian += row * row.transpose();
                side += row * ((point[axis] - atlas.mean[i][axis]) / sd);
            }
        }
        let shape = hessian.cholesky().map_or(side * 0.0, |factor| factor.solve(&side));
        atlas.clamped(&shape)
    }
}

/// Draws one of the models at random, with probabilities proportional to the weights. Returns `None` if there are no
/// models.
pub(crate) fn draw<'a>(models: &'a [CarModel], rng: &mut Rng) -> Option<&'a CarModel> {
    draw_by(models, |model| model.weight, rng)
}

fn draw_by<'a, T>(items: &'a [T], weight: impl Fn(&T) -> f64, rng: &mut Rng) -> Option<&'a T> {
    let last = items.last()?;
    let mut remaining = rng.unit() * items.iter().map(&weight).sum::<f64>();
    let found = items.iter().find(|item| {
        remaining -= weight(item);
        remaining < 0.0
    });
    Some(found.unwrap_or(last))
}

/// Draws the coefficients of all shape modes from the atlas' mixture of body types. Without body types, the
/// coefficients are drawn from N(0, I).
pub fn draw_shape(atlas: &ShapeAtlas, rng: &mut Rng) -> FullShape {
    let body = draw_by(&atlas.body_types, |body| body.share, rng);
    let normal = FullShape::from_fn(|_, _| rng.normal());
    let Some(body) = body else { return normal };
    // The covariance of a body type is positive definite, so this factorisation succeeds.
    body.covariance.cholesky().map_or(normal, |factor| body.mean + factor.l() * normal)
}

/// Moves each keypoint by a random residual times `factor`. The shape modes of the atlas do not describe this residual.
pub(crate) fn move_off_atlas(
    keypoints_in_car: &mut [Vector3<f64>; KEYPOINTS],
    atlas: &ShapeAtlas,
    factor: f64,
    rng: &mut Rng,
) {
    for (point, sd) in keypoints_in_car.iter_mut().zip(&atlas.fine_residual_sd_m) {
        *point += factor * sd.map(|sd| sd * rng.normal());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SynthOptions, scene};

    #[test]
    fn the_nearest_shape_of_an_atlas_car_is_its_own() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let shape = Shape::new(0.5, -1.0, 0.3, 0.8, -0.4, 1.0);
        let model = |shape: &Shape, weight| CarModel {
            model: String::new(),
            weight,
            keypoints_in_car: atlas.keypoints_in_car(shape),
        };
        // The prior reduces the coefficients a little.
        assert!((model(&shape, 1.0).nearest_shape(&atlas) - shape).amax() < 0.1);
        let models = vec![model(&shape, 3.0), model(&-shape, 1.0)];
        let options = SynthOptions { models: models.clone(), ..SynthOptions::default() };
        let mut first = 0;
        for seed in 0..40 {
            for car in scene(&atlas, &options, seed).cars {
                assert!(models.iter().any(|model| model.keypoints_in_car == car.keypoints_in_car));
                first += usize::from(car.keypoints_in_car == models[0].keypoints_in_car);
            }
        }
        assert!((270..330).contains(&first), "{first} of 400");
    }

    #[test]
    fn the_foreign_cars_are_read() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/foreign_cars.json");
        let cars = CarModel::list_from_json(&std::fs::read_to_string(path).unwrap()).unwrap();
        assert!(cars.len() > 10 && cars.iter().all(|car| car.weight > 0.0));
        let atlas = ShapeAtlas::shipped().unwrap();
        for car in &cars {
            let length = car.keypoints_in_car.iter().map(|p| p.x.abs()).fold(0.0, f64::max);
            assert!((1.0..4.5).contains(&length), "{}: {length}", car.model);
            assert!(car.nearest_shape(&atlas).iter().all(|c| c.is_finite()));
        }
    }
}
