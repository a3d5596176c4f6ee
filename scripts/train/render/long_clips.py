"""Random long clips of a parking lot with steady traffic: constant numbers of cars in view and of drivers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from .camera import Camera
from .clips import Clip, camera_over, lot_in_view, parked
from .frames import sample_finish
from .paths import Drive
from .places import Spot
from .props import Prop
from .renderer import MAX_CARS
from .scene import PlacedCar, Scene, person
from .stills import CarPool, car_at, sample_weather, seen_spots, set_exposure, wheelbase
from .traffic import Mover, Traffic, in_picture, mover

SEEN_M = (42, 60)  # width of the ground at the picture's centre
SPAN_S = 12.0  # interval in which one manoeuvre is placed
STEP_S = 0.5  # between times at which drivers are counted
FAILURES = 80  # failed manoeuvres after which a scene's traffic is complete
SHORT_OF = 0.6  # accepted share of the wanted drivers, on average
CLEAR_M = 0.3  # between cars and things
TALL_M = 1.7  # things that begin higher are no obstacle


def sample_long_clip(
    rng: np.random.Generator,
    pool: CarPool,
    weather: str,
    size: tuple[int, int],
    seconds: float,
    fps: float,
    cars: int,
    drivers: int,
) -> Clip:
    """Draws a lot with about `cars` in view at any time, of which about `drivers` drive, park, leave or pass."""
    while True:
        camera, middle = camera_over(rng, *SEEN_M, size)
        _, light = sample_weather(rng, weather)
        site = lot_in_view(rng, middle, weather == "wet")
        spots = [spot for spot, _ in seen_spots(camera, site, 0.028 * size[0], -40)]
        if sum(spot.kind == "bay" for spot in spots) < 1.5 * cars:
            continue
        traffic = Traffic(rng, site, seconds, camera)
        busy, driving, present = _steady(rng, pool, traffic, spots, drivers, MAX_CARS - cars // 2, weather == "dusk")
        if driving.mean() < drivers - SHORT_OF:
            continue
        stationary = max(round(cars - present.mean()), 0)
        placed = busy + parked(rng, pool, traffic, spots, stationary)
        if len(placed) < len(busy) + stationary or len(placed) > MAX_CARS:
            continue
        for car, motion in zip(placed, traffic.movers, strict=True):
            car.world_from_car = motion.at(0.0).world_from_car
        scene = Scene(placed, site.props, site.floor, light, np.append(middle, 0.0), 45.0, _nearest(camera))
        set_exposure(rng, scene, weather)
        walkers = []
        for _ in range(rng.integers(0, 3)):  # along the last row, away from turning cars
            start = site.place(min(traffic.middle_e + rng.uniform(5, 25), site.end_e - 3), 1.5 * site.period_m + 1.0)
            walkers.append((person(rng, tuple(start)), -site.along * rng.uniform(0.9, 1.4)))
        finish = sample_finish(rng, weather == "dusk")
        conditions = {"layout": "lot", "weather": weather}
        return Clip(camera, scene, traffic.movers, walkers, fps, round(fps * seconds), finish, conditions)


def _nearest(camera: Camera) -> float:
    """Returns the depth of the ground at the picture's lower edge, so that the depth buffers of all frames agree."""
    width, height = camera.image_size_px
    points = [camera.ground_from_pixel(np.array([x, height])) for x in (0, width)]
    return min(float(camera.pixel_from_world(point[None])[1][0]) for point in points if point is not None)


def _steady(
    rng: np.random.Generator, pool: CarPool, traffic: Traffic, spots: list[Spot], drivers: int, most: int, dark: bool
) -> tuple[list[PlacedCar], np.ndarray, np.ndarray]:
    """Returns drives such that about `drivers` cars drive in view at all times.

    It also returns how many drive, and how many of these cars are in view, every STEP_S.
    """
    times = np.arange(0, traffic.seconds, STEP_S)
    driving, present = np.zeros(len(times), int), np.zeros(len(times), int)
    driven: list[PlacedCar] = []
    failures = 0
    seen: dict[str, np.ndarray] = {}

    def suits(car: Mover) -> bool:
        motions = [car.at(time_s) for time_s in times]
        seen["present"] = in_picture(traffic.camera, motions)
        seen["driving"] = seen["present"] & np.array([motion.speed_mps != 0 for motion in motions])
        wanted = (seen["driving"] & (driving == driving.min())).any()
        return bool(wanted and (driving + seen["driving"]).max() <= drivers + 1 and _clear_of_props(car, traffic))

    while failures < FAILURES and len(driven) < most and driving.min() < drivers:
        few = times[driving == driving.min()]
        traffic.begin_s = float(few[rng.integers(len(few))]) - SPAN_S / 2
        traffic.span_s = SPAN_S
        gpu = pool.draw(rng)
        if traffic.add(mover(gpu.mesh, wheelbase(gpu.mesh)), _manoeuvre(rng, traffic, spots), 4, suits):
            driven.append(car_at(rng, gpu, np.zeros(3), dark))
            driving += seen["driving"]
            present += seen["present"]
        else:
            failures += 1
    return driven, driving, present


def _manoeuvre(rng: np.random.Generator, traffic: Traffic, spots: list[Spot]) -> Callable[[float], Drive | None]:
    bays = [spot for spot in spots if spot.kind == "bay" and 0 <= spot.row <= 2]  # of the aisles that are driven
    kind = rng.choice(["park", "leave", "halt", "through", "out", "in"], p=[0.2, 0.2, 0.1, 0.2, 0.15, 0.15])
    if kind in ("park", "leave") and bays:
        spot = bays[rng.integers(len(bays))]
        return traffic.park(spot) if kind == "park" else traffic.leave(spot)
    others = {"halt": partial(traffic.through, halt=True), "out": traffic.out_of_aisle, "in": traffic.into_aisle}
    return others.get(kind, traffic.through)


def _clear_of_props(car: Mover, traffic: Traffic) -> bool:
    """Returns whether a car never drives into a thing while it is in view."""
    motions = [car.at(time_s) for time_s in np.arange(0, traffic.seconds, 0.25)]
    inside = in_picture(traffic.camera, motions)
    props = [prop for prop in traffic.site.props if prop.world_from_prop[2, 3] < TALL_M]
    poses = np.array([motion.world_from_car for motion, shown in zip(motions, inside, strict=True) if shown])
    return not any(_meets(car, poses, prop) for prop in props)


def _meets(car: Mover, poses: np.ndarray, prop: Prop) -> bool:
    """Returns whether a car touches a thing at any pose; one's points are tested in the other's rectangle."""
    half = np.linalg.norm(prop.world_from_prop[:2, :2], axis=0) / 2
    ahead, side = poses[:, :2, 0], poses[:, :2, 1]
    away = prop.world_from_prop[:2, 3] - poses[:, :2, 3]
    x, y = (away * ahead).sum(1), (away * side).sum(1)
    reach = half.min() + CLEAR_M
    over = (x > car.bounds[0] - reach) & (x < car.bounds[1] + reach) & (np.abs(y) < car.dims[1] / 2 + reach)
    if over.any() or half.max() < 1:
        return bool(over.any())
    outline = np.array([(a, b) for a in np.linspace(*car.bounds, 7) for b in (-car.dims[1] / 2, car.dims[1] / 2)])
    points = poses[:, None, :2, 3] + outline[None] @ poses[:, :2, :2].transpose(0, 2, 1)
    local = (points - prop.world_from_prop[:2, 3]) @ (prop.world_from_prop[:2, :2] / (2 * half) / half)
    return bool((np.abs(local) < 1).all(2).any())
