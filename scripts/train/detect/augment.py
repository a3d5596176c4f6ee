"""Random views of a picture, and the faults of surveillance cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from roadplane_train.detect.model import INPUT_PX
from roadplane_train.detect.outlines import bounds
from roadplane_train.detect.pictures import IGNORED, Picture

PADDING = 114  # grey beyond the picture, as in crates/detect
LARGEST_ROLL_DEG = 35.0
# Size (square root of the area) that a drawn vehicle gets in the net's input, px.
SIZES_PX = (16.0, 300.0)
SCALES = (0.15, 1.6)
# Share of the views that look at a mistake of an earlier net, of pictures that have some. It is an ESTIMATE.
MISTAKES_SHARE = 0.4
# Share of dark views, and the largest sd of the noise by night and by day, of full scale. They are ESTIMATES.
NIGHT_SHARE, NIGHT_NOISE, DAY_NOISE = 0.2, 0.1, 0.045
# A vehicle of which less lies inside the input is ignored, and one with a shorter longer side.
SMALLEST_INSIDE, SMALLEST_SIDE_PX = 0.35, 10.0


@dataclass(frozen=True)
class View:
    """A part of a picture as the net's input: the picture's `centre` comes to the middle, scaled, rolled, mirrored."""

    centre: tuple[float, float]
    scale: float
    roll_rad: float = 0.0
    mirrored: bool = False
    size_px: int = INPUT_PX

    def matrix(self) -> np.ndarray:
        """Returns the map [2, 3] from the picture to the input, both in px from the corner."""
        c, s = self.scale * math.cos(self.roll_rad), self.scale * math.sin(self.roll_rad)
        turn = np.array([[c, -s], [s, c]])
        if self.mirrored:
            turn[0] *= -1
        shift = self.size_px / 2 - turn @ np.array(self.centre)
        return np.concatenate([turn, shift[:, None]], 1)

    def pixels(self, image: np.ndarray) -> np.ndarray:
        """Returns the input's pixels, with area averages where it is smaller, as in the product."""
        height, width = image.shape[:2]
        matrix = self.matrix()
        if self.scale < 1:
            small = (max(1, round(width * self.scale)), max(1, round(height * self.scale)))
            image = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
            matrix = matrix * np.array([[width / small[0], height / small[1], 1]])
        # OpenCV's pixel (0, 0) is the centre of the first one.
        matrix[:, 2] += matrix[:, :2].sum(1) * 0.5 - 0.5
        size = (self.size_px, self.size_px)
        grey = (PADDING,) * 3
        return cv2.warpAffine(image, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=grey)

    def boxes(self, picture: Picture) -> tuple[np.ndarray, np.ndarray]:
        """Returns the boxes [n, 4] of the vehicles in the input, and their classes [n]."""
        boxes, classes = [], []
        matrix = self.matrix()
        for outline, kind in zip(picture.outlines, picture.classes, strict=True):
            box = bounds(outline @ matrix[:, :2].T + matrix[:, 2])
            cut = box.clip(0, self.size_px)
            sides = cut[2:] - cut[:2]
            if (sides <= 0).any():
                continue
            inside = float(np.prod(sides) / np.prod(box[2:] - box[:2]))
            clear = inside >= SMALLEST_INSIDE and sides.max() >= SMALLEST_SIDE_PX
            boxes.append(cut)
            classes.append(kind if clear else IGNORED)
        return np.array(boxes, np.float32).reshape(-1, 4), np.array(classes, np.int64)


def letterbox(size_px: tuple[int, int], input_px: int = INPUT_PX) -> View:
    """Returns the view of a whole picture, never enlarged."""
    width, height = size_px
    return View((width / 2, height / 2), min(1.0, input_px / max(width, height)), size_px=input_px)


