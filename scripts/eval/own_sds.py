#!/usr/bin/env python3
"""Compares the errors of positions with the tracks' own sds, on rendered clips with the true camera.

    .runtime/train/bin/python scripts/eval/own_sds.py RUNS TRUTH... [--binary FILE] [--out FOLDER]

RUNS is the folder of finished runs with `--frames`. A truth file is CLIP.truth.json (gzipped or not). The script tracks
the frames again with the true camera as user constraint, so errors of the camera have no part. A row counts if it is
observed, and if its box has an overlap (IoU) of 0.5 with the box of a car whose heading is right to 30°.

The table has one line per group of rows:

- number of rows and of tracks
- own: share of rows with an error below 1.5 m. Other rows are those of tracks that show another vehicle
- median error, m, and median of `x_own_sd_m` and `y_own_sd_m`
- rms of the normalised errors of x and of y, over the rows with an error below 1.5 m
- share of normalised errors within 1.96
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from roadplane_train.detect.metrics import overlaps
from roadplane_train.json_files import read_json
from roadplane_train.render.camera import Camera

ROOT = Path(__file__).resolve().parents[2]
MIN_IOU = 0.5
MOST_TURN = np.radians(30)
OTHER_M = 1.5
RANGES_M = [(0, 30), (30, 60), (60, 100), (100, 1000)]
# Rows: clip and track, distance, error of x and y, sd of x and y, speed; m and m/s.
COLUMNS = {"track": 0, "distance": 1, "error": slice(2, 4), "sd": slice(4, 6), "speed": 6, "visible": 7}


def pose_of(world_from_truth: np.ndarray, car: dict) -> tuple[float, float, float]:
    """Returns x, y and heading of a true car in the world of `roadplane`, m and rad."""
    pose = world_from_truth @ np.array(car["world_from_car"])
    return pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])


def track(frames: Path, camera: dict, out: Path, binary: Path) -> None:
    """Tracks the frames of a run with the true camera."""
    numbers = {
        "focal-px": f"{camera['focal_px']}±0.01%",
        "tilt-deg": f"{np.degrees(camera['tilt_rad'])}±0.001",
        "roll-deg": f"{np.degrees(camera['roll_rad'])}±0.001",
        "height-m": f"{camera['height_m']}±0.01%",
    }
    given = [f"--{name}={value}" for name, value in numbers.items()]
    subprocess.run([binary, "track", frames, "--out", out, *given], check=True, capture_output=True)


def rows_of(truth: dict, tracks: Path, clip: int) -> list[list[float]]:
    """Returns the rows of tracks that show a car."""
    world_from_truth = np.linalg.inv(Camera.of(truth["camera"]).camera_from_world) @ truth["camera"]["camera_from_world"]
    kinds = {model["id"]: model["class"] for model in truth["models"]}
    cars = {frame["frame"]: frame["cars"] for frame in truth["frames"]}
    rows = []
    for row in csv.DictReader(tracks.open()):
        found = cars.get(int(row["frame"]), [])
        if row["observed"] != "true" or row["class"] != "car" or not found:
            continue
        box = np.array([float(row[f"bbox_{side}_px"]) for side in ("x0", "y0", "x1", "y1")])
        shared = overlaps(box[None], np.array([car["box"] for car in found]))[0][0]
        car = found[int(shared.argmax())]
        x, y, heading = pose_of(world_from_truth, car)
        turn = np.angle(np.exp(1j * (float(row["heading_rad"]) - heading)))
        if shared.max() < MIN_IOU or kinds[car["id"]] != "car" or abs(turn) > MOST_TURN:
            continue
        errors = [float(row["x_m"]) - x, float(row["y_m"]) - y]
        sds = [float(row["x_own_sd_m"]), float(row["y_own_sd_m"])]
        number = 1e6 * clip + int(row["track"])
        rows.append([number, np.hypot(x, y), *errors, *sds, abs(float(row["speed_mps"])), car["visible_share"]])
    return rows


def line(name: str, rows: np.ndarray) -> None:
    """Prints the figures of a group of rows."""
    if len(rows) < 20:
        return
    error, sd = rows[:, COLUMNS["error"]], rows[:, COLUMNS["sd"]]
    own = np.linalg.norm(error, axis=1) < OTHER_M
    rms = np.sqrt(((error[own] / sd[own]) ** 2).mean(0))
    within = 100 * (np.abs(error) < 1.96 * sd).mean()
    tracks = len(np.unique(rows[:, COLUMNS["track"]]))
    print(
        f"{name:24} {len(rows):7} {tracks:6}  {100 * own.mean():5.1f} %  {np.median(np.abs(error)):5.3f}  "
        f"{np.median(sd):5.3f}  {rms[0]:5.2f}  {rms[1]:5.2f}  {within:5.1f} %"
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("truth", type=Path, nargs="+")
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/roadplane")
    parser.add_argument("--out", type=Path, help="keeps the tracks in this folder")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        for number, file in enumerate(options.truth):
            clip = file.name.split(".")[0]
            out = (options.out or Path(temporary)) / clip
            truth = read_json(file)
            track(options.runs / clip / "frames.jsonl", truth["camera"], out, options.binary)
            rows += rows_of(truth, out / "tracks.csv", number)
    table = np.array(rows)
    print(f"{'rows':24}  rows   tracks      own    error     sd    z x    z y   within")
    line("all", table)
    parked = table[:, COLUMNS["speed"]] == 0
    for name, of_kind in (("stationary", parked), ("driving", ~parked)):
        for low, high in RANGES_M:
            far = table[:, COLUMNS["distance"]]
            line(f"{name}, {low}–{high} m", table[of_kind & (far >= low) & (far < high)])
    line("less than 60 % visible", table[table[:, COLUMNS["visible"]] < 0.6])


if __name__ == "__main__":
    sys.exit(main())
