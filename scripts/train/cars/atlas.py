"""Build the shape atlas: mean and six principal components of the keypoints over cars as common as in traffic.

`PYTHONPATH=scripts/train python -m cars.atlas` writes models/atlas.json and prints the report.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .mesh import KEYPOINT_NAMES, MIRROR, REPOSITORY

MODES = 6
MIRROR_SIGN = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Population:
    """Cars in rows: keypoints (n, 36, 3) with NaN where missing, dims (n, 3), weight (n,), base model (n,)."""

    keypoints: np.ndarray
    dims: np.ndarray
    weights: np.ndarray
    models: np.ndarray


@dataclass(frozen=True)
class Basis:
    """Half-car PCA: rows are the 18 left keypoints then dims; modes scaled to unit standard deviation."""

    mean: np.ndarray  # (57,)
    modes: np.ndarray  # (MODES, 57)
    variances: np.ndarray  # all eigenvalues, m²


def _half(population: Population) -> np.ndarray:
    """Symmetrised left half and dims as rows (n, 57); what is missing on one side is taken from the other."""
    mirrored = population.keypoints[:, MIRROR] * MIRROR_SIGN
    both = np.stack([population.keypoints[:, :18], mirrored[:, :18]])
    count = np.isfinite(both).sum(0)
    half = np.where(count > 0, np.nansum(both, 0) / np.maximum(count, 1), np.nan)
    return np.concatenate([half.reshape(len(half), -1), population.dims], axis=1)


def fit(rows: np.ndarray, weights: np.ndarray, iterations: int = 30) -> Basis:
    """Weighted probabilistic-free PCA with missing values: alternate between fitting and filling in from the fit."""
    weights = weights / weights.sum()
    seen = np.isfinite(rows)
    column_mean = np.nansum(rows * weights[:, None], 0) / np.maximum((seen * weights[:, None]).sum(0), 1e-12)
    filled = np.where(seen, rows, column_mean)
    for _ in range(iterations if not seen.all() else 1):
        mean = weights @ filled
        centred = (filled - mean) * np.sqrt(weights)[:, None]
        _, singular, axes = np.linalg.svd(centred, full_matrices=False)
        low_rank = mean + (filled - mean) @ axes[:MODES].T @ axes[:MODES]
        filled = np.where(seen, rows, low_rank)
    return Basis(mean, axes[:MODES] * singular[:MODES, None], singular**2)


def project(basis: Basis, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares coefficients of one car from what it has, and its residual (57,), NaN where missing."""
    seen = np.isfinite(row)
    coefficients, *_ = np.linalg.lstsq(basis.modes[:, seen].T, (row - basis.mean)[seen], rcond=None)
    return coefficients, row - basis.mean - coefficients @ basis.modes


def orient(basis: Basis) -> Basis:
    """Fix each mode's sign: positive makes the sum of length, width and height larger."""
    sign = np.where(basis.modes[:, 54:].sum(1) < 0, -1.0, 1.0)
    return Basis(basis.mean, basis.modes * sign[:, None], basis.variances)


def left_out_residuals(rows: np.ndarray, population: Population) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (n, 57) of every base model against the basis of all the others, with their weights."""
    residuals = np.full_like(rows, np.nan)
    for model in np.unique(population.models):
        out = population.models == model
        basis = fit(rows[~out], population.weights[~out], iterations=8)
        for i in np.flatnonzero(out):
            residuals[i] = project(basis, rows[i])[1]
    return residuals, population.weights


def _weighted_rms(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    seen = np.isfinite(values)
    w = weights.reshape(-1, *[1] * (values.ndim - 1)) * seen
    return np.sqrt(np.nansum(w * np.where(seen, values, 0) ** 2, 0) / np.maximum(w.sum(0), 1e-12))


def to_json(basis: Basis, bounds: np.ndarray, residual_sd: np.ndarray, version: str, note: str) -> dict:
    """The data file's content; both sides from the half, so that symmetry is exact."""

    def whole(vector: np.ndarray, offset_sign: np.ndarray) -> list:
        left = vector[:54].reshape(18, 3)
        return np.round(np.concatenate([left, left * offset_sign]), 6).tolist()

    sd = residual_sd[:54].reshape(18, 3)
    return {
        "schema": "roadplane.atlas/1",
        "version": version,
        "mean": whole(basis.mean, MIRROR_SIGN),
        "modes": [whole(mode, MIRROR_SIGN) for mode in basis.modes],
        "bounds": np.round(bounds, 3).tolist(),
        "dims_mean": np.round(basis.mean[54:], 6).tolist(),
        "dims_modes": np.round(basis.modes[:, 54:], 6).tolist(),
        "residual_sd_m": np.round(np.concatenate([sd, sd]), 5).tolist(),
        "note": note,
    }


def report(rows: np.ndarray, population: Population, basis: Basis, residual: np.ndarray, bounds: np.ndarray) -> str:
    """Variance explained, residual per keypoint of cars left out, and the spread of the dimensions."""
    lines = [f"cars {len(rows)} of {len(np.unique(population.models))} base models"]
    share = basis.variances / basis.variances.sum()
    for j in range(MODES):
        lines.append(
            f"mode {j}: variance {100 * share[j]:5.1f} %, together {100 * share[: j + 1].sum():5.1f} %, "
            f"bounds {bounds[j, 0]:+.2f} … {bounds[j, 1]:+.2f}"
        )
    lines.append("residual of models left out, mm RMS:  x    y    z   3-D")
    for i, (x, y, z) in enumerate(1000 * residual[:54].reshape(18, 3)):
        name = KEYPOINT_NAMES[i].removeprefix("left_")
        lines.append(f"  {name:20s} {x:12.0f} {y:4.0f} {z:4.0f} {np.sqrt(x * x + y * y + z * z):5.0f}")
    whole = 1000 * np.sqrt((residual[:54] ** 2).reshape(18, 3).sum(1).mean())
    lines.append(f"  all keypoints, 3-D RMS {whole:.0f} mm; length, width, height {np.round(1000 * residual[54:])} mm")
    return "\n".join(lines)
