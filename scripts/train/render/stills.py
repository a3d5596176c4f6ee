"""Random still scenes of a data set: a surveillance camera over a parking lot or a street, and the weather."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from roadplane_train.cars.builder import sample_car
from roadplane_train.cars.mesh import KEYPOINT_NAMES, CarMesh

from .appearance import Light, sample_car_appearance, sample_light
from .camera import Camera, world_from_car
from .frames import Finish, sample_finish
from .gpu_car import GpuCar
from .places import Site, Spot, make_lot, make_street
from .renderer import ENVIRONMENTS, Renderer
from .scene import PlacedCar, Scene, _clear

SIZE = (1280, 720)
CAR_M = 4.3  # length of a typical car, where only its size in the picture matters
MESH_SHARE = 0.2  # share of real meshes among the cars, if they are installed
FRONT, REAR = KEYPOINT_NAMES.index("left_wheel_front"), KEYPOINT_NAMES.index("left_wheel_rear")
WEATHERS = {"sun": 0.4, "overcast": 0.22, "dusk": 0.13, "wet": 0.13, "haze": 0.12}


class CarPool:
    """The cars of a data set, built on first use; they do not depend on the order of use."""

    def __init__(self, renderer: Renderer, split: str, seed: int, meshes: list[CarMesh], size: int = 96) -> None:
        self.renderer, self.split, self.seed, self.meshes, self.size = renderer, split, seed, meshes, size
        self._built: dict[int, GpuCar] = {}

    def draw(self, rng: np.random.Generator) -> GpuCar:
        """Draws a random car."""
        number = int(rng.integers(self.size))
        if rng.random() < MESH_SHARE and self.meshes:
            number = self.size + number % len(self.meshes)
        if number not in self._built:
            mesh = (
                self.meshes[number - self.size]
                if number >= self.size
                else sample_car(np.random.default_rng([self.seed, 2, number]), split=self.split)
            )
            self._built[number] = self.renderer.upload(mesh)
        return self._built[number]


@dataclass
class Still:
    """A scene as one camera sees it."""

    camera: Camera
    scene: Scene
    finish: Finish
    conditions: dict[str, str]
    effects: list[Callable[[np.ndarray], np.ndarray]] = field(default_factory=list)  # change the drawing, in order


def wheelbase(mesh: CarMesh) -> float:
    """Returns the distance from axle to axle, m."""
    return float(mesh.keypoints[FRONT, 0] - mesh.keypoints[REAR, 0])


def sample_camera(
    rng: np.random.Generator, car_px: tuple[float, float], tilt_deg: tuple[float, float] = (5, 40), size: tuple[int, int] = SIZE
) -> Camera:
    """Draws a camera 4–20 m high, focal 0.7–3 widths, roll within 3°, with cars about `car_px` long."""
    while True:
        height, tilt = np.exp(rng.uniform(np.log(4), np.log(20))), np.radians(rng.uniform(*tilt_deg))
        focal = size[0] * np.exp(rng.uniform(np.log(0.7), np.log(3.0)))
        if car_px[0] <= focal * CAR_M * np.sin(tilt) / height <= car_px[1]:
            return Camera(size, focal, height, tilt, float(np.clip(rng.normal(0, np.radians(1.2)), -0.052, 0.052)))


def sample_weather(rng: np.random.Generator, weather: str | None = None) -> tuple[str, Light]:
    """Draws a kind of weather (of WEATHERS, which has their frequencies, unless given) and its light."""
    weather = weather or str(rng.choice(list(WEATHERS), p=list(WEATHERS.values())))
    sky = rng.choice(["overcast", "haze"], p=[0.75, 0.25]) if weather == "wet" else weather
    light = sample_light(rng, ENVIRONMENTS, sky)
    light.dapple = 0.0
    if weather == "haze":
        light.haze = rng.uniform(0.001, 0.006)
    return weather, light


def set_exposure(rng: np.random.Generator, scene: Scene, weather: str) -> None:
    """Sets the exposure as the camera's automatic would, darker at dusk."""
    scene.set_exposure(rng.uniform(0.09, 0.14) if weather == "dusk" else np.exp(rng.uniform(np.log(0.16), np.log(0.3))))


