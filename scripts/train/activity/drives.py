"""Synthetic drives: manoeuvres with the labels of `render.paths`, and the errors of a tracker.

A drive is a chain of manoeuvres: straights, curves, turns, half turns, three-point turns, shunting into a bay, creeping
in a queue, backing out. Then come the noise of a tracker, gaps, and another frame rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadplane_train.render import paths
from roadplane_train.render.paths import Drive, Leg, Piece, straight, turn

LABELS = ("not_moving", "moving", "starting", "stopping", "turning_left", "turning_right", "u_turn", "reversing")
TRUTH_HZ = 20.0


@dataclass(frozen=True)
class Truth:
    """A drive without errors, at TRUTH_HZ."""

    time_s: np.ndarray  # (n,)
    pose: np.ndarray  # (n, 3) x, y, heading
    label: np.ndarray  # (n,) of LABELS


def _forwards(rng: np.random.Generator) -> list[Piece]:
    pieces = [straight(rng.uniform(2, 30))]
    for _ in range(rng.integers(0, 3)):
        kind, hand = rng.random(), rng.choice([-1, 1])
        if kind < 0.5:
            pieces.append(turn(hand * rng.uniform(35, 115), np.exp(rng.uniform(np.log(4), np.log(18))), rng.uniform(1.5, 5)))
        elif kind < 0.75:
            pieces.append(turn(hand * rng.uniform(155, 190), rng.uniform(3.5, 9), rng.uniform(1.5, 4)))
        elif kind < 0.9:
            pieces.append(turn(hand * rng.uniform(3, 22), rng.uniform(8, 60), rng.uniform(1.5, 6)))
        else:  # a lane change
            bend = turn(hand * rng.uniform(4, 15), rng.uniform(10, 40), 3.0)
            pieces += [bend, straight(rng.uniform(0.5, 5)), Piece(bend.length_m, -bend.angle_rad, bend.ramp_m)]
        pieces.append(straight(rng.uniform(1, 25)))
    return pieces


def _legs(rng: np.random.Generator) -> list[Leg]:
    """Returns the legs between rests; the first and the last may start and end at speed."""
    legs: list[Leg] = []

    def rest() -> float:
        return float(np.exp(rng.uniform(np.log(0.5), np.log(12))))

    def add(pieces: list[Piece], cruise: float, backwards: bool = False) -> None:
        legs.append(Leg(pieces, cruise, backwards, True, True, rest()))

    while sum(piece.length_m for leg in legs for piece in leg.pieces) < 15 or rng.random() < 0.45:
        kind, hand = rng.random(), rng.choice([-1, 1])
        if kind < 0.55:
            add(_forwards(rng), np.exp(rng.uniform(np.log(2), np.log(14))))
        elif kind < 0.68:  # backing out, or into a bay
            bend = turn(hand * rng.uniform(40, 100), rng.uniform(4, 6), 2.0)
            pieces = [straight(rng.uniform(0.5, 8)), bend, straight(rng.uniform(0.2, 3))]
            add(pieces[:: rng.choice([-1, 1])], rng.uniform(0.8, 2.5), backwards=True)
        elif kind < 0.76:
            add([straight(rng.uniform(1, 15))], rng.uniform(0.6, 3), backwards=True)
        elif kind < 0.84:  # three-point turn, or shunting
            for i in range(rng.integers(2, 5)):
                angle = hand * rng.uniform(10, 65) * (1 if i % 2 == 0 else -1)
                add([turn(angle, rng.uniform(4, 6), rng.uniform(0.5, 1.5))], rng.uniform(0.8, 2), backwards=i % 2 == 1)
        else:  # a queue
            for _ in range(rng.integers(2, 5)):
                add([straight(rng.uniform(1, 9))], rng.uniform(0.8, 3.5))
    ends = [rng.random() < 0.6 and not legs[0].backwards, rng.random() < 0.6 and not legs[-1].backwards]
    for number, field in ((0, "from_rest"), (-1, "to_rest")):
        if ends[number]:
            legs[number] = Leg(**{**vars(legs[number]), field: False})
    return legs


def truth(rng: np.random.Generator) -> Truth:
    """Returns a drive of 15 to 90 s, with the rests around it; one in eight is a car that is stationary throughout."""
    if rng.random() < 0.125:
        time_s = np.arange(0, rng.uniform(3, 40), 1 / TRUTH_HZ)
        return Truth(time_s, np.tile(rng.uniform(-np.pi, np.pi, 3), (len(time_s), 1)), np.zeros(len(time_s), int))
    paths.STEP_M = 0.05
    drive = Drive(_legs(rng), rng.uniform(2.4, 3.2))
    drive.placed(np.array([0, 0, rng.uniform(-np.pi, np.pi)]))
    pace = np.exp(rng.uniform(np.log(0.65), np.log(1.3)))  # drivers differ: acceleration scales by the square of this
    before, after = rng.uniform(0, 6, 2)
    clock = np.arange(-before * pace, drive.length_s + after * pace, pace / TRUTH_HZ)[: int(90 * TRUTH_HZ)]
    motions = [drive.at(t) for t in clock]
    pose = np.array([[m.world_from_car[0, 3], m.world_from_car[1, 3], np.arctan2(*m.world_from_car[1::-1, 0])] for m in motions])
    names = ["not_moving" if m.activity == "parked" else m.activity for m in motions]
    return Truth(np.arange(len(clock)) / TRUTH_HZ, pose, np.array([LABELS.index(name) for name in names]))


def _wander(rng: np.random.Generator, time_s: np.ndarray, memory_s: float) -> np.ndarray:
    """Returns noise of sd 1 with a correlation time of `memory_s`: white noise, smoothed."""
    step = time_s[1] - time_s[0]
    reach = max(int(3 * memory_s / step), 1)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step / memory_s) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    return np.convolve(rng.normal(size=len(time_s) + 2 * reach), kernel, "valid")


def tracked(drive: Truth, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Returns time, positions, headings and standard deviations of a drive as a tracker estimates them.

    The errors are slow (larger along the line of sight), with some jitter, a wrong scale, and gaps.
    """
    keep = np.arange(0, len(drive.time_s), rng.integers(1, 5))
    time_s, pose = drive.time_s[keep], drive.pose[keep]
    sd = np.exp(rng.uniform(np.log(0.01), np.log(0.35))) * np.array([1.0, np.exp(rng.uniform(0, 1.2))])
    jitter = sd * (rng.uniform(0, 0.7) if rng.random() < 0.5 else 0.0)
    memory_s = np.exp(rng.uniform(np.log(0.25), np.log(4)))
    snaps = rng.random() < 0.5  # a tracker that detects stationary vehicles gives them one position
    errors = np.stack([_wander(rng, time_s, memory_s) * sd[i] for i in (0, 1)], 1) if len(keep) > 2 else np.zeros((len(keep), 2))
    if snaps:
        at_rest = drive.label[keep] == 0
        for first, last in _runs(at_rest):
            errors[first:last] = errors[first]
        if rng.random() < 0.7:
            jitter = 0 * jitter
    errors += rng.normal(size=errors.shape) * jitter
    xy = pose[:, :2] * np.exp(rng.normal(0, 0.12)) + errors
    heading_sd = np.exp(rng.uniform(np.log(0.01), np.log(0.12)))
    wander = _wander(rng, time_s, memory_s) if len(keep) > 2 else 0.0
    heading = pose[:, 2] + heading_sd * wander
    seen = np.ones(len(keep), bool)
    if rng.random() < 0.3:  # not detected for a while
        first = rng.uniform(0, time_s[-1])
        seen = (time_s < first) | (time_s > first + rng.exponential(1.0))
        seen[[0, -1]] = True
    stated_sd = np.tile(np.hypot(sd, jitter) * np.exp(rng.normal(0, 0.3)), (len(keep), 1))
    return time_s[seen], xy[seen], heading[seen], stated_sd[seen]


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Returns the first index, and one past the last, of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
