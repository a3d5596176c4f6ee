"""Renders training crops with truth.

roadplane-train render crops --out DIR --count N --seed S --split train|eval
"""

from __future__ import annotations

import argparse
import os
import time
import zlib
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import get_args

import cv2
import numpy as np

from roadplane_train.cars.builder import sample_car
from roadplane_train.cars.deform import deform
from roadplane_train.cars.heavy import sample_heavy
from roadplane_train.cars.mesh import CarMesh
from roadplane_train.cars.meshes import MissingFurnitureError, load_meshes

from .camera import Camera
from .degrade import degrade
from .gpu_car import GpuCar
from .renderer import ENVIRONMENTS, Renderer
from .scene import Scene, SceneSampler, Views

SHARD = 512
CROP_PX = 128
CROP_SCALE = 1.25  # side of the crop over the box's longer side
CARS_PER_SHARD = 48
MESHES_PER_SHARD = 10
MESH_SHARE = 0.2  # share of targets that are real meshes (deformed for training) rather than built cars
TRUTH_PX = 160
TRUTH_SCALE = 1.35
DEPTH_TOLERANCE_M = 0.10
LARGEST_PATCH_PX = 200  # larger cars are rendered at a lower frame resolution, as the net's input is 128 px anyway
OCCLUDED_BELOW = 0.65  # visible share below which a car counts as strongly occluded
HIDDEN_BELOW = 0.9  # largest visible share of a car of the hidden views
HEAVY_PER_SHARD = 8  # lorries and buses that hide cars in the hidden views


@dataclass
class Crop:
    """One training example; see the module's README for fields."""

    image: np.ndarray
    keypoints: np.ndarray
    visible: np.ndarray
    box_side_px: float
    car_px: float
    share: float
    elevation_deg: float


@dataclass
class VisiblePart:
    """The visible part of the target, in frame pixels."""

    box: np.ndarray  # tight around the visible silhouette: x0, y0, x1, y1
    whole_box: np.ndarray  # around all of the car inside the frame
    extent: np.ndarray  # around all of the car, including the part outside the frame
    share: float  # visible over whole silhouette, ignoring the frame
    seen_share: float  # the same, with the part outside the frame as invisible
    keypoints: np.ndarray  # (36, 2)
    visible: np.ndarray  # (36,) bool


def in_world(points: np.ndarray, world_from_car: np.ndarray) -> np.ndarray:
    """Returns car points (n, 3) in the world."""
    return points @ world_from_car[:3, :3].T + world_from_car[:3, 3]


def visible_part(renderer: Renderer, scene: Scene, camera: Camera, index: int, least_inside: float = 0.3) -> VisiblePart | None:
    """Returns the truth of one car; None if less than `least_inside` of its unhidden part is in the frame."""
    car = scene.cars[index]
    pixels, depth = camera.pixel_from_world(in_world(car.gpu.mesh.vertices, car.world_from_car))
    if depth.min() < 1.0:
        return None
    low, high = pixels.min(0), pixels.max(0)
    frame = np.array(camera.image_size_px) - 0.5
    inside = np.concatenate([np.maximum(low, -0.5), np.minimum(high, frame)])
    if np.any(inside[2:] - inside[:2] < 4):
        return None
    side = TRUTH_SCALE * (high - low).max()
    left, top = (low + high) / 2 - side / 2
    window = (left, top, side, side)
    size = (TRUTH_PX, TRUTH_PX)
    whole_mask, seen, away = renderer.truth(scene, camera, window, size, first=index)
    centres = (np.arange(TRUTH_PX) + 0.5) / TRUTH_PX * side
    in_frame = ((top + centres > -0.5) & (top + centres < frame[1]))[:, None] & (
        (left + centres > -0.5) & (left + centres < frame[0])
    )[None]
    mask = seen == index + 1
    share = mask.sum() / max(whole_mask.sum(), 1)
    shown = mask & in_frame
    if shown.sum() < least_inside * whole_mask.sum() * share or shown.sum() < 60:
        return None
    box = inside
    if share < 0.98:
        rows, columns = np.nonzero(shown.any(1))[0], np.nonzero(shown.any(0))[0]
        cell = side / TRUTH_PX
        box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]) * cell + [left, top, left, top]
        box = np.concatenate([np.maximum(box[:2], inside[:2]), np.minimum(box[2:], inside[2:])])
    points, point_depth = camera.pixel_from_world(in_world(car.gpu.mesh.keypoints, car.world_from_car))
    visible = np.zeros(len(points), bool)
    for k, (x, y) in enumerate(points):
        if not (-0.5 <= x <= frame[0] and -0.5 <= y <= frame[1]):
            continue
        column, row = int((x - left) / side * TRUTH_PX), int((y - top) / side * TRUTH_PX)
        near = away[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] >= point_depth[k] - DEPTH_TOLERANCE_M
        visible[k] = near.sum() >= 3
    extent = np.concatenate([low, high])
    seen_share = float(shown.sum() / max(whole_mask.sum(), 1))
    return VisiblePart(box, inside, extent, float(share), seen_share, points, visible)


