"""Sites where cars park and drive: parking lots with rows of bays, streets with kerbs; ground, spots, things around.

A site has its own ground frame: e along its rows or its road, n across (left of e). The origin is in the middle of an
aisle or of the road. Metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .appearance import sample_ground
from .props import Prop, placed
from .scene import Floor, bush, person, pole, tree

FAR_M = 130.0  # all things are nearer to the site's origin


@dataclass(frozen=True)
class Spot:
    """A position to park in: site coordinates, heading relative to e."""

    e: float
    n: float
    heading_rad: float
    kind: str  # bay, kerb, lane
    row: int = 0
    number: int = 0


@dataclass
class Site:
    """A parking lot or a street on the ground."""

    layout: str
    origin: np.ndarray  # world, (2,)
    turn_rad: float  # of e, world
    floor: Floor
    spots: list[Spot]
    props: list[Prop] = field(default_factory=list)
    aisle_m: float = 0.0  # lot: width of an aisle; street: half the road between its kerbs
    period_m: float = 0.0  # lot: distance of two aisles' centres; street: width of a lane
    lanes: int = 0  # street
    end_e: float = np.inf  # lot: end of its rows, where open ground begins
    driveway_e: float = np.inf  # street

    @property
    def along(self) -> np.ndarray:
        """Returns the unit vector of e, world."""
        return np.array([np.cos(self.turn_rad), np.sin(self.turn_rad)])

    @property
    def across(self) -> np.ndarray:
        """Returns the unit vector of n, world."""
        return np.array([-np.sin(self.turn_rad), np.cos(self.turn_rad)])

    def place(self, e: float, n: float) -> np.ndarray:
        """Returns the world point (2,) of a site point."""
        return self.origin + self.along * e + self.across * n

    def pose(self, e: float, n: float, heading_rad: float) -> np.ndarray:
        """Returns the world pose (x, y, heading) of a site pose."""
        return np.array([*self.place(e, n), self.turn_rad + heading_rad])

    @property
    def camera_n(self) -> float:
        """Returns the camera's n."""
        return float(-self.origin @ self.across)


def make_lot(rng: np.random.Generator, origin: np.ndarray, turn_rad: float, wet: bool, end_e: float | None = None) -> Site:
    """Makes rows of bays on both sides of aisles.

    With `end_e` they end near there at a crossing lane, for turning cars.
    """
    pitch, length, aisle = rng.uniform(2.5, 2.9), rng.uniform(4.9, 5.4), rng.uniform(6.4, 7.2)
    period = aisle + 2 * length
    floor = _floor(rng, "asphalt" if end_e is not None else rng.choice(["grass", "concrete", "gravel"], p=[0.6, 0.3, 0.1]), wet)
    site = Site("lot", origin, turn_rad, floor, [], aisle_m=aisle, period_m=period)
    floor.frame = (*site.place(0, period / 2), *site.along)
    floor.bays = (1.0 if rng.random() < 0.92 else 0.0, pitch, length, rng.uniform(0.08, 0.13))
    floor.rows = (period, 0.0, float(rng.random() < 0.6))
    last = int(rng.integers(0, 3)) if end_e is None else 1  # aisles beyond the middle one
    far = last * period + aisle / 2 + length
    if end_e is not None:
        site.end_e = pitch * round(end_e / pitch)
        floor.grounds[1].low, floor.grounds[1].high = floor.grounds[0].low * 0.97, floor.grounds[0].high * 0.97
        floor.kerb_width_m = 0.0
        floor.borders = [(*site.along, float(site.place(site.end_e, 0) @ site.along))]
    else:
        floor.borders = [(*site.across, float(site.place(0, far + 0.3) @ site.across))]
        if rng.random() < 0.5:
            side = rng.choice([-1, 1])
            edge = side * pitch * round(rng.uniform(16, 40) / pitch)
            floor.borders.append((*(site.along * side), float(site.place(edge, 0) @ (site.along * side))))
    for aisle_number in range(-4, last + 1):
        for side in (-1, 1):
            n = aisle_number * period + side * (aisle + length) / 2
            for k in range(int(-FAR_M / pitch), int(FAR_M / pitch)):
                e = (k + 0.5) * pitch
                if _within(site, e, n, margin=pitch / 2):
                    nose = side * np.pi / 2 + np.pi * (rng.random() < 0.3)
                    site.spots.append(Spot(e, n, nose, "bay", 2 * aisle_number + (side > 0), k))
    for _ in range(rng.integers(0, 7)):
        site.spots.append(
            Spot(
                rng.uniform(-25, min(25, site.end_e)),
                rng.integers(-1, last + 1) * period + rng.choice([-1, 1]) * rng.uniform(1.2, 1.7),
                rng.choice([0, np.pi]),
                "lane",
            )
        )
    _lot_props(rng, site, pitch, far)
    return site