def seen_spots(camera: Camera, site: Site, least_px: float, margin_px: float) -> list[tuple[Spot, float]]:
    """Returns the spots in the picture or just outside, with the length of a car there in pixels."""
    found = []
    for spot in site.spots:
        point = np.append(site.place(spot.e, spot.n), 0.6)
        pixel, depth = camera.pixel_from_world(point[None])
        inside = np.all(pixel[0] > -margin_px) and np.all(pixel[0] < np.array(camera.image_size_px) + margin_px)
        if depth[0] > 4 and inside and np.linalg.norm(point - [0, 0, camera.height_m]) > 6:
            length = camera.focal_px * CAR_M / depth[0]
            if length >= least_px:
                found.append((spot, float(length)))
    return found


def car_at(rng: np.random.Generator, gpu: GpuCar, pose: np.ndarray, driven_in_the_dark: bool = False) -> PlacedCar:
    """Returns a car with a finish of its own at a pose (x, y, heading)."""
    appearance = sample_car_appearance(rng)
    appearance.dirt *= 0.6
    if driven_in_the_dark:
        appearance.headlamp, appearance.taillamp = rng.uniform(2, 6), rng.uniform(0.5, 1.5)
    return PlacedCar(gpu, appearance, world_from_car(*pose))


def shadow_reach(cars: list[PlacedCar], centre: np.ndarray) -> float:
    """Returns half the side of the shadow map, m: the cars and a margin."""
    away = [np.linalg.norm(car.world_from_car[:2, 3] - centre) for car in cars]
    return float(np.clip(max(away, default=0.0) + 12, 25, 90))


def _crowded(rng: np.random.Generator, spots: list[Spot], busy: Spot) -> list[Spot]:
    """Returns spots in random order, with those around `busy` rather early."""
    keys = [rng.random() * (1 + np.hypot(spot.e - busy.e, spot.n - busy.n) / 12) for spot in spots]
    return [spots[i] for i in np.argsort(keys)]


def sample_still(rng: np.random.Generator, pool: CarPool) -> Still:
    """Draws a scene with 5 cars or more that are at least 40 px long."""
    while True:
        camera = sample_camera(rng, (40, 210))
        middle = camera.ground_from_pixel(np.array(camera.principal_point_px) + [rng.normal(0, 100), rng.normal(0, 40)])
        if middle is None:
            continue
        weather, light = sample_weather(rng)
        turn = rng.uniform(-np.pi / 2, np.pi / 2)
        if rng.random() < 0.6:
            site = make_lot(rng, middle[:2], turn * 0.8, weather == "wet")
        else:
            site = make_street(rng, middle[:2], turn, weather == "wet", int(rng.choice([2, 4])))
        spots = seen_spots(camera, site, 14, 60)
        large = [spot for spot, px in spots if px > 52]
        wanted = int(np.exp(rng.uniform(np.log(8), np.log(41))))
        if len(large) < 8 or len(spots) < wanted:
            continue
        busy = large[rng.integers(len(large))]  # cars cluster
        order = _crowded(rng, large, busy)[:8] + _crowded(rng, [spot for spot, _ in spots], busy)
        cars: list[PlacedCar] = []
        for spot in order:
            gpu = pool.draw(rng)
            heading = spot.heading_rad + rng.normal(0, 0.02)
            pose = site.pose(spot.e + rng.normal(0, 0.08), spot.n + rng.normal(0, 0.12), heading)
            if len(cars) < wanted and _clear(pose[:2], pose[2], gpu.mesh.dims, cars):
                cars.append(car_at(rng, gpu, pose, spot.kind == "lane" and weather == "dusk"))
        centre = np.median([car.world_from_car[:2, 3] for car in cars], axis=0)
        scene = Scene(cars, site.props, site.floor, light, np.append(centre, 0.0), shadow_reach(cars, centre))
        set_exposure(rng, scene, weather)
        finish = sample_finish(rng, weather == "dusk")
        return Still(camera, scene, finish, {"layout": site.layout, "weather": weather})
