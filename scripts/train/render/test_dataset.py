"""Tests of rendered data sets: items that repeat, and clips redrawn in parts equal to whole frames (need EGL)."""

from __future__ import annotations

import unittest

import numpy as np

from .clips import sample_clip
from .dataset import still_truth
from .frames import SUPERSAMPLING, Canvas, draw
from .renderer import Renderer
from .stills import SIZE, CarPool, sample_still


class DatasetTest(unittest.TestCase):
    """Scenes of the eval split, built cars only."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.renderer = Renderer(shadow_size=1024)

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


if __name__ == "__main__":
    unittest.main()
