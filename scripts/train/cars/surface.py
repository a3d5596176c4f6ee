"""Triangles under construction: grids, exact painting and cutting of regions, mirroring and joining."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .mesh import MATERIALS

# A test gives one value per vertex from (points (V, 3), uv (V, 2)); a region is where all its tests are ≥ 0.
Test = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass
class Shell:
    """Vertices with unit normals and surface coordinates uv, and faces with a material; metres, car frame."""

    points: np.ndarray  # (V, 3)
    normals: np.ndarray  # (V, 3)
    uv: np.ndarray  # (V, 2)
    faces: np.ndarray  # (F, 3)
    materials: np.ndarray  # (F,)

    def paint(self, material: str, *tests: Test) -> None:
        """Gives a region another material; faces across its edge are split along it."""
        inside = self._divide(tests)  # may replace self.materials, hence first
        self.materials[inside] = MATERIALS.index(material)

    def cut(self, *tests: Test) -> None:
        """Removes a region."""
        inside = self._divide(tests)
        keep = np.ones(len(self.faces), bool)
        keep[inside] = False
        self.faces, self.materials = self.faces[keep], self.materials[keep]

    def _divide(self, tests: tuple[Test, ...]) -> np.ndarray:
        """Splits faces along each test's zero line within the region so far; returns the indices of those inside."""
        inside = np.arange(len(self.faces))
        for test in tests:  # a coarse pass first, so that far-away faces are not split
            a, b, c = (test(self.points, self.uv) > 0)[self.faces[inside]].T
            inside = inside[a | b | c]
        for test in tests:
            value = test(self.points, self.uv)
            value = np.where(np.abs(value) < 1e-7, 1e-7, value)
            positive = value[self.faces[inside]] > 0
            count = positive[:, 0].astype(int) + positive[:, 1] + positive[:, 2]
            mixed = (count > 0) & (count < 3)
            whole = inside[count == 3]
            if mixed.any():
                new = self._split(inside[mixed], value, positive[mixed], count[mixed] == 1)
                inside = np.concatenate([whole, new])
            else:
                inside = whole
        return inside

    def _split(self, which: np.ndarray, value: np.ndarray, positive: np.ndarray, lone_in: np.ndarray) -> np.ndarray:
        """Cuts faces along value = 0 into one triangle and two; returns the indices of the positive parts."""
        lone = np.where(lone_in, positive.argmax(1), (~positive).argmax(1))
        rows = np.arange(len(which))
        a, b, c = (self.faces[which, (lone + step) % 3] for step in range(3))
        start, first_new = len(self.points), len(self.faces)
        far = np.concatenate([b, c])
        near = np.concatenate([a, a])
        t = (value[near] / (value[near] - value[far]))[:, None]
        normal = self.normals[near] + t * (self.normals[far] - self.normals[near])
        normal /= np.sqrt((normal**2).sum(1, keepdims=True)).clip(1e-9)
        self.points = np.concatenate([self.points, self.points[near] + t * (self.points[far] - self.points[near])])
        self.normals = np.concatenate([self.normals, normal])
        self.uv = np.concatenate([self.uv, self.uv[near] + t * (self.uv[far] - self.uv[near])])
        ab, ac = start + rows, start + len(which) + rows
        self.faces[which] = np.stack([a, ab, ac], 1)
        self.faces = np.concatenate([self.faces, np.stack([ab, b, c], 1), np.stack([ab, c, ac], 1)])
        old = self.materials[which]
        self.materials = np.concatenate([self.materials, old, old])
        rest = first_new + rows[~lone_in]
        return np.concatenate([which[lone_in], rest, rest + len(which)])

    def mirrored(self) -> Shell:
        """Returns the other side of the car."""
        flip = np.array([1.0, -1.0, 1.0])
        return Shell(
            self.points * flip,
            self.normals * flip,
            self.uv,
            self.faces[:, ::-1].copy(),
            self.materials.copy(),
        )

    def moved(self, offset: tuple[float, float, float]) -> Shell:
        """Returns a copy shifted by `offset`."""
        return Shell(self.points + np.array(offset), self.normals, self.uv, self.faces.copy(), self.materials.copy())


def join(shells: list[Shell]) -> Shell:
    """Joins shells into one."""
    offsets = np.cumsum([0] + [len(s.points) for s in shells[:-1]])
    return Shell(
        np.concatenate([s.points for s in shells]),
        np.concatenate([s.normals for s in shells]),
        np.concatenate([s.uv for s in shells]),
        np.concatenate([s.faces + o for s, o in zip(shells, offsets)]),
        np.concatenate([s.materials for s in shells]),
    )


def grid(points: np.ndarray, uv: np.ndarray, material: str, symmetric: bool = False) -> Shell:
    """Smooth surface through points (n, m, 3), faces wound so that d/dn × d/dm points out.

    `symmetric`: the surface is half of one mirrored at y = 0, so normals on that plane have no y part.
    """
    n, m, _ = points.shape
    index = np.arange(n * m).reshape(n, m)
    p00, p10, p01, p11 = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]))
    faces = np.concatenate([np.stack([p00, p10, p11], 1), np.stack([p00, p11, p01], 1)])
    flat = points.reshape(-1, 3)
    cross = np.cross(flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]])
    normals = np.stack([np.bincount(faces.ravel(), np.repeat(cross[:, axis], 3), len(flat)) for axis in range(3)], axis=1)
    if symmetric:
        normals[np.abs(flat[:, 1]) < 1e-9, 1] = 0.0
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    keep = np.linalg.norm(cross, axis=1) > 1e-10
    code = np.full(int(keep.sum()), MATERIALS.index(material), np.uint8)
    return Shell(flat.copy(), normals, uv.reshape(-1, 2).copy(), faces[keep], code)


def flat_polygon(corners: np.ndarray, material: str) -> Shell:
    """A flat convex polygon (n, 3), counter-clockwise seen from outside."""
    corners = np.asarray(corners, float)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal).clip(1e-12)
    n = len(corners)
    faces = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], 1)
    code = np.full(n - 2, MATERIALS.index(material), np.uint8)
    return Shell(corners, np.tile(normal, (n, 1)), np.zeros((n, 2)), faces, code)


def rounded_box(centre: np.ndarray, half: np.ndarray, material: str, power: float = 4.0, steps: int = 6) -> Shell:
    """Builds a superellipsoid: a sphere for power 2, a box with soft edges above."""
    unit = _unit_box(power, steps)
    normal = unit.normals / half
    normal = normal / np.sqrt((normal**2).sum(1, keepdims=True))
    code = np.full(len(unit.faces), MATERIALS.index(material), np.uint8)
    return Shell(unit.points * half + centre, normal, unit.uv, unit.faces, code)


@lru_cache
def _unit_box(power: float, steps: int) -> Shell:
    lat = np.linspace(-np.pi / 2, np.pi / 2, steps)[None, :]
    lon = np.linspace(0, 2 * np.pi, 2 * steps - 1)[:, None]

    def soft(value: np.ndarray) -> np.ndarray:
        return np.sign(value) * np.abs(value) ** (2.0 / power)

    unit = np.stack(
        [
            soft(np.cos(lat)) * soft(np.cos(lon)),
            soft(np.cos(lat)) * soft(np.sin(lon)),
            soft(np.sin(lat)) + 0 * lon,
        ],
        -1,
    )
    shell = grid(unit, np.zeros(unit.shape[:2] + (2,)), "paint")
    shell.normals = np.sign(shell.points) * np.abs(shell.points) ** (power - 1)
    return shell
