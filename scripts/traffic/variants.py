"""Changes of a street's tracks: noise, mirrors, turns, fewer vehicles, cut tracks, parked vehicles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from streets import Movement, Street, Track


def noisy(street: Street, rng: np.random.Generator, low_m: float = 0.1, high_m: float = 0.5) -> Street:
    """Adds errors of position that change over about 10 m, with a sd per vehicle, and the sds."""
    tracks = []
    for track in street.tracks:
        rows, sd = track.rows.copy(), rng.uniform(low_m, high_m, 2)
        step = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(rows[:, 1:3], axis=0), axis=1))])
        at = np.arange(-20, step[-1] + 21, 1.0)
        white = rng.normal(size=(len(at), 2))
        kernel = np.exp(-0.5 * (np.arange(-15, 16) / 5.0) ** 2)
        smooth = np.stack([np.convolve(white[:, i], kernel / np.linalg.norm(kernel), "same") for i in (0, 1)], 1)
        rows[:, 1:3] += sd * np.stack([np.interp(step, at, smooth[:, i]) for i in (0, 1)], 1)
        rows[:, 4] += np.where(rows[:, 4] == 0, 0, rng.normal(0, 0.2, len(rows)))
        rows[:, 5:7] = sd
        tracks.append(replace(track, rows=rows))
    return replace(street, tracks=tracks)


def moved(street: Street, angle: float, mirror: bool) -> Street:
    """Turns the street about the camera, or mirrors it first. In a mirror, traffic keeps left."""
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.array([[cos, -sin], [sin, cos]]) @ np.diag([-1.0 if mirror else 1.0, 1.0])

    def track(old: Track) -> Track:
        rows = old.rows.copy()
        rows[:, 1:3] = rows[:, 1:3] @ matrix.T
        ahead = np.stack([np.cos(rows[:, 3]), np.sin(rows[:, 3])], 1) @ matrix.T
        rows[:, 3] = np.arctan2(ahead[:, 1], ahead[:, 0])
        return replace(old, rows=rows)

    movements = [Movement([p @ matrix.T for p in m.lanes], [p @ matrix.T for p in m.stops]) for m in street.movements]
    return Street([track(old) for old in street.tracks], movements, street.seconds)


def fewer(street: Street, rng: np.random.Generator, share: float) -> Street:
    """Keeps a share of the vehicles."""
    return replace(street, tracks=[track for track in street.tracks if rng.random() < share])


def cut(street: Street, rng: np.random.Generator, every_m: float) -> tuple[Street, Street]:
    """Cuts tracks at random places, about once in a given distance. One second is lost at each cut.

    Returns the street, and the street with the tracks alone that are whole.
    """
    tracks, whole = [], []
    for track in street.tracks:
        step = np.concatenate([[0], np.linalg.norm(np.diff(track.rows[:, 1:3], axis=0), axis=1)])
        lost = np.nonzero(rng.random(len(step)) < step / every_m)[0]
        keep = np.ones(len(step), bool)
        for k in lost:
            keep[k : k + 5] = False
        edges = np.nonzero(np.diff(keep.astype(int)))[0] + 1
        parts = [part for part, kept in zip(np.split(track.rows, edges), np.split(keep, edges), strict=True) if kept[0]]
        tracks += [replace(track, rows=part) for part in parts if len(part) >= 3]
        whole += [track] if keep.all() else []
    return replace(street, tracks=tracks), replace(street, tracks=whole)


def parked(street: Street, rng: np.random.Generator, count: int) -> Street:
    """Adds vehicles at rest whose positions have noise."""
    centre = np.concatenate([track.rows[:, 1:3] for track in street.tracks]).mean(0)
    tracks = list(street.tracks)
    for _ in range(count):
        times = np.arange(rng.uniform(0, street.seconds / 3), rng.uniform(0.6, 1) * street.seconds, 0.5)
        at, sd = centre + rng.normal(0, 25, 2), rng.uniform(0.1, 0.6)
        rows = np.column_stack([times, at + rng.normal(0, sd, (len(times), 2)), np.full((len(times), 2), [1.0, 0.0])])
        tracks.append(Track(np.column_stack([rows, np.full((len(times), 2), sd)]), 4.3, 1.8, None))
    return replace(street, tracks=tracks)
