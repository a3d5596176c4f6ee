"""Things beside and on a road that a detector takes for vehicles: shrubs, paint, cabinets, people in pairs.

The shares and sizes are ESTIMATES, chosen to show each kind often.
"""

from __future__ import annotations

import numpy as np

from .places import FAR_M, Site
from .props import Prop, placed
from .scene import bush, person

SHRUBS_SHARE, PAINT_SHARE, CABINETS_SHARE, PAIRS_SHARE = 0.45, 0.6, 0.3, 0.3
PAINT_M = 0.012  # above the ground, else both fight for the same pixels


def add_roadside(rng: np.random.Generator, site: Site) -> None:
    """Adds such things to a lot or a street, clear of the places of vehicles."""
    street = site.layout == "street"
    for side in (-1, 1) if street else ():
        if rng.random() < SHRUBS_SHARE:
            site.props += _shrubs(rng, site, side)
        if rng.random() < CABINETS_SHARE:
            site.props += _cabinets(rng, site, side)
    if rng.random() < PAINT_SHARE:
        for _ in range(rng.integers(2, 9)):
            lane = (rng.integers(site.lanes) - (site.lanes - 1) / 2) if street else rng.integers(-2, 2) + rng.choice([-0.1, 0.1])
            heading = 0.0 if lane < 0 else np.pi
            site.props += _paint(rng, site, rng.uniform(-60, 60), lane * site.period_m, heading)
    if rng.random() < PAIRS_SHARE:
        for _ in range(rng.integers(1, 5)):
            edge = site.aisle_m + rng.uniform(0.8, 2.5) if street else site.aisle_m / 2 - 0.6
            e, n = rng.uniform(-30, 30), rng.choice([-1, 1]) * edge
            for aside in (-0.3, 0.3):
                site.props += person(rng, tuple(site.place(e + aside, n + rng.normal(0, 0.15))))


def _shrubs(rng: np.random.Generator, site: Site, side: int) -> list[Prop]:
    """Returns a row of shrubs behind a kerb: a closed hedge, or single ones a car's length apart."""
    size, clipped = rng.uniform(0.7, 1.7), rng.random() < 0.35
    step = size * 0.7 if rng.random() < 0.5 else rng.uniform(2.0, 6.5)
    first, n = rng.uniform(-FAR_M, 30), side * (site.aisle_m + 0.5 + 0.7 * size)
    green = np.array([rng.uniform(0.02, 0.12), rng.uniform(0.05, 0.15), rng.uniform(0.015, 0.06)])
    found = []
    for e in np.arange(first, first + rng.uniform(15, 110), step):
        at = tuple(site.place(e, n + rng.normal(0, 0.1)))
        if np.hypot(*at) < 8:
            continue
        if clipped:
            sides = (max(step * 0.6, size), size, size * rng.uniform(0.7, 1.1))
            found.append(placed("box", at, sides, green, site.turn_rad, leaves=rng.uniform(0.2, 0.6), texture=0.6))
        else:
            found += bush(rng, at, size * rng.uniform(0.8, 1.3))
    return found


def _cabinets(rng: np.random.Generator, site: Site, side: int) -> list[Prop]:
    """Returns a few cabinets, bins and blocks of stone behind a kerb."""
    found = []
    for e in rng.uniform(-40, 40, rng.integers(1, 6)):
        sides = tuple(rng.uniform((0.4, 0.4, 0.5), (2.2, 1.1, 1.7)))
        at = tuple(site.place(e, side * (site.aisle_m + rng.uniform(1.0, 3.0))))
        heading = site.turn_rad + rng.normal(0, 0.1)
        found.append(placed("box", at, sides, rng.uniform(0.02, 0.6, 3), heading, texture=rng.uniform(0.05, 0.4)))
    return found


def _paint(rng: np.random.Generator, site: Site, e: float, n: float, heading_rad: float) -> list[Prop]:
    """Returns an arrow or a word on the ground, read from behind at a heading."""
    white = np.array([0.7, 0.7, 0.67]) * rng.uniform(0.5, 1.0)
    strokes = []  # (ahead, aside, turn, length, width)
    if rng.random() < 0.6:
        length, width = rng.uniform(1.5, 4.0), rng.uniform(0.12, 0.3)
        turn = rng.choice([0.0, 0.0, 0.8, -0.8])
        tip = np.array([length / 2, 0.0])
        strokes.append((0.0, 0.0, 0.0, length, width))
        for side in (-1, 1):
            angle = turn + side * rng.uniform(2.4, 2.7)
            barb = np.array([np.cos(angle), np.sin(angle)]) * 0.5
            strokes.append((*(tip + barb * 0.8), angle, 0.9, width * 1.2))
    else:
        letters, tall = rng.integers(3, 7), rng.uniform(1.0, 2.5)
        for k in range(letters):
            aside = (k - (letters - 1) / 2) * 0.5
            strokes.append((0.0, aside - 0.15, 0.0, tall, 0.09))
            strokes.append((rng.choice([-0.5, 0.0, 0.5]) * tall, aside, np.pi / 2, 0.35, 0.12))
            if rng.random() < 0.5:
                strokes.append((0.0, aside + 0.15, 0.0, tall, 0.09))
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return [
        placed(
            "box",
            tuple(site.place(e + cos * ahead - sin * aside, n + sin * ahead + cos * aside)),
            (length, width, PAINT_M),
            white,
            site.turn_rad + heading_rad + turn,
            texture=0.2,
        )
        for ahead, aside, turn, length, width in strokes
    ]
