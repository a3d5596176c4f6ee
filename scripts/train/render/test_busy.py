"""Tests of busy streets: occlusion, and the following of vehicles."""

from __future__ import annotations

import unittest

import numpy as np

from roadplane_train.cars.heavy import sample_heavy
from roadplane_train.cars.mesh import KEYPOINT_NAMES, CarMesh
from roadplane_train.render.busy import CARRIED_M, OffPlane, changed_regions, with_carried
from roadplane_train.render.camera import Camera, world_from_car
from roadplane_train.render.crops import in_world
from roadplane_train.render.junction import WARM_S, Junction, touching
from roadplane_train.render.outlines import Outlines
from roadplane_train.render.places import make_street
from roadplane_train.render.stills import sample_weather


def block(length: float = 4.4) -> CarMesh:
    """Returns a car as a plain box with its corners as keypoints."""
    corners = np.array([(x, y, z) for x in (-length / 2, length / 2) for y in (-0.9, 0.9) for z in (0.0, 1.5)])
    points = np.full((len(KEYPOINT_NAMES), 3), np.nan)
    points[:8] = corners * [1, 1, 0.8]
    normals, faces, materials = np.zeros((8, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros(0, np.uint8)
    dims = np.array([length, 1.8, 1.5])
    return CarMesh("block", "wagon", corners.astype(np.float32), normals, faces, materials, points, dims)


class Busy(unittest.TestCase):
    def test_a_bus_hides_the_car_behind_it(self) -> None:
        camera = Camera((1280, 720), 1200.0, 6.0, 0.2, 0.0)
        outlines = Outlines(camera, [])
        bus, car = sample_heavy(np.random.default_rng(1), "bus"), block()
        cars = [(1, car, world_from_car(0.0, 40.0, 0.0)), (2, car, world_from_car(14.0, 40.0, 0.0))]
        alone = outlines.visible_parts(cars)
        self.assertGreater(alone[1].seen_share, 0.9)
        behind = outlines.visible_parts([(0, bus, world_from_car(-4.0, 34.0, 0.0)), *cars])
        self.assertLess(behind[1].seen_share if 1 in behind else 0.0, 0.4)
        self.assertAlmostEqual(behind[2].seen_share, alone[2].seen_share, places=2)
        # A car seen from the front hides its own far corners.
        visible = alone[2].visible[:8]
        self.assertTrue(0 < visible.sum() < 8)

    def test_only_what_moved_is_drawn_again(self) -> None:
        camera, bus = Camera((1280, 720), 1200.0, 6.0, 0.2, 0.0), sample_heavy(np.random.default_rng(1), "bus")
        _, light = sample_weather(np.random.default_rng(2), "sun")
        bounds = dict.fromkeys(range(4), (bus.vertices.min(0), bus.vertices.max(0)))
        stays, goes, comes = (world_from_car(x, 40.0, 0.0) for x in (-14.0, 0.0, 14.0))
        before, now = {0: stays, 1: goes, 2: goes}, {0: stays, 1: world_from_car(1.0, 40.0, 0.0), 3: comes}
        regions = changed_regions(camera, light, bounds, before, now)
        self.assertEqual(len(regions), 4)  # one moves, one arrives, one leaves
        for pose in (goes, now[1], comes):
            pixels, _ = camera.pixel_from_world(in_world(bus.vertices, pose))
            low, high = pixels.min(0).clip(0), np.minimum(pixels.max(0), (1279, 719))
            around = [x <= low[0] and y <= low[1] and x + w > high[0] and y + h > high[1] for x, y, w, h in regions]
            self.assertTrue(any(around))
        self.assertEqual(changed_regions(camera, light, bounds, {0: stays}, {0: stays}), [])

    def test_nobody_drives_through_another_and_bays_change_hands(self) -> None:
        rng = np.random.default_rng(5)
        site = make_street(rng, np.array([0.0, 45.0]), np.pi / 2, False, 4, 0.0)
        mesh = block()
        vehicles = Junction(rng, site, 30.0, {"car": [mesh], "truck": [mesh], "bus": [mesh]}, 5.0, {id(mesh): 2.7}).run()
        self.assertLess(touching(vehicles, 30.0), 3)
        driven = [v for v in vehicles if v.track and v.track[-1][0] - v.track[0][0] > 5]
        self.assertGreater(len(driven), 20)
        self.assertTrue(any(v.leaves_s is not None and v.shifts for v in vehicles))
        for vehicle in driven:
            steps = np.diff([s for s, _ in vehicle.track])
            self.assertTrue((steps >= 0).all() and steps.max() < 2.0)
        self.assertEqual(vehicles[0].from_step, -round(WARM_S * 10))
        for share in (0.0, 0.2, 0.7, 1.0):
            carried = [v for v in with_carried(vehicles, share) if isinstance(v, OffPlane)]
            self.assertAlmostEqual(len(carried), share * sum(v.kind == "car" for v in vehicles), delta=0.1 * len(vehicles))
        carried = [v for v in with_carried(vehicles, 1.0) if isinstance(v, OffPlane)]
        there = next(v for v in carried if v.at(15.0) is not None)
        raised = there.at(15.0).world_from_car - there.vehicle.at(15.0).world_from_car
        np.testing.assert_allclose(raised[2, 3], CARRIED_M)
        np.testing.assert_allclose(np.delete(raised.ravel(), 11), 0)
        gone = next(v for v in carried if v.vehicle.at(15.0) is None)
        self.assertIsNone(gone.at(15.0))
