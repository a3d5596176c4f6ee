"""Paths of cars: a kinematic bicycle whose steering and speed change no faster than a driver would change them.

A drive is a list of legs between rests. Curvature along a turn rises and falls linearly over a ramp. Speed follows from
a limit on lateral acceleration, and from constant acceleration from and to rest (Rajamani, Vehicle Dynamics and
Control, §2.2). Paths are those of the rear axle's centre, whose direction is the car's heading. Results are given for
the car's origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera import world_from_car

STEP_M = 0.01
ACCELERATION = 1.6  # m/s², along the path
LATERAL = 1.5  # m/s², limits the speed in turns
U_TURN_DEG, TURN_DEG = 150, 25  # total heading change from which a piece of path is called a turn
ACTIVITIES = ("parked", "moving", "turning_left", "turning_right", "u_turn", "stopping", "starting", "reversing", "parking")


@dataclass(frozen=True)
class Motion:
    """The state of a car at one time."""

    world_from_car: np.ndarray  # 4 × 4
    speed_mps: float = 0.0  # of the car's origin; negative when it reverses
    activity: str = "parked"  # one of ACTIVITIES; parked: at rest


@dataclass(frozen=True)
class Piece:
    """A piece of path."""

    length_m: float
    angle_rad: float = 0.0  # change of heading
    ramp_m: float = 0.0  # over which curvature rises, and falls again

    def headings(self, at: np.ndarray) -> np.ndarray:
        """Returns the heading relative to the piece's start, at distances along it."""
        if self.angle_rad == 0:
            return np.zeros_like(at)
        ramp, peak = self.ramp_m, self.angle_rad / (self.length_m - self.ramp_m)
        rise = np.clip(at, 0, ramp) ** 2 / (2 * ramp)
        fall = np.clip(at - (self.length_m - ramp), 0, ramp) ** 2 / (2 * ramp)
        return peak * (rise + np.clip(at - ramp, 0, None) - fall)

    @property
    def label(self) -> str:
        """Returns the activity of a car that drives it forwards."""
        turned = np.degrees(abs(self.angle_rad))
        if turned < TURN_DEG:
            return "moving"
        if turned >= U_TURN_DEG:
            return "u_turn"
        return "turning_left" if self.angle_rad > 0 else "turning_right"


def straight(length_m: float) -> Piece:
    """Returns a straight piece."""
    return Piece(length_m)


def turn(angle_deg: float, radius_m: float, ramp_m: float = 3.0) -> Piece:
    """Returns a turn, positive to the left as seen from above; its tightest radius is `radius_m` or larger."""
    angle = np.radians(angle_deg)
    return Piece(max(radius_m * abs(angle) + ramp_m, 2 * ramp_m), angle, ramp_m)


def turn_across(angle_deg: float, offset_m: float, ramp_m: float = 3.0) -> Piece:
    """Returns a turn that ends `offset_m` beside the line on which it began."""
    low, high = 2.0, 40.0
    for _ in range(50):
        middle = (low + high) / 2
        wide = abs(reach([turn(angle_deg, middle, ramp_m)])[1]) > offset_m
        low, high = (low, middle) if wide else (middle, high)
    return turn(angle_deg, low, ramp_m)


@dataclass(frozen=True)
class Leg:
    """Pieces driven without changing gear."""

    pieces: list[Piece]
    cruise_mps: float
    backwards: bool = False
    from_rest: bool = False
    to_rest: bool = False
    rest_s: float = 0.0  # after it
    parking_from: int | None = None  # pieces from this one on are called parking


def traced(leg: Leg) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns samples of a leg, and per sample the activity of the piece (index into ACTIVITIES).

    A sample has distance, pose (n, 3: x, y, heading; from the origin along +x), and curvature (1/m, of heading over
    distance).
    """
    ends = np.cumsum([p.length_m for p in leg.pieces])
    at = np.linspace(0, ends[-1], max(int(np.ceil(ends[-1] / STEP_M)), 2) + 1)
    heading, label = np.zeros_like(at), np.zeros(len(at), int)
    for piece, end in zip(leg.pieces, ends, strict=True):
        local = np.clip(at - (end - piece.length_m), 0, piece.length_m)
        heading += piece.headings(local)
        label[at >= end - piece.length_m] = ACTIVITIES.index(piece.label)
    middle = (heading[1:] + heading[:-1]) / 2
    sign = -1 if leg.backwards else 1
    steps = np.stack([np.cos(middle), np.sin(middle)], 1) * (np.diff(at) * sign)[:, None]
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, 0)])
    if leg.backwards:
        label[:] = ACTIVITIES.index("reversing")
    if leg.parking_from is not None:
        label[at >= ends[leg.parking_from] - leg.pieces[leg.parking_from].length_m] = ACTIVITIES.index("parking")
    return at, np.column_stack([xy, heading]), np.gradient(heading, at), label


def reach(pieces: list[Piece]) -> np.ndarray:
    """Returns the pose (x, y, heading) at the end of pieces that begin at the origin along +x."""
    return traced(Leg(pieces, 1.0))[1][-1]


def speeds(leg: Leg, at: np.ndarray, curvature: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the speed along a leg, and where acceleration from rest or braking to rest limits it."""
    limit = np.minimum(leg.cruise_mps, np.sqrt(LATERAL / np.maximum(np.abs(curvature), 1e-6)))
    square, step = limit**2, at[1] - at[0]
    # the lower envelope of all cones over the limits: each speed can be reached from earlier ones and left for later
    # ones
    gain = 2 * ACCELERATION * step * np.arange(len(at))
    square = np.minimum.accumulate(square - gain) + gain
    square = (np.minimum.accumulate((square + gain)[::-1]) - gain[::-1])[::-1]
    rise = 2 * ACCELERATION * at if leg.from_rest else np.full_like(at, np.inf)
    fall = 2 * ACCELERATION * (at[-1] - at) if leg.to_rest else np.full_like(at, np.inf)
    least = np.minimum(rise, fall)
    return np.sqrt(np.minimum(square, least)), (rise <= square) & (rise <= fall), (fall <= square) & (fall < rise)


