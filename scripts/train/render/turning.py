"""Makes clips of busy streets whose camera turns or zooms, with truth.

  roadplane-train render turning --out DIR

The scenes are those of `render busy`. Each scene is filmed by a camera at rest, and by that camera with each of the
motions. The camera turns about its own centre, or about a point `arm_m` behind it (motion `off_centre`). The motion
`carried` has no turn: the camera travels forwards, as on a vehicle. All motions begin with the camera at rest, so all
clips of a scene have the same world frame.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from roadplane_train.json_files import write_json

from .busy import film, frames_of, sample_busy
from .camera import Camera
from .dataset import TRUTH
from .renderer import Renderer
from .stills import WEATHERS
from .truth import dataset_record, item_record

ARM_M = 0.3  # of the motion `off_centre`
CARRIED_MPS = 8.0  # speed of the motion `carried`
CARRIED_FROM = 0.05  # its beginning, as a share of the clip
PAN_RAD = math.radians(20)  # from the leftmost to the rightmost direction


@dataclass(frozen=True)
class TurnedCamera(Camera):
    """A camera that is turned about a point on its optical axis, behind its centre, and moved forwards."""

    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)  # pan to the right, tilt down, roll, rad
    arm_m: float = 0.0
    forwards_m: float = 0.0  # along the horizontal viewing direction
    rotation: np.ndarray = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        """Computes the rotation from the camera at rest to this camera."""
        pan, tilt, roll = self.turn
        about_y = np.array([[math.cos(pan), 0, -math.sin(pan)], [0, 1, 0], [math.sin(pan), 0, math.cos(pan)]])
        about_x = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
        about_z = np.array([[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]])
        object.__setattr__(self, "rotation", about_z @ about_x @ about_y)

    @property
    def centre_m(self) -> tuple[float, float, float]:
        """Returns the position of the camera in the world."""
        pose = self.camera_from_world
        x_m, y_m, z_m = -pose[:3, :3].T @ pose[:3, 3]
        return float(x_m), float(y_m), float(z_m)

    @property
    def camera_from_world(self) -> np.ndarray:
        """Returns the 4 × 4 motion; camera axes x right, y down, z forward."""
        at_rest, arm = super().camera_from_world, np.array([0.0, 0.0, self.arm_m])
        moved = at_rest[:3, 3] - at_rest[:3, 1] * self.forwards_m
        result = np.eye(4)
        result[:3, :3] = self.rotation @ at_rest[:3, :3]
        result[:3, 3] = self.rotation @ (moved + arm) - arm
        return result


def turned(camera: Camera, motion: str, time_s: float, seconds: float) -> TurnedCamera:
    """Returns the camera at a time of a motion."""

    def wave(period_s: float) -> float:
        return math.sin(2 * math.pi * time_s / period_s)

    turn, growth, forwards_m = (0.0, 0.0, 0.0), 1.0, 0.0
    if motion == "sway":
        turn = 0.02 * wave(3.7), 0.008 * wave(2.3), 0.004 * wave(3.1)
    elif motion in ("pan", "off_centre"):
        turn = PAN_RAD / math.pi * math.asin(wave(seconds)), 0.0, 0.0
    elif motion == "zoom":
        growth = 1 + 0.25 * time_s / seconds
    elif motion == "carried":
        forwards_m = CARRIED_MPS * max(0.0, time_s - CARRIED_FROM * seconds)
    arm_m = ARM_M if motion == "off_centre" else 0.0
    pose = camera.height_m, camera.tilt_rad, camera.roll_rad
    return TurnedCamera(camera.image_size_px, growth * camera.focal_px, *pose, turn, arm_m, forwards_m)


MOTIONS = ("rest", "sway", "pan", "zoom", "off_centre", "carried")


def picture_from_world(at_rest: Camera, camera: TurnedCamera) -> np.ndarray | None:
    """Returns the homography K R K⁻¹ from pixels of the camera at rest to pixels of the turned one.

    A camera that is moved has none.
    """
    if camera.forwards_m:
        return None

    def matrix(of: Camera) -> np.ndarray:
        x, y = of.principal_point_px
        return np.array([[of.focal_px, 0, x], [0, of.focal_px, y], [0, 0, 1]])

    return matrix(camera) @ camera.rotation @ np.linalg.inv(matrix(at_rest))


def make(options: argparse.Namespace) -> None:
    """Makes the missing clips, then `dataset.json`."""
    folder = options.out / "scenes"
    folder.mkdir(parents=True, exist_ok=True)
    items, renderer = [], None
    for number in range(options.clips):
        missing = []
        for motion in options.motions:
            stem = f"{motion}_{number:04d}"
            items.append(f"scenes/{stem}{TRUTH}")
            if not (folder / f"{stem}{TRUTH}").exists():
                missing.append((motion, stem))
        if not missing:
            continue
        seed = [options.seed, 4, number]
        seconds, fps = options.seconds, options.fps
        camera, site, vehicles, _, _ = sample_busy(np.random.default_rng(seed), options.split, seconds, fps, options.size)
        weather = list(WEATHERS)[number % len(WEATHERS)]
        meshes = {i: vehicle.mesh for i, vehicle in enumerate(vehicles)}
        renderer = renderer or Renderer(shadow_size=4096)
        for motion, stem in missing:
            cameras = [turned(camera, motion, frame / fps, seconds) for frame in range(round(seconds * fps))]
            # All clips of a scene have the same colours, light and noise.
            film(renderer, np.random.default_rng([*seed, 1]), folder / f"{stem}.mp4", cameras, site, vehicles, weather, fps)
            conditions = {"layout": "junction", "weather": weather, "motion": motion}
            homographies = [picture_from_world(camera, here) for here in cameras]
            frames = frames_of(cameras, site, vehicles, fps)
            record = item_record(f"{stem}.mp4", fps, conditions, camera, meshes, frames, homographies)
            write_json(folder / f"{stem}{TRUTH}", record)
            print(f"{stem}: {len(record['models'])} vehicles", flush=True)
    write_json(options.out / "dataset.json", dataset_record("turning", options.split, options.seed, items), indent=1)


def main() -> None:
    """Makes the clips."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--clips", type=int, default=1, help="number of scenes")
    parser.add_argument("--motions", nargs="+", default=MOTIONS, choices=MOTIONS)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--fps", type=float, default=10.0)
    parser.add_argument(
        "--size", type=lambda text: tuple(map(int, text.split("x"))), default=(1920, 1080), metavar="WIDTHxHEIGHT"
    )
    parser.add_argument("--split", choices=("train", "eval"), default="eval")
    parser.add_argument("--seed", type=int, default=40)
    make(parser.parse_args())


if __name__ == "__main__":
    main()
