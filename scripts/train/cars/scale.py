"""Measures how well cars of unknown make determine the scale of a scene.

A camera sees a scene up to its scale; only the sizes of cars give metres. Here the scale of a car is estimated from its
keypoints in 3-D, as if camera and picture left no other uncertainty. The shape model does not contain the car's make:
each base model of the `train` split is left out in turn, or the car is from the `eval` split. Scenes of several cars
then give a lower bound on the error of any solver with this shape model. An error of 1 % moves a car 40 m away by 0.4
m.

`roadplane-train cars scale` prints the tables; with `--dataset tests/data/lots` also those of the clips there.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadplane_train.json_files import read_json

from .atlas import (
    Basis,
    BodyType,
    as_rows,
    body_types,
    fit,
    leave_out,
    left_out_residuals,
    population_in_traffic,
    weighted_rms,
)

CARS_IN_SCENE = (5, 10, 15, 20, 30, 40)
SCENES = 4000
NOISE_M = 0.01  # sd of each coordinate of a keypoint, after all frames
# Degrees of freedom of the Student t of whole cars, as in the solver (`SceneOptions::car_freedom`).
FREEDOM = 4.0


@dataclass(frozen=True)
class Estimate:
    """The estimate from one car: log scale (0 is right), information, squared misfit, number of measured values."""

    log_scale: float
    information: float
    misfit: float
    numbers: int


@dataclass(frozen=True)
class KeypointType:
    """A body type: share of traffic, and a Gaussian on measured coordinates, mean (54,), covariance (54, 54)."""

    share: float
    mean: np.ndarray
    covariance: np.ndarray


def estimate(measured: np.ndarray, types: list[KeypointType]) -> Estimate:
    """Estimates the scale of a car's keypoint coordinates (NaN if missing), marginalised over its shape.

    The body type is unknown.
    """
    seen = np.isfinite(measured)
    of_types = []  # log evidence, log scale, variance, misfit
    for body in types:
        factor = np.linalg.cholesky(body.covariance[np.ix_(seen, seen)])
        car, mean = np.linalg.solve(factor, np.stack([measured[seen], body.mean[seen]], axis=1)).T
        # Terms of ½ |u car − mean|² − n log u, u = 1 / scale: covariances grow with the scale.
        square, product, numbers = car @ car, car @ mean, len(car)
        u = (product + np.sqrt(product**2 + 4 * numbers * square)) / (2 * square)
        misfit = float(np.sum((u * car - mean) ** 2))
        information = 2 * u**2 * square - u * product
        volume = np.log(np.diag(factor)).sum() - numbers * np.log(u)
        evidence = np.log(body.share) - 0.5 * misfit - volume - 0.5 * np.log(information)
        of_types.append((evidence, -np.log(u), 1 / information, misfit))
    evidence, log_scale, variance, misfit = np.array(of_types).T
    odds = np.exp(evidence - evidence.max())
    odds /= odds.sum()
    mean = odds @ log_scale
    spread = odds @ (variance + (log_scale - mean) ** 2)
    return Estimate(float(mean), float(1 / spread), float(odds @ misfit), int(seen.sum()))


def keypoint_types(basis: Basis, types: list[BodyType], residual_sd: np.ndarray) -> list[KeypointType]:
    """Returns the types of the mixture, with the unexplained residual and the measurement noise added."""
    modes = np.concatenate([basis.modes, basis.fine_modes])[:, :54]
    noise = np.diag(residual_sd**2 + NOISE_M**2)
    return [
        KeypointType(body.share, basis.mean[:54] + body.mean @ modes, modes.T @ body.covariance @ modes + noise) for body in types
    ]


def estimates_of(cars: np.ndarray, types: list[KeypointType]) -> list[Estimate]:
    """Returns the estimates of cars in rows of 54 coordinates or more."""
    rng = np.random.default_rng(5)
    noisy = cars[:, :54] + rng.normal(0, NOISE_M, (len(cars), 54))
    return [estimate(car, types) for car in noisy]


def cars_of_clips(folder: Path) -> dict[str, np.ndarray]:
    """Returns the cars that appear in each clip of a data set, in rows."""
    clips = {}
    for item in read_json(folder / "dataset.json")["items"]:
        truth = read_json(folder / item)
        if truth["kind"] != "clip":
            continue
        seen = {car["id"] for frame in truth["frames"] for car in frame["cars"]}
        left = [model["keypoints_in_car"][:18] for model in truth["models"] if model["id"] in seen]
        points = [[point or [np.nan] * 3 for point in car] for car in left]
        clips[Path(item).name.split(".")[0]] = np.array(points, float).reshape(len(points), -1)
    return clips


def scene_error(cars: list[Estimate]) -> float:
    """Returns the log scale of a scene of these cars, each weighted by its information and by its fit."""
    say = [car.information * (FREEDOM + car.numbers) / (FREEDOM + car.misfit) for car in cars]
    return float(np.average([car.log_scale for car in cars], weights=say))


def report(title: str, models: list[list[Estimate]], shares: np.ndarray) -> None:
    """Prints the errors of single cars, and of scenes of cars drawn by their shares of traffic."""
    rng = np.random.default_rng(6)
    every = np.array([[car.log_scale, car.information**-0.5] for cars in models for car in cars])
    weights = np.concatenate([np.full(len(cars), share / len(cars)) for cars, share in zip(models, shares)])
    error, predicted = 100 * np.sqrt(np.average(every**2, axis=0, weights=weights))
    print(f"{title}: one car {error:.1f} % rms, {predicted:.1f} % predicted by the shape model")
    print("  cars  rms     median  40 m away")
    for count in CARS_IN_SCENE:
        errors = np.zeros(SCENES)
        for k in range(SCENES):
            drawn = rng.choice(len(models), count, p=shares / shares.sum())
            errors[k] = scene_error([models[m][rng.integers(len(models[m]))] for m in drawn])
        rms, median = 100 * np.sqrt(np.mean(errors**2)), 100 * np.median(abs(errors))
        print(f"  {count:4d}  {rms:.2f} %  {median:.2f} %  {0.4 * median:.2f} m")


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path, help="folder with clips")
    options = parser.parse_args()
    known, foreign = population_in_traffic("train"), population_in_traffic("eval")
    rows = as_rows(known)
    residual_sd = weighted_rms(left_out_residuals(rows, known)[1], known.weights)[:54]
    left_out, shares = [], []
    for out, others, basis in leave_out(rows, known):
        types = keypoint_types(basis, body_types(basis, rows[others], known.only(others)), residual_sd)
        left_out.append(estimates_of(rows[out], types))
        shares.append(known.weights[out].sum())
    report("models left out in turn", left_out, np.array(shares))
    basis = fit(rows, known.weights, iterations=8)
    types = keypoint_types(basis, body_types(basis, rows, known), residual_sd)
    models = np.unique(foreign.models)
    cars = estimates_of(as_rows(foreign), types)
    of_model = [[cars[i] for i in np.flatnonzero(foreign.models == model)] for model in models]
    report("eval split", of_model, np.array([foreign.weights[foreign.models == model].sum() for model in models]))
    errors = []
    for clip, cars in cars_of_clips(options.dataset).items() if options.dataset else ():
        errors.append(scene_error(estimates_of(cars, types)))
        print(f"{clip}: {len(cars)} cars, scale {100 * errors[-1]:+.2f} %")
    if errors:
        print(f"median {100 * np.median(np.abs(errors)):.2f} %, {40 * np.median(np.abs(errors)):.2f} m of 40 m")


if __name__ == "__main__":
    main()
