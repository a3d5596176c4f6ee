"""Parts between and behind the wheels of lorries."""

from __future__ import annotations

import numpy as np

from .fittings import WHEEL_M, both, tail_lamps, wheels
from .lorry import Lorry
from .solids import box, on_end
from .surface import Shell


def _axles(lorry: Lorry) -> list[tuple[float, bool]]:
    """Returns the positions of the axles behind the first, and whether their wheels are twins."""
    rear = lorry.rear
    if lorry.kind == "articulated":
        drive = lorry.first_axle - lorry.rng.uniform(3.6, 3.8)
        return [(drive, True), *((rear + x, False) for x in (2.0, 3.31, 4.62))]
    if lorry.kind == "tipper":
        return [(rear + 1.0, True), (rear + 2.35, True)]
    last = rear + (1.3 if lorry.kind == "light" else lorry.rng.uniform(1.7, 2.2))
    return [(last, True), (last + 1.35, True)] if lorry.length > 9.2 else [(last, True)]


def chassis(lorry: Lorry) -> list[Shell]:
    """Wheels, frame, tank, guards between the axles."""
    half, wheel, floor, rng = lorry.half, lorry.wheel, lorry.floor, lorry.rng
    rest = _axles(lorry)
    outer = half - 0.02
    shells = wheels(lorry.first_axle, lorry.cab_half, wheel, False)
    for x, twin in rest:
        shells += wheels(x, outer, wheel, twin)
        shells += both(box((x + wheel, x + wheel + 0.03), (outer - 0.5, outer), (0.55 * wheel, floor - 0.02), "plastic", 0.01))
    shells.append(box((lorry.rear + 0.1, lorry.front - 0.4), (-0.43, 0.43), (floor - 0.4, floor + 0.02), "underbody"))
    free_front = lorry.first_axle - wheel - 0.3
    free = [(rest[-1][0] + wheel + 0.25, free_front)]  # between the axles
    if lorry.kind == "articulated":  # the trailer's legs behind the tractor
        legs = lorry.load_front - 3.9
        shells += both(box((legs, legs + 0.15), (half - 0.5, half - 0.3), (0.25, floor), "plastic"))
        free = [(free[0][0], legs - 0.2), (rest[0][0] + wheel + 0.25, free_front)]
    for low, high in free:
        if high - low < 0.9:
            continue
        tank = min(rng.uniform(0.7, 1.2), high - low)
        if high == free_front:
            material = str(rng.choice(["chrome", "plastic", "rim"]))
            shells += both(box((high - tank, high), (half - 0.65, half - 0.06), (0.42, floor - 0.1), material, 0.12))
            high -= tank + 0.1
        if high - low > 0.5 and wheel == WHEEL_M:
            material = str(rng.choice(["chrome", "plastic", "livery"]))
            for z in (0.48, 0.76):
                shells += both(box((low, high), (half - 0.07, half - 0.03), (z, z + 0.14), material, 0.01))
    return shells


def tail(lorry: Lorry) -> list[Shell]:
    """Doors, lamps and under-run bar at the rear."""
    x, half, floor, top, rng = lorry.rear, lorry.half, lorry.floor, lorry.height, lorry.rng
    bar = 0.42 if lorry.wheel == WHEEL_M else 0.36
    shells = [
        box((x, x + 0.12), (0.06 - half, half - 0.06), (bar, bar + 0.14), str(rng.choice(["plastic", "chrome"]))),
        *tail_lamps(x + 0.02, half, floor - 0.26, (0.42, 0.16)),
    ]
    if lorry.kind == "tipper":
        return shells
    edge, seam = on_end((x, floor), (x, top), (half - 0.09, half - 0.01), "chrome"), 0.012
    shells += [*both(edge), on_end((x, floor), (x, top), (-seam, seam), "gap")]
    shells += [on_end((x, z), (x, z + 0.1), (-half, half), "plastic") for z in (floor, top - 0.12)]
    for y in (0.14, 0.32):
        shells += both(on_end((x, floor + 0.05), (x, top - 0.15), (y, y + 0.035), "chrome", 2))
    for z in np.linspace(floor + 0.4, top - 0.4, 3):
        shells += both(on_end((x, z), (x, z + 0.06), (half - 0.3, half - 0.02), "plastic", 2))
    return shells
