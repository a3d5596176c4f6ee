"""Fits the probability that both sides of a gap show the same vehicle: logistic regression on joins with truth.

  roadplane-train tracks same-vehicle JOINS.csv... --out models/tracks.json

`roadplane-lab eval tracker CLIPS --joins FILE` makes such a file.
"""

from __future__ import annotations

from .logistic import run


def main() -> None:
    """Fits and writes the weights."""
    run("same_vehicle", __doc__)
