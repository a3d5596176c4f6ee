"""How well cars of unknown make tell how large a scene is.

A camera sees a scene but for its scale, and only what cars are like says how many metres it has. Here the scale of a car is
estimated from its keypoints in 3-D, as if camera and picture had left no other doubt, by a shape model that does not know its
make: each base model of the `train` split left out in turn, or the `eval` split. Scenes of so many cars then show what no
solver with this shape model can be better than: an error of 1 % moves a car 40 m away by 0.4 m.

`PYTHONPATH=scripts/train python -m cars.scale` prints the tables; with `--dataset tests/data/lots` also the clips there.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from .atlas import Basis, as_rows, fit, leave_out, left_out_residuals, population_in_traffic, weighted_rms

CARS_IN_SCENE = (5, 10, 15, 20, 30, 40)
SCENES = 4000
NOISE_M = 0.01  # of each coordinate of a keypoint, after all frames
# Of the Student t of whole cars, as in the solver (`SceneOptions::car_freedom`).
FREEDOM = 4.0
WIDEST = 0.5  # of log scale that is looked at


@dataclass(frozen=True)
class Estimate:
    """What one car says: log scale (0 is right), its information, squared misfit and how many numbers were measured."""

    log_scale: float
    information: float
    misfit: float
    numbers: int


def estimate(measured: np.ndarray, mean: np.ndarray, modes: np.ndarray, residual_sd: np.ndarray) -> Estimate:
    """The most likely scale of a car's keypoint coordinates (NaN where missing), its shape integrated out."""
    seen = np.isfinite(measured)
    y, mean, modes, residual = measured[seen], mean[seen], modes[:, seen], np.diag(residual_sd[seen] ** 2)
    shape = modes.T @ modes + residual

    def whitened(log_scale: float) -> tuple[np.ndarray, float]:
        scale = np.exp(log_scale)
        factor = np.linalg.cholesky(scale**2 * shape + NOISE_M**2 * np.eye(len(y)))
        return np.linalg.solve(factor, y - scale * mean), float(np.log(np.diag(factor)).sum())

    def cost(log_scale: float) -> float:
        off, log_volume = whitened(log_scale)
        return 0.5 * off @ off + log_volume

    best = minimize_scalar(cost, bounds=(-WIDEST, WIDEST), method="bounded", options={"xatol": 1e-5}).x
    step = 1e-3
    curvature = (cost(best + step) - 2 * cost(best) + cost(best - step)) / step**2
    off, _ = whitened(best)
    return Estimate(best, max(curvature, 1.0), float(off @ off), len(y))


def estimates_of(cars: np.ndarray, basis: Basis, residual_sd: np.ndarray) -> list[Estimate]:
    """Of cars in rows of 54 coordinates or more."""
    rng = np.random.default_rng(5)
    modes = np.concatenate([basis.modes, basis.fine_modes])[:, :54]
    noisy = cars[:, :54] + rng.normal(0, NOISE_M, (len(cars), 54))
    return [estimate(car, basis.mean[:54], modes, residual_sd) for car in noisy]


def cars_of_clips(folder: Path) -> dict[str, np.ndarray]:
    """The cars that appear in each clip of a data set, in rows."""
    clips = {}
    for path in sorted(folder.glob("scenes/clip_*.truth.json")):
        truth = json.loads(path.read_text())
        seen = {car["id"] for frame in truth["frames"] for car in frame["cars"]}
        left = [model["keypoints_in_car"][:18] for model in truth["models"] if model["id"] in seen]
        points = [[point or [np.nan] * 3 for point in car] for car in left]
        clips[path.name.split(".")[0]] = np.array(points, float).reshape(len(points), -1)
    return clips


def scene_error(cars: list[Estimate]) -> float:
    """Log scale of a scene of these cars, each with the say of its information and of how well it fits."""
    say = [car.information * (FREEDOM + car.numbers) / (FREEDOM + car.misfit) for car in cars]
    return float(np.average([car.log_scale for car in cars], weights=say))


def report(title: str, models: list[list[Estimate]], shares: np.ndarray) -> None:
    """Prints the errors of single cars and of scenes of cars drawn by their shares of traffic."""
    rng = np.random.default_rng(6)
    every = np.array([[car.log_scale, car.information**-0.5] for cars in models for car in cars])
    weights = np.concatenate([np.full(len(cars), share / len(cars)) for cars, share in zip(models, shares)])
    error, believed = 100 * np.sqrt(np.average(every**2, axis=0, weights=weights))
    print(f"{title}: one car {error:.1f} % rms, {believed:.1f} % as the shape model believes")
    print("  cars  rms     median  40 m away")
    for count in CARS_IN_SCENE:
        errors = np.zeros(SCENES)
        for k in range(SCENES):
            drawn = rng.choice(len(models), count, p=shares / shares.sum())
            errors[k] = scene_error([models[m][rng.integers(len(models[m]))] for m in drawn])
        rms, median = 100 * np.sqrt(np.mean(errors**2)), 100 * np.median(abs(errors))
        print(f"  {count:4d}  {rms:.2f} %  {median:.2f} %  {0.4 * median:.2f} m")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path, help="folder with clips")
    options = parser.parse_args()
    known, foreign = population_in_traffic("train"), population_in_traffic("eval")
    rows = as_rows(known)
    residual_sd = weighted_rms(left_out_residuals(rows, known)[1], known.weights)[:54]
    left_out, shares = [], []
    for out, basis in leave_out(rows, known):
        left_out.append(estimates_of(rows[out], basis, residual_sd))
        shares.append(known.weights[out].sum())
    report("models left out in turn", left_out, np.array(shares))
    basis = fit(rows, known.weights, iterations=8)
    models = np.unique(foreign.models)
    cars = estimates_of(as_rows(foreign), basis, residual_sd)
    of_model = [[cars[i] for i in np.flatnonzero(foreign.models == model)] for model in models]
    report("eval split", of_model, np.array([foreign.weights[foreign.models == model].sum() for model in models]))
    errors = []
    for clip, cars in cars_of_clips(options.dataset).items() if options.dataset else ():
        errors.append(scene_error(estimates_of(cars, basis, residual_sd)))
        print(f"{clip}: {len(cars)} cars, scale {100 * errors[-1]:+.2f} %")
    if errors:
        print(f"median {100 * np.median(np.abs(errors)):.2f} %, {40 * np.median(np.abs(errors)):.2f} m of 40 m")


if __name__ == "__main__":
    main()
