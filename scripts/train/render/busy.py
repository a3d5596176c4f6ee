"""Makes clips of busy streets with truth: in seconds without pictures or, with `--pixels`, as videos.

  roadplane-train render busy --out DIR

A street with a junction has a queue at the light, lanes with overtaking, and lorries and buses that hide cars. Cars
leave their bays, and others take them. `outlines` computes the visible parts in either case. File formats: `truth.py`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from roadplane_train.cars.builder import sample_car
from roadplane_train.cars.heavy import sample_heavy
from roadplane_train.cars.mesh import CarMesh
from roadplane_train.json_files import write_json

from .appearance import Light, sample_car_appearance, sample_heavy_appearance
from .camera import Camera
from .dataset import TRUTH
from .frames import ExactCanvas, Region, VideoWriter, ffmpeg, finished, reached_region, sample_finish
from .junction import Junction, Vehicle, touching
from .outlines import Outlines
from .paths import Motion
from .places import Site, make_street
from .renderer import Renderer
from .scene import PlacedCar, Scene
from .stills import WEATHERS, sample_weather, set_exposure, wheelbase
from .truth import SMALLEST_SHARE, car_record, dataset_record, item_record

MODELS = {"car": 24, "truck": 8, "bus": 4}
IN_VIEW = (18, 45)  # vehicles in the picture, on average
LEAST_PX = 20.0  # longer side of the vehicles that count for that
CARRIED_M = 2.5  # height of carried cars above the road
OPEN_SKY = 0.5  # above the skylines in mirror images


def sample_camera(rng: np.random.Generator, size: tuple[int, int]) -> Camera:
    """Draws a camera above or beside the street: 6–12 m high, with a street's length in view."""
    return Camera(
        size,
        size[0] * rng.uniform(0.9, 1.5),
        rng.uniform(6, 12),
        np.radians(rng.uniform(9, 17)),
        float(np.clip(rng.normal(0, 0.015), -0.04, 0.04)),
    )


def sample_street(rng: np.random.Generator, camera: Camera, wet: bool) -> Site:
    """Draws a street that leads away from the camera, straight or at an angle, its junction at the picture's centre."""
    middle = camera.ground_from_pixel(np.array(camera.principal_point_px) + [0, 0.1 * camera.image_size_px[1]])
    ahead = np.array([0.0, min(float(middle[1]) if middle is not None else 45.0, 55.0)])
    turn = np.pi / 2 + rng.choice([-1, 1]) * (rng.uniform(0.05, 0.3) if rng.random() < 0.6 else rng.uniform(0.5, 1.0))
    across = np.array([-np.sin(turn), np.cos(turn)])
    return make_street(rng, ahead + across * rng.uniform(-6, 6), turn, wet, 4, rng.uniform(-4, 8))


def sample_busy(
    rng: np.random.Generator, split: str, seconds: float, fps: float, size: tuple[int, int]
) -> tuple[Camera, Site, list[Vehicle], list[list[dict]], np.random.Generator]:
    """Draws a scene in which no vehicles touch and enough are visible, with the cars of its frames."""
    meshes = {
        kind: [sample_car(rng, split=split) if kind == "car" else sample_heavy(rng, kind) for _ in range(count)]
        for kind, count in MODELS.items()
    }
    wheelbases = {
        id(mesh): wheelbase(mesh) if kind == "car" else 0.55 * float(mesh.dims[0])
        for kind, many in meshes.items()
        for mesh in many
    }
    while True:
        camera = sample_camera(rng, size)
        site = sample_street(rng, camera, False)
        site.props = [prop for prop in site.props if np.linalg.norm(prop.world_from_prop[:2, 3]) > 9]
        vehicles = Junction(rng, site, seconds, meshes, rng.uniform(3.5, 6.0), wheelbases).run()
        if _in_view(camera, vehicles, seconds) and not touching(vehicles, seconds):
            return camera, site, vehicles, frames_of([camera] * round(seconds * fps), site, vehicles, fps), rng


class OffPlane:
    """A vehicle that is off the plane of its path: on a rise of the road, or on a car transporter."""

    def __init__(self, vehicle: Vehicle, world_from_plane: np.ndarray, from_m: float = -np.inf) -> None:
        """Takes the vehicle on the plane, the motion (4 × 4) to its place, and the world y (m) from which it counts."""
        self.vehicle, self.mesh = vehicle, vehicle.mesh
        self.world_from_plane, self.from_m = world_from_plane, from_m

    def at(self, time_s: float) -> Motion | None:
        """Returns the motion of the vehicle at a time; None if it is not there."""
        motion = self.vehicle.at(time_s)
        if motion is None or motion.world_from_car[1, 3] <= self.from_m:
            return motion
        return replace(motion, world_from_car=self.world_from_plane @ motion.world_from_car)


