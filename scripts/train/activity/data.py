"""Training data of the activity nets: labelled sequences of MEVA's instances and of synthetic drives.

A row of the table names the input. `3d` is motion on the ground. `2d` is motion of the box's centre in the picture, the
paper's baseline. `2d_size` is the same, divided by the size of the box.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .drives import LABELS, Truth, tracked, truth
from .features import features, grid
from .meva import CLASSES, Instance, read_instances

ROWS = ("3d", "2d", "2d_size")
LONGEST = 100  # steps of a piece of a synthetic drive
SIZE_M = 2.2  # square root of the area of a car's box: scales motion in 2D to the order of metres
FUZZY_S = 0.3  # annotated beginnings and ends have a lower weight within this time


@dataclass(frozen=True)
class Sequence:
    """Features with a label per step."""

    values: np.ndarray  # (n, FEATURES)
    labels: np.ndarray  # (n,) index into LABELS
    weights: np.ndarray  # (n,)
    instance: bool  # one label for the whole sequence


def instance_motion(instance: Instance, row: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns positions and their standard deviations, as the input of a row."""
    if row == "3d":
        return instance.xy_m, instance.sd_m
    boxes = instance.boxes_px
    middle = np.stack([boxes[:, 0] + boxes[:, 2], -boxes[:, 1] - boxes[:, 3]], 1) / 2
    size = np.median(np.sqrt((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])))
    return (middle / 36 if row == "2d" else middle / size * SIZE_M), None


def instance_sequence(instance: Instance, row: str, rng: np.random.Generator | None = None) -> Sequence:
    """Returns an instance as it is, or augmented: size, noise, beginning and end vary a little."""
    xy, sd = instance_motion(instance, row)
    time_s, keep = instance.time_s, slice(None)
    if rng is not None:
        xy = xy * np.exp(rng.normal(0, 0.2)) + rng.normal(0, 0.5, xy.shape) * (0.03 if sd is None else sd)
        time_s = time_s * np.exp(rng.normal(0, 0.08))
        cut = (rng.random(2) * 0.12 * len(xy)).astype(int)
        keep = slice(cut[0], len(xy) - cut[1])
    time_s, xy, sd = time_s[keep], xy[keep], None if sd is None else sd[keep]
    at = grid(time_s)
    labels = np.full(len(at), LABELS.index(instance.activity))
    inside = np.minimum(at - time_s[0], time_s[-1] - at)
    weights = np.where(inside < FUZZY_S, 0.3, 1.0)
    return Sequence(features(at, time_s, xy, sd_m=sd), labels, weights, True)


def in_picture(drive: Truth, rng: np.random.Generator) -> tuple[np.ndarray, float] | None:
    """Returns pixels (n, 2; y up) and box size of a synthetic drive, projected by a random camera."""
    height, focal = np.exp(rng.uniform(np.log(3.5), np.log(14))), np.exp(rng.uniform(np.log(800), np.log(5000)))
    middle = drive.pose[:, :2].mean(0)
    away = max(height * rng.uniform(1.5, 8), 1.4 * np.linalg.norm(drive.pose[:, :2] - middle, axis=1).max())
    turn = rng.uniform(-np.pi, np.pi)
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    x, y = ((drive.pose[:, :2] - middle) @ spin.T + [0, away]).T
    tilt = np.arctan2(height, away)
    depth = y * np.cos(tilt) + height * np.sin(tilt)
    if depth.min() < 4:
        return None
    up = y * np.sin(tilt) - height * np.cos(tilt)
    return np.stack([x, up], 1) * (focal / depth)[:, None], float(np.median(SIZE_M * focal / depth))


def made_sequence(row: str, rng: np.random.Generator, drive: Truth) -> Sequence:
    """Returns a piece of a synthetic drive, as the input of a row; on the ground, three of four have a heading."""
    heading = sd = None
    if row == "3d":
        time_s, xy, heading, sd = tracked(drive, rng)
        if rng.random() < 0.25:
            heading = None
        if rng.random() < 0.25:
            sd = None
    else:
        seen = in_picture(drive, rng)
        while seen is None:
            seen = in_picture(drive, rng)
        pixels, size = seen
        keep = slice(None, None, int(rng.integers(1, 5)))
        time_s, pixels = drive.time_s[keep], pixels[keep]
        pixels = pixels + rng.normal(0, rng.uniform(0.002, 0.02) * size, pixels.shape)
        xy = pixels / 36 if row == "2d" else pixels / size * SIZE_M
    begin = rng.uniform(0, max(time_s[-1] - LONGEST * 0.2, 0))
    keep = (time_s >= begin) & (time_s <= begin + LONGEST * 0.2)
    time_s, xy = time_s[keep], xy[keep]
    at = grid(time_s)
    near = np.abs(drive.time_s[None] - at[:, None]).argmin(1)
    labels = drive.label[near]
    changed = np.concatenate([[False], labels[1:] != labels[:-1]])
    edge = changed | np.concatenate([changed[1:], [False]])
    part = (None if heading is None else heading[keep]), (None if sd is None else sd[keep])
    return Sequence(features(at, time_s, xy, *part), labels, np.where(edge, 0.3, 1.0), False)


def meva_sequences(folder: Path, row: str, cameras: tuple[str, ...], unseen: bool, versions: int, seed: int) -> list[Sequence]:
    """Returns the instances of all cameras but `cameras`, or of these (`unseen`), with augmented copies."""
    rng = np.random.default_rng(seed)
    chosen = [instance for instance in read_instances(folder) if (instance.camera in cameras) == unseen]
    changed = [instance_sequence(instance, row, rng) for instance in chosen for _ in range(versions)]
    return [instance_sequence(instance, row) for instance in chosen] + changed


def made_sequences(row: str, count: int, seed: int) -> list[Sequence]:
    """Returns pieces of synthetic drives, two of each drive."""
    rng = np.random.default_rng(seed)
    return [made_sequence(row, rng, drive) for drive in (truth(rng) for _ in range(count // 2)) for _ in range(2)]


INSTANCE_LABELS = [LABELS.index(name) for name in CLASSES]
