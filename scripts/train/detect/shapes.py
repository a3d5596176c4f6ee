"""Draws smooth shapes as pictures without vehicles: discs, cups, blobs, ribbons.

  roadplane-train detect shapes --out DIR [--backgrounds DIR] [--count N] [--seed S]

A net that learns from rendered cars takes shaded, rounded objects for cars. These pictures show such objects, in front
of parts of photographs without vehicles or of a plain gradient.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import cv2
import numpy as np

SIZE_PX = (640, 480)
SHAPES = (2, 9)  # number of shapes in a picture
RADII_PX = (10.0, 130.0)


def background(rng: np.random.Generator, photographs: list[np.ndarray]) -> np.ndarray:
    """Returns a part of a photograph, or a gradient between two colours; f32 in 0…255."""
    width, height = SIZE_PX
    if photographs and rng.random() < 0.6:
        image = photographs[rng.integers(len(photographs))]
        share = rng.uniform(0.4, 1.0)
        rows, columns = (max(2, int(length * share)) for length in image.shape[:2])
        y, x = (int(rng.integers(length - part + 1)) for length, part in zip(image.shape[:2], (rows, columns), strict=True))
        return cv2.resize(image[y : y + rows, x : x + columns], SIZE_PX).astype(np.float32)
    ends = rng.uniform(0, 255, (2, 3))
    angle = rng.uniform(0, 2 * math.pi)
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    along = ((x * math.cos(angle) + y * math.sin(angle)) / 3 + 0.5)[..., None]
    return (ends[0] * (1 - along) + ends[1] * along).astype(np.float32)


def outline(rng: np.random.Generator, radius: float) -> np.ndarray:
    """Returns a closed outline [n, 2] around 0: an ellipse, made a blob by waves of the radius."""
    angles = np.linspace(0, 2 * math.pi, 90, endpoint=False)
    waves = rng.integers(0, 4)
    lengths = radius * (1 + sum(rng.uniform(0, 0.3) / k * np.cos(k * angles + rng.uniform(0, 7)) for k in range(2, 2 + waves)))
    flat, turn = rng.uniform(0.35, 1.0), rng.uniform(0, math.pi)
    x, y = lengths * np.cos(angles), flat * lengths * np.sin(angles)
    return np.stack([x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)], 1)


def ribbon(rng: np.random.Generator, radius: float) -> np.ndarray:
    """Returns the outline [n, 2] of a curved band around 0."""
    t = np.linspace(-1, 1, 45)
    bend, width, turn = rng.uniform(-0.8, 0.8), radius * rng.uniform(0.1, 0.4), rng.uniform(0, math.pi)
    x, y = radius * 1.5 * t, radius * bend * (t**2 - 0.5)
    band = np.concatenate([np.stack([x, y - width], 1), np.stack([x, y + width], 1)[::-1]])
    return band @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])


def paint(rng: np.random.Generator, image: np.ndarray) -> np.ndarray:
    """Returns the picture with one more shape: shaded, perhaps with a rim, a shadow or out of focus."""
    height, width = image.shape[:2]
    radius = math.exp(rng.uniform(*np.log(RADII_PX)))
    centre = rng.uniform((0, 0), (width, height))
    points = (ribbon if rng.random() < 0.2 else outline)(rng, radius)

    def mask(scale: float, shift: np.ndarray) -> np.ndarray:
        found = np.zeros((height, width), np.float32)
        cv2.fillPoly(found, [np.rint(points * scale + centre + shift).astype(np.int32)], 1.0, cv2.LINE_AA)
        return found

    soft = rng.uniform(1.0, 8.0) if rng.random() < 0.25 else 0.6
    if rng.random() < 0.5:
        shadow = cv2.GaussianBlur(mask(1.0, radius * rng.uniform(-0.4, 0.4, 2)), (0, 0), 0.08 * radius + 1)
        image = image * (1 - rng.uniform(0.2, 0.6) * shadow[..., None])
    colour, light = rng.uniform(0, 255, 3), rng.uniform(-0.5, 0.5, 2)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    shade = 1 + ((x - centre[0]) * light[0] + (y - centre[1]) * light[1]) / radius
    parts = [(mask(1.0, np.zeros(2)), colour)]
    if rng.random() < 0.5:  # the inside of a cup, or a highlight
        parts.append((mask(rng.uniform(0.3, 0.92), radius * rng.uniform(-0.1, 0.1, 2)), rng.uniform(0, 255, 3)))
    for found, fill in parts:
        found = cv2.GaussianBlur(found, (0, 0), soft)[..., None]
        image = image * (1 - found) + found * (fill * shade.clip(0.2, 1.8)[..., None])
    return image.astype(np.float32)


def picture(seed: int, number: int, photographs: list[np.ndarray]) -> np.ndarray:
    """Returns a picture; it depends on the arguments alone."""
    rng = np.random.default_rng([seed, number])
    image = background(rng, photographs)
    for _ in range(int(rng.integers(*SHAPES))):
        image = paint(rng, image)
    return (image.clip(0, 255) + 0.5).astype(np.uint8)


def main() -> None:
    """Writes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--backgrounds", type=Path, help="folder of photographs without vehicles (*.png)")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    photographs = [cv2.imread(str(path)) for path in sorted(options.backgrounds.glob("*.png"))] if options.backgrounds else []
    options.out.mkdir(parents=True, exist_ok=True)
    for number in range(options.count):
        cv2.imwrite(str(options.out / f"shapes_{number:04}.jpg"), picture(options.seed, number, photographs))
    print(f"{options.count} pictures")


if __name__ == "__main__":
    main()
