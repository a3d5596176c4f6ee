"""Cabs of lorries: over the front axle, or behind a short bonnet."""

from __future__ import annotations

from .fittings import along, both, head_lamps, mirrors, plates, windscreen
from .lorry import Lorry
from .solids import Span, box, on_end, on_side, prism
from .surface import Shell


def cab(lorry: Lorry) -> list[Shell]:
    """Builds the whole cab."""
    f, half, top, rng = lorry.front, lorry.cab_half, lorry.cab_height, lorry.rng
    light = lorry.kind == "light"
    back, floor = f - lorry.cab_length, lorry.floor - 0.06
    waist = (0.5 if light else 0.46) * top + rng.uniform(-0.06, 0.1)  # the windscreen's lower edge
    slope = rng.uniform(0.55, 0.7) if light else rng.uniform(0.1, 0.32)
    nose = rng.uniform(0.45, 0.6) if light else 0.0  # a short bonnet
    lower, upper = (f - nose, waist), (f - nose - slope * (top - waist) / (top - waist + 0.2), top)
    shells = [
        prism([(back, floor), (lower[0], floor), lower, upper, (back, top)], (-half, half), "paint", 0.09),
        box((lorry.first_axle + lorry.wheel + 0.05, f - 0.03), (-half, half), (0.3, floor + 0.2), "paint", 0.05),
        box((f - 0.35, f), (-half, half), (0.28, 0.28 + rng.uniform(0.25, 0.4)), str(rng.choice(["plastic", "paint"])), 0.06),
        *windscreen(along(lower, upper, 0.04), along(lower, upper, 0.86), half - 0.1),
    ]
    if light:
        bonnet = [(lower[0] - 0.2, floor), (f - 0.02, floor), (f - 0.02, 0.72 * waist), (lower[0], waist + 0.02)]
        shells.append(prism(bonnet, (-half, half), "paint", 0.08))
    shells += _face(lorry, f - 0.02, (0.5, 0.72 * waist) if light else (0.62, waist - 0.12))
    shells += _side_of_cab(lorry, back, lower, upper)
    shells += mirrors(lower[0] - 0.12, half, waist + 0.3, 0.3 if light else 0.55)
    return shells + _on_cab(lorry, back, upper)


def _face(lorry: Lorry, x: float, z: Span) -> list[Shell]:
    """Grille, lamps and plate below the windscreen."""
    half, rng = lorry.cab_half, lorry.rng
    wide, bars = rng.uniform(0.55, 0.8) * half, int(rng.integers(2, 5))
    shells = [on_end((x, z[0]), (x, z[1]), (-wide, wide), str(rng.choice(["gap", "plastic"])))]
    for k in range(bars):
        low = z[0] + (k + 0.55) * (z[1] - z[0]) / bars
        material = str(rng.choice(["chrome", "paint"]))
        shells.append(on_end((x, low), (x, low + 0.05), (-wide + 0.04, wide - 0.04), material, 2))
    low = 0.5 if lorry.kind == "light" else rng.uniform(0.36, 0.46)
    size = (0.34, 0.2) if lorry.kind == "light" else (rng.uniform(0.36, 0.5), rng.uniform(0.15, 0.22))
    return [*shells, *head_lamps(lorry.front, half, low, size), *plates(lorry.front, lorry.rear, 0.42, half)]


def _side_of_cab(lorry: Lorry, back: float, lower: Span, upper: Span) -> list[Shell]:
    """Windows, doors and steps of both sides."""
    half, rng, floor = lorry.cab_half, lorry.rng, lorry.floor
    low, high = lower[1] + 0.05, upper[1] - 0.18 * (upper[1] - lower[1])
    at, lean = along(lower, upper, 0.1)[0] - 0.12, 0.8 * (lower[0] - upper[0])
    door = max(back + 0.12, at - 1.15)
    shells = [
        on_side(half, (door - 0.02, at + 0.02), (floor - 0.02, high + 0.05), "gap", 0, lean),
        on_side(half, (door, at), (floor, high + 0.03), "paint", 1, lean),
        on_side(half, (door + 0.05, at - 0.02), (low, high), "gap", 2, lean),
        on_side(half, (door + 0.08, at - 0.06), (low + 0.03, high - 0.03), "glass", 3, lean),
        on_side(half, (door + 0.1, door + 0.28), (low - 0.18, low - 0.13), "plastic", 2),
    ]
    x = (lorry.first_axle + lorry.wheel + 0.12, lorry.front - 0.38)
    if x[1] > x[0] + 0.1:
        shells += [on_side(half, x, (z, z + 0.14), "gap") for z in (0.4, 0.66)]
    if rng.random() < 0.3:  # a stripe
        shells.append(on_side(half, (door + 0.02, at), (low - 0.4, low - 0.25), "livery", 2))
    guard = lorry.first_axle - lorry.wheel - 0.08, lorry.first_axle + lorry.wheel + 0.08
    shells.append(box(guard, (half - 0.3, half - 0.02), (floor - 0.12, floor), "plastic"))
    return [part for shell in shells for part in both(shell)]


def _on_cab(lorry: Lorry, back: float, upper: Span) -> list[Shell]:
    """Sun visor, deflector, marker lamps."""
    half, rng, top = lorry.cab_half, lorry.rng, lorry.cab_height
    shells = []
    if lorry.kind != "light" and rng.random() < 0.6:
        x, z = upper[0] + 0.12, top - 0.17 * (top - 1.4)
        shells.append(box((x - 0.12, x + 0.12), (0.12 - half, half - 0.12), (z, z + 0.07), "gap"))
    above = lorry.height - top
    if lorry.kind != "tipper" and above > 0.3 and rng.random() < 0.65:
        outline = [(upper[0] - 0.25, top - 0.05), (back + 0.1, lorry.height - 0.1), (back + 0.1, top - 0.05)]
        shells.append(prism(outline, (0.15 - half, half - 0.15), "paint", 0.02))
    for y in (0.3 - half, half - 0.3):
        shells.append(box((upper[0] - 0.2, upper[0] - 0.1), (y - 0.08, y + 0.08), (top - 0.03, top + 0.04), "indicator"))
    return shells
