"""Calibrates the keypoint net: turns peaks of heatmaps into measurements with a calibrated sd."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from roadplane_train.net.decode import Calibration
from roadplane_train.net.evaluate import Crop, evaluate, robust_sd
from roadplane_train.net.model import Deployed

BINS = 6
# With fewer errors than this, the robust sd of a bin is uncertain by more than a fifth.
FEWEST = 30
# Lower bound of the floor. Rendered labels are exact; those of real cars scatter by about a pixel of the crop. The
# bound applies before the law is scaled as a whole. With the net of three stacks, the normalised error is 0.79
# on rendered and 1.27 on held-out real cars at 1.0 px. It is 0.80 and 1.25 at 1.2 px, 0.81 and 1.23 at 1.5 px (but 1.08
# on small cars).
LOWEST_FLOOR_PX = 1.2


def binned(variance: np.ndarray, error: np.ndarray) -> list[tuple[float, float, int]]:
    """Returns (mean variance, robust sd of the error, count) of bins of the variance with equal counts."""
    order = np.argsort(variance)
    parts = np.array_split(order, min(BINS, max(1, len(order) // FEWEST)))
    return [(float(variance[p].mean()), robust_sd(error[p]), len(p)) for p in parts]


def fit_sd(groups: list[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Fits a, b of sd² = a² · variance² + b² by least squares on log(sd / robust sd of the error), crop px.

    The fit uses bins of each group's (variance, error). Every group has the same weight, so that a few real cars count
    as much as many rendered ones. Bins give a robust scale per level of predicted spread; with a likelihood, the few
    gross errors would set the floor. Measurements show that errors grow with the variance, not with its root. The
    targets have a width of their own (`loss.TARGET_SD_CELLS`). A net's spread is too narrow if its uncertainty is
    large.
    """
    bins = [(v, sd, n / len(error)) for variance, error in groups for v, sd, n in binned(variance, error)]
    variance, sd, weight = np.array(bins).T

    def cost(logs: np.ndarray) -> float:
        predicted = 0.5 * np.log(np.exp(2 * logs[0]) * variance**2 + np.exp(2 * logs[1]) + LOWEST_FLOOR_PX**2)
        return float((weight * (predicted - np.log(sd)) ** 2).sum())

    starts = [np.log([a, b]) for a in (0.05, 0.2) for b in (0.3, 2.0)]
    best = min((minimize(cost, s, method="Nelder-Mead") for s in starts), key=lambda r: r.fun)
    a, b = np.exp(best.x[0]), np.hypot(np.exp(best.x[1]), LOWEST_FLOOR_PX)
    # Bins determine the shape of the law, each group as a whole its scale: one is as far above 1 as the other is below.
    normalised = [robust_sd(error / np.hypot(a * variance, b)) for variance, error in groups]
    scale = np.exp(np.mean(np.log(normalised)))
    return round(float(scale * a), 4), round(float(scale * b), 4)


def calibrate(net: Deployed, rendered: list[Crop], real: list[Crop]) -> Calibration:
    """Fits the sd on clear points of crops that the net was not trained on; the prior is that of rendered crops."""
    pairs = []
    for crops in (rendered, real):
        result = evaluate(net, crops) if crops else None
        if result and len(result.error) >= FEWEST:
            squared = np.diagonal(result.covariance @ result.covariance, axis1=1, axis2=2)
            pairs.append((np.sqrt(squared).ravel(), result.offset.ravel()))
    if not pairs:
        raise ValueError("no group has enough points to calibrate on")
    points = np.concatenate([crop.points[crop.clear] for crop in rendered]).astype(float)
    mean, sd = points.mean(0), points.std(0)
    return Calibration(*fit_sd(pairs), tuple(mean.round(2).tolist()), tuple(sd.round(2).tolist()))
