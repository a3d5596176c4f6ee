"""Logistic regression on claims of the tracker with known truth.

The weights have a Gaussian prior, so that a feature without evidence gets a weight near 0. The printed figures are of
predictions for a clip by the fit to all other clips.
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np

from ..json_files import write_json

SCHEMA = "roadplane.tracks/1"
# Sd of the prior of each weight. A step of 1 in a feature then rarely changes the odds by more than e⁶.
WEIGHT_SD = 3.0
ROUNDS = 50


def read(paths: list[Path]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the features (n × features), whether each claim is true (n), and the clip of each claim (n)."""
    features, truth, clips = [], [], []
    for path in paths:
        with path.open() as lines:
            for row in csv.DictReader(lines):
                features.append([float(row[name]) for name in row if name.startswith("feature_")])
                truth.append(float(row["is_true"]))
                # Files of the same clips begin with the same word: lots.csv, lots-low.csv.
                clips.append(f"{path.stem.split('-')[0]}/{row['clip']}")
    if not features:
        raise SystemExit("the files have no rows")
    return np.array(features), np.array(truth), np.array(clips)


def probability(weights: np.ndarray, features: np.ndarray) -> np.ndarray:
    """Returns the probability of each claim."""
    return 1.0 / (1.0 + np.exp(-features @ weights))


def fit(features: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Returns the weights of the largest posterior (Newton's method). The first, constant feature has no prior."""
    precision = np.full(features.shape[1], WEIGHT_SD**-2)
    precision[0] = 1e-6
    weights = np.zeros(features.shape[1])
    for _ in range(ROUNDS):
        p = probability(weights, features)
        gradient = features.T @ (truth - p) - precision * weights
        curvature = (features * (p * (1 - p))[:, None]).T @ features + np.diag(precision)
        step = np.linalg.solve(curvature, gradient)
        # A full step may overshoot where the classes are far apart.
        weights += step * min(1.0, 3.0 / max(np.abs(step).max(), 1e-12))
        if np.abs(step).max() < 1e-9:
            break
    return weights


def held_out(features: np.ndarray, truth: np.ndarray, clips: np.ndarray) -> np.ndarray:
    """Returns the probability of each claim by the fit to all other clips."""
    predicted = np.zeros(len(truth))
    for clip in np.unique(clips):
        inside = clips == clip
        predicted[inside] = probability(fit(features[~inside], truth[~inside]), features[inside])
    return predicted


def in_words(predicted: np.ndarray, truth: np.ndarray) -> str:
    """Returns the figures of predictions: errors at 0.5, log loss and calibration."""
    says = predicted >= 0.5
    p = np.clip(predicted, 1e-9, 1 - 1e-9)
    loss = -np.mean(truth * np.log(p) + (1 - truth) * np.log(1 - p))
    bins = np.minimum((10 * predicted).astype(int), 9)
    off = sum(abs((truth[bins == b] - predicted[bins == b]).sum()) for b in range(10)) / len(truth)
    lost, kept = int((~says & (truth == 1)).sum()), int((says & (truth == 0)).sum())
    return (
        f"{len(truth)} claims: {lost} of {int(truth.sum())} true ones are lost, {kept} of {int((1 - truth).sum())} "
        f"false ones are kept; log loss {loss:.3f}, expected calibration error {off:.3f}"
    )


def run(key: str, description: str | None) -> None:
    """Runs a command that fits the weights under this key of `tracks.json`."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("claims", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, help="file of weights; only those of this model change")
    options = parser.parse_args()
    features, truth, clips = read(options.claims)
    weights = fit(features, truth)
    print("held out by clip:", in_words(held_out(features, truth, clips), truth))
    print("weights:", " ".join(f"{weight:.3f}" for weight in weights))
    if options.out:
        others = json.loads(options.out.read_text(encoding="utf-8")) if options.out.exists() else {}
        write_json(options.out, {**others, "schema": SCHEMA, key: [round(float(w), 4) for w in weights]}, indent=2)
