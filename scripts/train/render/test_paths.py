"""Tests of drives: feasible kinematics, and activities that fit the motion. They need NumPy only."""

from __future__ import annotations

import unittest

import numpy as np

from roadplane_train.render.paths import Drive, Leg, Motion, reach, straight, turn, turn_across

WHEELBASE_M = 2.7
STEP_S = 0.02


def heading(motion: Motion) -> float:
    """Returns the heading of a car, rad."""
    return float(np.arctan2(motion.world_from_car[1, 0], motion.world_from_car[0, 0]))


DRIVES = {
    "left": [Leg([straight(20), turn(90, 6), straight(20)], 5.0)],
    "u-turn": [Leg([straight(15), turn_across(180, 10.2), straight(12)], 7.0)],
    "halt": [Leg([straight(25)], 7.0, to_rest=True, rest_s=1.5), Leg([straight(30)], 7.0, from_rest=True)],
    "park": [Leg([straight(12), turn(-90, 4.5, 2.0), straight(1)], 3.0, to_rest=True, parking_from=1)],
    "leave": [
        Leg([straight(3), turn(90, 4.5, 2.0)], 1.8, backwards=True, from_rest=True, to_rest=True, rest_s=1.0),
        Leg([straight(20)], 4.0, from_rest=True),
    ],
}


class DriveTest(unittest.TestCase):
    """Each kind of drive, sampled from before its start until after its end."""

    def sampled(self, name: str) -> list[Motion]:
        """Returns the motions of a drive, STEP_S apart."""
        drive = Drive(DRIVES[name], WHEELBASE_M, start_s=1.0).placed(np.array([3.0, -2.0, 0.7]))
        return [drive.at(t) for t in np.arange(0, drive.length_s + 2, STEP_S)]

    def test_speed_is_the_change_of_place_and_acceleration_is_bounded(self) -> None:
        for name in DRIVES:
            motions = self.sampled(name)
            place = np.array([m.world_from_car[:2, 3] for m in motions])
            speed = np.array([m.speed_mps for m in motions])
            moved = np.linalg.norm(place[2:] - place[:-2], axis=1) / (2 * STEP_S)
            np.testing.assert_allclose(moved, np.abs(speed[1:-1]), atol=0.02, err_msg=name)
            acceleration = np.linalg.norm(place[2:] - 2 * place[1:-1] + place[:-2], axis=1) / STEP_S**2
            self.assertLess(acceleration.max(), 3.2, name)

    def test_rear_axle_follows_the_heading(self) -> None:
        for name in DRIVES:
            motions = self.sampled(name)
            rear = np.array([(m.world_from_car @ [-WHEELBASE_M / 2, 0, 0, 1])[:2] for m in motions])
            side = np.array([m.world_from_car[:2, 1] for m in motions])
            slip = np.abs(((rear[2:] - rear[:-2]) * side[1:-1]).sum(1)) / (2 * STEP_S)
            self.assertLess(slip.max(), 0.03, name)

    def test_names_fit_the_motion(self) -> None:
        for name in DRIVES:
            motions = self.sampled(name)
            for now, after in zip(motions, motions[1:], strict=False):
                turned = np.angle(np.exp(1j * (heading(after) - heading(now))))
                self.assertEqual(now.activity == "parked", now.speed_mps == 0, name)
                self.assertEqual(now.activity == "reversing", now.speed_mps < 0, name)
                if now.activity == "turning_left":
                    self.assertGreaterEqual(turned, -1e-6, name)
                if now.activity == "turning_right":
                    self.assertLessEqual(turned, 1e-6, name)
                if now.activity == after.activity == "stopping":
                    self.assertLess(after.speed_mps, now.speed_mps, name)
                if now.activity == after.activity == "starting":
                    self.assertGreater(after.speed_mps, now.speed_mps, name)
        self.assertEqual([m.activity for m in self.sampled("park")][-1], "parked")
        self.assertIn("parking", {m.activity for m in self.sampled("park")})
        self.assertIn("u_turn", {m.activity for m in self.sampled("u-turn")})
        self.assertLessEqual({"stopping", "parked", "starting"}, {m.activity for m in self.sampled("halt")})

    def test_turns_end_where_they_should(self) -> None:
        np.testing.assert_allclose(reach([turn_across(180, 10.2)]), (0, 10.2, np.pi), atol=1e-3)
        self.assertAlmostEqual(reach([turn(-90, 5.0)])[2], -np.pi / 2, places=9)
        drive = Drive(DRIVES["park"], WHEELBASE_M).placed(np.array([1.0, 2.0, 0.5]), at_end=True)
        rest = drive.at(1e3)
        np.testing.assert_allclose([*rest.world_from_car[:2, 3], heading(rest)], (1.0, 2.0, 0.5), atol=1e-9)