def _within(site: Site, e: float, n: float, margin: float) -> bool:
    """Returns whether a point lies on the first ground, clear of its borders."""
    return all(site.place(e, n) @ np.array(border[:2]) < border[2] - margin for border in site.floor.borders)


def _floor(rng: np.random.Generator, beyond: str, wet: bool) -> Floor:
    grounds = sample_ground(rng, "asphalt"), sample_ground(rng, beyond)
    for ground in grounds:
        brightest = ground.high.max()
        if brightest > 0.3:  # with an exposure for asphalt, bright concrete would be overexposed
            ground.low, ground.high = ground.low * 0.3 / brightest, ground.high * 0.3 / brightest
        ground.gloss = rng.uniform(0.2, 0.6) if wet else 0.0
    floor = Floor(grounds, seed=tuple(rng.uniform(0, 500, 2)))
    floor.kerb_width_m = rng.uniform(0.08, 0.14)
    white = np.array([0.7, 0.7, 0.67]) if rng.random() < 0.85 else np.array([0.7, 0.5, 0.1])
    floor.paint = (*(white * rng.uniform(0.7, 1)), rng.uniform(0.0, 0.5))
    return floor


def _lot_props(rng: np.random.Generator, site: Site, pitch: float, far: float) -> None:
    """Trees, hedge and a building behind the last row, lamps and a few trees between the rows, people."""
    behind = far + (8.0 if np.isfinite(site.end_e) else 0.0)
    planted = rng.choice(["trees", "hedge", "building", "open"], p=[0.4, 0.2, 0.3, 0.1])
    if site.camera_n < far:
        if planted in ("trees", "building"):
            for e in np.arange(-70, 71, rng.uniform(6, 12)):
                site.props += tree(rng, tuple(site.place(e + rng.normal(0, 1.5), behind + 3.5 + rng.exponential(3))))
        if planted == "hedge":
            for e in np.arange(-50, 51, 1.3):
                site.props += bush(rng, tuple(site.place(e, behind + 1.4 + rng.normal(0, 0.2))), rng.uniform(1.2, 1.9))
        if planted == "building":
            _building(rng, site, rng.uniform(-30, 10), behind + rng.uniform(9, 16), 1, rng.uniform(20, 50))
    between = site.period_m / 2
    for row in (-1, 0, 1):
        if rng.random() < 0.6 and row * site.period_m + between < far:
            for e in pitch * np.round(rng.uniform(-30, min(30, site.end_e - 2), rng.integers(1, 4)) / pitch):
                at = tuple(site.place(e, row * site.period_m + between))
                if np.hypot(*at) > 12:
                    site.props += tree(rng, at) if rng.random() < 0.35 else pole(rng, at)
    for _ in range(rng.integers(0, 5)):
        site.props += person(
            rng,
            tuple(
                site.place(
                    rng.uniform(-18, min(18, site.end_e)),
                    rng.choice([-1, 1]) * (site.aisle_m / 2 - 0.5) + rng.integers(-1, 1) * site.period_m,
                )
            ),
        )


