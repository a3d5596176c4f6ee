"""Stills for the training of the detector: all kinds of vehicles, near and far, flat and steep, by day and by night.

They show queues, and rows parked bumper to bumper. They have lorries, buses and motorcycles, and cameras that look
down by up to 60°. There are night, rain, fog and low sun. Some streets are empty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadplane_train.cars.heavy import sample_heavy
from roadplane_train.cars.mesh import CarMesh
from roadplane_train.cars.meshes import MissingFurnitureError, load_meshes
from roadplane_train.cars.motorcycle import sample_motorcycle

from .appearance import CarAppearance, Light, sample_car_appearance, sample_heavy_appearance
from .camera import Camera, world_from_car
from .frames import sample_finish
from .gpu_car import GpuCar
from .places import Site, make_lot, make_street
from .roadside import add_roadside
from .scene import PlacedCar, Scene, _clear
from .sky import WEATHERS, Effect, effects_of, sample_sky
from .stills import CAR_M, CarPool, Still, set_exposure, shadow_reach

SIZES = ((960, 544), (960, 720), (1280, 720))
HEIGHT_M, FOCAL_WIDTHS = (3.0, 40.0), (0.5, 4.0)
STEEPEST_DEG, TILT_BETA = 60.0, (1.1, 1.6)  # tilt is 60° times a beta variate
LEAST_CONTRAST = 0.05  # share of a vehicle's contrast that fog leaves; fainter vehicles are left out
MOST_VEHICLES = 90  # the nearest ones
CAR_PX = (22.0, 460.0)  # length of a car where the camera aims
LEAST_PX = 9.0  # length of the smallest vehicle
FARTHEST_M, NEAREST_M = 260.0, 4.5
# Shares and sizes below are ESTIMATES, chosen to show all kinds often.
MIX = {"truck": 0.13, "bus": 0.07, "motorcycle": 0.1}  # shares in moving traffic; the rest are cars
PARKED_MIX = {"truck": 0.03, "bus": 0.0, "motorcycle": 0.05}
POOL = {"truck": 28, "bus": 16, "motorcycle": 16}
MESH_SHARE = 0.25  # share of imported lorries and buses, if they are installed
EMPTY_SHARE, QUEUE_SHARE = 0.04, 0.45
OPEN_SKY = 0.5  # above the skylines in mirror images
QUEUE_GAP_M, FREE_GAP_M, KERB_GAP_M = (0.5, 2.5), (4.0, 40.0), (0.25, 1.6)


@dataclass(frozen=True)
class Gap:
    """How vehicles of a line follow one another: gaps in metres, share of filled places, mix of kinds."""

    range_m: tuple[float, float]
    filled: float
    mix: dict[str, float]


class VehiclePool:
    """Vehicles of all kinds, built on first use; they do not depend on the order of use."""

    def __init__(self, cars: CarPool) -> None:
        self.cars = cars
        self.meshes: dict[str, list[CarMesh]] = {kind: [] for kind in POOL}
        try:
            for mesh in load_meshes(cars.split, kind="others"):
                self.meshes[mesh.body].append(mesh)
        except MissingFurnitureError as error:
            print(f"no motorcycles, fewer lorries: {error}")
        self._others: dict[tuple[str, int], GpuCar] = {}

    def of(self, rng: np.random.Generator, mix: dict[str, float], moving: bool) -> GpuCar:
        """Draws a vehicle of a random kind; a moving motorcycle has a rider, and a parked one has none."""
        level = rng.random()
        for kind, share in mix.items():
            level -= share
            if level < 0 and (kind != "motorcycle" or self.meshes[kind]):
                number = int(rng.integers(POOL[kind]))
                return self._other(kind, 2 * (number // 2) + moving if kind == "motorcycle" else number)
        return self.cars.draw(rng)

    def _other(self, kind: str, number: int) -> GpuCar:
        if (kind, number) not in self._others:
            rng = np.random.default_rng([self.cars.seed, 5, list(POOL).index(kind), number])
            meshes = self.meshes[kind]
            if kind == "motorcycle":
                mesh = sample_motorcycle(rng, meshes, ridden=number % 2 == 1)
            elif meshes and number < MESH_SHARE * POOL[kind]:
                mesh = meshes[number % len(meshes)]
            else:
                mesh = sample_heavy(rng, kind)
            self._others[kind, number] = self.cars.renderer.upload(mesh)
        return self._others[kind, number]


def sample_wide_camera(rng: np.random.Generator) -> tuple[Camera, np.ndarray]:
    """Draws a camera, and the ground point that it aims at."""
    while True:
        size = SIZES[rng.integers(len(SIZES))]
        tilt = np.radians(STEEPEST_DEG * rng.beta(*TILT_BETA))
        height, focal = (float(np.exp(rng.uniform(*np.log(span)))) for span in (HEIGHT_M, FOCAL_WIDTHS))
        camera = Camera(size, focal * size[0], height, float(tilt), float(rng.normal(0, np.radians(2))))
        aim = np.array(camera.principal_point_px) + [rng.normal(0, 0.1) * size[0], rng.uniform(-0.1, 0.35) * size[1]]
        ground = camera.ground_from_pixel(aim)
        if ground is None:
            continue
        distance = float(np.linalg.norm(ground - [0, 0, height]))
        if distance < FARTHEST_M and CAR_PX[0] <= camera.focal_px * CAR_M / distance <= CAR_PX[1]:
            return camera, ground


class Filler:
    """Puts vehicles on a site, as far as the camera sees them and they do not touch."""

    def __init__(
        self, rng: np.random.Generator, camera: Camera, site: Site, pool: VehiclePool, weather: str, haze: float
    ) -> None:
        self.rng, self.camera, self.site, self.pool = rng, camera, site, pool
        self.dark = weather in ("dusk", "night", "rain", "fog")
        self.farthest_m = -float(np.log(LEAST_CONTRAST)) / max(haze, 1e-9)
        self.found: list[PlacedCar] = []

    def line(self, n: float, heading_rad: float, moving: bool, gap: Gap) -> None:
        """Fills a lane or a kerb at a distance `n` across the site, from end to end."""
        middle = -float(self.site.origin @ self.site.along)  # the site's e of the camera
        e = middle - FARTHEST_M + self.rng.uniform(0, 10)
        while e < middle + FARTHEST_M:
            gpu = self.pool.of(self.rng, gap.mix, moving)
            half = float(gpu.mesh.dims[0]) / 2
            e += half
            aside = self.rng.normal(0, 0.15 if moving else 0.08)
            if self.rng.random() < gap.filled:
                self.put(gpu, e, n + aside, heading_rad + self.rng.normal(0, 0.015), moving)
            e += half + float(np.exp(self.rng.uniform(*np.log(gap.range_m))))

    def put(self, gpu: GpuCar, e: float, n: float, heading_rad: float, moving: bool) -> None:
        """Adds a vehicle, if there is room and the camera sees it."""
        pose = self.site.pose(e, n, heading_rad)
        if not self._seen(pose, float(gpu.mesh.dims[0])) or not _clear(pose[:2], pose[2], gpu.mesh.dims, self.found, 0.15):
            return
        self.found.append(PlacedCar(gpu, self._appearance(gpu, moving), world_from_car(*pose)))

    def _seen(self, pose: np.ndarray, length_m: float) -> bool:
        point = np.array([*pose[:2], 0.7])
        away = float(np.linalg.norm(point - [0, 0, self.camera.height_m]))
        pixel, depth = self.camera.pixel_from_world(point[None])
        if depth[0] < NEAREST_M or not NEAREST_M + length_m / 2 <= away < self.farthest_m:
            return False
        size = self.camera.focal_px * length_m / depth[0]
        margin = 0.6 * size
        inside = (pixel[0] > -margin).all() and (pixel[0] < np.array(self.camera.image_size_px) + margin).all()
        return bool(inside and size >= LEAST_PX)

    def _appearance(self, gpu: GpuCar, moving: bool) -> CarAppearance:
        rng, body = self.rng, gpu.mesh.body
        finish = sample_heavy_appearance(rng) if body in ("truck", "bus") else sample_car_appearance(rng)
        finish.dirt *= 0.6
        if body == "motorcycle":
            finish = replace(
                finish, livery=rng.uniform(0.01, 0.6, 3) if rng.random() < 0.5 else np.full(3, rng.uniform(0.01, 0.1))
            )
        if self.dark and moving:
            finish.headlamp, finish.taillamp = rng.uniform(4, 20), rng.uniform(0.8, 3)
        return finish


def fill(filler: Filler, layout: str) -> None:
    """Fills a lot or a street."""
    rng, site = filler.rng, filler.site
    if layout == "street":
        half = site.lanes // 2
        for side in (-1, 1):
            heading = 0.0 if side < 0 else np.pi
            for lane in range(half):
                queue = rng.random() < QUEUE_SHARE
                gap = Gap(QUEUE_GAP_M if queue else FREE_GAP_M, 0.93 if queue else 0.9, MIX)
                filler.line(side * (lane + 0.5) * site.period_m, heading, True, gap)
            if rng.random() < 0.6:
                kerb = site.aisle_m - 1.15
                filler.line(side * kerb, heading, False, Gap(KERB_GAP_M, rng.uniform(0.4, 1.0), PARKED_MIX))
        return
    filled = rng.uniform(0.2, 1.0)
    for spot in site.spots:
        mix = MIX if spot.kind == "lane" else PARKED_MIX
        if spot.kind == "lane" or rng.random() < filled:
            gpu = filler.pool.of(rng, mix, spot.kind == "lane")
            heading = spot.heading_rad + rng.normal(0, 0.03)
            filler.put(gpu, spot.e + rng.normal(0, 0.1), spot.n + rng.normal(0, 0.15), heading, spot.kind == "lane")


def sample_view(rng: np.random.Generator, pool: VehiclePool) -> Still:
    """Draws a scene for the detector; a few have no vehicles."""
    empty = rng.random() < EMPTY_SHARE
    while True:
        camera, aim = sample_wide_camera(rng)
        weather = str(rng.choice(list(WEATHERS), p=list(WEATHERS.values())))
        light: Light = sample_sky(rng, weather)
        wet, turn = weather in ("wet", "rain"), rng.uniform(-np.pi / 2, np.pi / 2)
        layout = "lot" if rng.random() < 0.4 else "street"
        if layout == "lot":
            site = make_lot(rng, aim[:2], turn, wet)
        else:
            site = make_street(rng, aim[:2], turn, wet, int(rng.choice([2, 4, 6], p=[0.4, 0.4, 0.2])))
        add_roadside(rng.spawn(1)[0], site)  # of its own, so that the rest of a view does not depend on it
        site.props = [prop for prop in site.props if np.linalg.norm(prop.world_from_prop[:2, 3]) > 6]
        filler = Filler(rng, camera, site, pool, weather, light.haze)
        if not empty:
            fill(filler, layout)
            if not filler.found:
                continue
        cars = sorted(filler.found, key=lambda car: float(np.hypot(*car.world_from_car[:2, 3])))[:MOST_VEHICLES]
        centre = np.median([car.world_from_car[:2, 3] for car in cars], axis=0) if cars else aim[:2]
        skyline = OPEN_SKY if rng.random() < 0.5 else -1.0
        reach = shadow_reach(cars, centre)
        scene = Scene(cars, site.props, site.floor, light, np.append(centre, 0.0), reach, least_rise=skyline)
        set_exposure(rng, scene, "dusk" if weather == "night" else weather)
        effects: list[Effect] = effects_of(rng, weather, camera, cars)
        return Still(
            camera, scene, sample_finish(rng, weather in ("dusk", "night")), {"layout": layout, "weather": weather}, effects
        )
