"""Random clips of a data set: cars that drive, turn, halt, reverse and park among stationary cars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from .camera import Camera
from .frames import Finish, Region, box_corners, changed_region, outline, reached_region, sample_finish
from .paths import Drive, Motion
from .places import Site, Spot, make_lot, make_street
from .props import Prop
from .scene import PlacedCar, Scene, person
from .stills import CAR_M, SIZE, CarPool, car_at, sample_camera, sample_weather, seen_spots, set_exposure, wheelbase
from .traffic import Mover, Traffic, collide, mover

MOVERS = 6  # wanted number of movers
FEWEST_MOVERS = 4
ATTEMPTS = 1000
CROWDS = {"quiet": (3, 12), "busy": (9, 40), "full": (22, 40)}  # fewest parked cars, most cars in total
PERSON = np.array([[-0.4, -0.4, 0.0], [0.4, 0.4, 1.8]])  # bounds for all directions
SEEN_M = {"quiet": (28, 52), "busy": (28, 52), "full": (45, 75)}  # width of the ground at the picture's centre


@dataclass
class Clip:
    """A scene in motion."""

    camera: Camera
    scene: Scene  # poses at time 0; its props are stationary
    movers: list[Mover]  # of the scene's cars, in order
    walkers: list[tuple[list[Prop], np.ndarray]]  # parts, metres per second
    fps: float
    frames: int
    finish: Finish
    conditions: dict[str, str]

    def motions(self, time_s: float) -> list[Motion]:
        """Returns the motion of each car."""
        return [car.at(time_s) for car in self.movers]

    def at(self, time_s: float) -> Scene:
        """Returns the scene at a time."""
        cars = [
            PlacedCar(car.gpu, car.appearance, motion.world_from_car)
            for car, motion in zip(self.scene.cars, self.motions(time_s), strict=True)
        ]
        props = list(self.scene.props)
        for parts, velocity in self.walkers:
            for part in parts:
                moved = part.world_from_prop.copy()
                moved[:2, 3] += velocity * time_s
                props.append(Prop(part.shape, moved, part.colour, part.leaves, part.texture))
        still = self.scene
        return Scene(cars, props, still.floor, still.light, still.centre, still.shadow_reach_m, still.nearest_m)

    def moving_regions(self, time_s: float) -> list[Region]:
        """Returns the regions where the frame at a time differs from one without moving cars and walkers."""
        regions = []
        for car in self.movers:
            if car.drive is not None:
                reach = np.hypot(max(map(abs, car.bounds)), car.dims[1] / 2) + 0.9
                centre = car.at(time_s).world_from_car[:2, 3]
                regions.append(changed_region(self.camera, self.scene.light, centre, reach, float(car.dims[2]) + 0.3))
        for parts, velocity in self.walkers:
            centre = parts[-1].world_from_prop[:2, 3] + velocity * time_s
            regions.append(changed_region(self.camera, self.scene.light, centre, 0.8, 2.0))
        return [region for region in regions if region is not None]

    def changed(self, before_s: float, time_s: float) -> tuple[list[Region], list[Region]]:
        """Returns the regions where the frames at two times differ, and the parts of them with something in front."""
        changed, hiding = [], []
        camera, light = self.camera, self.scene.light
        for car, placed in zip(self.movers, self.scene.cars, strict=True):
            poses = [car.at(t).world_from_car for t in (before_s, time_s)]
            if not np.array_equal(*poses):
                for pose in poses:
                    changed.append(reached_region(camera, light, pose, placed.gpu.bounds))
                    hiding.append(outline(camera, box_corners(pose, placed.gpu.bounds)))
        for parts, velocity in self.walkers if before_s != time_s else []:
            for t in (before_s, time_s):
                pose = np.eye(4)
                pose[:2, 3] = parts[-1].world_from_prop[:2, 3] + velocity * t
                changed.append(reached_region(camera, light, pose, PERSON))
                hiding.append(outline(camera, box_corners(pose, PERSON)))
        return [r for r in changed if r is not None], [r for r in hiding if r is not None]


def camera_over(
    rng: np.random.Generator, least_m: float, most_m: float, size: tuple[int, int] = SIZE
) -> tuple[Camera, np.ndarray]:
    """Returns a camera that shows a given width of ground, and the ground point at its picture's centre."""
    while True:
        camera = sample_camera(rng, (size[0] * CAR_M / most_m, size[0] * CAR_M / least_m), (9, 38), size)
        middle = camera.ground_from_pixel(np.array(camera.principal_point_px))
        if middle is not None and np.linalg.norm(middle[:2]) > 14:
            return camera, middle[:2]


def lot_in_view(rng: np.random.Generator, middle: np.ndarray, wet: bool) -> Site:
    """Returns a lot whose crossing lane is in view."""
    turn, end, back = rng.uniform(-1.1, 1.1), 30.0, rng.uniform(2, 9)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    return make_lot(rng, middle - along * (end - back) - across * rng.uniform(-1, 9), turn, wet, end_e=end)


