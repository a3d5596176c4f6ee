"""Tests that bound regions of a surface, for `Shell.paint` and `Shell.cut`; a value is positive inside."""

from __future__ import annotations

import numpy as np

from .surface import Test


def u_between(low: float, high: float) -> list[Test]:
    """A band along the outline."""
    return [lambda p, uv: uv[:, 0] - low, lambda p, uv: high - uv[:, 0]]


def v_between(low: float, high: float) -> list[Test]:
    """A band across the height."""
    return [lambda p, uv: uv[:, 1] - low, lambda p, uv: high - uv[:, 1]]


def x_between(low: float, high: float) -> list[Test]:
    """A band across the car."""
    return [lambda p, uv: p[:, 0] - low, lambda p, uv: high - p[:, 0]]


def z_between(low: float, high: float) -> list[Test]:
    """A level band."""
    return [lambda p, uv: p[:, 2] - low, lambda p, uv: high - p[:, 2]]


def left_of(a: tuple[float, float], b: tuple[float, float], beyond: float = 0.0) -> Test:
    """Returns a test for the left side of the line a → b in side view (x, z), and `beyond` metres past it."""
    (ax, az), (bx, bz) = a, b
    length = np.hypot(bx - ax, bz - az)
    return lambda p, uv: ((bx - ax) * (p[:, 2] - az) - (bz - az) * (p[:, 0] - ax)) / length + beyond


def stripe(a: tuple[float, float], b: tuple[float, float], half: float) -> list[Test]:
    """Within `half` metres of the line through a and b in side view (x, z)."""
    return [left_of(a, b, half), left_of(b, a, half)]


def disc(x: float, z: float, radius: float) -> Test:
    """Within a circle in side view."""
    return lambda p, uv: radius - np.hypot(p[:, 0] - x, p[:, 2] - z)


def pane(u: tuple[float, float], v: tuple[float, float], side: int, grow: float = 0.0) -> Test:
    """Returns a test for the centre-line side of a pane's edge, (u[0], v[0]) to (u[1], v[1]); side 1 front, −1 rear."""
    slope = (u[1] - u[0]) / (v[1] - v[0])
    return lambda p, uv: side * (u[0] + slope * (uv[:, 1] - v[0]) - uv[:, 0]) + grow


def quadrilateral(corners: list[tuple[float, float]]) -> list[Test]:
    """Inside a convex quadrilateral in (u, v)."""
    c = np.array(corners)
    first, second = c[1] - c[0], c[2] - c[1]
    if first[0] * second[1] < first[1] * second[0]:
        c = c[::-1]

    def edge(a: np.ndarray, b: np.ndarray) -> Test:
        return lambda p, uv: (b[0] - a[0]) * (uv[:, 1] - a[1]) - (b[1] - a[1]) * (uv[:, 0] - a[0])

    return [edge(c[i], c[(i + 1) % 4]) for i in range(4)]
