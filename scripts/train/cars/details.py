"""Parts attached to the skin: wheels, mirrors, plates, handles, seats and dashboard."""

from __future__ import annotations

import numpy as np

from .mesh import MATERIALS
from .surface import Shell, flat_polygon, grid, join, rounded_box


def wheel(centre: np.ndarray, radius: float, width: float, spokes: int, rim_share: float) -> Shell:
    """Builds a left wheel; `centre` lies on the hub's outer face, the tyre's outer face is 1.5 cm further out.

    `spokes` 0 makes a closed hub cap.
    """
    turns = np.linspace(0, 2 * np.pi, 33)
    rim = rim_share * radius
    # tyre profile: (radius, y relative to the hub's outer face), inner edge first
    tyre = np.array([(rim, -width + 0.05), (0.93 * radius, -width + 0.025), (radius, -width + 0.05),
                     (radius, -0.01), (0.975 * radius, 0.01), (0.9 * radius, 0.015),
                     (rim, 0.004)])  # fmt: skip
    shells = [_revolve(tyre, turns, "tyre")]
    face = np.array([(rim, 0.004), (0.95 * rim, -0.008), (0.90 * rim, -0.02), (0.32 * rim, -0.008), (0.2 * rim, 0.0)])
    disc = _revolve(face, turns, "rim")
    if spokes:
        # holes between the spokes: dark faces of the disc's middle ring
        angle = np.arctan2(*disc.points[disc.faces][:, :, [2, 0]].mean(1).T)
        reach = np.hypot(*disc.points[disc.faces][:, :, [0, 2]].mean(1).T)
        hole = (np.cos(spokes * angle) < 0.05) & (reach < 0.86 * rim) & (reach > 0.34 * rim)
        disc.materials[hole] = MATERIALS.index("gap")
    shells.append(disc)
    shells.append(_revolve(np.array([(0.2 * rim, 0.0), (0.0, 0.0)]), turns, "rim"))
    return join(shells).moved(tuple(centre))


def _revolve(profile: np.ndarray, turns: np.ndarray, material: str) -> Shell:
    """Surface of revolution about y; profile rows (radius, y)."""
    r, y = profile[:, 0], profile[:, 1]
    points = np.stack([r * np.cos(turns)[:, None], y + 0 * turns[:, None], r * np.sin(turns)[:, None]], -1)
    return grid(points[:, ::-1], np.zeros(points.shape[:2] + (2,)), material)


def mirror(foot: np.ndarray, tip_y: float, size: float, material: str) -> tuple[Shell, np.ndarray]:
    """A left door mirror from its foot at the side glass's front corner, and its outermost point."""
    half = np.array([0.42 * size, 0.5 * (tip_y - foot[1] - 0.05), 0.42 * size])
    half[1] = max(half[1], 0.06)
    centre = np.array([foot[0] - 0.14, tip_y - half[1], foot[2] + 0.02 + 0.75 * half[2]])
    housing = rounded_box(centre, half, material, power=3.0)
    back = centre[0] - half[0] - 0.002
    dy, dz = 0.78 * half[1], 0.74 * half[2]
    face = [(back, centre[1] + a * dy, centre[2] + b * dz) for a, b in ((1, -1), (-1, -1), (-1, 1), (1, 1))]
    glass = flat_polygon(np.array(face), "chrome")
    glass.faces = glass.faces if glass.normals[0, 0] < 0 else glass.faces[:, ::-1].copy()
    glass.normals = np.tile([-1.0, 0.0, 0.0], (4, 1))
    arm_half = np.array([0.05, 0.5 * (centre[1] - foot[1]) + 0.03, 0.03])
    arm = rounded_box(np.array([centre[0] + 0.02, 0.5 * (centre[1] + foot[1]), foot[2] + 0.02]), arm_half, "plastic", 3.0, 5)
    return join([housing, glass, arm]), np.array([centre[0], tip_y, centre[2]])


def plate(x: float, z: float, size: tuple[float, float], front: bool) -> Shell:
    """A number plate on the centre line, at the front or the rear, with its dark border."""
    w, h = size[0] / 2, size[1] / 2
    sign = 1.0 if front else -1.0
    shells = []
    for grow, step, material in ((0.012, 0.0, "plastic"), (0.0, 0.004, "plate")):
        a, b = w + grow, h + grow
        corners = [(x + sign * step, sign * y, z + dz) for y, dz in ((-a, -b), (a, -b), (a, b), (-a, b))]
        shells.append(flat_polygon(np.array(corners), material))
    return join(shells)


def interior(dash_x: float, rear_x: float, half_width: float, floor_z: float, belt_z: float, roof_z: float, rows: int) -> Shell:
    """Builds dashboard, steering wheel, seats and floor, with enough detail to be seen through the glass."""
    shells = []
    seat_z = belt_z - 0.38
    length = dash_x - rear_x
    shells.append(flat_polygon(np.array([
        (rear_x, -half_width, floor_z), (dash_x + 0.3, -half_width, floor_z),
        (dash_x + 0.3, half_width, floor_z),
        (rear_x, half_width, floor_z)]), "interior"))  # fmt: skip
    shells.append(rounded_box(np.array([dash_x + 0.12, 0, belt_z - 0.16]), np.array([0.34, half_width, 0.15]), "interior"))
    shells.append(rounded_box(np.array([dash_x - 0.32, 0.38, belt_z - 0.05]), np.array([0.04, 0.17, 0.15]), "interior", 2.3))
    first = dash_x - 0.95
    top = min(belt_z + 0.14, roof_z - 0.28)
    for row in range(rows):
        x = first - row * min(0.85, (length - 1.15) / max(rows - 1, 1))
        seats = (-0.38, 0.38) if row == 0 else (-0.42, 0.0, 0.42)
        wide = 0.25 if row == 0 else 0.22
        for y in seats:
            if abs(y) + wide > half_width:
                y *= (half_width - wide) / abs(y)
            back_half = np.array([0.08, wide, 0.5 * (top - seat_z)])
            shells.append(rounded_box(np.array([x, y, 0.5 * (top + seat_z)]), back_half, "interior", 4, 5))
            shells.append(rounded_box(np.array([x - 0.02, y, top + 0.09]), np.array([0.05, 0.13, 0.085]), "interior", 3, 5))
            if row == 0:
                shells.append(rounded_box(np.array([x + 0.25, y, seat_z + 0.05]), np.array([0.27, wide, 0.09]), "interior", 4, 5))
    return join(shells)
