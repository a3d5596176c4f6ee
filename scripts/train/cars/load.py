"""Load carriers of lorries: boxes, tarpaulins, buckets."""

from __future__ import annotations

import numpy as np

from .fittings import both
from .lorry import Lorry
from .solids import box, on_end, on_side, on_top, prism
from .surface import Shell


def box_body(lorry: Lorry) -> list[Shell]:
    """A smooth box with rails, doors behind, and letters or a stripe at its sides."""
    rear, front, half, floor, top, rng = lorry.rear, lorry.load_front, lorry.half, lorry.floor, lorry.height, lorry.rng
    rail = str(rng.choice(["chrome", "plastic", "paint"]))
    shells = [
        box((rear, front), (-half, half), (floor, top), "livery", 0.03),
        *(part for z in (floor, top - 0.1) for part in both(on_side(half, (rear, front), (z, z + 0.1), rail))),
        *(part for x in (rear, front - 0.08) for part in both(on_side(half, (x, x + 0.08), (floor, top), rail, 2))),
        *_letters(lorry, rear + 0.5, front - 0.5, floor + 0.25, top - 0.25),
    ]
    if rng.random() < 0.35:  # cooling unit
        shells.append(box((front, front + 0.4), (-0.8, 0.8), (top - 0.75, top - 0.12), "livery", 0.06))
        shells.append(on_end((front + 0.4, top - 0.62), (front + 0.4, top - 0.3), (-0.6, 0.6), "gap"))
    return shells


def curtains(lorry: Lorry) -> list[Shell]:
    """A tarpaulin with straps between front wall and doors."""
    rear, front, half, floor, top, rng = lorry.rear, lorry.load_front, lorry.half, lorry.floor, lorry.height, lorry.rng
    shells = [
        box((rear, front), (-half, half), (floor, top), "livery", 0.02),
        *both(on_side(half, (rear, front), (floor, floor + 0.13), "plastic")),
        *both(on_side(half, (rear, front), (top - 0.12, top), "chrome")),
        *_letters(lorry, rear + 0.8, front - 0.8, floor + 0.4, top - 0.35),
    ]
    for x in np.arange(rear + 0.35, front - 0.2, 0.62):
        shells += both(on_side(half, (x, x + 0.035), (floor + 0.02, floor + 0.3), "gap", 3))
    for x in np.arange(rear + 2.2, front - 1.0, 2.4):
        shells += both(on_side(half, (x, x + 0.02), (floor, top - 0.1), "plastic", 2))
    if rng.random() < 0.5:
        shells += both(on_side(half, (rear + 0.02, rear + 0.12), (floor, top), "chrome", 2))
    return shells


def _letters(lorry: Lorry, start: float, end: float, low: float, high: float) -> list[Shell]:
    """Adds the lettering of the sides: a stripe, a row of letters, both, or nothing."""
    rng, half = lorry.rng, lorry.half
    shells = []
    if rng.random() < 0.45:
        z = rng.uniform(low, low + 0.3 * (high - low))
        shells += both(on_side(half, (start, end), (z, z + rng.uniform(0.12, 0.45)), "paint", 2))
    if rng.random() < 0.6:
        tall = rng.uniform(0.35, 0.8)
        z, x, wide = rng.uniform(0.4 * low + 0.6 * high - tall, high - tall), start + rng.uniform(0.1, 1.0), 0.7 * tall
        for _ in range(int(rng.integers(4, 10))):
            if x + wide > end:
                break
            parts = rng.choice(4, 3, replace=False)  # strokes of a letter: left, right, top, middle
            for part in parts:
                upright = part < 2
                bar = (x + (0.75 * wide if part == 1 else 0.0), z if upright else z + (0.8 if part == 2 else 0.42) * tall)
                size = (0.25 * wide, tall) if upright else (wide, 0.2 * tall)
                place = (bar[0], bar[0] + size[0]), (bar[1], bar[1] + size[1])
                shells += both(on_side(half, *place, "paint", 3))
            x += 1.35 * wide
    return shells


def bucket(lorry: Lorry) -> list[Shell]:
    """A tipper's bucket with ribs, dark inside."""
    rear, front, half, floor, top, rng = lorry.rear, lorry.load_front, lorry.half, lorry.floor, lorry.height, lorry.rng
    wall = top - rng.uniform(0.1, 0.3)
    outline = [(rear + 0.25, floor), (front, floor), (front, wall), (rear, wall)]
    shells = [prism(outline, (0.05 - half, half - 0.05), "livery", 0.03)]
    for x in np.linspace(rear + 0.35, front - 0.15, int(rng.integers(5, 9))):
        shells += both(box((x - 0.07, x + 0.07), (half - 0.08, half), (floor, wall), "livery", 0.02))
    shells += both(box((rear, front), (half - 0.1, half), (wall - 0.14, wall + 0.02), "livery", 0.03))
    shells.append(on_top(wall + 0.01, (rear + 0.15, front - 0.15), (0.2 - half, half - 0.2), "gap"))
    hood = [(front - 0.1, wall - 0.3), (front + 0.1, wall - 0.3), (front + 0.45, top), (front - 0.1, top)]
    shells.append(prism(hood, (0.1 - half, half - 0.1), "livery", 0.03))
    return shells
