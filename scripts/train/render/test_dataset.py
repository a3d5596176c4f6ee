"""Tests of rendered data sets: repeatable items, and clips redrawn in parts that equal whole frames (need EGL)."""

from __future__ import annotations

import unittest

import numpy as np
import pytest

from roadplane_train.render.appearance import sample_light
from roadplane_train.render.camera import Camera, world_from_car
from roadplane_train.render.clips import Clip, sample_clip
from roadplane_train.render.dataset import still_truth
from roadplane_train.render.frames import SUPERSAMPLING, Canvas, ExactCanvas, box_corners, draw, merged, outline, reached_region
from roadplane_train.render.long_clips import sample_long_clip
from roadplane_train.render.renderer import Renderer
from roadplane_train.render.stills import SIZE, CarPool, sample_still
from roadplane_train.render.traffic import in_picture

pytestmark = pytest.mark.egl

LONG_SIZE = (480, 270)


class DatasetTest(unittest.TestCase):
    """Tests on scenes of the eval split, with built cars only."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.renderer = Renderer(shadow_size=1024)

    def long_clip(self) -> Clip:
        """Returns a small and short clip of 12 cars of which 3 drive."""
        pool = CarPool(self.renderer, "eval", 9, [])
        return sample_long_clip(np.random.default_rng([9, 1, 0]), pool, "sun", LONG_SIZE, 20.0, 10.0, 12, 3)

    def test_a_still_depends_on_its_seed_alone(self) -> None:
        records = []
        for first in (0, 1):
            pool = CarPool(self.renderer, "eval", 9, [])
            for number in range(first, 2):  # the second time without the still before it
                still = sample_still(np.random.default_rng([9, 0, number, 0]), pool)
            records.append(still_truth(self.renderer, still))
        self.assertGreater(len(records[0]), 4)
        self.assertEqual(*records)

    def test_clip_redrawn_in_regions_equals_whole_frames(self) -> None:
        pool = CarPool(self.renderer, "eval", 9, [])
        clip = sample_clip(np.random.default_rng([9, 1, 0]), pool, "lot", "sun", "quiet", 4.0, 5.0)
        canvas, whole = Canvas(self.renderer, clip.camera), (0, 0, *SIZE)
        canvas.update(clip.at(2.0), clip.moving_regions(2.0))
        before = canvas.drawn.copy()
        regions = canvas.update(clip.at(2.4), clip.moving_regions(2.4))
        self.assertNotIn(whole, regions)
        expected = draw(self.renderer, clip.at(2.4), clip.camera, whole)
        self.assertEqual(expected.shape, (SIZE[1] * SUPERSAMPLING, SIZE[0] * SUPERSAMPLING, 3))
        self.assertLess((np.abs(canvas.drawn.astype(int) - expected) > 6).mean(), 0.002)
        self.assertGreater((np.abs(before.astype(int) - expected) > 6).mean(), 0.002)

    def test_clips_of_one_camera_have_place_in_common_and_other_cars(self) -> None:
        pool, places, cars = CarPool(self.renderer, "eval", 9, []), [], []
        for number, weather in enumerate(("sun", "wet")):
            rng = np.random.default_rng([9, 1, number])
            clip = sample_clip(rng, pool, "lot", weather, "busy", 4.0, 5.0, [9])
            poses = [clip.camera.camera_from_world, *(prop.world_from_prop for prop in clip.scene.props)]
            places.append(np.array(poses))
            cars.append([car.gpu.mesh.name for car in clip.scene.cars])
        np.testing.assert_array_equal(*places)
        self.assertNotEqual(*cars)

    def test_long_clip_goes_on_as_if_every_frame_were_drawn_whole(self) -> None:
        clip = self.long_clip()
        canvas, whole = ExactCanvas(self.renderer, clip.camera), (0, 0, *LONG_SIZE)
        canvas.update(clip.at(2.0), [whole])
        before = canvas.drawn.copy()
        times = np.arange(2.0, 4.0, 0.1)
        drawn = 0
        for before_s, time_s in zip(times[:-1], times[1:], strict=True):
            regions = merged(clip.changed(before_s, time_s)[0])
            drawn += sum(region[2] * region[3] for region in regions)
            canvas.update(clip.at(time_s), regions)
        expected = draw(self.renderer, clip.at(times[-1]), clip.camera, whole).astype(int)
        self.assertGreater((np.abs(before - expected) > 6).mean(), 0.005)
        self.assertLessEqual(np.abs(canvas.drawn - expected).max(), 1)
        self.assertLess(drawn / len(times), 0.4 * LONG_SIZE[0] * LONG_SIZE[1])

    def test_long_clip_keeps_the_wanted_number_of_cars_driving(self) -> None:
        clip = self.long_clip()
        times = np.arange(0, 20, 0.5)
        shown = np.array([in_picture(clip.camera, clip.motions(time_s)) for time_s in times])
        moving = np.array([[motion.speed_mps != 0 for motion in clip.motions(time_s)] for time_s in times])
        self.assertLess(abs((shown & moving).sum(1).mean() - 3), 0.7)
        self.assertLessEqual((shown & moving).sum(1).max(), 4)
        self.assertLess(abs(shown.sum(1).mean() - 12), 1)

    def test_regions_cut_by_the_camera_plane_stay_in_the_frame(self) -> None:
        camera = Camera((640, 360), 480.0, 9.0, 0.3, 0.0)
        bounds = np.array([[-2.2, -0.9, 0.0], [2.2, 0.9, 1.5]])
        light = sample_light(np.random.default_rng(0), 1, "sun")
        self.assertIsNone(reached_region(camera, light, world_from_car(0.0, -30.0, 0.0), bounds))
        region = outline(camera, box_corners(world_from_car(0.0, 0.0, 1.5), bounds, 40.0))
        self.assertEqual(region, (0, 0, 640, 360))
        ahead = outline(camera, box_corners(world_from_car(0.0, 30.0, 0.0), bounds))
        self.assertTrue(0 < ahead[2] < 120 and 0 < ahead[3] < 60, ahead)

    def test_merged_regions_cover_all_and_are_no_more_to_draw(self) -> None:
        rng = np.random.default_rng(3)
        regions = [tuple(int(n) for n in rng.integers(1, 60, 4)) for _ in range(12)]
        joined = merged(regions)
        for x, y, width, height in regions:
            self.assertTrue(any(a <= x and b <= y and x + width <= a + w and y + height <= b + h for a, b, w, h in joined))
        self.assertLessEqual(sum(r[2] * r[3] for r in joined), sum(r[2] * r[3] for r in regions))

    def test_cars_of_a_clip_never_touch(self) -> None:
        for number, (layout, crowd, fewest, most) in enumerate(
            [("lot", "quiet", 7, 12), ("street", "busy", 13, 40), ("lot", "full", 26, 40)]
        ):
            pool = CarPool(self.renderer, "eval", 9, [])
            clip = sample_clip(np.random.default_rng([9, 1, number]), pool, layout, "sun", crowd, 8.0, 5.0)
            self.assertTrue(fewest <= len(clip.movers) <= most, len(clip.movers))
            for time_s in np.arange(0, 8, 0.25):
                places = np.array([m.world_from_car[:2, 3] for m in clip.motions(time_s)])
                away = np.linalg.norm(places[:, None] - places[None], axis=2) + 99 * np.eye(len(places))
                self.assertGreater(away.min(), 1.7)
