#!/usr/bin/env python3
"""Draws a found scene from above and, with a camera, in the picture.

    scripts/traffic/draw_scene.py TRACKS.csv SCENE.json --out OUT.png [--camera CAMERA.json --background PICTURE.png]

`SCENE.json` is a line of the example `scene` of the crate `traffic`. Paths are grey, gates red, lanes coloured with a
circle at their start, stop lines white.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

SIZE_PX, MARGIN_PX = 1000, 40
COLOURS = [(80, 200, 80), (230, 140, 60), (60, 160, 240), (200, 90, 200), (200, 200, 60), (90, 90, 230), (150, 220, 150)]


def paths_of(file: Path) -> list[np.ndarray]:
    """Returns the positions of each track."""
    tracks: dict[str, list[tuple[float, float]]] = {}
    with file.open() as lines:
        for row in csv.DictReader(lines):
            tracks.setdefault(row["track"], []).append((float(row["x_m"]), float(row["y_m"])))
    return [np.array(points) for points in tracks.values()]


def draw(picture: np.ndarray, paths: list[np.ndarray], scene: dict, pixel: Callable[[np.ndarray], np.ndarray]) -> None:
    """Draws a scene into a picture. `pixel` maps ground points (n, 2) to pixels; NaN: behind the camera."""

    def line(points: np.ndarray, colour: tuple[int, int, int], width: int) -> None:
        steps = np.concatenate([np.linspace(a, b, 8) for a, b in zip(points[:-1], points[1:], strict=True)])
        at = pixel(steps)
        for a, b in zip(at[:-1], at[1:], strict=True):
            if np.isfinite([a, b]).all() and np.abs([a, b]).max() < 1e4:
                cv2.line(picture, *(tuple(int(round(v)) for v in p) for p in (a, b)), colour, width, cv2.LINE_AA)

    for path in paths:
        line(path[:: max(len(path) // 60, 1)], (130, 130, 130), 1)
    for number, lane in enumerate(scene["lanes"]):
        colour, middle = COLOURS[number % len(COLOURS)], np.array(lane["middle"])
        line(middle, colour, 2)
        start = pixel(middle[:1])[0]
        if np.isfinite(start).all() and np.abs(start).max() < 1e4:
            cv2.circle(picture, tuple(int(v) for v in start), 5, colour, -1, cv2.LINE_AA)
    for arm in scene["arms"]:
        ends = np.array(arm["line"])
        line(ends, (40, 40, 240), 3)
        at = pixel(ends[:1])[0]
        if np.isfinite(at).all():
            text = f"{arm['name']}: {arm['entered']} in, {arm['left']} out"
            place = np.clip(at, [5, 20], [picture.shape[1] - 130, picture.shape[0] - 8])
            cv2.putText(picture, text, tuple(int(v) for v in place), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 240), 1, cv2.LINE_AA)
    for stop in scene["stop_lines"]:
        place, forward = np.array(stop["place"]), np.array(stop["forward"])
        side = np.array([-forward[1], forward[0]]) * 1.6
        line(np.array([place - side, place + side]), (255, 255, 255), 3)


def main() -> None:
    """Draws the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracks", type=Path)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--camera", type=Path)
    parser.add_argument("--background", type=Path)
    arguments = parser.parse_args()
    paths, scene = paths_of(arguments.tracks), json.loads(arguments.scene.read_text())
    points = np.concatenate(paths)
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    scale = (SIZE_PX - 2 * MARGIN_PX) / (high - low).max()
    above = np.full((SIZE_PX, SIZE_PX, 3), 40, np.uint8)
    draw(above, paths, scene, lambda p: (p - low) * [scale, -scale] + [MARGIN_PX, SIZE_PX - MARGIN_PX])
    pictures = [above]
    if arguments.camera and arguments.background:
        camera, picture = json.loads(arguments.camera.read_text()), cv2.imread(str(arguments.background))
        normal, offset = np.array(camera["plane_in_camera"]["normal"]), camera["plane_in_camera"]["offset_m"]
        ahead = np.array([0, 0, 1.0]) - normal * normal[2]
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, normal)

        def pixel(p: np.ndarray) -> np.ndarray:
            at = -normal * offset + p[:, :1] * right + p[:, 1:] * ahead
            depth = np.where(at[:, 2:] > 0.5, at[:, 2:], np.nan)
            return at[:, :2] / depth * camera["focal_px"] + camera["principal_point_px"]

        draw(picture, [], scene, pixel)
        pictures.append(picture)
    height = max(picture.shape[0] for picture in pictures)
    pictures = [cv2.copyMakeBorder(p, 0, height - p.shape[0], 0, 0, cv2.BORDER_CONSTANT) for p in pictures]
    cv2.imwrite(str(arguments.out), np.concatenate(pictures, 1))


if __name__ == "__main__":
    main()
