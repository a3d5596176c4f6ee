"""Outlines of vehicles, so that boxes stay tight when a picture is rolled.

An outline is a convex polygon [k, 2] in px from the picture's corner.
"""

from __future__ import annotations

import cv2
import numpy as np

# Share of each side of a box that its cut corners take. Boxes around rolled octagons then have the mean size of boxes
# around rolled cars: see `test_data.py`.
CUT_CORNER = 0.3


def octagon(box: np.ndarray) -> np.ndarray:
    """Returns a box with cut corners: a vehicle fills its box, but not the corners."""
    (x0, y0, x1, y1), cut = box, CUT_CORNER
    dx, dy = (x1 - x0) * cut, (y1 - y0) * cut
    corners = [(x0 + dx, y0), (x1 - dx, y0), (x1, y0 + dy), (x1, y1 - dy)]
    corners += [(x1 - dx, y1), (x0 + dx, y1), (x0, y1 - dy), (x0, y0 + dy)]
    return np.array(corners)


def bounds(points: np.ndarray) -> np.ndarray:
    """Returns the box around points."""
    return np.concatenate([points.min(0), points.max(0)])


def visible_outline(points: np.ndarray, whole: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Returns the outline of the visible part of a car.

    `points` [n, 2] are its projected keypoints or corners, hidden ones too. Their hull is stretched to the box of the
    whole car and cut by the box of the visible part.
    """
    hull = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    low, high = hull.min(0), hull.max(0)
    stretched = (hull - low) / np.maximum(high - low, 1e-6) * (whole[2:] - whole[:2]) + whole[:2]
    part = _within(stretched, visible)
    if len(part) < 3:
        return octagon(visible)
    # The visible part may end before the hull does: behind a car that has an outline of its own.
    low, high = part.min(0), part.max(0)
    return (part - low) / np.maximum(high - low, 1e-6) * (visible[2:] - visible[:2]) + visible[:2]


def _within(polygon: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Returns the part of a convex polygon inside a box, by Sutherland and Hodgman's clipping."""
    for axis, limit, sign in ((0, box[0], 1), (1, box[1], 1), (0, box[2], -1), (1, box[3], -1)):
        depth = sign * (polygon[:, axis] - limit)
        kept = []
        for a, b, da, db in zip(polygon, np.roll(polygon, -1, 0), depth, np.roll(depth, -1), strict=True):
            if da >= 0:
                kept.append(a)
            if (da >= 0) != (db >= 0):
                kept.append(a + (b - a) * da / (da - db))
        if len(kept) < 3:
            return np.zeros((0, 2))
        polygon = np.array(kept)
    return polygon
