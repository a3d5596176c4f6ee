"""Films a scene that `roadplane copy` wrote.

roadplane-train render copy SCENE [OUT.mp4] --camera same|opposite|side|above|FILE
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from roadplane_train.cars.builder import sample_car
from roadplane_train.cars.mesh import CarMesh

from .appearance import Ground, sample_car_appearance, sample_light
from .camera import Camera, world_from_car
from .frames import Canvas, Finish, VideoWriter, finished
from .gpu_car import GpuCar
from .renderer import ENVIRONMENTS, MAX_CARS, Renderer
from .scene import Floor, PlacedCar, Scene

ATLAS = json.loads((Path(__file__).resolve().parents[3] / "models" / "atlas.json").read_text())
MODELS = {
    "car": ("sedan", "hatchback", "wagon", "suv", "minivan", "coupe", "pickup", "van"),
    "truck": ("van", "pickup"),
    "bus": ("van",),
}
PER_BODY = 4  # models to choose from
FINISH = Finish(blur_px=0.6, noise=1.0)
EXPOSURE = 0.22  # middle tone
# Patched and stained: without texture on the ground, nothing shows that the camera does not move.
ASPHALT = Ground(np.full(3, 0.07), np.full(3, 0.22), (1.2, 1.0, 0.7), stains=0.7, cracks=0.8, gloss=0.0)


@dataclass(frozen=True)
class View:
    """A camera, and the pose (x, y, heading) of its world in that of the scene. Its foot is its world's origin."""

    camera: Camera
    foot: tuple[float, float, float]

    def place(self, x: float, y: float, heading_rad: float) -> np.ndarray:
        """Returns world from car, for a car given in the scene's world."""
        cos, sin = np.cos(self.foot[2]), np.sin(self.foot[2])
        dx, dy = x - self.foot[0], y - self.foot[1]
        return world_from_car(cos * dx + sin * dy, cos * dy - sin * dx, heading_rad - self.foot[2])


def view_of(name: str, scene: dict) -> View:
    """Returns the run's own camera, another one around the traffic's centre, or one from a file.

    A file is JSON with `image_size_px`, `focal_px`, `height_m`, `tilt_rad`, `roll_rad`, as in `camera.json`. The key
    `foot` has x, y (m) and heading (rad) of the camera's own world in that of the scene; the default is the scene's
    own.
    """
    known = scene["camera"]
    same = Camera.of(known)
    if name == "same":
        return View(same, (0.0, 0.0, 0.0))
    if name not in ("opposite", "side", "above"):
        file = json.loads(Path(name).read_text())
        foot = tuple(file.get("foot", (0.0, 0.0, 0.0)))
        return View(Camera.of(file), foot)
    around, higher = {"opposite": (np.pi, 1.0), "side": (np.pi / 2, 1.5), "above": (0.0, 4.0)}[name]
    middle = np.median([(v["x_m"], v["y_m"]) for car in scene["vehicles"] for v in car["trajectory"]], axis=0)
    away = np.linalg.norm(middle)
    heading = np.arctan2(middle[1], middle[0]) - np.pi / 2 + around
    foot = middle - away * np.array([-np.sin(heading), np.cos(heading)])
    height = known["height_m"] * higher
    closer = np.hypot(away, height) / np.hypot(away, known["height_m"])
    tilt = float(np.arctan2(height, away))
    camera = replace(same, focal_px=same.focal_px * closer, height_m=height, tilt_rad=tilt, roll_rad=0.0)
    return View(camera, (float(foot[0]), float(foot[1]), float(heading)))


def fitted_keypoints(shape: list[float]) -> np.ndarray:
    """Returns the 36 points of a fitted shape, car frame, m."""
    return np.array(ATLAS["mean"]) + np.tensordot(shape, np.array(ATLAS["modes"]), 1)


def rolled(trajectory: np.ndarray) -> np.ndarray:
    """Returns how far a car has driven forwards at each vertex [n] of its path (time, x, y, heading; [n, 4]), m."""
    steps, turned = np.diff(trajectory[:, 1:3], axis=0), (trajectory[1:, 3] + trajectory[:-1, 3]) / 2
    return np.concatenate([[0.0], np.cumsum(steps[:, 0] * np.cos(turned) + steps[:, 1] * np.sin(turned))])


