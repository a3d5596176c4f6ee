"""Scenes of crops: a target car as a surveillance camera sees it, its neighbours, ground, things around, light."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from .appearance import (
    CarAppearance,
    Ground,
    Light,
    sample_car_appearance,
    sample_ground,
    sample_heavy_appearance,
    sample_light,
)
from .camera import Camera, world_from_car
from .props import Prop, placed

if TYPE_CHECKING:
    from .gpu_car import GpuCar

Views = Literal["usual", "hard", "hidden"]  # hard: small cars, eye level, steep; hidden: behind another vehicle

HEAVY_SHARE = 0.4  # lorries and buses among the vehicles that hide cars in hidden views

FRAME_SIZES = ((1280, 720), (1920, 1080), (1280, 960), (720, 576), (640, 480), (2560, 1440), (1280, 720))


@dataclass
class PlacedCar:
    """A car on the ground."""

    gpu: GpuCar
    appearance: CarAppearance
    world_from_car: np.ndarray
    rolled_m: float = 0.0  # how far its wheels have rolled forwards


@dataclass
class Floor:
    """The ground plane's materials and markings; see ground.frag for the meaning of the tuples."""

    grounds: tuple[Ground, Ground]
    borders: list[tuple[float, float, float]] = field(default_factory=list)  # n_x, n_y, d: second material beyond
    kerb_width_m: float = 0.08
    frame: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 0.0)
    bays: tuple[float, float, float, float] = (0.0, 2.5, 5.0, 0.1)
    rows: tuple[float, float, float] = (0.0, 0.0, 0.0)
    paint: tuple[float, float, float, float] = (0.7, 0.7, 0.7, 0.3)
    seed: tuple[float, float] = (0.0, 0.0)


@dataclass
class Scene:
    """All input of the renderer; the target is the first car."""

    cars: list[PlacedCar]
    props: list[Prop]
    floor: Floor
    light: Light
    centre: np.ndarray  # centre of the shadow map, world
    shadow_reach_m: float
    nearest_m: float | None = None  # least depth in the picture; None: that of the nearest car
    least_rise: float = -1.0  # the sky below this elevation (sine) looks as at it: above the blurred skyline of mirrors

    @property
    def ground_radiance(self) -> np.ndarray:
        """Returns the radiance of the open ground."""
        ground = self.floor.grounds[0]
        return (ground.low + ground.high) / 2 * self.light.level

    def set_exposure(self, key: float) -> None:
        """Sets the exposure such that the scene's middle tone is `key` (linear, 0…1), as an automatic camera does."""
        middle = 0.6 * self.ground_radiance.mean() + 0.4 * 0.25 * self.light.level.mean()
        self.light.exposure = float(-np.log(1 - key) / 1.2 / middle)


def sample_elevation(rng: np.random.Generator, hard: bool = False) -> float:
    """Draws the angle below the horizon at which the camera sees the car, rad.

    Flat views of far cars are nearly as common as others. Hard views are at eye level or steep.
    """
    if hard:
        return float(np.radians(np.exp(rng.uniform(*np.log((0.4, 5)))) if rng.random() < 0.4 else rng.uniform(22, 62)))
    kind = rng.random()
    if kind < 0.45:
        return float(np.radians(np.exp(rng.uniform(np.log(0.8), np.log(20)))))
    return float(np.radians(rng.uniform(2.5, 50) if kind < 0.94 else rng.uniform(50, 68)))


def sample_view(rng: np.random.Generator, near_edge: bool, hard: bool = False) -> tuple[Camera, np.ndarray, float]:
    """Draws a camera, the ground point of its target, and the wanted size of the car in the frame (px).

    In hard views, half of the cars are small.
    """
    while True:
        size = FRAME_SIZES[rng.integers(len(FRAME_SIZES))]
        focal = np.exp(rng.uniform(np.log(0.6), np.log(6.0))) * size[0]
        car_px = np.exp(rng.normal(np.log(84), 0.62)) if rng.random() < 0.8 else np.exp(rng.uniform(np.log(24), np.log(500)))
        if hard and rng.random() < 0.5:
            car_px = np.exp(rng.uniform(*np.log((24, 64))))
        if not 24 <= car_px <= 500:
            continue
        below = sample_elevation(rng, hard)
        distance = focal * 3.9 / car_px
        height = distance * np.sin(below)
        if not 2.5 < height < 32:
            continue
        if near_edge:
            pixel = rng.uniform([0, 0], size)
            axis = rng.integers(2)
            pixel[axis] = rng.choice([0, size[axis]]) + rng.normal(0, 0.3 * car_px)
        else:
            margin = min(0.6 * car_px, 0.4 * size[1])
            pixel = rng.uniform([margin, margin], [size[0] - margin, size[1] - margin])
        offset = np.arctan2(pixel[1] - size[1] / 2, focal)
        tilt = below - offset
        if not np.radians(1) < tilt < np.radians(65):
            continue
        roll = rng.normal(0, np.radians(1.5)) if rng.random() < 0.8 else rng.uniform(-0.14, 0.14)
        camera = Camera(tuple(size), focal, height, tilt, roll)
        ground = camera.ground_from_pixel(pixel)
        if ground is not None and np.hypot(*ground[:2]) < 1.6 * distance:
            return camera, ground, car_px


