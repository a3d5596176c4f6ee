"""Reads Wavefront OBJ into arrays, before its materials are mapped to ours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Triangles:
    """Triangles in the file's own frame and unit, each with its material's and its group's name."""

    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int64
    materials: np.ndarray  # (F,) str
    groups: np.ndarray  # (F,) str


def parse(text: str) -> Triangles:
    """Parses a file; polygons become fans, and negative indices count from the last vertex read so far."""
    vertices: list[tuple[float, float, float]] = []
    faces: list[tuple[int, int, int]] = []
    materials: list[str] = []
    groups: list[str] = []
    material = group = ""
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        if word == "v":
            x, y, z = rest.split()[:3]
            vertices.append((float(x), float(y), float(z)))
        elif word == "f":
            corners = [int(corner.split("/", 1)[0]) for corner in rest.split()]
            corners = [c - 1 if c > 0 else len(vertices) + c for c in corners]
            fan = [(corners[0], b, c) for b, c in zip(corners[1:-1], corners[2:])]
            faces += fan
            materials += [material] * len(fan)
            groups += [group] * len(fan)
        elif word == "usemtl":
            material = rest.strip()
        elif word in ("g", "o"):
            group = rest.strip()
    return Triangles(np.array(vertices), np.array(faces), np.array(materials), np.array(groups))