def make_crop(renderer: Renderer, scene: Scene, camera: Camera, seen: VisiblePart, rng: np.random.Generator) -> Crop:
    """Renders, degrades and crops the target (the scene's first car), as inference would see it."""
    box = seen.box if seen.share > 0.98 or rng.random() < 0.6 else seen.whole_box
    size = box[2:] - box[:2]
    centre = (box[:2] + box[2:]) / 2 + size * rng.uniform(-0.05, 0.05, 2)
    side = CROP_SCALE * (size * rng.uniform(0.92, 1.08, 2)).max()
    reduced = min(1.0, LARGEST_PATCH_PX / side)  # pixels of the patch per pixel of the frame
    patch_px = int(np.ceil(side * reduced)) + 4
    corner = np.floor((centre - side / 2 + 0.5) * reduced - 2) / reduced - 0.5
    drawn_px = int(np.clip(1.5 * patch_px, 128, 224))
    drawn = renderer.colour(scene, camera, (*corner, patch_px / reduced, patch_px / reduced), (drawn_px, drawn_px))
    patch = cv2.resize(drawn, (patch_px, patch_px), interpolation=cv2.INTER_AREA)
    patch = degrade(rng, patch)
    edges = corner[:, None] + (np.arange(patch_px) + 0.5)[None] / reduced
    outside = [(e < -0.5) | (e > n - 0.5) for e, n in zip(edges, camera.image_size_px, strict=True)]
    patch = patch.copy()
    patch[outside[1]] = 128
    patch[:, outside[0]] = 128
    step = side * reduced / CROP_PX
    finer = 1 if step <= 1 else 2  # area-like when the crop is coarser than the frame
    scale = step / finer
    shift = (centre - side / 2 - corner) * reduced + 0.5 * scale - 0.5
    matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    image = cv2.warpAffine(
        patch, matrix, (CROP_PX * finer,) * 2, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )
    if finer == 2:
        image = cv2.resize(image, (CROP_PX, CROP_PX), interpolation=cv2.INTER_AREA)
    keypoints = ((seen.keypoints - centre) / side + 0.5) * CROP_PX - 0.5
    longer = float((seen.box[2:] - seen.box[:2]).max())
    east, north = scene.cars[0].world_from_car[:2, 3]
    elevation = float(np.degrees(np.arctan2(camera.height_m, np.hypot(east, north))))
    return Crop(image, keypoints.astype(np.float32), seen.visible, longer / side * CROP_PX, longer, seen.share, elevation)


