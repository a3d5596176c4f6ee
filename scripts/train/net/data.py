"""Training samples: rendered shards and hand-labelled real cars, augmented on the fly."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch.utils.data import Dataset

from roadplane_train.cars.mesh import KEYPOINT_NAMES, MIRROR
from roadplane_train.render.crops import CROP_SCALE

INPUT_PX = 128
CONTEXT = 1.17  # side of the crop over the longer side of the box
MIDDLE = np.full(2, INPUT_PX / 2 - 0.5)
GREY = 127
KEYPOINTS = len(KEYPOINT_NAMES)


@dataclass
class Batch:
    """image [B, 128, 128, 3] u8; points [B, 36, 2] crop px; the others [B, 36] in 0…1."""

    image: torch.Tensor
    points: torch.Tensor
    located: torch.Tensor  # weight of the location loss
    visible: torch.Tensor  # target of the visibility loss
    judged: torch.Tensor  # weight of the visibility loss

    def to(self, device: torch.device) -> Batch:
        """Returns the batch on a device."""
        return Batch(*(tensor.to(device, non_blocking=True) for tensor in vars(self).values()))


# One car of the labels, with its fields in this order.
Sample = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class Shards:
    """Rendered crops in memory, with more around the car than the net's input: room to rotate and shift them."""

    def __init__(self, folder: Path, limit: int | None = None) -> None:
        self.images: list[np.ndarray] = []
        self.points: list[np.ndarray] = []
        self.visible: list[np.ndarray] = []
        self.sides: list[float] = []  # longer side of the car's box, crop px
        self.sizes: list[float] = []  # the same in pixels of the picture
        self.elevations: list[float] = []  # of the camera above the ground at the car, deg
        self.bodies: list[str] = []
        for path in sorted(folder.glob("*.npz")):
            if limit and len(self) >= limit:
                break
            with np.load(path) as shard:
                if "elevation_deg" not in shard:
                    raise ValueError(f"{path} is of an older version: render the crops again")
                self.images.extend(shard["image"])
                self.points.extend(shard["keypoints"])
                self.visible.extend(shard["visible"])
                self.sides.extend(shard["box_side_px"])
                self.sizes.extend(shard["car_px"])
                self.elevations.extend(shard["elevation_deg"])
                self.bodies.extend(shard["body"])

    def __len__(self) -> int:
        return len(self.images)


@dataclass
class RealCar:
    """A labelled real car: a patch of its picture, labels in its pixels; `flag` 2 clear, 1 guessed, 0 unknown."""

    source: str
    patch: np.ndarray
    box: np.ndarray
    points: np.ndarray
    flag: np.ndarray
    body: str


def read_real(folder: Path) -> list[RealCar]:
    """Reads all cars of the label files of a folder (`*.json` in the format of README.md)."""
    cars = []
    for path in sorted(folder.glob("*.json")):
        labels = json.loads(path.read_text())
        picture = cv2.imread(str(folder / labels["image"]), cv2.IMREAD_COLOR)[..., ::-1]
        for car in labels["cars"]:
            box = np.array(car["box"], float)
            centre, side = (box[:2] + box[2:]) / 2, 2.2 * (box[2:] - box[:2]).max()
            corner = np.floor(centre - side / 2).astype(int)
            size = int(np.ceil(side))
            patch = np.full((size, size, 3), GREY, np.uint8)
            x0, y0 = np.maximum(corner, 0)
            x1, y1 = np.minimum(corner + size, [picture.shape[1], picture.shape[0]])
            patch[y0 - corner[1] : y1 - corner[1], x0 - corner[0] : x1 - corner[0]] = picture[y0:y1, x0:x1]
            points, flag = np.full((KEYPOINTS, 2), np.nan), np.zeros(KEYPOINTS, int)
            for name, (x, y, f) in car["keypoints"].items():
                index = KEYPOINT_NAMES.index(name)
                points[index], flag[index] = np.array([x, y]) - corner, f
            shifted = box - np.tile(corner, 2)
            cars.append(RealCar(path.stem, patch, shifted, points, flag, car.get("type", "")))
    return cars


def _similarity(rotation: float, scale: float, point: np.ndarray, becomes: np.ndarray) -> np.ndarray:
    """Returns the 2 × 3 affine map that rotates (rad) and scales, and maps one point to another."""
    c, s = np.cos(rotation) * scale, np.sin(rotation) * scale
    linear = np.array([[c, -s], [s, c]])
    return np.column_stack([linear, becomes - linear @ point])


def crop_from_box(box: np.ndarray, rotation: float = 0.0) -> np.ndarray:
    """Returns the 2 × 3 affine map from picture px to crop px of a box, rotated by `rotation` rad."""
    centre, side = (box[:2] + box[2:]) / 2, CONTEXT * (box[2:] - box[:2]).max()
    return _similarity(rotation, INPUT_PX / side, centre, MIDDLE)


def crop_from_rendered(rotation: float = 0.0, scale: float = 1.0, shift: np.ndarray | float = 0.0) -> np.ndarray:
    """Returns the 2 × 3 affine map from a rendered crop to the net's input: rotated (rad), scaled and shifted (px)."""
    return _similarity(rotation, scale * (CROP_SCALE / CONTEXT), MIDDLE, MIDDLE + shift)


