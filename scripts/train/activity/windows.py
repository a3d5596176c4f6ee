"""Windows of a video for the table's video row: the pixels of a fixed square around a car over 3 s.

The `roadplane-lab` binary cuts the same windows (`windows.rs` of `eval activity`); `tests/data/activity/windows.json`
holds both to the same pixels. A window belongs to a step of the clip (whole multiples of STEP_S). Its square lies
around the box of that step, and it has labels for the LABELLED steps around it. It needs NumPy and ffmpeg.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadplane_train.json_files import read_json, write_json

from .drives import LABELS
from .features import STEP_S

STEPS, BEFORE = 16, 8  # steps of a window; steps before its own
LABELLED, LABELLED_BEFORE = 4, 2  # labelled steps; labelled steps before its own
SIDE_PX = 48
REACH = 2.5  # side of the square over the longer side of the car's box
SUB = 3  # samples per pixel in each direction
SHARP_TURN = 0.05  # curvature, 1/m: `Label::of_truth`
SMALLEST_PX, LEAST_SHARE = 16.0, 0.3  # longer side and visible share of cars to train on


def square_around(box: np.ndarray) -> np.ndarray:
    """Returns left, top and side (px) of the square around a box."""
    side = max(REACH * max(box[2] - box[0], box[3] - box[1]), 8.0)
    return np.array([(box[0] + box[2] - side) / 2, (box[1] + box[3] - side) / 2, side])


def cut(picture: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Cuts (SIDE_PX, SIDE_PX, 3) out of a picture (height, width, 3), both in bytes.

    Pixels beyond its edge repeat the edge.
    """
    at = (np.arange(SUB * SIDE_PX) + 0.5) / (SUB * SIDE_PX) * square[2]
    columns = np.clip(np.floor(square[0] + at + 0.5).astype(int), 0, picture.shape[1] - 1)
    rows = np.clip(np.floor(square[1] + at + 0.5).astype(int), 0, picture.shape[0] - 1)
    sampled = picture[rows[:, None], columns[None]].reshape(SIDE_PX, SUB, SIDE_PX, SUB, 3)
    return ((sampled.sum((1, 3), dtype=np.int32) + SUB * SUB // 2) // (SUB * SUB)).astype(np.uint8)


def window(pictures: np.ndarray, step: int, square: np.ndarray) -> np.ndarray:
    """Returns (STEPS, SIDE_PX, SIDE_PX, 3) around a step.

    Before and after the clip, its first and last pictures repeat.
    """
    steps = np.clip(np.arange(step - BEFORE, step - BEFORE + STEPS), 0, len(pictures) - 1)
    return np.stack([cut(pictures[k], square) for k in steps])


@dataclass(frozen=True)
class Car:
    """A car of a clip with truth, by step."""

    steps: np.ndarray  # (n,), ascending
    boxes: np.ndarray  # (n, 4)
    labels: np.ndarray  # (n,) of LABELS


def read_pictures(path: Path, size: tuple[int, int], fps: float) -> np.ndarray:
    """Returns the picture of every step, (steps, height, width, 3)."""
    every = round(fps * STEP_S)
    command = ["ffmpeg", "-v", "error", "-threads", "1", "-i", str(path), "-vf", f"select=not(mod(n\\,{every}))", "-vsync", "0"]
    raw = subprocess.run([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], check=True, stdout=subprocess.PIPE).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


def label_of(activity: str, speed_mps: float, curvature: float) -> int:
    """Returns the label of a truth row, as `Label::of_truth` does."""
    if activity == "parking":
        side = "turning_left" if curvature > 0 else "turning_right"
        activity = "reversing" if speed_mps < 0 else side if abs(curvature) > SHARP_TURN else "stopping"
    return LABELS.index("not_moving" if activity == "parked" else activity)


def read_clip(path: Path) -> tuple[np.ndarray, list[Car]]:
    """Returns pictures and cars of the clip with this truth file."""
    truth = read_json(path)
    every = round(truth["fps"] * STEP_S)
    if every != truth["fps"] * STEP_S:
        raise SystemExit(f"{path}: {truth['fps']} frames per second; must be a multiple of {1 / STEP_S:.0f}")
    seen: dict[int, list[tuple]] = {}
    for frame in truth["frames"][::every]:
        for car in frame["cars"]:
            seen.setdefault(car["id"], []).append((frame["frame"] // every, car))
    cars = []
    for rows in seen.values():
        steps = np.array([step for step, _ in rows])
        pose = np.array([car["world_from_car"] for _, car in rows])
        speed = np.array([car["speed_mps"] for _, car in rows])
        heading = np.unwrap(np.arctan2(pose[:, 1, 0], pose[:, 0, 0]))
        after, before = np.minimum(np.arange(len(steps)) + 1, len(steps) - 1), np.maximum(np.arange(len(steps)) - 1, 0)
        driven = (steps[after] - steps[before]) * STEP_S * speed
        bend = np.where(np.abs(driven) > 1e-3, (heading[after] - heading[before]) / np.where(driven == 0, 1, driven), 0)
        labels = [label_of(car["activity"], v, b) for (_, car), v, b in zip(rows, speed, bend, strict=True)]
        boxes = np.array([car["box"] for _, car in rows])
        large = (boxes[:, 2:] - boxes[:, :2]).max(1) >= SMALLEST_PX
        keep = large & (np.array([car["visible_share"] for _, car in rows]) >= LEAST_SHARE)
        if keep.any():
            cars.append(Car(steps[keep], boxes[keep], np.array(labels)[keep]))
    return read_pictures(path.parent / truth["media"], truth["camera"]["image_size_px"], truth["fps"]), cars


def fixture(path: Path) -> None:
    """Writes boxes of a synthetic picture, and every fifth pixel of every fifth row of their crops."""
    width, height = 97, 61
    y, x = np.mgrid[:height, :width]
    picture = np.stack([(x * 7 + y * y) % 251, (x * x + y * 3) % 241, (x * y) % 239], 2).astype(np.uint8)
    cases = []
    for box in ([40.25, 20.5, 61.75, 33.0], [1.0, 2.0, 3.5, 3.0], [70.0, 30.0, 110.0, 75.5]):
        crop = cut(picture, square_around(np.array(box)))[::5, ::5]
        cases.append({"box": box, "crop": crop.reshape(-1, 3).tolist()})
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"schema": "roadplane.activity-windows/1", "size_px": [width, height], "cases": cases})
