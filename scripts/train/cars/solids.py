"""Solids with rounded edges, and panels on them: the building blocks of lorries and buses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .surface import Shell, flat_polygon, grid, join

ARC_STEPS = 3  # directions along a rounded edge
LIFT_M = 0.012  # offset of painted panels from the surface: more than depth buffers confuse

Span = tuple[float, float]


def prism(outline: Sequence[Span], width: Span, material: str, radius: float = 0.03) -> Shell:
    """Builds a convex side view (corners x, z) extruded from y = width[0] to width[1], with round edges.

    It is the sum of a smaller prism and a ball, so the normals are those of the ball.
    """
    corners = np.array(outline, float)
    along = np.roll(corners, -1, 0) - corners
    if (np.roll(along, -1, 0)[:, 1] * along[:, 0] - np.roll(along, -1, 0)[:, 0] * along[:, 1]).sum() < 0:
        return prism(outline[::-1], width, material, radius)
    after = np.stack([along[:, 1], -along[:, 0]], 1) / np.linalg.norm(along, axis=1, keepdims=True)  # outward, next edge's
    before = np.roll(after, 1, 0)
    core = corners - radius * (before + after) / (1 + (before * after).sum(1, keepdims=True))
    share = np.linspace(0, 1, ARC_STEPS)[None, :, None]
    turn = before[:, None] * (1 - share) + after[:, None] * share
    turn = (turn / np.linalg.norm(turn, axis=2, keepdims=True)).reshape(-1, 2)
    centre = np.repeat(core, ARC_STEPS, 0)
    turn, centre = np.concatenate([turn, turn[:1]]), np.concatenate([centre, centre[:1]])

    rise = np.linspace(0, np.pi / 2, ARC_STEPS)
    rise = np.concatenate([-rise[::-1], rise])
    middle = np.repeat([width[0] + radius, width[1] - radius], ARC_STEPS)
    normal = np.empty((len(turn), len(rise), 3))
    normal[..., [0, 2]] = turn[:, None] * np.cos(rise)[None, :, None]
    normal[..., 1] = np.sin(rise)
    points = radius * normal
    points[..., [0, 2]] += centre[:, None]
    points[..., 1] += middle
    skin = grid(points[::-1], np.zeros(points.shape[:2] + (2,)), material)
    skin.normals = normal[::-1].reshape(-1, 3)
    ends = [np.insert(core[::order], 1, y, 1) for y, order in ((width[0], 1), (width[1], -1))]
    return join([skin, *(flat_polygon(end, material) for end in ends)])


def box(x: Span, y: Span, z: Span, material: str, radius: float = 0.02) -> Shell:
    """Builds a box with vertical sides."""
    return prism([(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])], y, material, radius)


def panel(corners: np.ndarray, towards: np.ndarray, material: str) -> Shell:
    """Builds a flat convex polygon (n, 3) that is visible from the side to which `towards` points."""
    corners = np.asarray(corners, float)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return flat_polygon(corners if normal @ towards > 0 else corners[::-1], material)


def on_end(lower: Span, upper: Span, y: Span, material: str, layer: int = 1) -> Shell:
    """Builds a panel across the front or the rear, from (x, z) `lower` to `upper`; layers lie on each other."""
    sign = np.sign(lower[0] + upper[0])
    step = sign * LIFT_M * layer
    corners = [(x + step, b, z) for (x, z), b in ((lower, y[0]), (lower, y[1]), (upper, y[1]), (upper, y[0]))]
    return panel(np.array(corners), np.array([sign, 0.0, 0.0]), material)


def on_side(y: float, x: Span, z: Span, material: str, layer: int = 1, lean: float = 0.0) -> Shell:
    """Builds a vertical panel at y, on the left or the right; its front edge leans back by `lean` metres at the top."""
    at = y + np.sign(y) * LIFT_M * layer
    corners = [(x[0], at, z[0]), (x[1], at, z[0]), (x[1] - lean, at, z[1]), (x[0], at, z[1])]
    return panel(np.array(corners), np.array([0.0, np.sign(y), 0.0]), material)


def on_top(z: float, x: Span, y: Span, material: str) -> Shell:
    """A level panel."""
    corners = [(x[0], y[0], z + LIFT_M), (x[1], y[0], z + LIFT_M), (x[1], y[1], z + LIFT_M), (x[0], y[1], z + LIFT_M)]
    return panel(np.array(corners), np.array([0.0, 0.0, 1.0]), material)