def _manoeuvres(rng: np.random.Generator, traffic: Traffic, spots: list[Spot]) -> list[Callable[[float], Drive | None]]:
    """Returns the manoeuvres to add, the rarer ones first."""
    site = traffic.site

    def near(kind: str, row_low: int, row_high: int) -> list[Spot]:
        found = [s for s in spots if s.kind == kind and row_low <= s.row <= row_high]
        return [found[i] for i in rng.permutation(len(found))]

    if site.layout == "lot":
        bays = near("bay", 0, 2)  # aisle 0 on both sides, aisle 1 on the near one
        plan = [traffic.leave(b) for b in bays[:3]] + [traffic.park(b) for b in bays[3:6]]
        plan = [plan[i] for i in rng.permutation(len(plan))[:4]]
        return [
            plan[0],
            traffic.out_of_aisle,
            *plan[1:2],
            traffic.into_aisle,
            *plan[2:],
            partial(traffic.through, halt=True),
            traffic.through,
            traffic.out_of_aisle,
        ]
    kerbs = near("kerb", -1, 1)
    return [
        traffic.u_turn,
        traffic.pull_in(kerbs[0]),
        traffic.into_driveway,
        traffic.pull_out(kerbs[1]),
        partial(traffic.through, halt=True),
        traffic.through,
        traffic.through,
    ]


def parked(rng: np.random.Generator, pool: CarPool, traffic: Traffic, spots: list[Spot], count: int) -> list[PlacedCar]:
    """Returns cars that are stationary for the whole clip, clear of all movers."""
    cars: list[PlacedCar] = []
    for i in rng.permutation(len(spots)):
        spot = spots[i]
        if len(cars) == count:
            break
        if spot.kind == "lane":
            continue
        gpu = pool.draw(rng)
        pose = traffic.site.pose(spot.e, spot.n, spot.heading_rad) + rng.normal(0, (0.1, 0.1, 0.02))
        car = car_at(rng, gpu, pose)
        stationary = mover(gpu.mesh, wheelbase(gpu.mesh), Motion(car.world_from_car))
        clear = all(np.linalg.norm(other.world_from_car[:2, 3] - pose[:2]) > 2.4 for other in cars)
        if clear and not any(collide(stationary, other, traffic.seconds) for other in traffic.movers):
            cars.append(car)
            traffic.movers.append(stationary)
    return cars


def sample_clip(
    rng: np.random.Generator,
    pool: CarPool,
    layout: str,
    weather: str,
    crowd: str,
    seconds: float,
    fps: float,
    place_seed: list[int] | None = None,
) -> Clip:
    """Draws a clip of FEWEST_MOVERS or more moving cars, and of stationary cars.

    The number of cars is that of CROWDS, or fewer if there is no room, except in a full lot. Clips of one `place_seed`
    share camera and site. Their ground is dry, as a wet one would look different.
    """
    fewest, most = CROWDS[crowd]
    for _ in range(ATTEMPTS):
        place = rng if place_seed is None else np.random.default_rng(place_seed)
        camera, middle = camera_over(place, *SEEN_M[crowd])
        _, light = sample_weather(rng, weather)
        wet, turn = weather == "wet" and place_seed is None, place.uniform(-1.2, 1.2)
        site = (
            lot_in_view(place, middle, wet) if layout == "lot" else make_street(place, middle, turn, wet, 4, place.uniform(-6, 6))
        )
        spots = [spot for spot, _ in seen_spots(camera, site, 36, -40)]
        if sum(spot.kind != "lane" for spot in spots) < 10:
            continue
        traffic = Traffic(rng, site, seconds, camera)
        driven: list[PlacedCar] = []
        for manoeuvre in _manoeuvres(rng, traffic, spots):
            gpu = pool.draw(rng)
            if len(driven) < MOVERS and traffic.add(mover(gpu.mesh, wheelbase(gpu.mesh)), manoeuvre):
                driven.append(car_at(rng, gpu, np.zeros(3), weather == "dusk"))
        if len(driven) < FEWEST_MOVERS:
            continue
        cars = driven + parked(rng, pool, traffic, spots, int(rng.integers(fewest, most + 1 - len(driven))))
        if crowd == "full" and len(cars) - len(driven) < fewest:
            continue
        for car, motion in zip(cars, traffic.movers, strict=True):
            car.world_from_car = motion.at(0.0).world_from_car
        scene = Scene(cars, site.props, site.floor, light, np.append(middle, 0.0), 45.0)
        set_exposure(rng, scene, weather)
        walkers = []
        for side in rng.choice([-1, 1], rng.integers(0, 3)):
            n = 1.5 * site.period_m + 1.0 if layout == "lot" else side * (site.aisle_m + rng.uniform(0.9, 2.5))
            start = site.place(traffic.middle_e - side * rng.uniform(2, 12), n)
            walkers.append((person(rng, tuple(start)), site.along * side * rng.uniform(1.0, 1.6)))
        finish = sample_finish(rng, weather == "dusk")
        conditions = {"layout": layout, "weather": weather}
        return Clip(camera, scene, traffic.movers, walkers, fps, round(fps * seconds), finish, conditions)
    raise RuntimeError(f"no site with room for {FEWEST_MOVERS} drivers in {ATTEMPTS} attempts: another seed may have one")