def random_view(rng: np.random.Generator, picture: Picture, input_px: int = INPUT_PX) -> View:
    """Returns a random view, in which vehicles of all sizes come about equally often.

    It looks at a vehicle of a random class first, so that rare classes are in the middle of more views. Or it looks at
    a mistake of an earlier net.
    """
    size = np.array(picture.size_px, float)
    fit = input_px / size.max()
    vehicles: dict[int, list[np.ndarray]] = {}
    for outline, kind in zip(picture.outlines, picture.classes, strict=True):
        if kind != IGNORED:
            vehicles.setdefault(kind, []).append(outline)
    box = None
    if picture.mistakes and rng.random() < MISTAKES_SHARE:
        box = picture.mistakes[rng.integers(len(picture.mistakes))]
    elif vehicles and rng.random() < 0.75:
        outlines = vehicles[sorted(vehicles)[rng.integers(len(vehicles))]]
        box = bounds(outlines[rng.integers(len(outlines))])
    if box is not None:
        wanted = math.exp(rng.uniform(*np.log(SIZES_PX)))
        scale = wanted / max(math.sqrt(float(np.prod(box[2:] - box[:2]))), 1.0)
        centre = (box[:2] + box[2:]) / 2 + rng.uniform(-0.4, 0.4, 2) * input_px / np.clip(scale, *SCALES)
    else:
        scale, centre = fit * math.exp(rng.uniform(-0.2, 1.0)), rng.uniform(0.2, 0.8, 2) * size
    scale = float(np.clip(scale, max(SCALES[0], 0.6 * fit), SCALES[1]))
    # The input shows as little as possible beyond the picture.
    half = input_px / scale / 2
    low, high = np.minimum(half, size / 2), np.maximum(size - half, size / 2)
    centre = np.clip(centre, low, high)
    rolled = rng.random() < 0.6
    roll = math.radians(rng.uniform(-LARGEST_ROLL_DEG, LARGEST_ROLL_DEG)) if rolled else 0.0
    return View((float(centre[0]), float(centre[1])), scale, roll, bool(rng.random() < 0.5), input_px)


def degrade(rng: np.random.Generator, image: np.ndarray) -> np.ndarray:
    """Returns the picture as a worse camera might take it: light, colour, night, blur, noise, compression."""
    x = image.astype(np.float32) / 255
    if rng.random() < 0.6:
        x = _relit(x, math.exp(rng.normal(0, 0.25)), math.exp(rng.normal(0, 0.2)), rng.uniform(0.75, 1.2))
        x *= np.exp(rng.normal(0, 0.05, 3)).astype(np.float32)
    night = rng.random() < NIGHT_SHARE
    if night:
        x = _relit(x, rng.uniform(0.2, 0.6), rng.uniform(1.2, 2.2), rng.uniform(0.6, 1.0))
        if rng.random() < 0.5:  # the camera shows all that is darker than a level as black
            x = np.maximum(x - rng.uniform(0, 0.6) * x.mean(), 0)
    if rng.random() < 0.1:
        x = x.mean(2, keepdims=True).repeat(3, 2)
    x = _blurred(rng, x)
    if night or rng.random() < 0.4:
        x = x + rng.normal(0, rng.uniform(0, NIGHT_NOISE if night else DAY_NOISE), x.shape).astype(np.float32)
    found = (x.clip(0, 1) * 255 + 0.5).astype(np.uint8)
    if rng.random() < 0.5:
        quality = int(rng.integers(25, 90))
        _, data = cv2.imencode(".jpg", np.ascontiguousarray(found[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, quality])
        found = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]
    return np.ascontiguousarray(found)


def _relit(x: np.ndarray, gain: float, gamma: float, contrast: float) -> np.ndarray:
    lit = gain * np.clip(x, 0, 1) ** gamma
    return (lit - lit.mean()) * np.float32(contrast) + lit.mean()


def _blurred(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    kind = rng.random()
    if kind < 0.2:  # out of focus
        return cv2.GaussianBlur(x, (0, 0), rng.uniform(0.3, 1.5))
    if kind < 0.3:  # motion
        length = int(rng.integers(3, 10))
        kernel = np.zeros((length, length), np.float32)
        angle = rng.uniform(0, math.pi)
        along = np.linspace(-1, 1, 4 * length)[:, None] * np.array([math.cos(angle), math.sin(angle)]) * (length - 1) / 2
        columns, rows = np.rint(along + (length - 1) / 2).astype(int).T
        kernel[rows, columns] = 1
        return cv2.filter2D(x, -1, kernel / kernel.sum())
    if kind < 0.42:  # a coarse camera
        size = x.shape[1::-1]
        share = rng.uniform(0.4, 0.8)
        small = cv2.resize(x, (round(size[0] * share), round(size[1] * share)), interpolation=cv2.INTER_AREA)
        return cv2.resize(small, size, interpolation=cv2.INTER_LINEAR)
    return x
