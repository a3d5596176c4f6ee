"""The true paths of a rendered clip, and where they cross lines and borders of areas."""

from __future__ import annotations

import gzip
import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

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
    width_m: float
    kind: str


def read_json(path: Path) -> dict:
    """Reads a JSON file, gzipped or not."""
    opened = gzip.open(path, "rt") if path.suffix == ".gz" else path.open()
    with opened as file:
        return json.load(file)


def true_paths(truth: dict) -> list[VehiclePath]:
    """Returns the paths of all vehicles with two frames or more."""
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
    paths = []
    for number, listed in rows.items():
        if len(listed) > 1:
            table = np.array(listed, float)
            length, width, _ = models[number]["dims_m"]
            paths.append(
                VehiclePath(
                    table[:, 0],
                    table[:, 1:3],
                    np.unwrap(table[:, 3]),
                    table[:, 4],
                    table[:, 5] > 0,
                    length,
                    width,
                    models[number]["class"],
                )
            )
    return paths


class Camera:
    """The true camera."""

    def __init__(self, truth: dict) -> None:
        camera = truth["camera"]
        self.size = np.array(camera["image_size_px"], float)
        self.focal, self.principal = camera["focal_px"], np.array(camera["principal_point_px"])
        self.pose = np.array(camera["camera_from_world"])

    def pixel(self, ground: np.ndarray) -> np.ndarray | None:
        """Returns the pixel of a ground point, from the corner of the picture; None if it is outside."""
        x, y, z = self.pose[:3, :3] @ [*ground, 0.0] + self.pose[:3, 3]
        if z < 1.0:
            return None
        found = self.focal * np.array([x, y]) / z + self.principal
        return found if (found > 0).all() and (found < self.size).all() else None


@dataclass
class Crossing:
    """A true crossing: times of the centre and of the front, direction, speed, place along the line, and visibility."""

    time_s: float
    front_s: float
    direction: str
    speed: float
    along_m: float
    clear: bool
    length_m: float


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
            before = np.nonzero((front[: k + 1] > 0) != (side[k] <= 0))[0]
            fronts = np.nonzero((front[:-1] > 0) != (front[1:] > 0))[0]
            i = fronts[fronts <= k][-1] if len(before) and (fronts <= k).any() else None
            front_s = (
                np.nan
                if i is None
                else path.times[i] + front[i] / (front[i] - front[i + 1]) * (path.times[i + 1] - path.times[i])
            )
            clear = bool(path.clear[max(0, k - 4) : k + 6].mean() > 0.5)
            direction = "forward" if side[k] > 0 else "backward"
            found.append(
                Crossing(at(path.times), float(front_s), direction, abs(at(path.speeds)), at(place), clear, path.length_m)
            )
    return found


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
    return float(
        path.times[k] + np.mean(within != within[0]) * -(path.times[k + 1] - path.times[k]) + (path.times[k + 1] - path.times[k])
    )
