"""Compares lengths on the ground given by the user with those that a run's camera gives.

  python3 scripts/eval/lengths.py RUN KNOWN.csv

KNOWN.csv lists lengths as `roadplane run --known` reads them (x1,y1,x2,y2,length_m,sd_m,pixel_sd,name), or surveyed
points (x_px,y_px,east_m,north_m), of which all pairs are used. Lengths of one name (the dashes of a lane, say) form a
group. A group's ratio of our lengths to the given ones is that of speeds there, too. The sds are those of the run's
camera and of the given lengths. It needs the Python package: `pip install .`.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import sys
from pathlib import Path

import numpy as np

import roadplane

PIXEL_SD = 1.0
SURVEY_SD_M = 0.1


def read(path: Path) -> list[tuple[str, np.ndarray, float, float, float]]:
    """Yields name, ends (2, 2) px, length m, its sd, and the sd of each pixel."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if rows and "east_m" in rows[0]:
        points = [[float(row[key]) for key in ("x_px", "y_px", "east_m", "north_m")] for row in rows]
        pairs = itertools.combinations(enumerate(points, 1), 2)
        return [
            (f"{i}-{j}", np.array([a[:2], b[:2]]), float(np.hypot(a[2] - b[2], a[3] - b[3])), SURVEY_SD_M, PIXEL_SD)
            for (i, a), (j, b) in pairs
        ]
    lengths = []
    for k, row in enumerate(rows, 1):
        ends = np.array([[float(row["x1"]), float(row["y1"])], [float(row["x2"]), float(row["y2"])]])
        pixel_sd = float(row.get("pixel_sd") or PIXEL_SD)
        lengths.append((row.get("name") or str(k), ends, float(row["length_m"]), float(row["sd_m"]), pixel_sd))
    return lengths


def length(camera: roadplane.Camera, params: np.ndarray, ends: np.ndarray) -> float:
    """Returns the length on the ground between two pixels, m."""
    a, b = dataclasses.replace(camera, params=params).ground_from_pixel(ends)
    return float(np.hypot(*(a - b)))


def gradients(camera: roadplane.Camera, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the derivatives of the length's log by the four camera parameters, and by the pixels' coordinates."""

    def slope(by: str, i: int, step: float) -> float:
        logs = []
        for sign in (1, -1):
            params, pixels = camera.params.copy(), ends.copy().ravel()
            (params if by == "camera" else pixels)[i] += sign * step
            logs.append(np.log(length(camera, params, pixels.reshape(2, 2))))
        return (logs[0] - logs[1]) / (2 * step)

    return np.array([slope("camera", i, 1e-4) for i in range(4)]), np.array([slope("pixels", i, 0.05) for i in range(4)])


def main() -> None:
    run, known = roadplane.load(sys.argv[1]), read(Path(sys.argv[2]))
    camera = run.camera
    print(f"{'name':>12} {'given, m':>9} {'ours, m':>9} {'off, %':>7} {'sd, %':>6} {'off / sd':>8}")
    groups: dict[str, list[tuple[float, np.ndarray, float]]] = {}
    off_m, off_sd = [], []
    for name, ends, length_m, sd_m, pixel_sd in known:
        ours = length(camera, camera.params, ends)
        by_camera, by_pixels = gradients(camera, ends)
        own = (sd_m / length_m) ** 2 + pixel_sd**2 * float(by_pixels @ by_pixels)
        sd = float(np.sqrt(by_camera @ camera.covariance @ by_camera + own))
        off = float(np.log(ours / length_m))
        print(f"{name:>12} {length_m:9.2f} {ours:9.2f} {100 * off:7.1f} {100 * sd:6.1f} {off / sd:8.2f}")
        groups.setdefault(name, []).append((off, by_camera, own))
        off_m.append(ours - length_m)
        off_sd.append(off / sd)
    near = sum(abs(v) <= 1.5 for v in off_sd)
    print(f"{len(known)} lengths: rms {np.sqrt(np.mean(np.square(off_m))):.2f} m, {near} within 1.5 sd")
    if len(groups) < len(known):
        for name, lengths in groups.items():
            weights = np.array([1 / own for _, _, own in lengths])
            weights /= weights.sum()
            off = float(sum(w * o for w, (o, _, _) in zip(weights, lengths, strict=True)))
            by_camera = sum(w * g for w, (_, g, _) in zip(weights, lengths, strict=True))
            own = float(sum(w * w * v for w, (_, _, v) in zip(weights, lengths, strict=True)))
            sd = float(np.sqrt(by_camera @ camera.covariance @ by_camera + own))
            print(f"{name:>12}: ratio {np.exp(off):.3f} ± {sd:.3f}, {off / sd:.2f} sd")


if __name__ == "__main__":
    main()