def _clear(place: np.ndarray, heading: float, mesh_dims: np.ndarray, cars: list[PlacedCar], gap: float = 0.25) -> bool:
    """Returns whether a vehicle would be clear of the others.

    Points of either outline are outside the other's rectangle. One direction is not enough: a car fits between the
    points of a lorry.
    """
    own = world_from_car(place[0], place[1], heading)
    return not any(
        _enters(own, mesh_dims, car.world_from_car, car.gpu.mesh.dims, gap)
        or _enters(car.world_from_car, car.gpu.mesh.dims, own, mesh_dims, gap)
        for car in cars
    )


def _enters(pose: np.ndarray, dims: np.ndarray, other: np.ndarray, other_dims: np.ndarray, gap: float) -> bool:
    """Returns whether points of a vehicle are inside the rectangle of another one, enlarged by `gap` (m)."""
    outline = np.array([(a, b) for a in np.linspace(-0.5, 0.5, 7) for b in (-0.5, 0.0, 0.5)]) * dims[:2]
    local = (outline @ pose[:2, :2].T + pose[:2, 3] - other[:2, 3]) @ other[:2, :2]
    return bool(np.any(np.all(np.abs(local) < other_dims[:2] / 2 + gap, axis=1)))


class SceneSampler:
    """Draws random scenes from a pool of cars."""

    def __init__(self, pool: list[GpuCar], environments: int, heavy: list[GpuCar] | None = None) -> None:
        self.pool = pool
        self.heavy = heavy or []
        self.environments = environments

    def sample(
        self, rng: np.random.Generator, target: GpuCar, near_edge: bool, occluded: bool, views: Views = "usual"
    ) -> tuple[Scene, Camera]:
        """Draws a scene around a target at a random heading."""
        camera, ground, _ = sample_view(rng, near_edge, views == "hard")
        heading = rng.uniform(0, 2 * np.pi)
        first = PlacedCar(target, sample_car_appearance(rng), world_from_car(ground[0], ground[1], heading))
        cars = [first]
        layout = rng.choice(["lot", "street", "loose"], p=[0.5, 0.25, 0.25])
        floor = self._floor(rng, layout, ground, heading)
        self._neighbours(rng, layout, cars, floor)
        props = self._background(rng, ground, floor, camera, layout)
        if views == "hidden":
            self._put_vehicle_before(rng, camera, ground, cars, self.heavy if rng.random() < HEAVY_SHARE else self.pool)
        elif occluded:
            self._occlude(rng, camera, ground, cars, props)
        cars = [car for car in cars if car is first or np.linalg.norm(car.world_from_car[:3, 3] - [0, 0, camera.height_m]) > 4.5]
        light = sample_light(rng, self.environments)
        scene = Scene(cars, props, floor, light, np.array([ground[0], ground[1], 0.0]), shadow_reach_m=13.0)
        scene.set_exposure(np.exp(rng.uniform(np.log(0.09), np.log(0.32))))
        return scene, camera

    def _floor(self, rng: np.random.Generator, layout: str, place: np.ndarray, heading: float) -> Floor:
        kinds = ["asphalt", "concrete", "gravel", "grass"]
        first = rng.choice(kinds, p=[0.78, 0.12, 0.06, 0.04])
        second = rng.choice(["grass", "concrete", "gravel", "asphalt"], p=[0.5, 0.3, 0.1, 0.1])
        floor = Floor((sample_ground(rng, first), sample_ground(rng, second)), seed=tuple(rng.uniform(0, 500, 2)))
        floor.kerb_width_m = rng.choice([0.0, rng.uniform(0.05, 0.12)], p=[0.3, 0.7])
        ahead, side = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
        colour = np.array([0.75, 0.75, 0.72]) if rng.random() < 0.75 else np.array([0.75, 0.5, 0.08])
        floor.paint = (*(colour * rng.uniform(0.5, 1)), rng.uniform(0.0, 0.75))
        if layout == "lot":
            pitch = rng.uniform(2.35, 3.0)
            origin = place[:2] + ahead * (1.35 + rng.normal(0, 0.25)) + side * rng.normal(0, 0.12)
            length = rng.uniform(4.6, 5.6)
            double = rng.random() < 0.5
            origin = origin + ahead * (length / 2 if double else 0.0)  # rows that meet head to head share a line
            if rng.random() < 0.75:
                floor.bays = (1.0, pitch, length if double else length / 2, rng.uniform(0.07, 0.14))
            else:
                floor.bays = (0.0, pitch, length if double else length / 2, 0.1)
            depth = 2 * length if double else length
            pitch_to_next = depth + rng.uniform(6, 8) if rng.random() < 0.5 else 0.0
            head_line = 0.0 if double else length / 2 * rng.choice([-1, 1])
            floor.rows = (pitch_to_next, head_line, float(rng.random() < 0.5))
            floor.frame = (*origin, *side)
            if not double and rng.random() < 0.7:  # kerb in front
                sign = 1.0
                distance = (origin + ahead * (length / 2 + rng.uniform(0, 0.6))) @ ahead
                floor.borders.append((*(ahead * sign), distance))
        elif layout == "street":
            lane = rng.uniform(2.9, 3.7)
            floor.frame = (*(place[:2] + side * (lane * rng.choice([-1.5, -0.5, 0.5, 1.5]) + rng.normal(0, 0.25))), *-side)
            # lines are along the heading: the frame's second axis
            floor.bays = (2.0 if rng.random() < 0.8 else 0.0, lane, rng.uniform(6, 12), rng.uniform(0.1, 0.16))
            for sign in (-1, 1):
                if rng.random() < 0.6:
                    normal = side * sign
                    floor.borders.append((*normal, place[:2] @ normal + rng.choice([1.3, 4, 8]) + rng.exponential(1.0)))
        if layout == "loose" and rng.random() < 0.5:
            angle = rng.uniform(0, 2 * np.pi)
            normal = np.array([np.cos(angle), np.sin(angle)])
            floor.borders.append((*normal, place[:2] @ normal + rng.uniform(2.5, 12)))
        return floor

    def _neighbours(self, rng: np.random.Generator, layout: str, cars: list[PlacedCar], floor: Floor) -> None:
        pose = cars[0].world_from_car
        place, heading = pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])
        ahead, side = pose[:2, 0], pose[:2, 1]
        spots: list[tuple[np.ndarray, float]] = []
        if layout == "lot":
            occupancy = rng.uniform(0.2, 0.95)
            pitch, length = floor.bays[1], floor.bays[2]
            for row, turned in ((0, False), (1, True), (-1, True)):
                if row == 1 and floor.borders:
                    continue
                shift = 0.0 if row == 0 else (length if row == 1 else -length - rng.uniform(6, 8)) * 1.0
                if row == 1:
                    shift = 2 * 1.35 + rng.uniform(2.0, 2.6) + 0.0
                for k in range(-3, 4):
                    if (row == 0 and k == 0) or rng.random() > occupancy:
                        continue
                    flip = (rng.random() < 0.15) ^ turned
                    at = place + side * (k * pitch + rng.normal(0, 0.12)) + ahead * (shift + rng.normal(0, 0.25))
                    spots.append((at, heading + np.pi * flip + rng.normal(0, 0.025)))
        elif layout == "street":
            for _ in range(rng.integers(0, 6)):
                lane = rng.integers(-2, 3)
                at = place + side * (lane * floor.bays[1] + rng.normal(0, 0.2)) + ahead * rng.uniform(-16, 16)
                spots.append((at, heading + np.pi * (rng.random() < 0.4) + rng.normal(0, 0.03)))
        else:
            for _ in range(rng.integers(0, 5)):
                spots.append((place + rng.uniform(-9, 9, 2), rng.uniform(0, 2 * np.pi)))
        for at, angle in spots:
            gpu = self.pool[rng.integers(len(self.pool))]
            if len(cars) < 9 and _clear(at, angle, gpu.mesh.dims, cars):
                cars.append(PlacedCar(gpu, sample_car_appearance(rng), world_from_car(*at, angle)))

    def _background(self, rng: np.random.Generator, place: np.ndarray, floor: Floor, camera: Camera, layout: str) -> list[Prop]:
        props: list[Prop] = []
        away = place[:2] / np.linalg.norm(place[:2])
        across = np.array([-away[1], away[0]])

        def spot(near: float, far: float) -> tuple[float, float]:
            while True:
                at = place[:2] + across * rng.uniform(-1, 1) * far + away * rng.uniform(-0.3, 1) * far
                if np.linalg.norm(at - place[:2]) > near and np.linalg.norm(at) > 4:
                    return tuple(at)

        for _ in range(rng.poisson(1.2)):
            props += tree(rng, spot(6, 35))
        for _ in range(rng.poisson(0.8)):
            size = rng.uniform(0.6, 2.2)
            props += bush(rng, spot(3.4, 12), size)
        for _ in range(rng.poisson(0.5)):
            props += pole(rng, spot(2.6, 20))
        for _ in range(rng.poisson(0.4)):
            props += person(rng, spot(2.6, 10))
        if rng.random() < 0.35:  # wall or building behind
            distance = rng.uniform(6, 40)
            size = (rng.uniform(8, 60), rng.uniform(0.3, 12), rng.choice([rng.uniform(0.6, 2.5), rng.uniform(4, 15)]))
            angle = np.arctan2(across[1], across[0]) + rng.normal(0, 0.4)
            at = place[:2] + away * (distance + size[1]) + across * rng.normal(0, 8)
            colour = rng.uniform(0.12, 0.6) * (1 + rng.normal(0, 0.08, 3)).clip(0.7, 1.3)
            props.append(placed("box", tuple(at), size, colour, angle, texture=rng.uniform(0.1, 0.5)))
        if rng.random() < 0.15:  # barrier or wheel stop
            side = np.array(floor.frame[2:])
            ahead = np.array([side[1], -side[0]])
            at = place[:2] + ahead * rng.choice([-1, 1]) * rng.uniform(3.6, 5)
            props.append(
                placed(
                    "box",
                    tuple(at),
                    (rng.uniform(3, 20), rng.uniform(0.1, 0.3), rng.uniform(0.15, 0.9)),
                    np.ones(3) * rng.uniform(0.15, 0.6),
                    np.arctan2(side[1], side[0]),
                )
            )
        return props

    def _occlude(
        self,
        rng: np.random.Generator,
        camera: Camera,
        place: np.ndarray,
        cars: list[PlacedCar],
        props: list[Prop],
    ) -> None:
        """Puts something between the camera and the target."""
        kind = rng.choice(["pole", "bush", "tree", "person", "car", "wall"], p=[0.16, 0.2, 0.12, 0.1, 0.34, 0.08])
        if kind == "car":
            self._put_vehicle_before(rng, camera, place, cars, self.pool)
            return
        toward, aside, slope = _viewing_line(rng, camera, place)
        near = min(rng.uniform(2.6, 7), 0.5 * np.hypot(*place[:2]))
        low = min(near, 0.7 / slope + 2.2)
        if kind == "pole":
            props += pole(rng, tuple(aside + toward * near))
        elif kind == "bush":
            props += bush(rng, tuple(aside + toward * max(low, 2.2)), rng.uniform(0.8, 2.5))
        elif kind == "tree":
            props += tree(rng, tuple(aside + toward * near))
        elif kind == "person":
            props += person(rng, tuple(aside + toward * max(low, 1.5)))
        elif kind == "wall":
            props.append(
                placed(
                    "box",
                    tuple(aside + toward * max(low, 2.8)),
                    (rng.uniform(1, 5), 0.25, rng.uniform(0.6, 1.4)),
                    np.ones(3) * rng.uniform(0.1, 0.5),
                    np.arctan2(toward[0], -toward[1]) + rng.normal(0, 0.2),
                )
            )

    def _put_vehicle_before(
        self, rng: np.random.Generator, camera: Camera, place: np.ndarray, cars: list[PlacedCar], pool: list[GpuCar]
    ) -> None:
        """Puts a vehicle between the camera and the target, which then hides the target from below."""
        toward, aside, slope = _viewing_line(rng, camera, place)
        for _ in range(8):
            gpu = pool[rng.integers(len(pool))]
            far = max(2.4, min(6.5, (gpu.mesh.dims[2] - 0.5) / slope + 2.5))
            at = aside + toward * rng.uniform(2.0, far)
            angle = np.arctan2(*cars[0].world_from_car[1::-1, 0]) + rng.choice([0, np.pi, np.pi / 2, rng.uniform(0, 6)])
            is_heavy = gpu.mesh.body in ("truck", "bus")
            appearance = sample_heavy_appearance(rng) if is_heavy else sample_car_appearance(rng)
            if _clear(at, angle, gpu.mesh.dims, cars[:1], 0.1) and np.hypot(*at) > gpu.mesh.dims[0] / 2 + 3.0:
                cars[1:] = [c for c in cars[1:] if _clear(at, angle, gpu.mesh.dims, [c], 0.1)]
                cars.insert(1, PlacedCar(gpu, appearance, world_from_car(*at, angle)))
                break


