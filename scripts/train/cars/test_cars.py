"""Tests of built cars and of the atlas."""

from __future__ import annotations

import json
import unittest

import numpy as np

from roadplane_train.cars.builder import build, named_cars, sample_car
from roadplane_train.cars.mesh import BODY_TYPES, KEYPOINT_NAMES, MATERIALS, MIRROR, REPOSITORY, CarMesh
from roadplane_train.cars.specs import SPECS, TRAFFIC_SHARE
from roadplane_train.cars.style import sample_style

FLIP = np.array([1.0, -1.0, 1.0])


def distance_to_surface(point: np.ndarray, triangles: np.ndarray) -> float:
    """Smallest distance from a point to triangles (n, 3, 3), by dense sampling of the near ones."""
    near = np.linalg.norm(triangles.mean(1) - point, axis=1)
    close = triangles[np.argsort(near)[:60]]
    a, b = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21))
    inside = a + b <= 1
    weights = np.stack([a[inside], b[inside], 1 - a[inside] - b[inside]], 1)
    samples = np.einsum("sk,nkx->nsx", weights, close)
    return float(np.linalg.norm(samples - point, axis=2).min())


def every_body(seed: int) -> list[CarMesh]:
    rng = np.random.default_rng(seed)
    return [sample_car(rng, body, split) for body in BODY_TYPES for split in ("train", "eval")]


class Cars(unittest.TestCase):
    def test_keypoints_lie_on_the_surface(self) -> None:
        """The tolerance is 1.5 cm; the tyre's contact lies below its rounded shoulder, hence 3 cm there."""
        for car in every_body(1):
            triangles = car.vertices[car.faces].astype(float)
            for name, point in zip(KEYPOINT_NAMES, car.keypoints):
                if np.isfinite(point).all():
                    limit = 0.03 if "tyre" in name else 0.015
                    self.assertLess(distance_to_surface(point, triangles), limit, f"{car.name} {name}")

    def test_lamp_and_window_corners_touch_their_material(self) -> None:
        wanted = {
            "headlight": "headlamp",
            "taillight": "taillamp",
            "windscreen": "glass",
            "rear_window": "glass",
        }
        for car in every_body(2):
            for name, point in zip(KEYPOINT_NAMES, car.keypoints):
                for word, material in wanted.items():
                    if word in name:
                        triangles = car.vertices[car.material_faces(material)].astype(float)
                        self.assertLess(distance_to_surface(point, triangles), 0.02, f"{car.name} {name}")

    def test_symmetric(self) -> None:
        for car in every_body(3):
            np.testing.assert_allclose(car.keypoints[MIRROR] * FLIP, car.keypoints, atol=1e-12)

    def test_size_is_the_declared_one(self) -> None:
        """The paint fills length and height (dark bumpers and spoilers leave a margin); the wheels touch z = 0."""
        for car in every_body(4):
            paint = car.vertices[np.unique(car.faces[car.materials == MATERIALS.index("paint")])]
            length = np.ptp(paint[:, 0])
            self.assertAlmostEqual(length, car.dims[0], delta=0.15, msg=car.name)
            self.assertLess(length, car.dims[0] + 0.02, car.name)
            self.assertAlmostEqual(paint[:, 2].max(), car.dims[2], delta=0.05, msg=car.name)
            self.assertAlmostEqual(float(car.vertices[:, 2].min()), 0.0, delta=0.01, msg=car.name)

    def test_faces_are_wound_like_their_normals(self) -> None:
        for car in every_body(5):
            a, b, c = (car.vertices[car.faces[:, i]].astype(float) for i in range(3))
            cross = np.cross(b - a, c - a)
            area = np.linalg.norm(cross, axis=1)
            mean = car.normals[car.faces].astype(float).mean(1)
            agree = (cross * mean).sum(1) > 0
            self.assertGreater((area * agree).sum() / area.sum(), 0.99, car.name)

    def test_same_seed_same_car(self) -> None:
        one, two = (sample_car(np.random.default_rng(9)) for _ in range(2))
        np.testing.assert_array_equal(one.vertices, two.vertices)
        np.testing.assert_array_equal(one.materials, two.materials)

    def test_splits_share_no_model(self) -> None:
        names = {split: {s.name for s in SPECS if s.split == split} for split in ("train", "eval")}
        self.assertFalse(names["train"] & names["eval"])
        self.assertEqual({car.name for car in named_cars("eval")}, names["eval"])
        for body in BODY_TYPES:
            for split, known in names.items():
                self.assertIn(sample_style(np.random.default_rng(0), body, split).name, known)
        self.assertAlmostEqual(sum(TRAFFIC_SHARE.values()), 1.0)

    def test_many_styles_build(self) -> None:
        for seed in range(60):
            rng = np.random.default_rng(1000 + seed)
            car = build(sample_style(rng), rng)
            self.assertTrue(np.isfinite(car.vertices).all() and np.isfinite(car.normals).all(), car.name)
            self.assertLess(len(car.faces), 20_000)

    def test_a_van_with_a_short_bonnet_builds(self) -> None:
        car = sample_car(np.random.default_rng([77, 2, 71]), split="train")
        self.assertEqual(car.body, "van")


