"""Measures how far annotated beginnings and ends of activities spread, on MEVA's instances (`meva.py`).

  roadplane-train activity spread DIR

A motion has a beginning and an end of its own. A start begins when the vehicle first reaches a share of its top speed;
a stop ends when it last does. A turn begins and ends when a tenth and nine tenths of it are done. The script compares
these times with the annotated ones, instance by instance. Half the range of the middle 68 % is the spread, which is 1
sd for a Gaussian. The errors of the boxes are part of it, so annotators are a little better.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .features import STEP_S, features, grid
from .meva import Instance, read_instances

SHARE, LEAST_MPS = 0.15, 0.5
FASTEST_MPS, SLOW_END = 1.5, 0.4  # thresholds of starts and stops: top speed, share of it at rest
LEAST_TURN = 0.8  # rad


def offsets(instance: Instance) -> Iterator[tuple[str, float]]:
    """Yields each event's name, and how long it is after the annotated beginning or before the annotated end, s."""
    at = grid(instance.time_s)
    values = features(at, instance.time_s, instance.xy_m, sd_m=instance.sd_m)
    speed, turned = values[:, 0] * 5, np.cumsum(values[:, 8] * STEP_S)
    first, last = instance.time_s[[0, -1]]
    moving = at[speed > max(SHARE * speed.max(), LEAST_MPS)]
    rest = SLOW_END * speed.max()
    if instance.activity == "starting" and speed.max() > FASTEST_MPS and speed[0] < rest:
        yield "a start's beginning", moving[0] - first
    if instance.activity == "stopping" and speed.max() > FASTEST_MPS and speed[-1] < rest:
        yield "a stop's end", last - moving[-1]
    if "turn" in instance.activity and abs(turned[-1]) > LEAST_TURN:
        share = turned / turned[-1]
        yield "a turn's beginning", at[share > 0.1][0] - first
        yield "a turn's end", last - at[share < 0.9][-1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="activities.csv, boxes.parquet, krtd/")
    found: dict[str, list[float]] = {}
    for instance in read_instances(parser.parse_args().folder):
        for name, seconds in offsets(instance):
            found.setdefault(name, []).append(seconds)
    for name, seconds in sorted(found.items()):
        low, middle, high = np.percentile(seconds, [16, 50, 84])
        print(f"{name}: {len(seconds)} instances, {middle:.2f} s inside the annotation, spread {(high - low) / 2:.2f} s")


if __name__ == "__main__":
    main()
