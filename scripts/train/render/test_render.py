"""Tests of the renderer: frames and signs of `crates/base`, truth against the picture, repeatable shards."""

from __future__ import annotations

import unittest

import numpy as np
import pytest

from roadplane_train.cars.builder import sample_car
from roadplane_train.render import crops
from roadplane_train.render.appearance import Light, sample_car_appearance, sample_ground
from roadplane_train.render.camera import Camera, world_from_car
from roadplane_train.render.degrade import degrade
from roadplane_train.render.renderer import Renderer
from roadplane_train.render.scene import Floor, PlacedCar, Scene

pytestmark = pytest.mark.egl

CAMERA = Camera((1280, 720), 1500.0, 8.0, np.radians(15), 0.0)


class CameraTest(unittest.TestCase):
    """Tests of signs and frames."""

    def test_optical_axis_meets_the_ground_ahead(self) -> None:
        point = np.array([[0.0, 8.0 / np.tan(np.radians(15)), 0.0]])
        pixel, depth = CAMERA.pixel_from_world(point)
        np.testing.assert_allclose(pixel[0], (639.5, 359.5), atol=1e-9)
        self.assertAlmostEqual(depth[0], 8.0 / np.sin(np.radians(15)))

    def test_positive_roll_turns_the_horizon_clockwise(self) -> None:
        rolled = Camera((1280, 720), 1500.0, 8.0, np.radians(15), 0.1)
        pixel, _ = rolled.pixel_from_world(np.array([[-1e6, 1e7, 0], [1e6, 1e7, 0]]))
        self.assertGreater(pixel[1, 1], pixel[0, 1])  # the right end is lower

    def test_plane_contains_ground_points(self) -> None:
        normal, offset = Camera((1280, 720), 900.0, 6.0, 0.4, -0.05).plane_in_camera
        pose = Camera((1280, 720), 900.0, 6.0, 0.4, -0.05).camera_from_world
        ground = np.array([[3.0, 20, 0], [-8, 11, 0]]) @ pose[:3, :3].T + pose[:3, 3]
        np.testing.assert_allclose(ground @ normal + offset, 0, atol=1e-12)

    def test_ground_from_pixel_inverts_projection(self) -> None:
        point = CAMERA.ground_from_pixel(np.array([100.0, 600.0]))
        np.testing.assert_allclose(CAMERA.pixel_from_world(point[None])[0][0], (100, 600), atol=1e-9)
        self.assertIsNone(CAMERA.ground_from_pixel(np.array([640.0, -500.0])))


