"""Decodes heatmap logits to keypoints; the reference for crates/keypoints/src/heatmap.rs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WINDOW_CELLS = 3
# Upper bound of the prior's share of a location: dividing by the rest amplifies noise.
LARGEST_PRIOR_SHARE = 0.5


@dataclass(frozen=True)
class Calibration:
    """The card's `calibration`: turns a peak into a measurement with a calibrated covariance."""

    sd_per_variance: float  # a, 1 / crop px
    sd_floor_crop_px: float  # b
    prior_mean_crop_px: tuple[float, float]  # of x, y of visible keypoints in rendered training crops
    prior_sd_crop_px: tuple[float, float]

    def measurement(self, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Turns peaks [..., 2] and [..., 2, 2] of `decode` into locations and covariances, crop px.

        The covariance is S = a² V² + b². The net's mean m is that of a posterior, which the prior draws towards its own
        mean c. The measurement that explains it is c + (1 − S P⁻¹)⁻¹ (m − c), with covariance (S⁻¹ − P⁻¹)⁻¹.
        """
        centre, sd = np.array(self.prior_mean_crop_px), np.array(self.prior_sd_crop_px)
        posterior = self.sd_per_variance**2 * covariance @ covariance + self.sd_floor_crop_px**2 * np.eye(2)
        share, axes = np.linalg.eigh(posterior / np.outer(sd, sd))
        rest = 1 - np.minimum(share, LARGEST_PRIOR_SHARE)
        along = np.einsum("...ji,...j->...i", axes, (mean - centre) / sd)
        location = centre + sd * np.einsum("...ij,...j->...i", axes, along / rest)
        spread = np.einsum("...ik,...k,...jk->...ij", axes, share / rest, axes)
        return location, spread * np.outer(sd, sd)


def decode(logits: np.ndarray, input_px: int = 128) -> tuple[np.ndarray, np.ndarray]:
    """Maps logits [..., n, n] to means [..., 2] (x, y, crop px) and covariances [..., 2, 2] (px²), uncalibrated."""
    cells = logits.shape[-1]
    stride = input_px / cells
    flat = logits.reshape(-1, cells, cells).astype(np.float64)
    means = np.empty((len(flat), 2))
    covariances = np.empty((len(flat), 2, 2))
    for i, heat in enumerate(flat):
        row, column = divmod(int(heat.argmax()), cells)
        r0, r1 = max(row - WINDOW_CELLS, 0), min(row + WINDOW_CELLS + 1, cells)
        c0, c1 = max(column - WINDOW_CELLS, 0), min(column + WINDOW_CELLS + 1, cells)
        p = np.exp(heat[r0:r1, c0:c1] - heat[row, column])
        p /= p.sum()
        xs, ys = np.arange(c0, c1), np.arange(r0, r1)
        x, y = (p.sum(0) * xs).sum(), (p.sum(1) * ys).sum()
        dx, dy = xs - x, ys - y
        xy = (p * dy[:, None] * dx[None, :]).sum()
        covariances[i] = np.array([[(p.sum(0) * dx**2).sum(), xy], [xy, (p.sum(1) * dy**2).sum()]]) * stride**2
        means[i] = np.array([x, y]) * stride + (stride - 1) / 2
    return means.reshape(*logits.shape[:-2], 2), covariances.reshape(*logits.shape[:-2], 2, 2)
