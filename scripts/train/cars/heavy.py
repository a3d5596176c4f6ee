"""Lorries and buses: plain boxes with cab, panes and wheels, without keypoints; their origin is the middle of their length."""

from __future__ import annotations

import numpy as np

from .mesh import KEYPOINT_NAMES, CarMesh
from .surface import Shell, flat_polygon, join

# Length, width, height, m: types of road vehicles, estimated.
LENGTH_M = {"truck": (6.0, 10.5), "bus": (9.5, 13.0)}
WIDTH_M = {"truck": (2.2, 2.5), "bus": (2.5, 2.55)}
HEIGHT_M = {"truck": (2.6, 3.8), "bus": (2.9, 3.3)}
WHEEL_M = 0.95
WHEEL_SIDES = 16


def sample_heavy(rng: np.random.Generator, kind: str) -> CarMesh:
    """A random truck or bus (`kind`)."""
    length, width, height = (rng.uniform(*size[kind]) for size in (LENGTH_M, WIDTH_M, HEIGHT_M))
    build = _truck if kind == "truck" else _bus
    shells, axles = build(rng, length, width, height)
    shells += [_wheel(x, side * (width / 2 - 0.14)) for x in axles for side in (-1, 1)]
    whole = join(shells)
    name = f"{kind}-{length:.1f}"
    return CarMesh(
        name, kind, whole.points.astype(np.float32), whole.normals.astype(np.float32), whole.faces.astype(np.int32),
        whole.materials.astype(np.uint8), np.full((len(KEYPOINT_NAMES), 3), np.nan), np.array([length, width, height]),
    )  # fmt: skip


def _truck(rng: np.random.Generator, length: float, width: float, height: float) -> tuple[list[Shell], list[float]]:
    front, cab, cab_height = length / 2, 1.9, min(height, rng.uniform(2.4, 2.9))
    load = "paint" if rng.random() < 0.5 else "plate"
    shells = [
        _box((front - cab, front), width, (0.5, cab_height), "paint"),
        _box((-length / 2, front - cab - 0.25), width, (0.95, height), load),
        _box((-length / 2, front - cab), 0.6 * width, (0.6, 0.95), "underbody"),
        _pane((front + 0.01, front + 0.01), (-0.45 * width, 0.45 * width), (0.6 * cab_height, 0.92 * cab_height)),
        _box((front, front + 0.08), 0.95 * width, (0.4, 0.75), "plastic"),
    ]
    for side in (-1, 1):
        y = side * (width / 2 + 0.01)
        shells.append(_pane((front - 1.2, front - 0.2), (y, y), (0.6 * cab_height, 0.9 * cab_height)))
    rear = [-length / 2 + 1.6] + ([-length / 2 + 2.8] if length > 8 else [])
    return shells, [front - 1.2, *rear]


def _bus(_rng: np.random.Generator, length: float, width: float, height: float) -> tuple[list[Shell], list[float]]:
    front = length / 2
    shells = [_box((-front, front), width, (0.35, height), "paint")]
    for side in (-1, 1):
        y = side * (width / 2 + 0.01)
        for x in np.arange(-front + 0.4, front - 1.2, 1.5):
            shells.append(_pane((x, x + 1.35), (y, y), (1.3, 0.78 * height)))
    shells.append(_pane((front + 0.01, front + 0.01), (-0.46 * width, 0.46 * width), (1.1, 0.85 * height)))
    shells.append(_pane((-front - 0.01, -front - 0.01), (-0.4 * width, 0.4 * width), (1.6, 0.8 * height)))
    return shells, [front - 2.6, -front + 3.2]


def _box(x: tuple[float, float], width: float, z: tuple[float, float], material: str) -> Shell:
    """Upright box between two x and two heights."""
    shells = []
    low, high = np.array([x[0], -width / 2, z[0]]), np.array([x[1], width / 2, z[1]])
    for axis in range(3):
        for top in (False, True):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            corners = np.array([(high if top else low)] * 4)
            ring = [(0, 0), (1, 0), (1, 1), (0, 1)] if top else [(0, 0), (0, 1), (1, 1), (1, 0)]
            for corner, (u, v) in zip(corners, ring, strict=True):
                corner[a], corner[b] = (low, high)[u][a], (low, high)[v][b]
            shells.append(flat_polygon(corners, material))
    return join(shells)


def _pane(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Shell:
    """Upright rectangle from (x[0], y[0]) to (x[1], y[1]), seen from outside."""
    corners = np.array([(x[0], y[0], z[0]), (x[1], y[1], z[0]), (x[1], y[1], z[1]), (x[0], y[0], z[1])])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    outward = normal[:2] @ corners[:, :2].mean(0) > 0
    return flat_polygon(corners if outward else corners[::-1], "glass")


def _wheel(x: float, y: float) -> Shell:
    angles = np.linspace(0, 2 * np.pi, WHEEL_SIDES, endpoint=False)
    ring = np.stack([x + WHEEL_M / 2 * np.cos(angles), np.zeros(WHEEL_SIDES), WHEEL_M / 2 * (1 + np.sin(angles))], 1)
    inner, outer = ring + [0, y - 0.14, 0], ring + [0, y + 0.14, 0]
    around = [
        flat_polygon(np.array([inner[i], outer[i], outer[j], inner[j]]), "tyre")
        for i, j in ((i, (i + 1) % WHEEL_SIDES) for i in range(WHEEL_SIDES))
    ]
    return join([*around, flat_polygon(outer[::-1], "tyre"), flat_polygon(inner, "tyre")])
