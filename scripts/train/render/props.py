"""Unit shapes for all things except cars: boxes, cylinders, leafy blobs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SHAPES = ("box", "cylinder", "blob")


@dataclass
class Prop:
    """One placed shape. Its unit shape spans −0.5…0.5 in x and y and 0…1 in z, before `world_from_prop`."""

    shape: str
    world_from_prop: np.ndarray  # 4 × 4
    colour: np.ndarray  # linear RGB
    leaves: float = 0.0  # 0 solid … 1 ragged, translucent
    texture: float = 0.3


def placed(
    shape: str,
    centre: tuple[float, float],
    size: tuple[float, float, float],
    colour: np.ndarray,
    heading_rad: float = 0.0,
    bottom_m: float = 0.0,
    **style: float,
) -> Prop:
    """Returns a prop of a size (x, y, z in metres) on the ground or `bottom_m` above it."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    pose = np.array(
        [
            [cos * size[0], -sin * size[1], 0, centre[0]],
            [sin * size[0], cos * size[1], 0, centre[1]],
            [0, 0, size[2], bottom_m],
            [0, 0, 0, 1.0],
        ]
    )
    return Prop(shape, pose, np.asarray(colour, float), **style)


def unit_shape(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns the triangles of a unit shape: positions (3 n, 3) and normals (3 n, 3), float32."""
    if name == "box":
        positions, normals = [], []
        for axis in range(3):
            for sign in (-1, 1):
                normal = np.eye(3)[axis] * sign
                a, b = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3] * sign
                corners = [normal + s * a + t * b for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
                positions += [corners[i] for i in (0, 1, 2, 0, 2, 3)]
                normals += [normal] * 6
        positions = np.array(positions) * 0.5 + [0, 0, 0.5]
        return positions.astype(np.float32), np.array(normals, np.float32)
    if name == "cylinder":
        rows, columns = np.array([[0, 1], [1, 1]], float), 12  # height, radius
        return _revolved(rows, columns)
    angles = np.linspace(0, np.pi, 9)
    rows = np.stack([0.5 - 0.5 * np.cos(angles), np.sin(angles)], axis=1)
    return _revolved(rows, 14)


def _revolved(rows: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Surface of revolution about z from (height, radius of 0.5 units) rows."""
    angles = np.linspace(0, 2 * np.pi, columns + 1)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) * 0.5
    grid = np.concatenate(
        [ring[None] * rows[:, 1, None, None], np.broadcast_to(rows[:, 0, None, None], (len(rows), columns + 1, 1))], axis=2
    )
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    positions = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)
    around = rows[:, 1].max() == rows[:, 1].min()
    normals = positions * [1, 1, 0] if around else positions - [0, 0, 0.5]
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    return positions.astype(np.float32), normals.astype(np.float32)
