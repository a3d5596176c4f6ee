"""Tests of decoding; they need no PyTorch."""

from __future__ import annotations

import json
import unittest

import numpy as np

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.net.decode import Calibration, decode

FIXTURE = REPOSITORY / "tests/data/decoding.json"


class Decoding(unittest.TestCase):
    def test_what_rust_and_python_measure_is_the_same(self) -> None:
        fixture = json.loads(FIXTURE.read_text())
        calibration = Calibration(**fixture["calibration"])
        cells = fixture["cells"]
        self.assertGreaterEqual(len(fixture["cases"]), 4)
        for case in fixture["cases"]:
            logits = np.full((cells, cells), -20.0, np.float32)
            for row, column, logit in np.array(case["logits"]).reshape(-1, 3):
                logits[int(row), int(column)] = logit
            mean, variance = decode(logits, int(cells * fixture["stride_px"]))
            location, covariance = calibration.measurement(mean, variance)
            found = [mean, upper(variance), location, upper(covariance)]
            names = ["mean_crop_px", "variance_crop_px2", "location_crop_px", "covariance_crop_px2"]
            for name, values in zip(names, found, strict=True):
                np.testing.assert_allclose(values, case[name], atol=1e-4, err_msg=f"{case['name']}: {name}")


def upper(matrix: np.ndarray) -> list[float]:
    return [matrix[0, 0], matrix[0, 1], matrix[1, 1]]
