"""Parts that lorries and buses share: wheels, lamps, bumpers, windscreens, mirrors."""

from __future__ import annotations

import numpy as np

from . import details
from .solids import Span, box, on_end, on_side, panel
from .surface import Shell, join, rounded_box

WHEEL_M, LIGHT_WHEEL_M = 0.49, 0.35  # radii of tyres: of vehicles above about 6 t, and of delivery lorries
TYRE_M, TWIN_M = 0.3, 0.56  # widths of one tyre and of two side by side
PLATE_M = (0.52, 0.115)


def wheels(x: float, outer_y: float, radius: float, twin: bool) -> list[Shell]:
    """Builds both ends of an axle at x, the tyres' outer faces at ±`outer_y`; the rim of twins lies deep."""
    width, share = (TWIN_M if twin else TYRE_M) * radius / WHEEL_M, 0.5 if twin else 0.6
    left = details.wheel(np.array([x, outer_y - 0.015, radius]), radius, width, 8 if twin else 10, share)
    axle = box((x - 0.07, x + 0.07), (0.05 - outer_y, outer_y - 0.05), (radius - 0.07, radius + 0.07), "underbody")
    return [left, left.mirrored(), axle]


def both(shell: Shell) -> list[Shell]:
    """Returns a shell and its mirror image on the other side."""
    return [shell, shell.mirrored()]


def windscreen(lower: Span, upper: Span, half: float) -> list[Shell]:
    """A pane from (x, z) `lower` to `upper` in its black frame, with wipers."""
    pane = along(lower, upper, 0.05), along(lower, upper, 0.93)
    shells = [on_end(lower, upper, (-half, half), "gap"), on_end(*pane, (0.05 - half, half - 0.05), "glass", 2)]
    foot, tip = along(lower, upper, 0.02), along(lower, upper, 0.1)
    return shells + [on_end(foot, tip, (y, y + 0.42 * half), "plastic", 3) for y in (-0.8 * half, 0.05 * half)]


def along(lower: Span, upper: Span, share: float) -> Span:
    """Returns the point of a line at a share of its length."""
    return lower[0] + share * (upper[0] - lower[0]), lower[1] + share * (upper[1] - lower[1])


def head_lamps(x: float, half: float, z: float, size: Span) -> list[Shell]:
    """Builds lamps of a size (width, height) at both ends of the front, with indicators on their outer sides."""
    inner, outer = half - 0.06 - size[0], half - 0.06
    low, high = (x, z), (x, z + size[1])
    black = on_end((x, z - 0.03), (x, z + size[1] + 0.03), (inner - 0.03, outer + 0.03), "gap")
    lamp = on_end(low, high, (inner, outer - 0.09), "headlamp", 2)
    return [part for shell in (black, lamp, on_end(low, high, (outer - 0.08, outer), "indicator", 2)) for part in both(shell)]


def tail_lamps(x: float, half: float, z: float, size: Span) -> list[Shell]:
    """Builds lamps of a size (width, height) at both ends of the rear: red, amber, red, in a row or a column."""
    shells = []
    for k, material in enumerate(("taillamp", "indicator", "taillamp")):
        y, low, high = (half - 0.05 - size[0], half - 0.05), z, z + size[1]
        if size[0] > size[1]:
            y = y[0] + k * size[0] / 3, y[0] + (k + 1) * size[0] / 3
        else:
            low, high = z + k * size[1] / 3, z + (k + 1) * size[1] / 3
        shells += both(on_end((x, low), (x, high), y, material, 2))
    case = box((x - 0.005, x + 0.06), (half - 0.08 - size[0], half - 0.02), (z - 0.03, z + size[1] + 0.03), "gap")
    return [*both(case), *shells]


def mirrors(x: float, side_y: float, z: float, tall: float) -> list[Shell]:
    """Mirrors on arms at both sides of the windscreen, `tall` metres high."""
    centre = np.array([x, side_y + 0.2, z])
    housing = rounded_box(centre, np.array([0.07, 0.11, tall / 2]), "gap", 4.0)
    y, low, high = (side_y + 0.12, side_y + 0.28), z - 0.4 * tall, z + 0.4 * tall
    corners = [(x - 0.072, y[0], low), (x - 0.072, y[1], low), (x - 0.072, y[1], high), (x - 0.072, y[0], high)]
    face = panel(np.array(corners), np.array([-1.0, 0.0, 0.0]), "chrome")
    arm = box((x - 0.03, x + 0.03), (side_y - 0.05, side_y + 0.14), (z + tall / 2 - 0.1, z + tall / 2 - 0.04), "gap", 0.01)
    return both(join([housing, face, arm]))


def doors(y: float, x: Span, z: Span, glass_z: Span, leaves: int) -> list[Shell]:
    """A door at the side at y: gaps around its leaves, a pane in each."""
    shells = [on_side(y, x, z, "gap", 4)]
    wide = (x[1] - x[0]) / leaves
    for k in range(leaves):
        left = x[0] + k * wide
        shells.append(on_side(y, (left + 0.07, left + wide - 0.07), glass_z, "glass", 5))
    return shells


def plates(front: float, rear: float, z: float, half: float) -> list[Shell]:
    """Number plates, the front one in the middle, the rear one at the left lamp."""
    behind = details.plate(rear - 0.02, z, PLATE_M, False).moved((0.0, 0.35 * half, 0.0))
    return [details.plate(front + 0.02, z, PLATE_M, True), behind]