def make_street(
    rng: np.random.Generator, origin: np.ndarray, turn_rad: float, wet: bool, lanes: int, driveway_e: float = np.inf
) -> Site:
    """Makes a road with two or four lanes, cars parked along both kerbs, pavements, trees and houses.

    Traffic keeps right.

    With `driveway_e`, drives lead off it there on both sides.
    """
    width = rng.uniform(3.1, 3.6)
    floor = _floor(rng, rng.choice(["concrete", "grass", "asphalt"], p=[0.65, 0.2, 0.15]), wet)
    kerb = lanes * width / 2 + 2.3
    site = Site("street", origin, turn_rad, floor, [], aisle_m=kerb, period_m=width, lanes=lanes, driveway_e=driveway_e)
    floor.frame = (*site.origin, *site.across)
    floor.bays = (2.0, width, rng.uniform(7, 12), rng.uniform(0.1, 0.15))
    floor.borders = [(*(site.across * side), float(site.origin @ (site.across * side)) + kerb) for side in (-1, 1)]
    for side in (-1, 1):
        heading = 0.0 if side < 0 else np.pi
        gap, k = rng.uniform(5.9, 6.6), 0
        for e in np.arange(-FAR_M, FAR_M, gap):
            if abs(e - driveway_e) < 7:
                continue
            site.spots.append(Spot(e, side * (kerb - 1.15), heading, "kerb", side, k))
            k += 1
        for lane in range(lanes // 2):
            e = -FAR_M
            while (e := e + rng.uniform(8, 30)) < FAR_M:
                site.spots.append(Spot(e, side * (lane + 0.5) * width, heading, "lane", side * (lane + 1)))
    _street_props(rng, site, kerb)
    return site


def _street_props(rng: np.random.Generator, site: Site, kerb: float) -> None:
    """Trees, lamps, people and houses beside the road; few on the camera's own side."""
    for side in (-1, 1):
        ours = side * site.camera_n > 0
        for e in np.arange(-90, 91, rng.uniform(9, 16)):
            at = tuple(site.place(e + rng.normal(0, 1), side * (kerb + rng.uniform(0.9, 1.6))))
            wanted = rng.random() < (0.12 if ours else 0.7) and np.hypot(*at) > 14
            if wanted and abs(e - site.driveway_e) > 7:
                site.props += tree(rng, at) if rng.random() < 0.6 else pole(rng, at)
        for e in rng.uniform(-35, 35, rng.integers(0, 5)):
            if abs(e - site.driveway_e) > 4:
                site.props += person(rng, tuple(site.place(e, side * (kerb + rng.uniform(0.8, 2.5)))))
        if side * site.camera_n < kerb:
            e = rng.uniform(-80, -60)
            while e < 80:
                length = rng.uniform(12, 28)
                if e < site.driveway_e + 5 and e + length > site.driveway_e - 5:
                    e = site.driveway_e + 5
                _building(rng, site, e, kerb + rng.uniform(3.5, 9), side, length)
                e += length + rng.uniform(0, 9)
    if np.isfinite(site.driveway_e):
        grey = (site.floor.grounds[0].low + site.floor.grounds[0].high) / 2
        for side in (-1, 1):
            at = site.place(site.driveway_e, side * (kerb + 19.9))
            site.props.append(placed("box", tuple(at), (6.4, 40.0, 0.02), grey, site.turn_rad, texture=0.2))


def _building(rng: np.random.Generator, site: Site, e: float, n: float, side: int, length: float) -> None:
    """Makes a block from e on, with its front at n and rows of windows."""
    depth, height = rng.uniform(8, 14), rng.choice([4.0, 7.0, 10.0])
    wall = np.array([0.42, 0.37, 0.31]) * rng.uniform(0.5, 1.4) + rng.normal(0, 0.02, 3)
    site.props.append(
        placed(
            "box",
            tuple(site.place(e + length / 2, side * (n + depth / 2))),
            (length, depth, height),
            wall.clip(0.05, 0.8),
            site.turn_rad,
            texture=0.15,
        )
    )
    pane = np.array([0.03, 0.035, 0.045])
    for bottom in np.arange(1.0, height - 2, 3.1):
        for at in np.arange(2.0, length - 1.5, 3.6):
            site.props.append(
                placed(
                    "box",
                    tuple(site.place(e + at, side * (n - 0.02))),
                    (1.5, 0.1, 1.5),
                    pane,
                    site.turn_rad,
                    bottom_m=float(bottom),
                )
            )
