"""Measures how well three surveyed points predict others, on real points and by simulation.

  python3 scripts/eval/survey.py tests/data/road_survey.csv results/road_survey/camera.json

The first file lists surveyed points of the ground (x_px,y_px,east_m,north_m), the second is the run's camera. Every
choice of three points is given, and the others are predicted. On the real points this is done in several variants.
Simulated points have the errors that the best camera for all points leaves; their cameras have priors of different
accuracy. It needs NumPy.
"""

from __future__ import annotations

import csv
import itertools
import json
import sys
from pathlib import Path

import numpy as np

GIVEN = 3
DRAWS = 400
STEPS = 40
LONGEST_STEP = 0.05  # lower bounds of log focal length and angles: far points stay below the horizon
CLICK_PX, SURVEY_M = 1.5, 0.15  # sd of points that the program assumes
BAR_M = 0.30
# Prior sds of focal length (share), tilt, roll (degrees), height (share).
KNOWN = {"exactly": (1e-6, 1e-6, 1e-6, 1e-6), "1 %, 0.1°, 2 %": (0.01, 0.1, 0.1, 0.02), "3 %, 0.3°, 4 %": (0.03, 0.3, 0.3, 0.04)}


def ground(params: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Returns map positions [n, k, 2] of pixels [k, 2], relative to the principal point.

    `params` [n, 7] are log focal length, tilt, roll, log height, rotation, east, north.
    """
    log_focal, tilt, roll, log_height, turn = params[:, :5].T
    up = np.stack([np.sin(roll) * np.cos(tilt), -np.cos(roll) * np.cos(tilt), -np.sin(tilt)], -1)
    forward = np.array([0, 0, 1.0]) - up * up[:, 2:]
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    motion = np.stack([np.cross(forward, up), forward, up], -1)
    slopes = pixels / np.exp(log_focal)[:, None, None]
    rays = np.concatenate([slopes, np.ones_like(slopes[..., :1])], -1) @ motion
    here = rays[..., :2] * (np.exp(log_height)[:, None, None] / -rays[..., 2:])
    cos, sin = np.cos(turn), np.sin(turn)
    rotation = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], -2)
    return here @ rotation + params[:, None, 5:]


def by_params(params: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Returns the derivatives [n, k, 2, 7]."""
    steps = np.eye(7) * 1e-6
    return np.stack([(ground(params + s, pixels) - ground(params - s, pixels)) / 2e-6 for s in steps], -1)


def solved(
    prior: np.ndarray, information: np.ndarray, pixels: np.ndarray, targets: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Returns camera and map position [n, 7] by Gauss-Newton, as the program solves for them.

    The targets [n, k, 2] have weights [k, 2, 2]; the priors are cameras [n, 4] with an information [4, 4].
    """
    params = np.concatenate([prior, np.zeros((len(prior), 3))], 1)
    turn, shift = similarity(ground(params, pixels), targets, keep_scale=True)
    params[:, 4], params[:, 5], params[:, 6] = np.angle(turn), shift.real, shift.imag
    for _ in range(STEPS):
        slopes, errors = by_params(params, pixels), ground(params, pixels) - targets
        normal = np.einsum("nkai,kab,nkbj->nij", slopes, weights, slopes)
        gradient = np.einsum("nkai,kab,nkb->ni", slopes, weights, errors)
        normal[:, :4, :4] += information
        gradient[:, :4] += (params[:, :4] - prior) @ information
        step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        step *= np.minimum(1, LONGEST_STEP / np.abs(step[:, :3]).max(1, keepdims=True).clip(1e-12))
        params -= step
    return params


def similarity(a: np.ndarray, b: np.ndarray, keep_scale: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Returns rotation and scale, and translation [n], complex, that map points [n, k, 2] to others (Umeyama 1991)."""
    z, w = a[..., 0] + 1j * a[..., 1], b[..., 0] + 1j * b[..., 1]
    z0, w0 = z.mean(-1, keepdims=True), w.mean(-1, keepdims=True)
    turn = (np.conj(z - z0) * (w - w0)).sum(-1) / (abs(z - z0) ** 2).sum(-1)
    turn = turn / abs(turn) if keep_scale else turn
    return turn, w0[..., 0] - turn * z0[..., 0]


def choices(count: int, given: int) -> list[tuple[list[int], list[int]]]:
    """Yields the given points, and the others."""
    return [(list(c), [i for i in range(count) if i not in c]) for c in itertools.combinations(range(count), given)]


def click_weights(params: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Returns the inverse covariances [k, 2, 2] of positions from click and survey."""
    moved = [(ground(params, pixels + d) - ground(params, pixels - d))[0] / 2e-3 for d in np.eye(2) * 1e-3]
    slopes = np.stack(moved, -1)
    return np.linalg.inv(slopes @ slopes.transpose(0, 2, 1) * CLICK_PX**2 + np.eye(2) * SURVEY_M**2)


def predicted(
    prior: np.ndarray, information: np.ndarray, pixels: np.ndarray, targets: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Returns the errors [n, predictions] of points that were not given, over all choices, m."""
    errors = []
    for given, other in choices(len(pixels), GIVEN):
        params = solved(prior, information, pixels[given], targets[:, given], weights[given])
        errors.append(np.linalg.norm(ground(params, pixels[other]) - targets[:, other], axis=-1))
    return np.concatenate(errors, 1)


def rms(values: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Returns the root of the mean square."""
    return np.sqrt(np.mean(np.square(values), axis))


def homography(pixels: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Returns the [3, 3] matrix that maps four pixels to their positions."""
    rows = []
    for (x, y), (u, v) in zip(pixels, targets, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y, -u], [0, 0, 0, x, y, 1, -v * x, -v * y, -v]]
    return np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)


def other_fits(params: np.ndarray, best: np.ndarray, pixels: np.ndarray, targets: np.ndarray) -> dict[str, float]:
    """Returns the residuals on the real points of fits that do not change the camera, or need none."""
    found: dict[str, list[float]] = {}
    for name, camera in (("the run's camera", params), ("the best camera for all points", best)):
        here = ground(camera, pixels)
        for given, other in choices(len(pixels), GIVEN):
            turn, shift = similarity(here[:, given], targets[:, given])
            at = turn * (here[0, other] @ [1, 1j]) + shift
            found.setdefault(f"{name}, similarity", []).extend(abs(at - targets[0, other] @ [1, 1j]))
            flat = np.column_stack([here[0], np.ones(len(pixels))])
            at = flat[other] @ np.linalg.solve(flat[given], targets[0, given])
            found.setdefault(f"{name}, affine", []).extend(np.linalg.norm(at - targets[0, other], axis=1))
    for given, other in choices(len(pixels), 4):
        # In units for which all numbers are near 1.
        at = np.column_stack([pixels[other] / 300, np.ones(1)]) @ homography(pixels[given] / 300, targets[0, given]).T
        found.setdefault("no camera: homography of four points, the fifth predicted", []).extend(
            np.linalg.norm(at[:, :2] / at[:, 2:] - targets[0, other], axis=1)
        )
    return {name: float(rms(np.array(errors))) for name, errors in found.items()}


def main() -> None:
    """Prints the tables of the survey."""
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    with Path(sys.argv[1]).open(newline="") as file:
        table = np.array([[float(row[key]) for key in ("x_px", "y_px", "east_m", "north_m")] for row in csv.DictReader(file)])
    camera = json.loads(Path(sys.argv[2]).read_text())
    pixels = table[:, :2] - camera["principal_point_px"]
    targets = (table[:, 2:] - table[:, 2:].mean(0))[None]
    prior = np.array([[np.log(camera["focal_px"]), camera["tilt_rad"], camera["roll_rad"], np.log(camera["height_m"])]])
    covariance = np.array(camera["covariance"])
    information = np.linalg.inv(covariance)

    free = solved(prior, np.eye(4) * 1e-6, pixels, targets, np.tile(np.eye(2) / SURVEY_M**2, (len(pixels), 1, 1)))
    left = rms(np.linalg.norm(ground(free, pixels) - targets, axis=-1))
    spare = 2 * len(pixels) - 7
    noise = left * np.sqrt(len(pixels) / spare)
    print(
        f"best camera for all points: {np.exp(free[0, 0]):.0f} px, tilt {np.degrees(free[0, 1]):.1f}°, height "
        f"{np.exp(free[0, 3]):.2f} m, leaves {left:.3f} m rms with {spare} degrees of freedom: error of a point "
        f"{np.sqrt(2) * noise:.2f} m rms"
    )

    print("\nreal points, pooled rms (m)")
    start = solved(prior, information * 1e6, pixels, targets, click_weights(free, pixels))
    as_here = predicted(prior, information, pixels, targets, click_weights(start, pixels))
    print(f"  {rms(as_here):.2f}  camera and map position together, as in the program")
    for name, error in other_fits(start, free, pixels, targets).items():
        print(f"  {error:.2f}  {name}")

    print(
        f"\nsimulated, {DRAWS} draws: prior of the camera, survey exact or with its errors: median of the rms (m), "
        f"share of {BAR_M} m or better"
    )
    random, truth = np.random.default_rng(22), ground(free, pixels)
    known = {name: np.diag(np.square([s[0], *np.radians(s[1:3]), s[3]])) for name, s in KNOWN.items()} | {"as here": covariance}
    for name, sds in known.items():
        for sd in (0.0, noise):
            cameras = random.multivariate_normal(free[0, :4], sds, DRAWS)
            survey = truth + random.normal(0, 1, (DRAWS, len(pixels), 2)) * sd
            weights = np.tile(np.eye(2) / max(sd, 0.01) ** 2, (len(pixels), 1, 1))
            errors = rms(predicted(cameras, np.linalg.inv(sds), pixels, survey, weights), 1)
            print(f"  {name:16} {'with errors' if sd else 'exact':12} {np.median(errors):.2f}  {np.mean(errors <= BAR_M):.0%}")


if __name__ == "__main__":
    main()
