"""Computes the input of the nets from the motion of a track, at five steps per second.

`crates/activity/src/{motion,features}.rs` compute the same; `tests/data/activity/features.json` holds both to the same
numbers.

At every grid time (whole multiples of STEP_S) a parabola is fitted to the nearby positions, axis by axis. It is a
least-squares fit with Gaussian weights in time. The weights always have the same sum, so the frame rate does not
matter. Priors on speed and acceleration, weighted by the sd of the positions, keep the motion calm where samples are
few or poor.
"""

from __future__ import annotations

import numpy as np

STEP_S = 0.2
WINDOW_SD_S, WINDOW_S = 0.35, 1.05  # samples farther away have no weight
WEIGHT = 5.0  # sum of the weights, samples
LEAST_SD_M, UNKNOWN_SD_M = 0.05, 0.15
SPEED_MPS, ACCELERATION = 10.0, 2.5  # sd of the priors
HEADING_SD, YAW_RATE = 0.05, 1.0
SLOW_MPS = 0.3  # directions fade out below this speed
FEATURES = 15
ODD = (3, 5, 6, 7, 8)  # features whose sign changes when left and right are exchanged


def grid(time_s: np.ndarray) -> np.ndarray:
    """Returns the grid times, from the one at or before the first sample to the one at or after the last."""
    first, last = np.floor(time_s[0] / STEP_S + 1e-6), np.ceil(time_s[-1] / STEP_S - 1e-6)
    return np.arange(first, last + 1) * STEP_S


def local_fit(at: np.ndarray, time_s: np.ndarray, values: np.ndarray, sd: np.ndarray, priors: tuple[float, ...]) -> tuple:
    """Fits a polynomial around each grid time.

    Returns the coefficients (grid, 1 + len(priors)) of dt^k / k!, the weighted mean square residual (grid,), and the sd
    of the samples there (grid,). The constant has no prior.
    """
    dt = time_s[None] - at[:, None]
    # In a gap the window moves to the nearest sample; otherwise it would be empty.
    distance = np.maximum(np.abs(dt) - np.abs(dt).min(1)[:, None], 0)
    weight = np.exp(-0.5 * (distance / WINDOW_SD_S) ** 2) * (distance <= WINDOW_S)
    weight *= WEIGHT / weight.sum(1, keepdims=True)
    variance = weight @ sd**2 / WEIGHT
    basis = np.stack([np.ones_like(dt), dt, dt * dt / 2][: 1 + len(priors)], 2)
    normal = np.einsum("gs,gsi,gsj->gij", weight, basis, basis)
    for k, prior in enumerate(priors, 1):
        normal[:, k, k] += variance / prior**2
    found = np.linalg.solve(normal, np.einsum("gs,gsi,s->gi", weight, basis, values)[..., None])[..., 0]
    residual = values[None] - np.einsum("gsi,gi->gs", basis, found)
    return found, (weight * residual**2).sum(1) / WEIGHT, np.sqrt(variance)


def features(
    at: np.ndarray,
    time_s: np.ndarray,
    xy: np.ndarray,
    heading: np.ndarray | None = None,
    sd_m: np.ndarray | None = None,
) -> np.ndarray:
    """Returns features (grid, FEATURES) of positions (n, 2). `heading` (n,), rad, and `sd_m` (n, 2) are optional."""
    sd_m = np.full_like(xy, UNKNOWN_SD_M) if sd_m is None else np.maximum(sd_m, LEAST_SD_M)
    fits = [local_fit(at, time_s, xy[:, i], sd_m[:, i], (SPEED_MPS, ACCELERATION)) for i in (0, 1)]
    velocity, acceleration = (np.stack([fit[0][:, k] for fit in fits], 1) for k in (1, 2))
    rms = np.sqrt(fits[0][1] + fits[1][1])
    sd = np.stack([fit[2] for fit in fits], 1)
    speed = np.hypot(*velocity.T)
    faded = np.sqrt(speed**2 + SLOW_MPS**2)
    along = (velocity * acceleration).sum(1) / faded
    across = (velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]) / faded
    course_rate = across / faded
    if heading is None:
        known, forward, sideways, yaw_rate = 0.0, speed, np.zeros_like(speed), course_rate
    else:
        found, _, _ = local_fit(at, time_s, np.unwrap(heading), np.full(len(time_s), HEADING_SD), (YAW_RATE,))
        cos, sin = np.cos(found[:, 0]), np.sin(found[:, 0])
        known, yaw_rate = 1.0, found[:, 1]
        forward = velocity[:, 0] * cos + velocity[:, 1] * sin
        sideways = velocity[:, 1] * cos - velocity[:, 0] * sin
    gap = np.abs(time_s[None] - at[:, None]).min(1)
    # The sd along the motion and across it; for a stationary car the mean of both.
    part = (velocity / faded[:, None]) ** 2 + (SLOW_MPS**2 / faded**2 / 2)[:, None]
    sd_along = np.sqrt((part * sd**2).sum(1))
    sd_across = np.sqrt((part[:, ::-1] * sd**2).sum(1))
    return np.stack(
        [
            speed / 5,
            np.log1p(speed / SLOW_MPS) / 3,
            np.tanh(forward),
            np.clip(sideways, -2, 2),
            along / 2,
            across / 2,
            np.clip(course_rate, -2, 2),
            np.clip(across / faded**2, -1, 1) * 3,
            np.clip(yaw_rate, -2, 2),
            np.full_like(speed, known),
            known * np.tanh(forward / SLOW_MPS),
            np.log(np.clip(rms, 0.005, 1.0) / 0.05) / 2,
            np.log(np.clip(sd_along, 0.05, 2.0) / 0.2),
            np.log(np.clip(sd_across, 0.05, 2.0) / 0.2),
            np.minimum(gap, 2.0),
        ],
        1,
    ).astype(np.float32)
