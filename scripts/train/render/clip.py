"""Renders clips of a car park with complete truth: `python -m render.clip --out DIR --count N --seed S`.

Each clip is `NAME.mp4` and `NAME.truth.json` (fields: see the README of this folder).
"""

from __future__ import annotations

import argparse
import json
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from cars.builder import sample_car
from cars.mesh import CarMesh

from .camera import Camera, world_from_car
from .crops import Sight, real_meshes, sight
from .looks import Light, sample_car_look, sample_ground
from .props import Prop, placed
from .renderer import ENVIRONMENTS, Renderer
from .scene import Floor, PlacedCar, Scene, bush, person, pole, tree

SCHEMA = "roadplane.clip-truth/1"
SUPERSAMPLING = 2
SMALLEST_SHARE = 0.15  # cars of which less is seen are left out of a frame's truth
BAY = (2.7, 5.2)  # metres
ROW_PITCH_M = 12.6  # from one row's middle to the next: bay and aisle


@dataclass
class Clip:
    """What a clip shows."""

    camera: Camera
    scene: Scene
    fps: float
    frames: int
    drives: dict[int, tuple[CubicSpline, float]] = field(default_factory=dict)  # car → path by arc length, speed
    walkers: list[tuple[list[Prop], np.ndarray]] = field(default_factory=list)  # parts, metres per second

    def at(self, time_s: float) -> Scene:
        """The scene at a time."""
        cars = list(self.scene.cars)
        for index, (path, speed) in self.drives.items():
            x, y = path(speed * time_s)
            dx, dy = path(speed * time_s, 1)
            cars[index] = PlacedCar(cars[index].gpu, cars[index].look, world_from_car(x, y, np.arctan2(dy, dx)))
        props = list(self.scene.props)
        for parts, velocity in self.walkers:
            for part in parts:
                moved = part.world_from_prop.copy()
                moved[:2, 3] += velocity * time_s
                props.append(Prop(part.shape, moved, part.colour, part.leaves, part.texture))
        return Scene(cars, props, self.scene.floor, self.scene.light, self.scene.centre, self.scene.shadow_reach_m)

    def walkers_at(self, time_s: float) -> list[np.ndarray]:
        """Ground points (2,) of the walkers."""
        return [parts[-1].world_from_prop[:2, 3] + velocity * time_s for parts, velocity in self.walkers]


def path_through(points: np.ndarray) -> CubicSpline:
    """A smooth path through points (n, 2), by its length in metres."""
    rough = CubicSpline(np.arange(len(points)), points)
    fine = rough(np.linspace(0, len(points) - 1, 400))
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    return CubicSpline(length, fine)


