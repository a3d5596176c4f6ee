"""Fits how much the colours of two boxes say about whether they show one vehicle.

  roadplane-train tracks colour --clips DIR... --runs DIR [--out models/tracks.json]

CLIPS are rendered clips with truth; stills are left out. RUNS has the frames of `roadplane run CLIP --out RUNS
--frames` for each of them. The three numbers minimise the log loss of `track/src/colour.rs`, where pairs of one vehicle
and of two are equally frequent. The printed loss is that of clips by the fit to all other clips.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from ..detect.metrics import overlaps
from ..json_files import read_json, write_json
from .logistic import SCHEMA

LEAST_IOU = 0.5  # of a box and of the visible part of the vehicle that it shows
BLOCK_S = 1.0  # colours are means over this time, as at the ends of tracklets
LATER = (1, 2, 4, 8)  # distances of the blocks that are compared
FREEDOM = 4.0  # of the t distribution, as in `base/src/robust.rs`
START = (8.0, 3.0, 2.5)


def detections(frame: dict, cars: list[dict]) -> Iterator[tuple[int, np.ndarray]]:
    """Yields the vehicle and the colour of each box in a frame that shows one of these vehicles."""
    cars = [car for car in cars if car["box"]]
    found = [box for box in frame.get("cars", []) if box.get("colour_rgb")]
    if not cars or not found:
        return
    overlap, _ = overlaps(np.array([box["bbox_px"] for box in found]), np.array([car["box"] for car in cars], float))
    for box, row in zip(found, overlap, strict=True):
        if row.max() >= LEAST_IOU:
            yield cars[int(row.argmax())]["id"], np.array(box["colour_rgb"], float)


def pairs(truth: dict, frames: Path) -> tuple[np.ndarray, np.ndarray]:
    """Returns the changes of colour [n, 3] from block to block, of one vehicle and of two."""
    cars = {frame["frame"]: frame["cars"] for frame in truth["frames"]}
    seen: dict[tuple[int, int], list[np.ndarray]] = {}
    for line in frames.read_text(encoding="utf-8").splitlines():
        frame = json.loads(line)
        for vehicle, colour in detections(frame, cars.get(frame.get("frame"), [])):
            seen.setdefault((int(frame["time_s"] / BLOCK_S), vehicle), []).append(colour)
    means = {key: np.mean(colours, 0) for key, colours in seen.items()}
    at: dict[int, list[int]] = {}
    for block, vehicle in means:
        at.setdefault(block, []).append(vehicle)
    same, other = [], []
    for (block, vehicle), colour in means.items():
        for later in (block + step for step in LATER):
            for one in at.get(later, []):
                (same if one == vehicle else other).append(means[later, one] - colour)
    return np.array(same).reshape(-1, 3), np.array(other).reshape(-1, 3)


def cost(squared: np.ndarray) -> np.ndarray:
    """Returns the negative log density of a squared distance in sds, up to a constant."""
    return (FREEDOM + 3) / 2 * np.log1p(squared / FREEDOM)


def log_ratio(numbers: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Returns the log likelihood ratio of one vehicle against two."""
    light_sd, tint_sd, ratio = numbers
    light = change.mean(1)
    squared = (light / light_sd) ** 2 + ((change - light[:, None]) ** 2).sum(1) / tint_sd**2
    return 3 * np.log(ratio) - cost(squared) + cost(squared / ratio**2)


def loss(numbers: np.ndarray, same: np.ndarray, other: np.ndarray) -> float:
    """Returns the log loss, in nats."""
    of_same, of_other = np.logaddexp(0, -log_ratio(numbers, same)), np.logaddexp(0, log_ratio(numbers, other))
    return float(of_same.mean() + of_other.mean()) / 2


def fit(same: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Returns the sds of light and tint, and the ratio of the sds of two vehicles and of one."""
    found = minimize(lambda x: loss(np.exp(x), same, other), np.log(START), method="Nelder-Mead")
    return np.exp(found.x)


def main() -> None:
    """Fits and writes the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path, nargs="+", required=True, help="folders of rendered clips with truth")
    parser.add_argument("--runs", type=Path, nargs="+", required=True, help="one folder of runs for each of them")
    parser.add_argument("--out", type=Path, help="file of numbers; only those of colours change")
    options = parser.parse_args()
    clips = []
    for folder, runs in zip(options.clips, options.runs, strict=True):
        for path in sorted(folder.rglob("*.truth.json.gz")):
            if (truth := read_json(path))["kind"] == "clip":
                clips.append(pairs(truth, runs / path.name.removesuffix(".truth.json.gz") / "frames.jsonl"))
    same, other = (np.concatenate(kind) for kind in zip(*clips, strict=True))
    losses = []
    for i, clip in enumerate(clips):
        rest = [np.concatenate(kind) for kind in zip(*clips[:i], *clips[i + 1 :], strict=True)]
        losses.append(loss(fit(*rest), *clip))
    numbers = fit(same, other)
    print(f"{len(clips)} clips, {len(same)} pairs of one vehicle, {len(other)} of two")
    print(f"held out by clip: log loss {np.mean(losses):.3f} (0.693 without colours)")
    print("sd of light, sd of tint, ratio:", " ".join(f"{number:.2f}" for number in numbers))
    if options.out:
        others = read_json(options.out) if options.out.exists() else {}
        write_json(options.out, {**others, "schema": SCHEMA, "colour": [round(float(n), 2) for n in numbers]}, indent=2)