def warp(picture: np.ndarray, crop_from_picture: np.ndarray) -> np.ndarray:
    """Resamples to the crop; averages first if it shrinks by more than a little."""
    scale = np.sqrt(abs(np.linalg.det(crop_from_picture[:, :2])))
    matrix = crop_from_picture.copy()
    if scale < 0.7:
        size = np.maximum(1, np.round(np.array(picture.shape[1::-1]) * scale)).astype(int)
        ratio = size / np.array(picture.shape[1::-1])
        picture = cv2.resize(picture, tuple(int(v) for v in size), interpolation=cv2.INTER_AREA)
        # Half-pixel centres: small = (large + 0.5) · ratio − 0.5.
        matrix[:, 2] += matrix[:, :2] @ (0.5 / ratio - 0.5)
        matrix[:, :2] = matrix[:, :2] / ratio
    return cv2.warpAffine(
        picture,
        matrix,
        (INPUT_PX, INPUT_PX),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(GREY, GREY, GREY),
    )


def apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Applies an affine map to points [n, 2]."""
    return points @ matrix[:, :2].T + matrix[:, 2]


def _recolour(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Changes exposure, contrast, colour cast and gamma, and sometimes removes the colour."""
    x = image.astype(np.float32)
    x = (x - 127) * rng.uniform(0.65, 1.35) + 127 + rng.uniform(-35, 35)
    x *= 1 + rng.normal(0, 0.06, 3).astype(np.float32)
    if rng.random() < 0.1:
        x = np.repeat(x @ np.array([[0.3], [0.59], [0.11]], np.float32), 3, 2)
    x = np.clip(x, 0, 255)
    return (255 * (x / 255) ** rng.uniform(0.75, 1.35)).astype(np.uint8)


def _degrade(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Adds lower resolution, blur, noise and JPEG to real crops (rendered ones are degraded already)."""
    if rng.random() < 0.5:
        small = int(INPUT_PX * rng.uniform(0.3, 0.9))
        image = cv2.resize(cv2.resize(image, (small, small), interpolation=cv2.INTER_AREA), (INPUT_PX, INPUT_PX))
    if rng.random() < 0.3:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.3))
    if rng.random() < 0.4:
        noise = rng.normal(0, rng.uniform(1, 9), image.shape)
        image = np.clip(image + noise, 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 90))])
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if done else image
    return image


class Sampler(Dataset[Batch]):
    """Draws augmented batches; a batch depends on the seed and its number alone."""

    def __init__(
        self,
        shards: Shards,
        real: list[RealCar],
        batch: int,
        real_share: float,
        seed: list[int],
        augment: bool = True,
    ) -> None:
        self.shards, self.real, self.batch = shards, real, batch
        self.real_count = round(batch * real_share) if real else 0
        self.seed, self.augment = seed, augment

    def __getitem__(self, number: int) -> Batch:
        """Returns the batch of a number."""
        self.rng = np.random.default_rng([*self.seed, number])
        samples = [self._real() for _ in range(self.real_count)]
        samples += [self._rendered() for _ in range(self.batch - self.real_count)]
        return Batch(*(torch.from_numpy(np.stack(column)) for column in zip(*samples)))

    def _rendered(self) -> Sample:
        rng = self.rng
        i = int(rng.integers(len(self.shards)))
        image, points, seen = self.shards.images[i], self.shards.points[i], self.shards.visible[i] > 0
        exists = np.isfinite(points[:, 0])
        truth = (np.where(seen, 1.0, 0.4) * exists, seen * 1.0, exists * 1.0)
        if not self.augment:
            matrix = crop_from_rendered()
            return self._labelled(warp(image, matrix), apply(matrix, points), *truth)
        matrix = crop_from_rendered(rng.normal(0, 0.1), np.exp(rng.uniform(-0.15, 0.1)), rng.uniform(-5, 5, 2))
        return self._finish(warp(image, matrix), apply(matrix, points), *truth)

    def _real(self) -> Sample:
        rng = self.rng
        car = self.real[int(rng.integers(len(self.real)))]
        size = (car.box[2:] - car.box[:2]).max()
        jitter = np.tile(rng.normal(0, 0.05, 2) * size, 2) + np.array([-1, -1, 1, 1]) * rng.uniform(-0.06, 0.1) * size
        matrix = crop_from_box(car.box + jitter, rng.normal(0, 0.12))
        image = _degrade(warp(car.patch, matrix), rng)
        points = apply(matrix, car.points)
        known = np.select([car.flag == 2, car.flag == 1], [1.0, 0.4], 0.0)
        return self._finish(image, points, known, (car.flag == 2) * 1.0, (car.flag == 2) * 1.0)

    def _finish(
        self, image: np.ndarray, points: np.ndarray, located: np.ndarray, visible: np.ndarray, judged: np.ndarray
    ) -> Sample:
        if self.rng.random() < 0.5:
            image = image[:, ::-1]
            points = points[MIRROR] * [-1, 1] + [INPUT_PX - 1, 0]
            located, visible, judged = located[MIRROR], visible[MIRROR], judged[MIRROR]
        return self._labelled(_recolour(image, self.rng), points, located, visible, judged)

    @staticmethod
    def _labelled(image: np.ndarray, points: np.ndarray, located: np.ndarray, visible: np.ndarray, judged: np.ndarray) -> Sample:
        points = np.nan_to_num(points, nan=-1e3)
        inside = ((points > -0.5) & (points < INPUT_PX - 0.5)).all(1)
        return image, *(x.astype(np.float32) for x in (points, located * inside, visible * inside, judged))
