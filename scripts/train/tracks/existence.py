"""Fits the probability that a track is a vehicle: logistic regression on the features of tracks with truth.

  roadplane-train tracks existence CANDIDATES.csv... --out models/tracks.json

`roadplane-lab eval tracker CLIPS --recorded RUNS --set track.min_exists_p=0 --candidates FILE` makes such a file. The
weights have a Gaussian prior, so that a feature without evidence gets a weight near 0. The printed figures are of
predictions for a clip by the fit to all other clips.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

from ..json_files import write_json

SCHEMA = "roadplane.tracks/1"
# Sd of the prior of each weight. A step of 1 in a feature then rarely changes the odds by more than e⁶.
WEIGHT_SD = 3.0
ROUNDS = 50


def read(paths: list[Path]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the features (n × features), whether each track is a vehicle (n), and the clip of each track (n)."""
    features, vehicles, clips = [], [], []
    for path in paths:
        with path.open() as lines:
            for row in csv.DictReader(lines):
                features.append([float(row[name]) for name in row if name.startswith("feature_")])
                vehicles.append(float(row["is_vehicle"]))
                # Files of the same clips begin with the same word: lots.csv, lots-low.csv.
                clips.append(f"{path.stem.split('-')[0]}/{row['clip']}")
    if not features:
        raise SystemExit("the files have no tracks")
    return np.array(features), np.array(vehicles), np.array(clips)


def probability(weights: np.ndarray, features: np.ndarray) -> np.ndarray:
    """Returns the probability that each track is a vehicle."""
    return 1.0 / (1.0 + np.exp(-features @ weights))


def fit(features: np.ndarray, vehicles: np.ndarray) -> np.ndarray:
    """Returns the weights of the largest posterior (Newton's method). The first, constant feature has no prior."""
    precision = np.full(features.shape[1], WEIGHT_SD**-2)
    precision[0] = 1e-6
    weights = np.zeros(features.shape[1])
    for _ in range(ROUNDS):
        p = probability(weights, features)
        gradient = features.T @ (vehicles - p) - precision * weights
        curvature = (features * (p * (1 - p))[:, None]).T @ features + np.diag(precision)
        step = np.linalg.solve(curvature, gradient)
        # A full step may overshoot where the classes are far apart.
        weights += step * min(1.0, 3.0 / max(np.abs(step).max(), 1e-12))
        if np.abs(step).max() < 1e-9:
            break
    return weights


def held_out(features: np.ndarray, vehicles: np.ndarray, clips: np.ndarray) -> np.ndarray:
    """Returns the probability of each track by the fit to all other clips."""
    predicted = np.zeros(len(vehicles))
    for clip in np.unique(clips):
        inside = clips == clip
        predicted[inside] = probability(fit(features[~inside], vehicles[~inside]), features[inside])
    return predicted


def in_words(predicted: np.ndarray, vehicles: np.ndarray) -> str:
    """Returns the figures of predictions: errors at 0.5, log loss and calibration."""
    says = predicted >= 0.5
    p = np.clip(predicted, 1e-9, 1 - 1e-9)
    loss = -np.mean(vehicles * np.log(p) + (1 - vehicles) * np.log(1 - p))
    bins = np.minimum((10 * predicted).astype(int), 9)
    off = sum(abs((vehicles[bins == b] - predicted[bins == b]).sum()) for b in range(10)) / len(vehicles)
    lost, kept = int((~says & (vehicles == 1)).sum()), int((says & (vehicles == 0)).sum())
    return (
        f"{len(vehicles)} tracks: {lost} of {int(vehicles.sum())} vehicles are lost, {kept} of "
        f"{int((1 - vehicles).sum())} others are kept; log loss {loss:.3f}, expected calibration error {off:.3f}"
    )


def main() -> None:
    """Fits and writes the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("candidates", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    features, vehicles, clips = read(options.candidates)
    weights = fit(features, vehicles)
    print("held out by clip:", in_words(held_out(features, vehicles, clips), vehicles))
    print("weights:", " ".join(f"{weight:.3f}" for weight in weights))
    if options.out:
        write_json(options.out, {"schema": SCHEMA, "existence": [round(float(w), 4) for w in weights]}, indent=2)
