"""How a keypoint's spread in its heatmap becomes an honest sd: sd² = a² · variance + b² (ARCHITECTURE.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from net.evaluate import Crop, evaluate
from net.model import Deployed

BINS = 6
# With fewer errors than this a bin's robust sd is not known to better than a fifth.
FEWEST = 30
NORMAL_SD_PER_MAD = 1.4826
# No keypoint is known better than the rounding to a crop pixel, 1/√12: keeps covariances away from singular.
LOWEST_FLOOR_PX = 0.29


@dataclass
class Calibration:
    """The card's `calibration`."""

    sd_scale: float  # a
    sd_floor_crop_px: float  # b


def binned(variance: np.ndarray, error: np.ndarray) -> list[tuple[float, float, int]]:
    """(mean variance, robust sd of the error, count) of equally filled bins of the variance."""
    order = np.argsort(variance)
    parts = np.array_split(order, min(BINS, max(1, len(order) // FEWEST)))
    return [
        (float(variance[p].mean()), float(NORMAL_SD_PER_MAD * np.median(np.abs(error[p]))), len(p))
        for p in parts
    ]


def fit(groups: list[tuple[np.ndarray, np.ndarray]]) -> Calibration:
    """Least squares on log(predicted / robust sd) in bins of each group's (variance, error), crop px.

    Every group weighs the same, so that a few real cars count as much as many rendered ones. Bins make a
    robust scale per level of predicted spread; a likelihood would let the few gross errors set the floor.
    """
    bins = [(v, sd, n / len(error)) for variance, error in groups for v, sd, n in binned(variance, error)]
    variance, sd, weight = np.array(bins).T

    def cost(logs: np.ndarray) -> float:
        predicted = 0.5 * np.log(np.exp(2 * logs[0]) * variance + np.exp(2 * logs[1]) + LOWEST_FLOOR_PX**2)
        return float((weight * (predicted - np.log(sd)) ** 2).sum())

    starts = [np.log([a, b]) for a in (0.3, 1.0) for b in (0.3, 2.0)]
    best = min((minimize(cost, s, method="Nelder-Mead") for s in starts), key=lambda r: r.fun)
    a, b = np.exp(best.x[0]), np.hypot(np.exp(best.x[1]), LOWEST_FLOOR_PX)
    return Calibration(round(float(a), 4), round(float(b), 4))


def calibrate(net: Deployed, groups: dict[str, list[Crop]]) -> Calibration:
    """Fits on clear points of groups of crops that the net has not learnt from."""
    pairs = []
    for crops in groups.values():
        result = evaluate(net, crops)
        if len(result.error) >= FEWEST:
            pairs.append((result.variance.ravel(), result.offset.ravel()))
    if not pairs:
        raise ValueError("no group has enough points to calibrate on")
    return fit(pairs)
