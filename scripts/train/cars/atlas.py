"""Builds the shape atlas: mean and principal components of the keypoints over cars as common as in traffic.

`roadplane-train cars atlas` writes models/atlas.json and prints a report. The atlas is built on the cars of the `train`
split. `--foreign FILE` writes the keypoints of the `eval` cars, for tests on cars that the atlas was not built on.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from .builder import both_sides, keypoints_of
from .mesh import KEYPOINT_NAMES, MIRROR, REPOSITORY
from .meshes import catalogue
from .specs import SPECS, TRAFFIC_SHARE
from .style import model_style, vary

MODES = 6
# The next components: the correlations that six modes leave unexplained.
FINE_MODES = 6
# Some meshes are variants of each other or of cars that were never built, and their points were marked by eye.
MESH_WEIGHT = 1 / 3
# Weight of all cars together against a body type's own models, in the covariance of that type, in models.
POOLED_MODELS = 10
MIRROR_SIGN = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Population:
    """Cars in rows: keypoints (n, 36, 3; NaN if missing), dims (n, 3), weights, base models, body types (n,)."""

    keypoints: np.ndarray
    dims: np.ndarray
    weights: np.ndarray
    models: np.ndarray
    bodies: np.ndarray

    def only(self, cars: np.ndarray) -> Population:
        """Returns the cars of these indices."""
        return Population(*(getattr(self, field.name)[cars] for field in fields(self)))


@dataclass(frozen=True)
class BodyType:
    """A body type: share of traffic, and a Gaussian on all coefficients: mean (12,), covariance (12, 12)."""

    name: str
    share: float
    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Basis:
    """PCA of half a car: rows are the 18 left keypoints, then the dims; modes are scaled to unit standard deviation."""

    mean: np.ndarray  # (57,)
    modes: np.ndarray  # (MODES, 57)
    fine_modes: np.ndarray  # (FINE_MODES, 57)
    variances: np.ndarray  # all eigenvalues, m²


def population_in_traffic(split: str, variants: int = 8, seed: int = 7) -> Population:
    """Returns `variants` cars near every base model of a split's built cars, and its imported meshes.

    A body type's share of traffic is divided evenly among its models; a mesh counts as MESH_WEIGHT of a model.
    """
    rng = np.random.default_rng(seed)
    meshes = [mesh for mesh in catalogue() if mesh["split"] == split]
    specs = [spec for spec in SPECS if spec.split == split]
    models_of = Counter(spec.body for spec in specs)
    for mesh in meshes:
        models_of[mesh["body"]] += MESH_WEIGHT
    rows = []  # keypoints, dims, weight, model, body
    for spec in specs:
        share = TRAFFIC_SHARE[spec.body] / models_of[spec.body] / variants
        for _ in range(variants):
            style = vary(model_style(spec), rng)
            rows.append((keypoints_of(style, rng), (style.length, style.width, style.height), share, spec.name, spec.body))
    for mesh in meshes:
        left = {name: np.full(3, np.nan) if point is None else np.array(point) for name, point in mesh["keypoints"].items()}
        share = TRAFFIC_SHARE[mesh["body"]] / models_of[mesh["body"]] * MESH_WEIGHT
        rows.append((both_sides(left), mesh["dims"], share, mesh["name"], mesh["body"]))
    return Population(*(np.array(column) for column in zip(*rows)))


def as_rows(population: Population) -> np.ndarray:
    """Returns the symmetrised left side and dims as rows (n, 57); values missing on one side come from the other."""
    mirrored = population.keypoints[:, MIRROR] * MIRROR_SIGN
    both = np.stack([population.keypoints[:, :18], mirrored[:, :18]])
    count = np.isfinite(both).sum(0)
    half = np.where(count > 0, np.nansum(both, 0) / np.maximum(count, 1), np.nan)
    return np.concatenate([half.reshape(len(half), -1), population.dims], axis=1)


def fit(rows: np.ndarray, weights: np.ndarray, iterations: int = 30) -> Basis:
    """Computes a weighted PCA; missing values are filled in from the fit, iteratively."""
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
    modes = axes[: MODES + FINE_MODES] * singular[: MODES + FINE_MODES, None]
    return Basis(mean, modes[:MODES], modes[MODES:], singular**2)


def project(basis: Basis, row: np.ndarray, fine: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Returns the least-squares coefficients of a car from its present values, and its residual (57,)."""
    seen = np.isfinite(row)
    modes = np.concatenate([basis.modes, basis.fine_modes]) if fine else basis.modes
    coefficients, *_ = np.linalg.lstsq(modes[:, seen].T, (row - basis.mean)[seen], rcond=None)
    return coefficients, row - basis.mean - coefficients @ modes