class PictureTest(unittest.TestCase):
    """Tests of the truth against the picture."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.renderer = Renderer()
        rng = np.random.default_rng(4)
        cls.car = cls.renderer.upload(sample_car(rng, body="sedan"))
        cls.other = cls.renderer.upload(sample_car(rng, body="van"))
        cls.rng = rng

    def scene(self, *cars: tuple) -> Scene:
        """Returns cars given as (gpu, x, y, heading) on asphalt under an overcast sky."""
        rng = np.random.default_rng(1)
        floor = Floor((sample_ground(rng, "asphalt"), sample_ground(rng, "grass")))
        placed = [PlacedCar(gpu, sample_car_appearance(rng), world_from_car(x, y, heading)) for gpu, x, y, heading in cars]
        light = Light(np.array([0, 0, 1.0]), np.zeros(3), np.ones(3) * 0.6, 0.1, 0.0, 0.0, 0, 1.0, 0.0)
        scene = Scene(placed, [], floor, light, np.zeros(3), 20.0)
        scene.set_exposure(0.25)
        return scene

    def test_silhouette_fills_the_projected_box(self) -> None:
        scene = self.scene((self.car, 0.0, 28.0, 0.5))
        alone, seen, depth = self.renderer.truth(scene, CAMERA, (-0.5, -0.5, 1280, 720), (1280, 720))
        pixels, _ = CAMERA.pixel_from_world(crops.in_world(self.car.mesh.vertices, scene.cars[0].world_from_car))
        rows, columns = np.nonzero(seen == 1)
        drawn = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        np.testing.assert_allclose(drawn, np.concatenate([pixels.min(0), pixels.max(0)]), atol=1.6)
        np.testing.assert_array_equal(alone, seen == 1)
        self.assertLess(abs(depth[seen == 1].mean() - 28.5), 2.0)

    def test_near_side_is_visible_and_far_side_hidden(self) -> None:
        scene = self.scene((self.car, 0.0, 28.0, 0.0))  # drives to the right: its right side faces the camera
        seen = crops.visible_part(self.renderer, scene, CAMERA, 0)
        self.assertTrue(seen.visible[18:22].all())  # wheels and tyres
        self.assertFalse(seen.visible[0:4].any())
        self.assertGreater(seen.keypoints[18, 0], seen.keypoints[19, 0])  # front wheel right of the rear one

    def test_car_in_front_hides(self) -> None:
        scene = self.scene((self.car, 0.0, 28.0, 0.0), (self.other, 1.0, 25.0, 0.0))
        alone = crops.visible_part(self.renderer, self.scene((self.car, 0.0, 28.0, 0.0)), CAMERA, 0)
        seen = crops.visible_part(self.renderer, scene, CAMERA, 0)
        self.assertEqual(alone.share, 1.0)
        self.assertLess(seen.share, 0.6)
        self.assertLess(seen.visible.sum(), alone.visible.sum())

    def test_picture_shows_the_car_where_truth_says(self) -> None:
        empty, scene = self.scene(), self.scene((self.car, 0.0, 28.0, 0.5))
        window, size = (-0.5, -0.5, 1280, 720), (640, 360)
        change = (
            np.abs(
                self.renderer.colour(scene, CAMERA, window, size).astype(int) - self.renderer.colour(empty, CAMERA, window, size)
            ).max(2)
            > 8
        )
        _, seen, _ = self.renderer.truth(scene, CAMERA, window, size)
        self.assertGreater(change[seen == 1].mean(), 0.85)
        self.assertLess(change[:, :150].mean(), 0.01)

    def test_shards_repeat_and_follow_the_crop_contract(self) -> None:
        first, again = (crops.Generator("train", 5, [], self.renderer).shard(3, count=6) for _ in range(2))
        for name, array in first.items():
            np.testing.assert_array_equal(array, again[name])
        self.assertEqual(first["image"].shape, (6, 128, 128, 3))
        whole = first["share"] > 0.98
        low, high = np.nanmin(first["keypoints"][whole], 1), np.nanmax(first["keypoints"][whole], 1)
        sides = first["box_side_px"][whole]
        self.assertTrue((sides < 128 / crops.CROP_SCALE * 1.1).all())
        grey = (first["image"][whole] == 128).all(3)  # beyond the frame's edge
        cut = grey.all(1).any(1) | grey.all(2).any(1)
        self.assertFalse(cut.all())
        np.testing.assert_array_less((high - low).max(1)[~cut], sides[~cut] * 1.02 + 1)

    def test_hidden_views_hide_a_part_of_every_car(self) -> None:
        first, again = (crops.Generator("train", 5, [], self.renderer, views="hidden").shard(3, count=4) for _ in range(2))
        for name, array in first.items():
            np.testing.assert_array_equal(array, again[name])
        self.assertLessEqual(first["share"].max(), crops.HIDDEN_BELOW)
        hidden = np.isfinite(first["keypoints"][..., 0]) & (first["visible"] == 0)
        self.assertTrue(hidden.any(1).all())


class DegradeTest(unittest.TestCase):
    """Tests that any size is accepted."""

    def test_sizes(self) -> None:
        rng = np.random.default_rng(0)
        for size in (34, 35, 77, 204):
            image = rng.integers(0, 255, (size, size, 3), dtype=np.uint8)
            for _ in range(20):
                worse = degrade(rng, image)
                self.assertEqual((worse.shape, worse.dtype), (image.shape, image.dtype))