def sample_clip(rng: np.random.Generator, renderer: Renderer, meshes: list[CarMesh], options: argparse.Namespace) -> Clip:
    """A car park with two rows, one car in the aisle and one on the lane in front, people, trees behind."""
    size = tuple(options.size)
    height = options.height_m or rng.uniform(5, 14)
    middle = height / np.tan(np.radians(rng.uniform(16, 20)))  # ground distance of the image centre
    focal = rng.uniform(1.0, 1.25) * size[0] * middle / 25
    camera = Camera(size, focal, height, np.arctan2(height, middle), rng.normal(0, np.radians(1.0)))
    turn = np.radians(rng.choice([-1, 1]) * rng.uniform(14, 32))
    along, away = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    origin = np.array([0, middle + 2.0])

    def place(e: float, n: float) -> np.ndarray:
        return origin + along * e + away * n

    def car(e: float, n: float, heading: float) -> PlacedCar:
        mesh = meshes[rng.integers(len(meshes))] if rng.random() < options.mesh_share else sample_car(rng, split=options.split)
        look = sample_car_look(rng)
        look.dirt *= 0.5
        return PlacedCar(renderer.upload(mesh), look, world_from_car(*place(e, n), heading))

    cars: list[PlacedCar] = []
    for row, count, first in ((-0.5, 4, -2), (0.5, 4, -3)):
        for k in sorted(rng.choice(np.arange(first, first + 6), count, replace=False)):
            nose = turn + np.pi / 2 + np.pi * (rng.random() < 0.35)
            cars.append(car(k * BAY[0] + rng.normal(0, 0.1), row * ROW_PITCH_M + rng.normal(0, 0.15), nose + rng.normal(0, 0.02)))
    drives = {}
    way = rng.choice([-1, 1])
    aisle = np.array([(-13 * way, -1.2 * way), (-5 * way, -1.4 * way), (3 * way, -1.2 * way), (14 * way, -1.0 * way)])
    lane = np.array([(11 * way, -11.2), (3 * way, -11.4), (-5 * way, -11.9), (-16 * way, -12.0)])
    for path, speed in ((aisle, rng.uniform(3.2, 4.5)), (lane, rng.uniform(4.0, 5.5))):
        drives[len(cars)] = path_through(np.array([place(*p) for p in path])), speed
        cars.append(car(0, 0, 0))

    props: list[Prop] = []
    for e in np.arange(-40, 41, 5.5):
        props += tree(rng, tuple(place(e + rng.normal(0, 1), 17 + rng.exponential(5))))
    for e in rng.uniform(-12, 14, 4):
        props += bush(rng, tuple(place(e, 11.2 + rng.normal(0, 0.3))), rng.uniform(0.8, 1.6))
    for e in (-9.5, 11.5):
        props += pole(rng, tuple(place(e, 10.6)))
    wall = np.array([0.42, 0.35, 0.29])
    props.append(placed("box", tuple(place(6, 38)), (60, 8, 9), wall, turn, texture=0.15))
    for e in np.arange(-22, 34, 4):
        props.append(placed("box", tuple(place(e, 33.95)), (2.2, 0.1, 1.5), (0.03, 0.035, 0.045), turn, bottom_m=2.2))
        props.append(placed("box", tuple(place(e, 33.95)), (2.2, 0.1, 1.5), (0.03, 0.035, 0.045), turn, bottom_m=5.6))
    walkers = [(person(rng, tuple(place(rng.uniform(-6, 6), 2.9 * way))), -along * way * 1.3),
               (person(rng, tuple(place(rng.uniform(2, 8), 10.0))), along * 1.1)]

    asphalt, grass = sample_ground(rng, "asphalt"), sample_ground(rng, "grass")
    asphalt.gloss, asphalt.stains = 0.0, 0.35
    floor = Floor((asphalt, grass), seed=tuple(rng.uniform(0, 500, 2)))
    floor.borders = [(*away, place(0, 9.3) @ away)]
    floor.frame = (*place(BAY[0] / 2, -0.5 * ROW_PITCH_M), *along)
    floor.bays = (1.0, BAY[0], BAY[1] / 2, 0.11)
    floor.rows = (ROW_PITCH_M, BAY[1] / 2, 0.0)
    floor.paint = (0.62, 0.62, 0.58, 0.15)
    elevation, azimuth = np.radians(rng.uniform(35, 55)), turn + np.radians(rng.uniform(200, 330))
    to_sun = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    light = Light(to_sun, np.array([1.0, 0.95, 0.87]), np.array([0.2, 0.24, 0.3]), softness_m=0.06, dapple=0.0, haze=0.0008,
                  environment=int(rng.integers(ENVIRONMENTS)), exposure=1.0, sun_mirror=25.0)
    scene = Scene(cars, props, floor, light, np.append(origin, 0.0), shadow_reach_m=34.0)
    scene.set_exposure(0.2)
    return Clip(camera, scene, options.fps, round(options.fps * options.seconds), drives, walkers)


