"""Tests of cameras around a copied scene, of fitting models, and of the comparison of a run with a filmed scene.

No drawing.
"""

import json
import tempfile
import unittest
from pathlib import Path

import numpy as np
import pytest

from roadplane_train.render.copy import Garage, fitted_keypoints, rolled, view_of
from roadplane_train.render.copy_boxes import Meshes, overlap
from roadplane_train.render.copy_loop import fitted, pairs, truth

pytestmark = pytest.mark.egl

CAMERA = {"image_size_px": [1280, 720], "focal_px": 1400.0, "height_m": 8.0, "tilt_rad": 0.3, "roll_rad": 0.02}


def scene() -> dict:
    """Returns a moving car that passes a stationary one."""
    trajectory = [
        {"time_s": 0.0, "x_m": -6.0, "y_m": 24.0, "heading_rad": 0.2},
        {"time_s": 5.0, "x_m": 6.0, "y_m": 27.0, "heading_rad": 0.2},
    ]
    stationary = [{"time_s": 0.0, "x_m": 1.0, "y_m": 31.0, "heading_rad": 1.5}]
    car = {"class": "car", "dims_m": [4.6, 1.8, 1.5], "shape": [0.3, 0, 0, 0, 0, 0], "span_s": [0.0, 5.0], "colour": [90, 20, 20]}
    return {
        "camera": CAMERA,
        "span_s": [0.0, 5.0],
        "vehicles": [{"track": 1, "trajectory": trajectory, **car}, {"track": 2, "trajectory": stationary, **car}],
    }


class CopyTest(unittest.TestCase):
    def test_views_look_at_the_traffic(self) -> None:
        middle = np.array([1.0, 27.0])
        for name in ("opposite", "side", "above"):
            view = view_of(name, scene())
            pose = view.place(*middle, 0.0)
            pixel, depth = view.camera.pixel_from_world(pose[None, :3, 3])
            self.assertLess(np.abs(pixel[0] - view.camera.principal_point_px).max(), 1e-6, name)
            self.assertGreater(depth[0], 20)
        self.assertAlmostEqual(view_of("side", scene()).camera.height_m, 12.0)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "camera.json")
            file.write_text(json.dumps({**CAMERA, "height_m": 5.0, "foot": [3, 4, 0.5]}))
            self.assertEqual(view_of(str(file), scene()).foot, (3, 4, 0.5))
            file.write_text(json.dumps(CAMERA))
            self.assertEqual(view_of(str(file), scene()), view_of("same", scene()))
        same = view_of("same", scene())
        np.testing.assert_allclose(same.place(3, 20, 0.7)[:2, 3], [3, 20])

    def test_a_model_has_the_dimensions_and_nearly_the_points(self) -> None:
        vehicle = scene()["vehicles"][0]
        mesh = Garage(Meshes()).of(vehicle)
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0)[[0, 2]], [4.6, 1.5], atol=0.15)
        self.assertLess(np.sqrt(np.nanmean((mesh.keypoints - fitted_keypoints(vehicle["shape"])) ** 2)), 0.12)

    def test_a_turned_shifted_and_scaled_run_is_fitted(self) -> None:
        view, times = view_of("side", scene()), np.arange(0, 5.01, 0.1)
        true, seen = truth(scene(), view, times)
        self.assertEqual(set(seen), {1, 2})
        turn, shift = 1.04 * np.exp(0.05j), 0.4 - 0.3j
        found = {}
        for track, rows in true.items():
            place = (rows[:, 1:3] @ [1, 1j] - shift) / turn
            found[track + 10] = np.column_stack([rows[:, 0], place.real, place.imag, rows[:, 3] - 0.05])
        matched = pairs(true, found, 1.04, 0.1)
        self.assertEqual([pair[0] for pair in matched], [1, 2])
        again = fitted(*(np.concatenate([pair[i] for pair in matched])[:, 1:3] for i in (1, 2)))
        np.testing.assert_allclose(again, (turn, shift), atol=1e-9)

    def test_wheels_roll_as_far_as_the_car_drives_and_back(self) -> None:
        trajectory = np.array([[0, 0, 0, 1.5], [1, 3 * np.cos(1.5), 3 * np.sin(1.5), 1.5], [2, np.cos(1.5), np.sin(1.5), 1.5]])
        np.testing.assert_allclose(rolled(trajectory), [0, 3, 1], atol=1e-12)

    def test_overlap(self) -> None:
        self.assertAlmostEqual(overlap(np.array([0, 0, 2, 2.0]), np.array([1, 0, 3, 2.0])), 1 / 3)
