//! Tests of the outlier model of keypoints.

#![allow(missing_docs)]

use roadplane_solve::OutlierModel;

#[test]
fn weight_is_the_derivative_of_cost() {
    for model in [OutlierModel::default(), OutlierModel { threshold_squared: 6.0 }, OutlierModel::none()] {
        assert!(model.cost(0.0).abs() < 1e-15);
        for step in 0..400 {
            let s = 0.1 * f64::from(step) + 1e-3;
            let numeric = (model.cost(s + 1e-5) - model.cost(s - 1e-5)) / 2e-5;
            assert!((numeric - model.weight(s)).abs() < 1e-6, "s = {s}");
        }
        assert!(model.cost(1e300).is_finite() && model.weight(1e300).is_finite());
        let most = model.cost_of_wrong();
        assert!(most.is_infinite() || (model.cost(1e3) / most - 1.0).abs() < 0.02);
    }
}
