"""The true paths of a rendered clip, and where they cross lines and borders of areas."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

LEAST_SHARE, LEAST_PX = 0.3, 24.0  # of the vehicles that must be counted


@dataclass
class VehiclePath:
    """The true path of a vehicle: times, centres of the footprint, headings, speeds; and whether it is clear to see."""

    times: np.ndarray
    centres: np.ndarray
    headings: np.ndarray
    speeds: np.ndarray
    clear: np.ndarray
    length_m: float


def true_paths(truth: dict) -> dict[int, VehiclePath]:
    """Returns the paths of all vehicles with two frames or more, by their ids."""
    models = {model["id"]: model for model in truth["models"]}
    rows: dict[int, list] = defaultdict(list)
    for frame in truth["frames"]:
        for car in frame["cars"]:
            model = models[car["id"]]
            pose = np.array(car["world_from_car"])
            points = [point for point in model["keypoints_in_car"] or [] if point]
            middle = (min(p[0] for p in points) + max(p[0] for p in points)) / 2 if points else 0.0
            centre = pose[:2, :2] @ [middle, 0.0] + pose[:2, 3]
            box = np.array(car["box"])
            clear = car["visible_share"] >= LEAST_SHARE and (box[2:] - box[:2]).max() >= LEAST_PX
            heading = np.arctan2(pose[1, 0], pose[0, 0])
            rows[car["id"]].append((frame["time_s"], *centre, heading, car["speed_mps"], clear))
    paths = {}
    for number, listed in rows.items():
        if len(listed) > 1:
            table = np.array(listed, float)
            length_m = models[number]["dims_m"][0]
            times, x, y, headings, speeds, clear = table.T
            paths[number] = VehiclePath(times, np.stack([x, y], 1), np.unwrap(headings), speeds, clear > 0, length_m)
    return paths


@dataclass
class Crossing:
    """A true crossing: times of the centre and of the front, direction, speed, place along the line, and visibility."""

    time_s: float
    front_s: float
    direction: str
    speed: float
    along_m: float
    clear: bool


def crossings_of(path: VehiclePath, line: np.ndarray) -> list[Crossing]:
    """Returns the true crossings of a line."""
    a, b = line
    along = (b - a) / np.linalg.norm(b - a)
    left = np.array([-along[1], along[0]])
    side = (path.centres - a) @ left  # positive on the left, seen from a towards b
    ahead = np.stack([np.cos(path.headings), np.sin(path.headings)], 1)
    front = side + path.length_m / 2 * ahead @ left
    place = (path.centres - a) @ along
    found = []
    for k in np.nonzero((side[:-1] > 0) != (side[1:] > 0))[0]:
        if path.times[k + 1] - path.times[k] > 1.0:
            continue

        def at(values: np.ndarray, share: float = side[k] / (side[k] - side[k + 1]), k: int = k) -> float:
            return float(values[k] + share * (values[k + 1] - values[k]))

        if 0 < at(place) < np.linalg.norm(b - a):
            clear = bool(path.clear[max(0, k - 4) : k + 6].mean() > 0.5)
            direction = "forward" if side[k] > 0 else "backward"
            front_s = front_time(path, front, k)
            found.append(Crossing(at(path.times), front_s, direction, abs(at(path.speeds)), at(place), clear))
    return found


def front_time(path: VehiclePath, front: np.ndarray, k: int) -> float:
    """Returns the last time up to frame k at which the front crosses the line; NaN if it was not seen to do so."""
    crossed = np.nonzero((front[: k + 1] > 0) != (front[1 : k + 2] > 0))[0]
    if not len(crossed):
        return np.nan
    i = crossed[-1]
    return float(path.times[i] + front[i] / (front[i] - front[i + 1]) * (path.times[i + 1] - path.times[i]))


def inside(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Returns whether each point lies in a polygon."""
    found = np.zeros(len(points), bool)
    for p, q in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        crosses = (p[1] > points[:, 1]) != (q[1] > points[:, 1])
        at = p[0] + (points[:, 1] - p[1]) / np.where(q[1] == p[1], 1e-9, q[1] - p[1]) * (q[0] - p[0])
        found ^= crosses & (points[:, 0] < at)
    return found


def border_s(path: VehiclePath, zone: np.ndarray, k: int) -> float:
    """Returns the time between two frames at which a path crosses the border of the zone."""
    shares = np.linspace(0, 1, 101)[:, None]
    within = inside(path.centres[k] + shares * (path.centres[k + 1] - path.centres[k]), zone)
    return float(path.times[k] + np.mean(within == within[0]) * (path.times[k + 1] - path.times[k]))