def with_rise(vehicles: Sequence[Vehicle], slope: float, from_m: float) -> list[OffPlane]:
    """Returns the vehicles on a road whose slope changes by `slope` at the world y `from_m`."""
    cos, sin = np.cos(np.arctan(slope)), np.sin(np.arctan(slope))
    turn, there = np.eye(4), np.eye(4)
    turn[1:3, 1:3], there[1, 3] = [[cos, -sin], [sin, cos]], from_m
    return [OffPlane(vehicle, there @ turn @ np.linalg.inv(there), from_m) for vehicle in vehicles]


def with_carried(vehicles: Sequence[Vehicle], share: float) -> list[Vehicle | OffPlane]:
    """Returns the vehicles. About this share of the cars is carried, evenly distributed; transporters are left out."""
    raised = np.eye(4)
    raised[2, 3] = CARRIED_M
    chosen = np.diff(np.ceil(share * np.arange(len(vehicles) + 1) - 1e-9)) > 0
    pairs = zip(vehicles, chosen, strict=True)
    return [OffPlane(vehicle, raised) if is_chosen and vehicle.kind == "car" else vehicle for vehicle, is_chosen in pairs]


def _in_view(camera: Camera, vehicles: list[Vehicle], seconds: float) -> bool:
    counts = []
    for time_s in np.linspace(0, seconds, 6):
        places = np.array([m.world_from_car[:3, 3] for v in vehicles if (m := v.at(time_s)) is not None])
        pixels, depth = camera.pixel_from_world(places + [0, 0, 0.7])
        large = camera.focal_px * 4.3 / depth > LEAST_PX
        counts.append((((pixels > 0) & (pixels < camera.image_size_px)).all(1) & large & (depth > 5)).sum())
    return IN_VIEW[0] <= np.mean(counts) <= IN_VIEW[1]


def frames_of(cameras: list[Camera], site: Site, vehicles: Sequence[Vehicle | OffPlane], fps: float) -> list[list[dict]]:
    """Returns the well visible vehicles of each frame. `cameras` has the camera of each frame."""
    outlines = Outlines(cameras[0], site.props)
    frames = []
    for number, camera in enumerate(cameras):
        if camera != outlines.camera:
            outlines = Outlines(camera, site.props)
        there = [(i, v, m) for i, v in enumerate(vehicles) if (m := v.at(number / fps)) is not None]
        visible_parts = outlines.visible_parts([(i, v.mesh, m.world_from_car) for i, v, m in there])
        shown = [(i, m) for i, _, m in there if i in visible_parts and visible_parts[i].seen_share >= SMALLEST_SHARE]
        frames.append([car_record(i, m, visible_parts[i]) for i, m in shown])
    return frames


def film(
    renderer: Renderer,
    rng: np.random.Generator,
    path: Path,
    cameras: list[Camera],
    site: Site,
    vehicles: list[Vehicle],
    weather: str,
    fps: float,
) -> None:
    """Writes the video. `cameras` has the camera of each frame.

    While the camera is at rest, each frame is the one before with its changed parts redrawn, within a grey level of a
    full redraw.
    """
    gpu = {id(mesh): renderer.upload(mesh) for mesh in {id(v.mesh): v.mesh for v in vehicles}.values()}
    looks = [sample_car_appearance(rng) if vehicle.kind == "car" else sample_heavy_appearance(rng) for vehicle in vehicles]
    _, light = sample_weather(rng, weather)
    finish, centre = sample_finish(rng, weather == "dusk"), np.append(site.origin, 0.0)
    size = cameras[0].image_size_px
    video, canvas = VideoWriter(path, size, fps, 23), ExactCanvas(renderer, cameras[0])
    exposure, start, before = None, time.monotonic(), {}
    for number, camera in enumerate(cameras):
        poses = {i: m.world_from_car for i, v in enumerate(vehicles) if (m := v.at(number / fps)) is not None}
        cars = [PlacedCar(gpu[id(vehicles[i].mesh)], looks[i], pose) for i, pose in poses.items()]
        cars.sort(key=lambda car: np.linalg.norm(car.world_from_car[:2, 3]))
        scene = Scene(cars, site.props, site.floor, light, centre, 70.0, 4.0, OPEN_SKY)
        if exposure is None:
            set_exposure(rng, scene, weather)
            exposure = light.exposure
        if number and camera == canvas.camera:
            bounds = {i: gpu[id(vehicles[i].mesh)].bounds for i in before.keys() | poses.keys()}
            changed = changed_regions(camera, light, bounds, before, poses)
        else:
            canvas.camera, changed = camera, [(0, 0, *size)]
        canvas.update(scene, changed)
        before = poses
        video.write(finished(rng, canvas.drawn, size, finish))
        if number % 50 == 49:
            left = (time.monotonic() - start) / (number + 1) * (len(cameras) - number - 1)
            print(f"{path.stem}: frame {number + 1} of {len(cameras)}, {left / 60:.1f} min left", flush=True)
    video.finish()
    for car in gpu.values():
        car.release()