def _viewing_line(rng: np.random.Generator, camera: Camera, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Returns the direction to the camera, a point beside the target, and the rise of the line of sight, m per m."""
    away_m = np.hypot(*place[:2])
    toward = -place[:2] / away_m
    aside = place[:2] + np.array([-toward[1], toward[0]]) * rng.normal(0, 1.3)
    return toward, aside, camera.height_m / away_m


def tree(rng: np.random.Generator, at: tuple[float, float]) -> list[Prop]:
    """Trunk and crown."""
    height, crown = rng.uniform(3.5, 10), rng.uniform(2, 6)
    green = np.array([rng.uniform(0.03, 0.1), rng.uniform(0.07, 0.16), rng.uniform(0.015, 0.05)])
    parts = [placed("cylinder", at, (0.3, 0.3, height * 0.7), (0.07, 0.055, 0.04))]
    for _ in range(rng.integers(2, 6)):
        centre = np.array(at) + rng.normal(0, crown * 0.25, 2)
        size = crown * rng.uniform(0.5, 1)
        parts.append(
            placed(
                "blob",
                tuple(centre),
                (size, size, size * rng.uniform(0.6, 1.1)),
                green,
                bottom_m=height * rng.uniform(0.35, 0.7),
                leaves=rng.uniform(0.45, 1),
                texture=0.5,
            )
        )
    return parts


def bush(rng: np.random.Generator, at: tuple[float, float], size: float) -> list[Prop]:
    """A few leafy blobs on the ground."""
    green = np.array([rng.uniform(0.03, 0.12), rng.uniform(0.06, 0.15), rng.uniform(0.015, 0.06)])
    return [
        placed(
            "blob",
            tuple(np.array(at) + rng.normal(0, size * 0.3, 2)),
            (size, size, size * rng.uniform(0.5, 1)),
            green,
            bottom_m=-0.15 * size,
            leaves=rng.uniform(0.4, 0.9),
            texture=0.5,
        )
        for _ in range(rng.integers(1, 4))
    ]


def pole(rng: np.random.Generator, at: tuple[float, float]) -> list[Prop]:
    """Lamp post, sign or bollard."""
    colour = np.ones(3) * np.exp(rng.uniform(np.log(0.02), np.log(0.5)))
    width = rng.uniform(0.05, 0.28)
    kind = rng.integers(3)
    if kind == 0:
        return [placed("cylinder", at, (width, width, rng.uniform(5, 10)), colour)]
    if kind == 1:
        height = rng.uniform(1.6, 2.8)
        sign = placed("box", at, (0.55, 0.04, 0.5), rng.uniform(0.1, 0.7, 3), rng.uniform(0, 3), bottom_m=height - 0.5)
        return [placed("cylinder", at, (0.07, 0.07, height), colour), sign]
    return [placed("cylinder", at, (width, width, rng.uniform(0.6, 1.2)), rng.uniform(0.05, 0.7, 3))]


def person(rng: np.random.Generator, at: tuple[float, float]) -> list[Prop]:
    """Returns a walking person: legs, trunk and head."""
    angle = rng.uniform(0, 2 * np.pi)
    skin = np.array([0.45, 0.28, 0.2]) * rng.uniform(0.3, 1.1)
    trousers, shirt = rng.uniform(0.01, 0.3, 3), rng.uniform(0.01, 0.7, 3)
    step = np.array([np.cos(angle), np.sin(angle)]) * 0.13
    return [
        placed("cylinder", tuple(np.array(at) + step), (0.16, 0.16, 0.85), trousers),
        placed("cylinder", tuple(np.array(at) - step), (0.16, 0.16, 0.85), trousers),
        placed("blob", at, (0.32, 0.46, 0.75), shirt, angle, bottom_m=0.75),
        placed("blob", at, (0.2, 0.2, 0.26), skin, bottom_m=1.47),
    ]
