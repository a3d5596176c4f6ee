"""Tests of the scale of scenes."""

from __future__ import annotations

import unittest

import numpy as np

from roadplane_train.cars.scale import Estimate, KeypointType, estimate, scene_error

TRUE_LOG_SCALE = 0.07


class Scale(unittest.TestCase):
    def test_cars_of_the_model_give_their_scale_as_well_as_they_claim(self) -> None:
        rng = np.random.default_rng(3)
        mean, modes = rng.normal(0, 1, 54), rng.normal(0, 0.1, (5, 54))
        covariance = modes.T @ modes + np.diag(rng.uniform(0.01, 0.05, 54) ** 2)
        # These differ in size alone, so the type of a car is often ambiguous.
        other = 1.03 * mean + rng.normal(size=5) @ modes
        types = [KeypointType(0.7, mean, covariance), KeypointType(0.3, other, covariance)]
        standardised = []
        for _ in range(200):
            body = types[int(rng.random() < 0.3)]
            measured = np.exp(TRUE_LOG_SCALE) * rng.multivariate_normal(body.mean, body.covariance)
            measured[rng.permutation(54)[:9]] = np.nan
            found = estimate(measured, types)
            standardised.append((found.log_scale - TRUE_LOG_SCALE) * np.sqrt(found.information))
            self.assertEqual(found.numbers, 45)
        self.assertLess(abs(np.mean(standardised)), 4 / np.sqrt(200))
        self.assertAlmostEqual(float(np.std(standardised)), 1.0, delta=4 / np.sqrt(400))

    def test_a_car_that_fits_badly_says_less(self) -> None:
        good = Estimate(log_scale=0.0, information=100.0, misfit=50.0, numbers=54)
        odd = Estimate(log_scale=0.2, information=100.0, misfit=540.0, numbers=54)
        self.assertAlmostEqual(scene_error([good, good]), 0.0)
        self.assertLess(scene_error([good, odd]), 0.02)
