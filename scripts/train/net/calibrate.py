"""How a peak in a heatmap becomes a measurement with an honest sd (`decode.Calibration`, ARCHITECTURE.md)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from net.decode import Calibration
from net.evaluate import Crop, evaluate, robust_sd
from net.model import Deployed

BINS = 6
# With fewer errors than this a bin's robust sd is not known to better than a fifth.
FEWEST = 30
# Rendered labels are exact, those of real cars scatter by about a pixel of the crop: the least floor, before the law is
# scaled as a whole. With the net of three stacks error / sd is 0.79 on rendered and 1.27 on held-out real cars at 1.0 px, 0.80
# and 1.25 at 1.2 px, 0.81 and 1.23 at 1.5 px (but 1.08 on small cars).
LOWEST_FLOOR_PX = 1.2


def binned(variance: np.ndarray, error: np.ndarray) -> list[tuple[float, float, int]]:
    """(mean variance, robust sd of the error, count) of equally filled bins of the variance."""
    order = np.argsort(variance)
    parts = np.array_split(order, min(BINS, max(1, len(order) // FEWEST)))
    return [(float(variance[p].mean()), robust_sd(error[p]), len(p)) for p in parts]


def fit_sd(groups: list[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """a, b of sd² = a² · variance² + b²: least squares on log(sd / robust sd of the error), crop px.

    In bins of each group's (variance, error). Every group weighs the same, so that a few real cars count as much as
    many rendered ones. Bins make a robust scale per level of predicted spread; a likelihood would let the few gross
    errors set the floor. That errors grow with the variance, not with its root, is what was found: the targets have a
    width of their own (`loss.TARGET_SD_CELLS`), and a net's spread is too narrow where it knows little.
    """
    bins = [(v, sd, n / len(error)) for variance, error in groups for v, sd, n in binned(variance, error)]
    variance, sd, weight = np.array(bins).T

    def cost(logs: np.ndarray) -> float:
        predicted = 0.5 * np.log(np.exp(2 * logs[0]) * variance**2 + np.exp(2 * logs[1]) + LOWEST_FLOOR_PX**2)
        return float((weight * (predicted - np.log(sd)) ** 2).sum())

    starts = [np.log([a, b]) for a in (0.05, 0.2) for b in (0.3, 2.0)]
    best = min((minimize(cost, s, method="Nelder-Mead") for s in starts), key=lambda r: r.fun)
    a, b = np.exp(best.x[0]), np.hypot(np.exp(best.x[1]), LOWEST_FLOOR_PX)
    # Bins settle the shape of the law, each group as a whole its scale: as far above 1 in one as below in the other.
    normalised = [robust_sd(error / np.hypot(a * variance, b)) for variance, error in groups]
    scale = np.exp(np.mean(np.log(normalised)))
    return round(float(scale * a), 4), round(float(scale * b), 4)


def calibrate(net: Deployed, rendered: list[Crop], real: list[Crop]) -> Calibration:
    """Fits the sd on clear points of crops that the net has not learnt from; the prior is that of rendered crops."""
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
