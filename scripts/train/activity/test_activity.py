"""Tests of the features, the windows and MEVA's conversion; they need NumPy alone."""

from __future__ import annotations

import json
import unittest
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from roadplane_train.activity.drives import LABELS, tracked, truth
from roadplane_train.activity.features import FEATURES, ODD, features, grid
from roadplane_train.activity.meva import ground_below, ground_track, undistorted
from roadplane_train.activity.windows import REACH, SIDE_PX, STEPS, cut, fixture, square_around, window

FIXTURES = Path(__file__).parents[3] / "tests/data/activity"
FIXTURE = FIXTURES / "features.json"


class Features(unittest.TestCase):
    def test_fixture_is_of_this_code(self) -> None:
        for case in json.loads(FIXTURE.read_text())["cases"]:
            time_s, xy = np.array(case["time_s"]), np.array(case["xy_m"])
            heading, sd = (np.array(case[key]) if case[key] else None for key in ("heading_rad", "sd_m"))
            found = features(grid(time_s), time_s, xy, heading, sd)
            np.testing.assert_allclose(found, case["features"], atol=2e-5)

    def test_turning_and_moving_the_world_changes_nothing(self) -> None:
        rng = np.random.default_rng(1)
        time_s, xy, heading, _ = tracked(truth(rng), rng)
        same_sd = np.full_like(xy, 0.2)
        angle = 0.7
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        before = features(grid(time_s), time_s, xy, heading, same_sd)
        after = features(grid(time_s), time_s, xy @ turn.T + [3, 4], heading + angle, same_sd)
        np.testing.assert_allclose(before, after, atol=1e-4)

    def test_the_mirror_changes_signs(self) -> None:
        rng = np.random.default_rng(2)
        time_s, xy, heading, sd = tracked(truth(rng), rng)
        sign = np.ones(FEATURES)
        sign[list(ODD)] = -1
        before = features(grid(time_s), time_s, xy, heading, sd)
        after = features(grid(time_s), time_s, xy * [1, -1], -heading, sd)
        np.testing.assert_allclose(before * sign, after, atol=1e-4)


class Drives(unittest.TestCase):
    def test_all_labels_come_up_and_fit_the_motion(self) -> None:
        rng = np.random.default_rng(3)
        seen = set()
        for _ in range(40):
            drive = truth(rng)
            seen |= set(drive.label.tolist())
            step = np.diff(drive.pose[:, :2], axis=0)
            ahead = step[:, 0] * np.cos(drive.pose[1:, 2]) + step[:, 1] * np.sin(drive.pose[1:, 2])
            inside = drive.label[1:] == drive.label[:-1]
            label = drive.label[1:]
            self.assertTrue((np.abs(ahead[inside & (label == 0)]) < 1e-6).all())
            self.assertTrue((ahead[inside & (label == LABELS.index("reversing"))] < 1e-6).all())
            self.assertTrue((ahead[inside & (label == LABELS.index("moving"))] > -1e-6).all())
        self.assertEqual(seen, set(range(len(LABELS))))


class Windows(unittest.TestCase):
    def test_fixture_is_of_this_code(self) -> None:
        with TemporaryDirectory() as folder:
            fixture(Path(folder) / "windows.json")
            self.assertEqual((Path(folder) / "windows.json").read_text(), (FIXTURES / "windows.json").read_text())

    def test_a_window_shows_its_square_step_by_step(self) -> None:
        """Each picture is as bright as its number, with a dark box at its centre."""
        pictures = np.repeat(np.arange(100, 110, dtype=np.uint8), 40 * 60 * 3).reshape(10, 40, 60, 3).copy()
        pictures[:, 16:24, 25:35] = 0
        square = square_around(np.array([25.0, 16.0, 34.0, 23.0]) + [-0.5, -0.5, 0.5, 0.5])
        self.assertEqual(square.tolist(), [17.0, 7.0, 25.0])
        seen = window(pictures, 3, square)
        self.assertEqual(seen.shape, (STEPS, SIDE_PX, SIDE_PX, 3))
        self.assertEqual(seen[:, 0, 0, 0].tolist(), [100] * 6 + list(range(101, 110)) + [109])
        dark = (seen[0, :, :, 0] == 0).sum(0).max() / SIDE_PX, (seen[0, :, :, 0] == 0).sum(1).max() / SIDE_PX
        np.testing.assert_allclose(dark, [8 / 25, 10 / (10 * REACH)], atol=2.5 / SIDE_PX)

    def test_beyond_the_edge_it_goes_on(self) -> None:
        picture = np.arange(30, dtype=np.uint8)[None, :, None].repeat(20, 0).repeat(3, 2)
        crop = cut(picture, np.array([-24.0, -2.0, 24.0]))
        self.assertEqual(crop[:, :47].max(), 0)


class Ground(unittest.TestCase):
    def test_a_lens_is_undone(self) -> None:
        lens = np.array([-0.3, 0.1, 1e-3, -2e-3, 0.0])
        x, y = true = np.array([0.3, -0.2])
        r2 = x * x + y * y
        radial = 1 + lens[0] * r2 + lens[1] * r2 * r2
        shift = [2 * lens[2] * x * y + lens[3] * (r2 + 2 * x * x), lens[2] * (r2 + 2 * y * y) + 2 * lens[3] * x * y]
        distorted = true * radial + shift
        np.testing.assert_allclose(undistorted(distorted[None], lens)[0], true, atol=1e-6)

    def test_a_track_comes_back_in_metres(self) -> None:
        """The camera is 10 m high and tilted by 0.5 rad.

        A box with its centre 0.75 m above the ground moves 10 m to the right.
        """
        tilt, height, focal = 0.5, 10.0, 1500.0
        down = np.array([0, np.cos(tilt), np.sin(tilt)])
        forward = np.array([0, -np.sin(tilt), np.cos(tilt)])
        k = np.array([[focal, 0, 960], [0, focal, 540], [0, 0, 1]])
        rotation = np.stack([[1, 0, 0], forward, -down], 1)
        camera = k, rotation, -rotation @ np.array([0, 0, height]), np.zeros(5)
        ground = ground_below([], camera)
        boxes = []
        for x in np.linspace(-5, 5, 21):
            middle = x * np.array([1, 0, 0]) + 18.3 * forward + (height - 0.75) * down
            u, v = (k @ middle / middle[2])[:2]
            side = 2.6 * focal / middle[2] / 2
            boxes.append([u - side, v - side, u + side, v + side])
        xy, _ = ground_track(np.array(boxes), camera, ground)
        steps = np.diff(xy, axis=0)
        self.assertLess(np.abs(steps[:, 1]).max(), 0.02)
        self.assertLess(np.ptp(steps[:, 0]), 0.02)
        self.assertGreater(steps[0, 0], 0.3)
