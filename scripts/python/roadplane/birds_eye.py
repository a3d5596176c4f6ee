"""Draws a run from above with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.pyplot import subplots

from roadplane.camera import Array, Camera

if TYPE_CHECKING:
    from roadplane.run import Run

# Reach of the drawn view over the distance of the farthest car.
_VIEW_MARGIN = 1.15


def draw(run: Run, ax: Axes | None, segment: int) -> Axes:
    """Draws a run; see `Run.plot_birds_eye`."""
    camera = run.cameras[segment]
    rows = run.tracks()
    rows = rows[rows["segment"] == segment]
    if ax is None:
        ax = subplots(figsize=(8, 8))[1]
    farthest = 20.0 if rows.empty else float(np.hypot(rows["x_m"], rows["y_m"]).max())
    ax.add_patch(Polygon(_view(camera, farthest * _VIEW_MARGIN), color="0.93", zorder=0))
    ax.plot(0, 0, marker="^", color="black")
    for index, (track, path) in enumerate(rows.groupby("track")):
        colour = f"C{index % 10}"
        last = path.iloc[-1]
        ax.plot(path["x_m"], path["y_m"], color=colour, linewidth=1)
        ax.add_patch(Polygon(_footprint(*last[["x_m", "y_m", "heading_rad", "length_m", "width_m"]]), color=colour, alpha=0.5))
        ax.annotate(str(track), (last["x_m"], last["y_m"]), ha="center", va="center", fontsize=8)
    ax.set_aspect("equal")
    ax.set_xlabel("x, m (right of the camera)")
    ax.set_ylabel("y, m (ahead of the camera)")
    return ax


def _footprint(x: float, y: float, heading: float, length: float, width: float) -> Array:
    """Returns [4, 2] corners, m. The centre is the middle between the axles, within 0.2 m of the body's centre."""
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [length / 2, width / 2]
    turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    return np.asarray(corners @ turn + [x, y])


def _view(camera: Camera, reach: float) -> Array:
    """Returns the [n, 2] outline of the ground that the camera sees within a reach, m."""
    width, height = camera.image_size_px
    down = np.linspace(0, height - 1, 200)
    left, right = (camera.ground_from_pixel(np.column_stack([np.full_like(down, x), down])) for x in (0, width - 1))
    outline = np.concatenate([left, right[::-1]])
    distance = np.linalg.norm(outline, axis=1)
    return np.asarray(outline[np.isfinite(distance) & (distance <= reach)])