def changed_regions(
    camera: Camera,
    light: Light,
    bounds: dict[int, tuple[np.ndarray, np.ndarray]],
    before: dict[int, np.ndarray],
    now: dict[int, np.ndarray],
) -> list[Region]:
    """Returns the regions where two frames differ, from the vehicles' poses in them."""
    moved = [i for i in bounds if i not in before or i not in now or not np.array_equal(before[i], now[i])]
    reached = [reached_region(camera, light, poses[i], bounds[i]) for i in moved for poses in (before, now) if i in poses]
    return [region for region in reached if region is not None]


def make(out: Path, options: argparse.Namespace) -> None:
    """Makes the missing clips, then `dataset.json`."""
    folder = out / "scenes"
    folder.mkdir(parents=True, exist_ok=True)
    items, renderer = [], None
    if options.pixels:
        ffmpeg()  # checked first, as sampling takes minutes
    for number in range(options.clips):
        stem = f"busy_{number:04d}"
        items.append(f"scenes/{stem}{TRUTH}")
        if (folder / f"{stem}{TRUTH}").exists():
            continue
        rng = np.random.default_rng([options.seed, 3, number])
        weather = list(WEATHERS)[number % len(WEATHERS)]
        camera, site, vehicles, frames, rng = sample_busy(rng, options.split, options.seconds, options.fps, options.size)
        if options.rise:
            risen = with_rise(vehicles, options.rise, options.rise_from_m)
            frames = frames_of([camera] * len(frames), site, risen, options.fps)
        if options.carried:
            some = with_carried(vehicles, options.carried)
            frames = frames_of([camera] * len(frames), site, some, options.fps)
        media = f"{stem}.mp4" if options.pixels else None
        if options.pixels:
            renderer = renderer or Renderer(shadow_size=4096)
            film(renderer, rng, folder / media, [camera] * len(frames), site, vehicles, weather, options.fps)
        meshes: dict[int, CarMesh] = {i: vehicle.mesh for i, vehicle in enumerate(vehicles)}
        conditions = {"layout": "junction", "weather": weather}
        if options.rise:
            conditions |= {"rise": f"{options.rise:g}", "rise_from_m": f"{options.rise_from_m:g}"}
        if options.carried:
            conditions["carried"] = f"{options.carried:g}"
        record = item_record(media, options.fps, conditions, camera, meshes, frames)
        write_json(folder / f"{stem}{TRUTH}", record)
        seen = sum(map(len, frames)) / len(frames)
        print(f"{stem}: {len(record['models'])} vehicles, {seen:.0f} visible at a time", flush=True)
    write_json(out / "dataset.json", dataset_record("busy", options.split, options.seed, items), indent=1)


def main() -> None:
    """Makes the clips."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--clips", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--fps", type=float, default=10.0)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(1280, 720), metavar="WIDTHxHEIGHT")
    parser.add_argument("--split", choices=("train", "eval"), default="eval")
    parser.add_argument("--seed", type=int, default=6)
    parser.add_argument("--pixels", action="store_true", help="renders the videos, too")
    parser.add_argument("--rise", type=float, default=0.0, metavar="SLOPE", help="change of the road's slope, such as 0.06")
    parser.add_argument("--rise-from-m", type=float, default=45.0, metavar="M", help="world y at which it changes, m")
    parser.add_argument("--carried", type=float, default=0.0, metavar="SHARE", help="share of cars that are 2.5 m too high")
    options = parser.parse_args()
    if (options.rise or options.carried) and options.pixels:
        parser.error("--rise and --carried have no pictures: leave out --pixels")
    if options.rise and options.carried:
        parser.error("--rise and --carried exclude each other")
    if not 0 <= options.carried <= 1:
        parser.error("--carried is a share, from 0 to 1")
    make(options.out, options)


if __name__ == "__main__":
    main()
