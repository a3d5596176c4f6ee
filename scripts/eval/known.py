"""Measures the effect of one user constraint, a length on the ground, on the metres of finished runs with truth.

  roadplane run tests/data/lots/scenes/clip_*.mp4 --out runs --frames
  python3 scripts/eval/known.py target/release/roadplane runs tests/data/lots/scenes

For each clip, a length across the road is taken from the truth, at the nearest tenth of the cars' positions. Its ends
are rounded to whole pixels, and its metres get an error according to its sd. `roadplane stage track --known` then
solves the run's frames again.

The errors are in per cent: focal length, height, sideways positions (slope of estimated on true x), and distances from
the camera (median ratio). The last column is the sd of the height that the camera states. The table shows each clip's
root mean square over the draws.
"""

from __future__ import annotations

import csv
import gzip
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from boxes import overlap

# Errors of the given length in units of its sd; their root mean square is 1.
DRAWS = (-(1.5**0.5), 0.0, 1.5**0.5)
LENGTH_M = 10.0
LENGTH_SD = 0.01
# Quantile of the cars' distances at which the length lies.
QUANTILE = 0.1
# A row belongs to the true car whose box it overlaps by this intersection over union.
MIN_IOU = 0.6


def read_truth(path: Path) -> dict:
    with gzip.open(path, "rt") as file:
        return json.load(file)


def constraint_length(truth: dict, off_sd: float) -> str:
    camera = truth["camera"]
    camera_from_world = np.array(camera["camera_from_world"])
    places = [car["world_from_car"] for frame in truth["frames"] for car in frame["cars"]]
    y_m = np.quantile([place[1][3] for place in places], QUANTILE)
    ends = []
    for x_m in (-LENGTH_M / 2, LENGTH_M / 2):
        point = camera_from_world @ np.array([x_m, y_m, 0.0, 1.0])
        pixel = camera["focal_px"] * point[:2] / point[2] + np.array(camera["principal_point_px"])
        ends += [int(v) for v in np.round(pixel)]
    given_m = LENGTH_M * (1.0 + LENGTH_SD * off_sd)
    return "x1,y1,x2,y2,length_m,sd_m,pixel_sd\n" + ",".join(map(str, [*ends, given_m, LENGTH_SD * given_m, 0.3])) + "\n"


def errors(run: Path, truth: dict) -> np.ndarray:
    """Returns focal length, height, sideways and distance errors, all as shares, and the stated sd of the height."""
    camera, true = json.loads((run / "camera.json").read_text()), truth["camera"]
    frames = {frame["frame"]: frame["cars"] for frame in truth["frames"]}
    found, expected = [], []
    with (run / "tracks.csv").open() as file:
        for row in csv.DictReader(file):
            if row["observed"] != "true" or row["class"] != "car":
                continue
            box = [float(row[f"bbox_{corner}_px"]) for corner in ("x0", "y0", "x1", "y1")]
            cars = [car for car in frames.get(int(row["frame"]), []) if car["whole_box"]]
            best = max(cars, key=lambda car: overlap(box, car["whole_box"]), default=None)
            if best is not None and overlap(box, best["whole_box"]) > MIN_IOU:
                found.append([float(row["x_m"]), float(row["y_m"])])
                expected.append([best["world_from_car"][axis][3] for axis in (0, 1)])
    found, expected = np.array(found), np.array(expected)
    sideways = found[:, 0] @ expected[:, 0] / (expected[:, 0] @ expected[:, 0])
    distance = np.median(np.hypot(*found.T) / np.hypot(*expected.T))
    focal, height = camera["focal_px"] / true["focal_px"], camera["height_m"] / true["height_m"]
    return np.array([focal - 1, height - 1, sideways - 1, distance - 1, camera["height_sd_m"] / camera["height_m"]])


def main(program: str, runs: Path, scenes: Path) -> None:
    rms = {"without": [], "with": []}
    print("rms, %                 focal height sideways distance | claimed height")
    for run in sorted(run for run in runs.iterdir() if (run / "frames.jsonl").is_file()):
        truth = read_truth(scenes / f"{run.name}.truth.json.gz")
        rows = {"without": [errors(run, truth)], "with": []}
        with tempfile.TemporaryDirectory() as folder:
            for draw in DRAWS:
                known, out = Path(folder) / "known.csv", Path(folder) / f"{draw:.1f}"
                known.write_text(constraint_length(truth, draw))
                command = [program, "stage", "track", run / "frames.jsonl", "--out", out, "--known", known]
                subprocess.run(command, check=True, capture_output=True)
                rows["with"].append(errors(out, truth))
        for which, values in rows.items():
            rms[which].append(np.sqrt(np.mean(np.square(values), axis=0)))
            show(f"{run.name} {which}", rms[which][-1])
    for which, values in rms.items():
        show(f"all, rms, {which}", np.sqrt(np.mean(np.square(values), axis=0)))
        show(f"all, median, {which}", np.median(values, axis=0))


def show(name: str, values: np.ndarray) -> None:
    print(f"{name:24}" + "".join(f"{100 * value:7.2f}" for value in values))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