class Garage:
    """Car models, each stretched to the dimensions of a vehicle."""

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self._models: dict[tuple[str, int], CarMesh] = {}

    def of(self, vehicle: dict) -> GpuCar:
        """Returns the model whose points are nearest to the vehicle's after stretching to its dimensions."""
        wanted = fitted_keypoints(vehicle["shape"])
        options = [
            self.stretched(self._model(body, i), vehicle["dims_m"]) for body in MODELS[vehicle["class"]] for i in range(PER_BODY)
        ]
        return self.renderer.upload(min(options, key=lambda mesh: np.nanmean((mesh.keypoints - wanted) ** 2)))

    def _model(self, body: str, number: int) -> CarMesh:
        if (body, number) not in self._models:
            self._models[body, number] = sample_car(np.random.default_rng([7, number]), body)
        return self._models[body, number]

    @staticmethod
    def stretched(mesh: CarMesh, dims_m: list[float]) -> CarMesh:
        """Returns the model with other dimensions."""
        scale = np.array(dims_m) / mesh.dims
        normals = mesh.normals / scale
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        return replace(
            mesh,
            vertices=(mesh.vertices * scale).astype(np.float32),
            normals=normals.astype(np.float32),
            keypoints=mesh.keypoints * scale,
            dims=np.array(dims_m),
        )


class Player:
    """A scene at any time."""

    def __init__(self, scene: dict, view: View, renderer: Renderer, seed: int) -> None:
        rng = np.random.default_rng(seed)
        garage = Garage(renderer)
        self.view, self.vehicles = view, scene["vehicles"]
        self._cars = [garage.of(vehicle) for vehicle in self.vehicles]
        self._appearances = [self._appearance(rng, vehicle["colour"]) for vehicle in self.vehicles]
        self._trajectories = [
            np.array([[v["time_s"], v["x_m"], v["y_m"], v["heading_rad"]] for v in vehicle["trajectory"]])
            for vehicle in self.vehicles
        ]
        self._rolled = [rolled(trajectory) for trajectory in self._trajectories]
        self._light = replace(sample_light(rng, ENVIRONMENTS, "overcast"), sky=np.full(3, 0.7), haze=0.0, dapple=0.0)
        self._floor = Floor((ASPHALT, ASPHALT))

    @staticmethod
    def _appearance(rng: np.random.Generator, colour: list[int]) -> object:
        paint = (np.array(colour) / 255.0) ** 2.2 * 0.8
        return replace(sample_car_appearance(rng), paint=paint, metallic=0.2, dirt=0.0, headlamp=0.0, taillamp=0.0)

    def there(self, time_s: float) -> list[int]:
        """Returns the vehicles that are present, by number."""
        return [i for i, vehicle in enumerate(self.vehicles) if vehicle["span_s"][0] <= time_s <= vehicle["span_s"][1]]

    def at(self, time_s: float) -> Scene:
        """Returns the visible scene; if there are more cars than the renderer takes, the nearest to the camera."""
        cars = []
        for i in self.there(time_s):
            trajectory = self._trajectories[i]
            pose = [float(np.interp(time_s, trajectory[:, 0], trajectory[:, column])) for column in (1, 2, 3)]
            driven = float(np.interp(time_s, trajectory[:, 0], self._rolled[i]))
            cars.append(PlacedCar(self._cars[i], self._appearances[i], self.view.place(*pose), driven))
        cars.sort(key=lambda car: float(np.linalg.norm(car.world_from_car[:2, 3])))
        middle = np.mean([car.world_from_car[:3, 3] for car in cars], axis=0) if cars else np.array([0.0, 20.0, 0.0])
        scene = Scene(cars[:MAX_CARS], [], self._floor, self._light, middle, 60.0, 1.0)
        scene.set_exposure(EXPOSURE)
        return scene


def main() -> None:
    """Writes the clip."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder that roadplane copy wrote")
    parser.add_argument("out", type=Path, nargs="?", help="video to write, .mp4 (default SCENE/CAMERA.mp4)")
    parser.add_argument("--camera", default="same", help="same, opposite, side (90° around, 1.5 times as high), above, or a file")
    parser.add_argument("--fps", type=float, help="frames per second (default: those of the run)")
    parser.add_argument("--seconds", type=float, help="length, s (default: that of the scene)")
    parser.add_argument("--seed", type=int, default=1, help="seed of light, ground and noise")
    args = parser.parse_args()
    scene = json.loads((args.scene / "scene.json").read_text())
    view = view_of(args.camera, scene)
    fps = args.fps or scene["frames_per_s"]
    seconds = min(args.seconds or np.inf, scene["span_s"][1] - scene["span_s"][0])
    renderer = Renderer()
    player = Player(scene, view, renderer, args.seed)
    size = view.camera.image_size_px
    even = (size[0] // 2 * 2, size[1] // 2 * 2)
    rng = np.random.default_rng(args.seed)
    writer = VideoWriter(args.out or args.scene / f"{Path(args.camera).stem}.mp4", even, fps, crf=18)
    for frame in range(int(seconds * fps + 1e-6) + 1):
        canvas = Canvas(renderer, view.camera)
        canvas.update(player.at(frame / fps), [])
        writer.write(finished(rng, canvas.drawn, size, FINISH)[: even[1], : even[0]])
    writer.finish()


if __name__ == "__main__":
    main()