def finished(rng: np.random.Generator, drawn: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The camera's picture: box filter, slight blur and noise."""
    image = cv2.GaussianBlur(cv2.resize(drawn, size, interpolation=cv2.INTER_AREA), (0, 0), 0.55).astype(np.float32)
    image += rng.normal(0, 1.6, (*image.shape[:2], 1))
    return image.clip(0, 255).round().astype(np.uint8)


def draw(renderer: Renderer, scene: Scene, camera: Camera, region: tuple[int, int, int, int]) -> np.ndarray:
    """A region (x, y, width, height in pixels) of the frame, supersampled; the same pixels whatever the region."""
    x, y, width, height = region
    return renderer.colour(scene, camera, (x - 0.5, y - 0.5, width, height), (width * SUPERSAMPLING, height * SUPERSAMPLING))


def moving_regions(clip: Clip, scene: Scene, time_s: float) -> list[tuple[int, int, int, int]]:
    """Regions of the frame that moving things and their shadows can change."""
    boxes = [(scene.cars[i].world_from_car[:2, 3], 4.8, 2.8) for i in clip.drives]
    boxes += [(place, 0.8, 2.0) for place in clip.walkers_at(time_s)]
    return [region for box in boxes if (region := _region(clip.camera, scene.light, *box)) is not None]


def _region(camera: Camera, light: Light, centre: np.ndarray, reach: float, height: float) -> tuple[int, int, int, int] | None:
    corners = np.array([(x, y, z) for x in (-reach, reach) for y in (-reach, reach) for z in (0.0, height)])
    corners[:, :2] += centre
    shadows = corners - light.to_sun * (corners[:, 2:] / light.to_sun[2])
    pixels, depth = camera.pixel_from_world(np.concatenate([corners, shadows]))
    if depth.min() < 1:
        return 0, 0, *camera.image_size_px
    low = np.clip(np.floor(pixels.min(0)), 0, camera.image_size_px).astype(int)
    high = np.clip(np.ceil(pixels.max(0)) + 1, 0, camera.image_size_px).astype(int)
    return (*low.tolist(), *(high - low).tolist()) if (high > low).all() else None


def car_truth(index: int, car: PlacedCar, seen: Sight) -> dict:
    """JSON of one car in one frame."""
    mesh = car.gpu.mesh
    points = [None if not np.isfinite(p).all() else [round(float(p[0]), 3), round(float(p[1]), 3), int(v)]
              for p, v in zip(seen.keypoints, seen.visible, strict=True)]
    return {
        "id": index, "class": "car", "body": mesh.body, "dims_m": [round(float(d), 4) for d in mesh.dims],
        "world_from_car": np.round(car.world_from_car, 6).tolist(), "box": np.round(seen.box, 2).tolist(),
        "whole_box": np.round(seen.whole_box, 2).tolist(), "visible_share": round(seen.share, 3), "keypoints_px": points,
    }


def camera_truth(camera: Camera) -> dict:
    """JSON of the camera, in the words of `camera.json`."""
    normal, offset = camera.plane_in_camera
    return {
        "image_size_px": list(camera.image_size_px), "focal_px": camera.focal_px,
        "principal_point_px": list(camera.principal_point_px), "height_m": camera.height_m,
        "tilt_rad": camera.tilt_rad, "roll_rad": camera.roll_rad,
        "plane_in_camera": {"normal": normal.tolist(), "offset_m": offset},
        "camera_from_world": camera.camera_from_world.tolist(),
    }


def write_clip(renderer: Renderer, clip: Clip, out: Path, name: str, rng: np.random.Generator, crf: int) -> None:
    """Draws all frames, encodes them with ffmpeg, writes the truth beside the video."""
    width, height = clip.camera.image_size_px
    out.mkdir(parents=True, exist_ok=True)
    video, temporary = out / f"{name}.mp4", out / f"{name}.part.mp4"
    encoder = subprocess.Popen(
        ["ffmpeg", "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(clip.fps),
         "-i", "-", "-c:v", "libx264", "-preset", "slow", "-crf", str(crf), "-pix_fmt", "yuv420p", "-movflags", "+faststart",
         "-fflags", "+bitexact", "-flags:v", "+bitexact", str(temporary)], stdin=subprocess.PIPE)
    assert encoder.stdin is not None
    frames = []
    drawn = np.empty((height * SUPERSAMPLING, width * SUPERSAMPLING, 3), np.uint8)
    stale = [(0, 0, width, height)]
    for number in range(clip.frames):
        scene = clip.at(number / clip.fps)
        moving = moving_regions(clip, scene, number / clip.fps)
        for region in {*stale, *moving}:
            x, y, w, h = (n * SUPERSAMPLING for n in region)
            drawn[y:y + h, x:x + w] = draw(renderer, scene, clip.camera, region)
        stale = moving
        image = finished(rng, drawn, (width, height))
        encoder.stdin.write(image.tobytes())
        cars = []
        for index in range(len(scene.cars)):
            seen = sight(renderer, scene, clip.camera, index)
            if seen is not None and seen.share >= SMALLEST_SHARE:
                cars.append(car_truth(index, scene.cars[index], seen))
        frames.append({"frame": number, "time_s": round(number / clip.fps, 6), "cars": cars})
    encoder.stdin.close()
    if encoder.wait() != 0:
        raise RuntimeError(f"ffmpeg failed on {temporary.name}")
    truth = {"schema": SCHEMA, "video": video.name, "fps": clip.fps, "camera": camera_truth(clip.camera), "frames": frames}
    (out / f"{name}.truth.json").write_text(json.dumps(truth, separators=(",", ":")))
    temporary.rename(video)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--name", default="lot", help="stem of the files; with several clips a number follows")
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720))
    parser.add_argument("--fps", type=float, default=12.0)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--height-m", type=float, help="of the camera; random unless given")
    parser.add_argument("--split", choices=("train", "eval"), default="train", help="of the cars")
    parser.add_argument("--mesh-share", type=float, default=0.0, help="of the cars that are real meshes, the rest is built")
    parser.add_argument("--crf", type=int, default=24)
    parser.add_argument("--still", action="store_true", help="only the first frame, as PNG")
    options = parser.parse_args()
    renderer = Renderer(shadow_size=4096)
    meshes = real_meshes("eval" if options.split == "eval" else "train") if options.mesh_share > 0 else []
    for number in range(options.count):
        rng = np.random.default_rng([options.seed, number])
        clip = sample_clip(rng, renderer, meshes, options)
        name = options.name if options.count == 1 else f"{options.name}_{number:03d}"
        if options.still:
            options.out.mkdir(parents=True, exist_ok=True)
            drawn = draw(renderer, clip.at(2.0), clip.camera, (0, 0, *options.size))
            cv2.imwrite(str(options.out / f"{name}.png"), finished(rng, drawn, tuple(options.size))[..., ::-1])
        else:
            write_clip(renderer, clip, options.out, name, rng, options.crf)
        for car in clip.scene.cars:
            car.gpu.release()


if __name__ == "__main__":
    main()