class Atlas(unittest.TestCase):
    def setUp(self) -> None:
        self.atlas = json.loads((REPOSITORY / "models" / "atlas.json").read_text())

    def test_exactly_symmetric(self) -> None:
        for shape in (self.atlas["mean"], *self.atlas["modes"], *self.atlas["fine_modes"]):
            shape = np.array(shape)
            np.testing.assert_array_equal(shape[MIRROR] * FLIP, shape)

    def test_explains_a_new_car(self) -> None:
        """Within bounds, six coefficients bring eval models' keypoints to 10 cm RMS, dims to 30 cm."""
        mean, modes = np.array(self.atlas["mean"]), np.array(self.atlas["modes"])
        errors, size_errors = [], []
        for car in named_cars("eval"):
            seen = np.isfinite(car.keypoints[:, 0])
            design = modes[:, seen].reshape(6, -1).T
            shape, *_ = np.linalg.lstsq(design, (car.keypoints - mean)[seen].ravel(), rcond=None)
            low, high = np.array(self.atlas["bounds"]).T
            shape = shape.clip(low, high)
            errors.append(np.linalg.norm((mean + np.tensordot(shape, modes, 1) - car.keypoints)[seen], axis=1))
            size_errors.append(self.atlas["dims_mean"] + shape @ np.array(self.atlas["dims_modes"]) - car.dims)
        self.assertLess(np.sqrt(np.mean(np.concatenate(errors) ** 2)), 0.10)
        self.assertLess(np.abs(size_errors).max(), 0.30)

    def test_body_types_together_are_traffic(self) -> None:
        share = np.array([body["share"] for body in self.atlas["body_types"]])
        means = np.array([body["mean"] for body in self.atlas["body_types"]])
        within = np.array([body["covariance"] for body in self.atlas["body_types"]])
        self.assertAlmostEqual(share.sum(), 1.0, places=3)
        np.testing.assert_allclose(share @ means, 0.0, atol=0.05)
        variance = share @ np.array([np.diag(covariance) for covariance in within]) + share @ means**2
        np.testing.assert_allclose(variance, 1.0, atol=0.25)

    def test_body_types_know_a_new_car(self) -> None:
        modes = np.array([*self.atlas["modes"], *self.atlas["fine_modes"]])
        right, cars = 0, named_cars("eval")
        for car in cars:
            seen = np.isfinite(car.keypoints[:, 0])
            design = modes[:, seen].reshape(12, -1).T
            shape, *_ = np.linalg.lstsq(design, (car.keypoints - np.array(self.atlas["mean"]))[seen].ravel(), rcond=None)

            def log_likelihood(body: dict, shape: np.ndarray = shape) -> float:
                off, covariance = shape - body["mean"], np.array(body["covariance"])
                volume = np.linalg.slogdet(covariance)[1]
                return np.log(body["share"]) - 0.5 * (off @ np.linalg.solve(covariance, off) + volume)

            right += max(self.atlas["body_types"], key=log_likelihood)["name"] == car.body
        self.assertGreater(right, 0.8 * len(cars))