def body_types(basis: Basis, rows: np.ndarray, population: Population) -> list[BodyType]:
    """Returns the mixture that models traffic: a Gaussian over the coefficients of all modes, per body type.

    A type has too few models for a covariance of its own. So it is shrunk towards the covariance of all cars about the
    means of their types.
    """
    coefficients = np.array([project(basis, row, fine=True)[0] for row in rows])
    weights, bodies = population.weights / population.weights.sum(), population.bodies
    names, number = np.unique(bodies, return_inverse=True)
    means = np.array([np.average(coefficients[number == k], axis=0, weights=weights[number == k]) for k in range(len(names))])
    off = coefficients - means[number]
    outer = weights[:, None, None] * off[:, :, None] * off[:, None, :]
    pooled = outer.sum(0)
    types = []
    for k, name in enumerate(names):
        of_type = number == k
        share, models = weights[of_type].sum(), len(np.unique(population.models[of_type]))
        own = outer[of_type].sum(0) / share * models / max(models - 1, 1)
        covariance = (models * own + POOLED_MODELS * pooled) / (models + POOLED_MODELS)
        types.append(BodyType(str(name), float(share), means[k], covariance))
    return types


def orient(basis: Basis) -> Basis:
    """Fixes the sign of each mode: a positive coefficient increases the sum of length, width and height."""

    def larger(modes: np.ndarray) -> np.ndarray:
        return modes * np.where(modes[:, 54:].sum(1) < 0, -1.0, 1.0)[:, None]

    return replace(basis, modes=larger(basis.modes), fine_modes=larger(basis.fine_modes))


def leave_out(rows: np.ndarray, population: Population) -> Iterator[tuple[np.ndarray, np.ndarray, Basis]]:
    """Yields, for each base model, the indices of its cars and of all others, and the basis of the others."""
    for model in np.unique(population.models):
        out = population.models == model
        yield np.flatnonzero(out), np.flatnonzero(~out), fit(rows[~out], population.weights[~out], iterations=8)


def left_out_residuals(rows: np.ndarray, population: Population) -> tuple[np.ndarray, np.ndarray]:
    """Returns the residuals (n, 57) of every base model in the basis of all others: without and with the fine modes."""
    without, fine = np.full_like(rows, np.nan), np.full_like(rows, np.nan)
    for out, _, basis in leave_out(rows, population):
        for i in out:
            without[i], fine[i] = project(basis, rows[i])[1], project(basis, rows[i], fine=True)[1]
    return without, fine


def foreign_residuals(basis: Basis, foreign: Population) -> np.ndarray:
    """Returns the weighted RMS residuals (57,) of cars that the basis was not built on."""
    rows = as_rows(foreign)
    return weighted_rms(np.array([project(basis, row)[1] for row in rows]), foreign.weights)


def foreign_json(foreign: Population) -> dict:
    """Returns one car of each base model: keypoints in the car frame (null if missing), share of traffic."""
    cars = []
    for model in np.unique(foreign.models):
        first = int(np.flatnonzero(foreign.models == model)[0])
        points = [None if np.isnan(p).any() else np.round(p, 4).tolist() for p in foreign.keypoints[first]]
        weight = float(foreign.weights[foreign.models == model].sum())
        cars.append({
            "model": str(model), "weight": round(weight, 5), "dims_m": np.round(foreign.dims[first], 3).tolist(),
            "keypoints_in_car": points,
        })  # fmt: skip
    return {"schema": "roadplane.cars/1", "cars": cars}


def coefficient_bounds(basis: Basis, rows: np.ndarray) -> np.ndarray:
    """Returns the range of 99.6 % of the population's coefficients, extended by 0.25 standard deviations, (6, 2)."""
    coefficients = np.array([project(basis, row)[0] for row in rows])
    low, high = np.percentile(coefficients, [0.2, 99.8], axis=0)
    return np.stack([low - 0.25, high + 0.25], axis=1)