class Drive:
    """The motion of a car over time. It is at rest before and after, unless it arrives or leaves at speed."""

    def __init__(self, legs: list[Leg], wheelbase_m: float, start_s: float = 0.0) -> None:
        times, poses, curvatures, signed, labels = [], [], [], [], []
        clock, pose = 0.0, np.zeros(3)
        for leg in legs:
            at, local, curvature, label = traced(leg)
            speed, starting, stopping = speeds(leg, at, curvature)
            moving = label == ACTIVITIES.index("moving")
            label[moving & starting] = ACTIVITIES.index("starting")
            label[moving & stopping] = ACTIVITIES.index("stopping")
            pause = 2 * np.diff(at) / (speed[1:] + speed[:-1])
            times.append(clock + np.concatenate([[0], np.cumsum(pause)]))
            poses.append(_moved(local, pose))
            curvatures.append(curvature)
            signed.append(-speed if leg.backwards else speed)
            labels.append(label)
            clock, pose = times[-1][-1] + leg.rest_s, poses[-1][-1]
        self._parts = list(zip(times, poses, curvatures, signed, labels, strict=True))
        self._legs = legs
        self.wheelbase_m, self.start_s, self.length_s = wheelbase_m, start_s, clock

    def placed(self, pose: np.ndarray, at_end: bool = False) -> Drive:
        """Moves the drive so that the car's origin has `pose` (x, y, heading) at its start (or end)."""
        rear = pose - self.wheelbase_m / 2 * np.array([np.cos(pose[2]), np.sin(pose[2]), 0])
        known = self._parts[-1][1][-1] if at_end else self._parts[0][1][0]
        angle = rear[2] - known[2]
        cos, sin = np.cos(angle), np.sin(angle)
        shift = rear[:2] - np.array([[cos, -sin], [sin, cos]]) @ known[:2]
        frame = np.array([*shift, angle])
        self._parts = [(t, _moved(p, frame), *rest) for t, p, *rest in self._parts]
        return self

    def at(self, time_s: float) -> Motion:
        """Returns the car's motion at a time."""
        clock = time_s - self.start_s
        for number, (times, poses, curvature, signed, labels) in enumerate(self._parts):
            if clock <= times[-1] or number == len(self._parts) - 1:
                break
            if clock < self._parts[number + 1][0][0]:
                return self._state(poses[-1], 0.0, 0.0, "parked")
        first, last = number == 0, number == len(self._parts) - 1
        leg = self._legs[number]
        if clock < times[0] and first:
            gone = 0.0 if leg.from_rest else (clock - times[0]) * signed[0]
            return self._ahead(poses[0], gone, signed[0] * (not leg.from_rest), labels[0])
        if clock > times[-1] and last:
            gone = 0.0 if leg.to_rest else (clock - times[-1]) * signed[-1]
            return self._ahead(poses[-1], gone, signed[-1] * (not leg.to_rest), labels[-1])
        k = int(np.clip(np.searchsorted(times, clock, side="right") - 1, 0, len(times) - 2))
        since, step = clock - times[k], times[k + 1] - times[k]
        share = since / step
        speed = signed[k] + (signed[k + 1] - signed[k]) * share
        travelled = abs((signed[k] + speed) / 2 * since)
        whole = abs((signed[k] + signed[k + 1]) / 2 * step)
        pose = poses[k] + (poses[k + 1] - poses[k]) * (travelled / whole)
        bend = curvature[k] + (curvature[k + 1] - curvature[k]) * share
        return self._state(pose, speed, bend, ACTIVITIES[labels[k]] if speed != 0 else "parked")

    def _ahead(self, pose: np.ndarray, distance: float, speed: float, label: int) -> Motion:
        forward = np.array([np.cos(pose[2]), np.sin(pose[2]), 0])
        return self._state(pose + distance * forward, speed, 0.0, ACTIVITIES[label] if speed else "parked")

    def _state(self, rear: np.ndarray, speed: float, curvature: float, activity: str) -> Motion:
        origin = rear[:2] + self.wheelbase_m / 2 * np.array([np.cos(rear[2]), np.sin(rear[2])])
        lever = np.hypot(1.0, curvature * self.wheelbase_m / 2)  # the origin moves on a wider circle than the rear axle
        return Motion(world_from_car(*origin, rear[2]), float(speed * lever), activity)


def _moved(poses: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Returns poses (n, 3) given in a frame (x, y, heading), in that frame's parent."""
    cos, sin = np.cos(frame[2]), np.sin(frame[2])
    xy = poses[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + frame[:2]
    return np.column_stack([xy, poses[:, 2] + frame[2]])