class Generator:
    """Deterministic shards of crops."""

    def __init__(
        self, split: str, seed: int, meshes: list[CarMesh], renderer: Renderer | None = None, views: Views = "usual"
    ) -> None:
        self.split, self.seed, self.views = split, seed, views
        self.renderer = renderer or Renderer()
        self.meshes = meshes

    def shard(self, number: int, count: int = SHARD) -> dict[str, np.ndarray]:
        """Returns the arrays of one shard."""
        rng = np.random.default_rng([self.seed, number, zlib.crc32(self.split.encode())])
        built = [self.renderer.upload(sample_car(rng, split=self.split)) for _ in range(CARS_PER_SHARD)]
        chosen = rng.permutation(len(self.meshes))[:MESHES_PER_SHARD]
        real = [self.meshes[i] for i in chosen]
        if self.split == "train":
            real = [deform(mesh, rng) for mesh in real]
        real = [self.renderer.upload(mesh) for mesh in real]
        kinds = ["truck", "bus"] * (HEAVY_PER_SHARD // 2) if self.views == "hidden" else []
        heavy = [self.renderer.upload(sample_heavy(rng, kind)) for kind in kinds]
        sampler = SceneSampler(built + real, ENVIRONMENTS, heavy)
        crops: list[Crop] = []
        cars: list[GpuCar] = []
        occluded = 0
        while len(crops) < count:
            targets = real if real and rng.random() < MESH_SHARE else built
            target = targets[rng.integers(len(targets))]
            scene, camera = sampler.sample(
                rng, target, near_edge=rng.random() < 0.1, occluded=rng.random() < 0.28, views=self.views
            )
            seen = visible_part(self.renderer, scene, camera, 0)
            if seen is None or seen.share < 0.25:
                continue
            if self.views == "hidden":
                if seen.share > HIDDEN_BELOW:
                    continue
            elif seen.share < OCCLUDED_BELOW:
                if occluded > 0.17 * (len(crops) + 4):
                    continue
                occluded += 1
            crops.append(make_crop(self.renderer, scene, camera, seen, rng))
            cars.append(target)
        result = {
            "image": np.stack([c.image for c in crops]),
            "keypoints": np.stack([c.keypoints for c in crops]),
            "visible": np.stack([c.visible for c in crops]).astype(np.uint8),
            "box_side_px": np.array([c.box_side_px for c in crops], np.float32),
            "car_px": np.array([c.car_px for c in crops], np.float32),
            "share": np.array([c.share for c in crops], np.float32),
            "elevation_deg": np.array([c.elevation_deg for c in crops], np.float32),
            "car": np.array([car.mesh.name for car in cars]),
            "body": np.array([car.mesh.body for car in cars]),
        }
        for car in built + real + heavy:
            car.release()
        return result


def real_meshes(split: str) -> list[CarMesh]:
    """Returns meshes of real cars of a split; none, with a message, if they are not installed."""
    try:
        return load_meshes(split)
    except MissingFurnitureError as error:
        print(f"built cars only: {error}", flush=True)
        return []


def main() -> None:
    """Renders the shards."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the shards, OUT/SPLIT/shard_00000.npz …")
    parser.add_argument("--count", type=int, default=SHARD, help="number of crops, rounded up to whole shards")
    parser.add_argument("--first", type=int, default=0, help="number of the first shard, to split the work among processes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--split", choices=("train", "eval"), default="train")
    parser.add_argument(
        "--views",
        choices=get_args(Views),
        default="usual",
        help="hard: small cars, and views from eye level and from above; hidden: cars mostly behind another vehicle",
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes that render at the same time")
    parser.add_argument("--redo-before", type=float, default=0.0, help="renders older shards again (Unix time)")
    options = parser.parse_args()
    (options.out / options.split).mkdir(parents=True, exist_ok=True)
    numbers = range(options.first, options.first + -(-options.count // SHARD))
    if options.jobs == 1:
        render_shards(options, numbers)
        return
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:  # an OpenGL context does not survive a fork
        list(pool.map(render_shards, [options] * options.jobs, [numbers[k :: options.jobs] for k in range(options.jobs)]))


def render_shards(options: argparse.Namespace, numbers: range) -> None:
    """Renders the shards that are missing or too old."""
    folder = options.out / options.split
    generator = None
    for number in numbers:
        path = folder / f"shard_{number:05d}.npz"
        if path.exists() and path.stat().st_mtime >= options.redo_before:
            continue
        generator = generator or Generator(options.split, options.seed, real_meshes(options.split), views=options.views)
        start = time.perf_counter()
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        with temporary.open("wb") as file:
            np.savez(file, **generator.shard(number))
        temporary.rename(path)
        print(f"{path} {(time.perf_counter() - start) / SHARD * 1000:.0f} ms per crop", flush=True)


if __name__ == "__main__":
    main()