def weighted_rms(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Returns the weighted RMS over the first axis, without NaN."""
    seen = np.isfinite(values)
    w = weights.reshape(-1, *[1] * (values.ndim - 1)) * seen
    return np.sqrt(np.nansum(w * np.where(seen, values, 0) ** 2, 0) / np.maximum(w.sum(0), 1e-12))


def to_json(
    basis: Basis,
    types: list[BodyType],
    bounds: np.ndarray,
    residual_sd: np.ndarray,
    fine_residual_sd: np.ndarray,
    version: str,
    note: str,
) -> dict:
    """Returns the contents of the data file; both sides come from one half, so that the symmetry is exact."""

    def whole(vector: np.ndarray, offset_sign: np.ndarray) -> list:
        left = vector[:54].reshape(18, 3)
        # Adding 0 turns −0 into 0.
        return (np.round(np.concatenate([left, left * offset_sign]), 6) + 0.0).tolist()

    def both(sd: np.ndarray) -> list:
        return np.round(np.tile(sd[:54].reshape(18, 3), (2, 1)), 5).tolist()

    return {
        "schema": "roadplane.atlas/3",
        "version": version,
        "mean": whole(basis.mean, MIRROR_SIGN),
        "modes": [whole(mode, MIRROR_SIGN) for mode in basis.modes],
        "bounds": np.round(bounds, 3).tolist(),
        "dims_mean": np.round(basis.mean[54:], 6).tolist(),
        "dims_modes": np.round(basis.modes[:, 54:], 6).tolist(),
        "residual_sd_m": both(residual_sd),
        "fine_modes": [whole(mode, MIRROR_SIGN) for mode in basis.fine_modes],
        "fine_residual_sd_m": both(fine_residual_sd),
        "body_types": [
            {
                "name": body.name,
                "share": round(body.share, 5),
                "mean": np.round(body.mean, 5).tolist(),
                "covariance": np.round(body.covariance, 6).tolist(),
            }
            for body in types
        ],
        "note": note,
    }


def report(
    rows: np.ndarray,
    population: Population,
    basis: Basis,
    residual: np.ndarray,
    fine_residual: np.ndarray,
    bounds: np.ndarray,
    foreign: np.ndarray,
) -> str:
    """Prints the explained variance, the residual per keypoint of left-out cars, and the spread of the dimensions."""
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
    for name, values in (
        ("models left out in turn", residual),
        ("the same with fine modes", fine_residual),
        ("cars of the eval split", foreign),
    ):
        whole = 1000 * np.sqrt((values[:54] ** 2).reshape(18, 3).sum(1).mean())
        lines.append(f"  all keypoints, {name}: 3-D RMS {whole:.0f} mm; length, width, height {np.round(1000 * values[54:])} mm")
    return "\n".join(lines)


# For comparison, from memory: footprints (wheelbase × track). US light vehicles of 2008–2018 have 4.5–4.6 m² (EPA
# Automotive Trends). New cars in the EU have about 3.9–4.0 m² (ICCT pocketbook). Our traffic mixes both.
def spread(population: Population, basis: Basis) -> str:
    """Returns mean and sd of the dimensions: published base models, the population, the atlas under λ ~ N(0, I)."""
    share = np.array([TRAFFIC_SHARE[s.body] / sum(o.body == s.body for o in SPECS) for s in SPECS])
    published = np.array([(s.length, s.width, s.height, s.wheelbase, s.wheelbase * s.track) for s in SPECS])
    w = population.weights / population.weights.sum()
    base = population.keypoints[:, 0, 0] - population.keypoints[:, 1, 0]
    seen = np.isfinite(base)
    cars = np.column_stack([population.dims, base])
    wheelbase_modes = basis.modes[:, 0] - basis.modes[:, 3]
    modes = np.column_stack([basis.modes[:, 54:], wheelbase_modes])
    atlas_mean = np.append(basis.mean[54:], basis.mean[0] - basis.mean[3])

    def row(name: str, mean: np.ndarray, sd: np.ndarray) -> str:
        return f"  {name:34s}" + "  ".join(f"{m:.2f} ± {d:.2f}" for m, d in zip(mean, sd))

    def moments(values: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        weights = weights / weights.sum()
        mean = weights @ values
        return mean, np.sqrt(weights @ (values - mean) ** 2)

    return "\n".join([
        "mean ± sd over traffic, m:            length      width       height      wheelbase   footprint, m²",
        row("published, base models", *moments(published, share)),
        row("population", *moments(cars[seen], w[seen])),
        row("atlas, coefficients normal", atlas_mean, np.sqrt((modes**2).sum(0))),
    ])  # fmt: skip


def main() -> None:
    """Writes the atlas and prints its report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "models" / "atlas.json")
    parser.add_argument("--version", default="1.8")
    parser.add_argument("--foreign", type=Path, help="file for the keypoints of the cars of the eval split")
    arguments = parser.parse_args()

    population, foreign = population_in_traffic("train"), population_in_traffic("eval")
    rows = as_rows(population)
    basis = orient(fit(rows, population.weights))
    types = body_types(basis, rows, population)
    bounds = coefficient_bounds(basis, rows)
    residual_sd, fine_residual_sd = (
        weighted_rms(residuals, population.weights) for residuals in left_out_residuals(rows, population)
    )
    note = (
        f"Mean, six principal components and six finer ones, {len(rows)} cars of "
        f"{len(np.unique(population.models))} base models of the train split, "
        "weighted by body type as in traffic; scripts/train/cars, `python -m cars.atlas`."
    )
    text = json.dumps(to_json(basis, types, bounds, residual_sd, fine_residual_sd, arguments.version, note))
    arguments.out.write_text(text + "\n")
    if arguments.foreign:
        arguments.foreign.write_text(json.dumps(foreign_json(foreign)) + "\n")
    foreign_residual = foreign_residuals(basis, foreign)
    print(report(rows, population, basis, residual_sd, fine_residual_sd, bounds, foreign_residual))
    print(spread(population, basis))


if __name__ == "__main__":
    main()
